"""The compiled loops of the airlight that runs live: a table of prefix sums, and what a gate reads from it.

Coarse rays stand at every `step`-th corner of pixels. Along each stand n + 1 nodes in inverse depth; the table holds,
per coarse row, node and coarse column, less the light scattered between the node and the last one: sums from the camera
on, so that what happens far away changes nothing near.
Within a coarse row all rays have the same nodes, w = (a + q u) / (1 - p u) for u = 0, 1/n, .. 1: from a, the farthest
place that fog and raster hold in that row, to the nearest, half of them beyond the place that p and q set by the fog's
density. Between coarse rays and between nodes the table is linear.

Fog and raster begin and end sharply. A coarse ray goes on beyond them as far as its neighbours reach, and the table is
read at any w: what of it counts is cut pixel by pixel, where the very ray of the pixel is lit and inside the fog.
"""

from __future__ import annotations

from math import inf
from typing import Final, NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.airlight_kernels import NEVER, Optics, density, lit_span, make_ray, tau_of
from slopegate.core.render.fog import Medium
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Ints, Singles
from slopegate.core.rig.rig import Vector3

Box = tuple[int, int, int, int]
"""First row, row after the last, first column, column after the last."""

_NOWHERE: Final = 1e38
"""Inverse depth, within float32, of what is before everything."""

TILE: Final = 64
CLEAR: Final = 1.0 - 1e-4
"""What stands before a place by less than this share casts no shadow on it: float32 and the map's cells."""


class AirTable(NamedTuple):
    """light (h, n + 1, w): the sums, 0 or less; rows (h, 4): a, nearest w, p and q of each coarse row;
    directions (h, w, 3): of the coarse rays, z = 1; seen (h, 3, w): the same in the projector's axes; step: pixels from
    ray to ray."""

    light: Singles
    rows: Doubles
    directions: Doubles
    seen: Singles
    step: int


class ShadeMap(NamedTuple):
    """Inverse depth (h, w) in 1/m of what the projector's light meets first, along its axis, 0 for nothing.

    Cell (r, c) covers (x/z - left) scale_x in [c, c + 1) and (y/z - top) scale_y in [r, r + 1). Without cells nothing
    casts a shadow.
    """

    left: float
    top: float
    scale_x: float
    scale_y: float
    nearest: Singles


class Bend(NamedTuple):
    """Where a distorted projector's rows and columns lie: rows (n, n), y/z of rows that stand evenly over the raster at
    x/z evenly from low[0] to high[0]; columns (n, n), x/z of columns at y/z from low[1] to high[1]. (0, 0): a pinhole.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    rows: Doubles
    columns: Doubles


class Limits(NamedTuple):
    """Of each pixel (H, W): the table's value at its surface, or where it begins to be lit, and where that ends; the w
    at which it begins and ends. Per tile (H, tiles): least and greatest of the first value, least of the second.
    """

    beyond: Singles
    every: Singles
    far: Singles
    near: Singles
    least_beyond: Singles
    most_beyond: Singles
    least_every: Singles


# Building.


@njit(cache=True, nogil=True, error_model="numpy")
def _line_slope(lines: Doubles, low: float, high: float, line: float, x: float) -> float:
    """y/z of a distorted projector's row at x/z, or x/z of its column at y/z; `line`: its continuous place in lines."""
    c = min(max((x - low) / (high - low), 0.0), 1.0) * (lines.shape[1] - 1)
    i, j = min(int(line), lines.shape[0] - 2), min(int(c), lines.shape[1] - 2)
    return bilinear(lines[i, j], lines[i, j + 1], lines[i + 1, j], lines[i + 1, j + 1], line - i, c - j)


@njit(cache=True, nogil=True, error_model="numpy")
def _meets_line(
    lines: Doubles, low: float, high: float, line: float, q: Vector3, o: Vector3, nearest: float
) -> tuple[float, float]:
    """The slope q[0] / q[2] at which a ray meets a line of a distorted projector, and w there.

    q and o: ray and offset in the projector's axes, the slope's component first. From a slope to the place and back:
    each step leaves of an error what the slope changes along the line, a tenth or less.
    """
    slope, w = _line_slope(lines, low, high, line, 0.5 * (low + high)), 0.0
    for _ in range(5):
        w = (q[0] - slope * q[2]) / _never_zero(o[0] - slope * o[2])
        near = min(max(w, 0.0), nearest)
        z = q[2] - near * o[2]
        slope = _line_slope(lines, low, high, line, (q[1] - near * o[1]) / z if z > NEVER else 0.0)
    return slope, (q[0] - slope * q[2]) / _never_zero(o[0] - slope * o[2])


@njit(cache=True, nogil=True, error_model="numpy")
def _never_zero(change: float) -> float:
    """How fast a ray leaves a sheet of light, per unit of w; where it runs along it all of it lies to one side."""
    return change if change != 0.0 else -1e-300


@njit(cache=True, nogil=True, error_model="numpy")
def exact_span(optics: Optics, medium: Medium, bend: Bend, along: Vector3) -> tuple[float, float]:
    """`lit_span`, for a distorted projector too: least and greatest w, (0, 0) for none."""
    first, last = lit_span(optics, medium, along)
    if bend.rows.shape[0] == 0 or last == 0.0:
        return first, last
    r, o = optics.rotation, optics.offset
    qx, ox = _dot(r[0], along), _dot(r[0], o)
    qy, oy = _dot(r[1], along), _dot(r[1], o)
    qz, oz = _dot(r[2], along), _dot(r[2], o)
    most, end = bend.rows.shape[0] - 1.0, last
    for side in range(4):
        line = most * (side % 2)
        if side < 2:
            slope, w = _meets_line(bend.rows, bend.low[0], bend.high[0], line, (qy, qx, qz), (oy, ox, oz), end)
            rises = oy - slope * oz < 0.0
        else:
            slope, w = _meets_line(bend.columns, bend.low[1], bend.high[1], line, (qx, qy, qz), (ox, oy, oz), end)
            rises = ox - slope * oz < 0.0
        # Beyond the first line and before the last one.
        if rises == (side % 2 == 0):
            first = max(first, w)
        else:
            last = min(last, w)
    return (first, last) if first < last else (0.0, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, error_model="numpy")
def fill_spans(optics: Optics, medium: Medium, bend: Bend, directions: Doubles, spans: Doubles) -> None:
    """Least and greatest w (h, w, 2) at which rays (h, w, 3), z = 1, are lit and inside the fog; 0 and 0 for none."""
    for k in range(spans.shape[0]):
        for j in range(spans.shape[1]):
            d = directions[k, j]
            spans[k, j, 0], spans[k, j, 1] = exact_span(optics, medium, bend, (d[0], d[1], d[2]))


@njit(cache=True, nogil=True, error_model="numpy")
def fill_slopes(optics: Optics, bend: Bend, table: AirTable, out: Singles) -> None:
    """The slopes y/z (h, m, w) at which coarse rays meet m rows that stand evenly over a distorted raster."""
    r, o = optics.rotation, optics.offset
    offset = (_dot(r[1], o), _dot(r[0], o), _dot(r[2], o))
    for k in range(out.shape[0]):
        for j in range(out.shape[2]):
            q = (np.float64(table.seen[k, 1, j]), np.float64(table.seen[k, 0, j]), np.float64(table.seen[k, 2, j]))
            for i in range(out.shape[1]):
                line = i * (bend.rows.shape[0] - 1.0) / (out.shape[1] - 1)
                found = _meets_line(bend.rows, bend.low[0], bend.high[0], line, q, offset, table.rows[k, 1])
                out[k, i, j] = found[0]


@njit(cache=True, nogil=True, error_model="numpy")
def fill_cells(optics: Optics, medium: Medium, table: AirTable, spans: Doubles, coarse: int, cells: Singles) -> None:
    """Light (n, w) scattered between the nodes of one coarse row, without shadows, by the midpoint rule."""
    nodes, columns = cells.shape
    places = node_places(table, coarse, nodes, optics.kappa)
    for j in range(columns):
        d = table.directions[coarse, j]
        ray = make_ray(optics, medium, (d[0], d[1], d[2]))
        first, last = tau_of(spans[coarse, j, 0], optics.kappa), tau_of(spans[coarse, j, 1], optics.kappa)
        for i in range(nodes):
            before, after = places[i], places[i + 1]
            # A cell that is lit in part counts as a whole: within it light rises evenly, and places are cut exactly.
            lit = before < last and after > first
            cells[i, j] = (after - before) * density(optics, medium, ray, 0.5 * (before + after)) if lit else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def node_places(table: AirTable, coarse: int, nodes: int, kappa: float) -> Doubles:
    """The places tau (n + 1,) of a coarse row's nodes."""
    a, p, q = table.rows[coarse, 0], table.rows[coarse, 2], table.rows[coarse, 3]
    out = np.empty(nodes + 1)
    for i in range(nodes + 1):
        out[i] = _node(a, p, q, i / nodes, kappa)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _node(a: float, p: float, q: float, u: float, kappa: float) -> float:
    """tau of the node at share u of a coarse row."""
    e, f = kappa * max(1.0 - p * u, 0.0), a + q * u
    return f / (f + e)


@njit(cache=True, nogil=True, error_model="numpy")
def crossing(optics: Optics, table: AirTable, shade: ShadeMap, box: Box, own: Singles, coarse: int) -> tuple[int, int]:
    """First coarse column of a row, and one past the last, whose ray, as far as it is seen, the projector sees within a
    box of shade's cells; (0, 0) for none. own (w,) as for `add_up`."""
    nodes, columns = table.light.shape[1] - 1, table.seen.shape[2]
    a, p, q = table.rows[coarse, 0], table.rows[coarse, 2], table.rows[coarse, 3]
    start, end = columns, 0
    near = _node(a, p, q, 1.0, optics.kappa)
    for j in range(columns):
        behind = int(node_at(table.rows, coarse, np.float64(own[j]), nodes))
        # The ray's picture is a straight line: between its ends in both directions.
        x0, y0 = _shade_cell(optics, table, shade, coarse, j, _node(a, p, q, behind / nodes, optics.kappa))
        x1, y1 = _shade_cell(optics, table, shade, coarse, j, near)
        apart = max(x0, x1) < box[2] or min(x0, x1) > box[3] or max(y0, y1) < box[0] or min(y0, y1) > box[1]
        if not apart:
            start, end = min(start, j), j + 1
    return (start, end) if start < end else (0, 0)


@njit(cache=True, nogil=True, error_model="numpy")
def _shade_cell(
    optics: Optics, table: AirTable, shade: ShadeMap, coarse: int, j: int, tau: float
) -> tuple[float, float]:
    """Continuous column and row of shade's cells at which the projector sees a place; far beside it when behind."""
    x, y, z = _seen_at(optics, table, coarse, j, tau)
    if not z > 1e-9:
        return (1e30 if x > 0.0 else -1e30), (1e30 if y > 0.0 else -1e30)
    return (x / z - shade.left) * shade.scale_x, (y / z - shade.top) * shade.scale_y


@njit(cache=True, nogil=True, error_model="numpy")
def _seen_at(optics: Optics, table: AirTable, coarse: int, j: int, tau: float) -> Vector3:
    """A vector in the projector's axes towards the place tau of a coarse ray, at infinity of length about 1."""
    r, o = optics.rotation, optics.offset
    e, f = 1.0 - tau, optics.kappa * tau
    return (
        e * table.seen[coarse, 0, j] - f * (r[0][0] * o[0] + r[0][1] * o[1] + r[0][2] * o[2]),
        e * table.seen[coarse, 1, j] - f * (r[1][0] * o[0] + r[1][1] * o[1] + r[1][2] * o[2]),
        e * table.seen[coarse, 2, j] - f * (r[2][0] * o[0] + r[2][1] * o[1] + r[2][2] * o[2]),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def add_up(
    optics: Optics,
    table: AirTable,
    shade: ShadeMap,
    own: Singles,
    coarse: int,
    columns: tuple[int, int],
    cells: Singles,
) -> None:
    """The sums of one coarse row from its cells (n, w), of which only what the projector sees counts.

    A cell counts where its end towards the camera is lit, so that the one that a surface cuts counts as a whole. own
    (w,): inverse depth of the farthest surface that a pixel beside the coarse ray shows. What lies beyond it counts as
    the place right before it does: it stands for what pixels farther away see beside that surface.
    """
    nodes, width = cells.shape
    shaded = shade.nearest.shape[0] > 0
    places = node_places(table, coarse, nodes, optics.kappa)
    behind, held, total = np.empty(width, np.int64), np.ones(width), np.zeros(width)
    for j in range(columns[0], columns[1]):
        behind[j] = min(int(node_at(table.rows, coarse, np.float64(own[j]), nodes)), nodes - 1)
        if shaded:
            held[j] = _is_lit(
                shade, _seen_at(optics, table, coarse, j, places[behind[j] + 1]), optics.kappa * places[behind[j] + 1]
            )
        table.light[coarse, nodes, j] = 0.0
    for i in range(nodes - 1, -1, -1):
        tau = places[i + 1]
        for j in range(columns[0], columns[1]):
            if cells[i, j] > 0:
                lit = held[j]
                if shaded and i > behind[j]:
                    lit = _is_lit(shade, _seen_at(optics, table, coarse, j, tau), optics.kappa * tau)
                total[j] += lit * cells[i, j]
            table.light[coarse, i, j] = -total[j]


@njit(cache=True, nogil=True, error_model="numpy")
def _is_lit(shade: ShadeMap, seen: Vector3, f: float) -> float:
    """1 where the projector sees a place that lies in the direction `seen`, at inverse depth f / seen[2], else 0."""
    x, y, z = seen
    if not z > 0.0:
        return 0.0
    near, last_row, last_column = shade.nearest, shade.nearest.shape[0] - 1, shade.nearest.shape[1] - 1
    scale = 1.0 / z
    column = (x * scale - shade.left) * shade.scale_x - 0.5
    row = (y * scale - shade.top) * shade.scale_y - 0.5
    if not (-1.0 < column < last_column + 1.0 and -1.0 < row < last_row + 1.0):
        return 1.0  # rays just beside the raster carry on what is inside it
    # Inverse depth is affine over a plane's picture: between cells' centres it is the plane's own.
    column, row = min(max(column, 0.0), last_column), min(max(row, 0.0), last_row)
    c, r = min(int(column), last_column - 1), min(int(row), last_row - 1)
    met = bilinear(near[r, c], near[r, c + 1], near[r + 1, c], near[r + 1, c + 1], row - r, column - c)
    return 1.0 if met * z * CLEAR <= f else 0.0


# Looking up.


@njit(cache=True, nogil=True, error_model="numpy")
def node_at(rows: Doubles, k: int, w: float, nodes: int) -> float:
    """The continuous node of a coarse row at an inverse depth, cut to 0..nodes."""
    a, nearest = rows[k, 0], rows[k, 1]
    w = min(max(w, a), nearest)
    return float(min(max(nodes * (w - a) / (rows[k, 2] * w + rows[k, 3]), 0.0), nodes))


@njit(cache=True, nogil=True, error_model="numpy")
def _read(table: AirTable, y: float, w: float, x: float) -> float:
    """The table at a continuous coarse row, an inverse depth and a continuous coarse column."""
    light, rows, nodes = table.light, table.rows, table.light.shape[1] - 1
    k, j = min(int(y), light.shape[0] - 2), min(int(x), light.shape[2] - 2)
    # Beyond the last node of both rows nothing is left.
    if w >= rows[k, 1] and w >= rows[k + 1, 1]:
        return 0.0
    t, v = y - k, x - j
    place = node_at(rows, k, w, nodes)
    i = min(int(place), nodes - 1)
    above = bilinear(light[k, i, j], light[k, i, j + 1], light[k, i + 1, j], light[k, i + 1, j + 1], place - i, v)
    place = node_at(rows, k + 1, w, nodes)
    i, k = min(int(place), nodes - 1), k + 1
    below = bilinear(light[k, i, j], light[k, i, j + 1], light[k, i + 1, j], light[k, i + 1, j + 1], place - i, v)
    return float(above + t * (below - above))


@njit(cache=True, nogil=True, error_model="numpy")
def bilinear(a: float, b: float, c: float, d: float, u: float, v: float) -> float:
    """Between the rows a b and c d at share u down and v across."""
    top, bottom = a + v * (b - a), c + v * (d - c)
    return top + u * (bottom - top)


@njit(cache=True, nogil=True, error_model="numpy")
def _along(directions: Doubles, y: float, x: float) -> Vector3:
    """The direction at a continuous coarse row and column: exact but for a distorted camera, and there to 1e-6."""
    k, j = min(int(y), directions.shape[0] - 2), min(int(x), directions.shape[1] - 2)
    t, v, d = y - k, x - j, directions
    return (
        bilinear(d[k, j, 0], d[k, j + 1, 0], d[k + 1, j, 0], d[k + 1, j + 1, 0], t, v),
        bilinear(d[k, j, 1], d[k, j + 1, 1], d[k + 1, j, 1], d[k + 1, j + 1, 1], t, v),
        1.0,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _ends(
    optics: Optics, medium: Medium, bend: Bend, table: AirTable, column: float, row: float
) -> tuple[float, float]:
    """The w at which the ray through a place of the image begins and ends to be lit; very large for nowhere."""
    first, last = exact_span(optics, medium, bend, _along(table.directions, row / table.step, column / table.step))
    return (first, last) if last > 0.0 else (_NOWHERE, _NOWHERE)


@njit(cache=True, nogil=True, error_model="numpy")
def fill_limits(
    optics: Optics, medium: Medium, bend: Bend, table: AirTable, inverse_depth: Singles, out: Limits
) -> None:
    """The limits of all pixels, from their surfaces (H, W)."""
    height, width = inverse_depth.shape
    for k in range(height):
        for j in range(width):
            first, last = _ends(optics, medium, bend, table, j + 0.5, k + 0.5)
            out.far[k, j], out.near[k, j] = min(first, _NOWHERE), min(last, _NOWHERE)
    clip(table, inverse_depth, (0, height, 0, width), out)


@njit(cache=True, nogil=True, error_model="numpy")
def clip(table: AirTable, inverse_depth: Singles, box: Box, out: Limits) -> None:
    """Read the table where pixels end, in rows box[0]..box[1] and columns box[2]..box[3], from their surfaces (H, W).

    Tiles that the box touches are judged anew as a whole.
    """
    for k in range(box[0], box[1]):
        if box[2] >= box[3]:
            continue
        _clip_row(table, inverse_depth, k, box[2], box[3], out)
        _judge_tiles(k, box[2], box[3], out)


@njit(cache=True, nogil=True, error_model="numpy")
def _judge_tiles(k: int, left: int, right: int, out: Limits) -> None:
    """The bounds of the tiles of camera row k that columns left..right touch."""
    for tile in range(left // TILE, (right - 1) // TILE + 1):
        least, most, least_every = np.float32(inf), np.float32(-inf), np.float32(inf)
        for j in range(tile * TILE, min((tile + 1) * TILE, out.every.shape[1])):
            least, most = min(least, out.beyond[k, j]), max(most, out.beyond[k, j])
            least_every = min(least_every, out.every[k, j])
        out.least_beyond[k, tile], out.most_beyond[k, tile] = least, most
        out.least_every[k, tile] = least_every


@njit(cache=True, nogil=True, error_model="numpy")
def fill_ends(table: AirTable, inverse_depth: Singles, limits: Limits, out: Singles) -> None:
    """The continuous nodes out (4, H, W) of the coarse rows above and below each pixel at which its ray ends at the
    surface (H, W), and then those at which it ends to be lit."""
    nodes = table.light.shape[1] - 1
    for k in range(out.shape[1]):
        r = min(int((k + 0.5) / table.step), table.light.shape[0] - 2)
        for j in range(out.shape[2]):
            near = np.float64(limits.near[k, j])
            w = min(max(np.float64(inverse_depth[k, j]), np.float64(limits.far[k, j])), near)
            for i in range(2):
                out[i, k, j] = node_at(table.rows, r + i, w, nodes)
                out[2 + i, k, j] = node_at(table.rows, r + i, near, nodes)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz", "contract"})
def clip_at(table: AirTable, ends: Singles, out: Limits) -> None:
    """`clip` of all pixels, whose ends are known already: `fill_ends`. To 1e-5 of what lies between two nodes."""
    light, step, last = table.light, table.step, np.float32(table.light.shape[1] - 1)
    most = table.light.shape[1] - 2
    for k in range(out.every.shape[0]):
        y = (k + 0.5) / step
        r = min(int(y), light.shape[0] - 2)
        t = np.float32(y - r)
        for c in range(light.shape[2] - 1):
            for j in range(c * step, min((c + 1) * step, out.every.shape[1])):
                v = np.float32((j + 0.5) / step - c)
                out.every[k, j] = 0
                for kind in range(2):
                    above, below = ends[2 * kind, k, j], ends[2 * kind + 1, k, j]
                    if kind == 1 and above >= last and below >= last:
                        continue  # beyond the last node nothing is left
                    m, n = min(int(above), most), min(int(below), most)
                    one = _between(light, r, m, c, above - np.float32(m), v)
                    other = _between(light, r + 1, n, c, below - np.float32(n), v)
                    value = one + t * (other - one)
                    if kind == 0:
                        out.beyond[k, j] = value
                    else:
                        out.every[k, j] = value
        _judge_tiles(k, 0, out.every.shape[1], out)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz", "contract"})
def _between(light: Singles, r: int, i: int, c: int, u: np.float32, v: np.float32) -> np.float32:
    """A coarse row at share u from node i to the next, and v from column c to the next."""
    k, m, j, one = np.uint64(r), np.uint64(i), np.uint64(c), np.uint64(1)
    near = light[k, m, j] + v * (light[k, m, j + one] - light[k, m, j])
    far = light[k, m + one, j] + v * (light[k, m + one, j + one] - light[k, m + one, j])
    return np.float32(near + u * (far - near))


@njit(cache=True, nogil=True, error_model="numpy")
def _clip_row(table: AirTable, inverse_depth: Singles, k: int, left: int, right: int, out: Limits) -> None:
    y, step = (k + 0.5) / table.step, table.step
    for j in range(left, right):
        x, near = (j + 0.5) / step, np.float64(out.near[k, j])
        w = min(max(np.float64(inverse_depth[k, j]), np.float64(out.far[k, j])), near)
        out.beyond[k, j], out.every[k, j] = _read(table, y, w, x), _read(table, y, near, x)


@njit(cache=True, nogil=True, error_model="numpy")
def follow(
    optics: Optics,
    table: AirTable,
    shade: ShadeMap,
    own: Singles,
    cells: Singles,
    inverse_depth: Singles,
    moved: Box,
    shaded: Box,
    out: Limits,
) -> None:
    """Bring table and limits up to date after surfaces changed in a box of pixels, and shade in a box of its cells.

    own (h, w) as for `add_up`; cells (h, n, w): the light between nodes of all coarse rows.
    """
    height, width, step = inverse_depth.shape[0], inverse_depth.shape[1], table.step
    count = table.seen.shape[0]
    extents = np.zeros((count, 2), np.int64)
    for k in range(count):
        first, last = 0, 0
        if shaded[0] < shaded[1]:
            first, last = crossing(optics, table, shade, shaded, own[k], k)
        if moved[0] < moved[1] and moved[0] <= k * step <= moved[1]:
            left, right = moved[2] // step, moved[3] // step + 1
            first, last = (min(first, left), max(last, right)) if first < last else (left, right)
        last = min(last, table.seen.shape[2])
        if first < last:
            add_up(optics, table, shade, own[k], k, (first, last), cells[k])
        extents[k, 0], extents[k, 1] = first, last
    for k in range(height):
        # Pixels between coarse rows take from both; those beside a coarse column, too.
        r = k // step
        left, right = width, 0
        for i in range(r, r + 2):
            if extents[i, 0] < extents[i, 1]:
                left = min(left, (extents[i, 0] - 1) * step)
                right = max(right, extents[i, 1] * step)
        if moved[0] <= k < moved[1]:
            left, right = min(left, moved[2]), max(right, moved[3])
        left, right = max(left, 0), min(right, width)
        if left < right:
            clip(table, inverse_depth, (k, k + 1, left, right), out)


@njit(cache=True, nogil=True, error_model="numpy")
def fill_edge_pixels(
    optics: Optics,
    medium: Medium,
    bend: Bend,
    table: AirTable,
    columns: Ints,
    first: Indices,
    inverse_depth: Singles,
    out: Singles,
) -> None:
    """The table's values out (E, N, N) at the surfaces of the rays of pixels, at inverse depths (E N N,).

    columns (E,) of the pixels, row by row, and first (H + 1,): where each row begins. The table is read, and fog and
    raster cut it, at the middles of the pixels.
    """
    depths = inverse_depth.reshape(out.shape)
    for k in range(first.shape[0] - 1):
        for i in range(first[k], first[k + 1]):
            x, y = columns[i] + 0.5, k + 0.5
            begin, end = _ends(optics, medium, bend, table, x, y)
            for m in range(out.shape[1]):
                for n in range(out.shape[2]):
                    w = min(max(np.float64(depths[i, m, n]), begin), end)
                    out[i, m, n] = _read(table, y / table.step, w, x / table.step)


@njit(cache=True, nogil=True, error_model="numpy")
def find_edges(inverse_depth: Singles, share: float, out: Bools) -> None:
    """Pixels at which no plane joins the surfaces of three neighbours, in a row or a column.

    Inverse depth (H, W) is affine over a plane's picture: its second difference above `share` of it tells.
    """
    height, width = inverse_depth.shape
    for k in range(height):
        for j in range(width):
            w = inverse_depth[k, j]
            found = False
            for m, n in ((0, 1), (1, 0)):
                if m <= k < height - m and n <= j < width - n:
                    a, b = inverse_depth[k - m, j - n], inverse_depth[k + m, j + n]
                    found |= abs(a - 2 * w + b) > share * max(a, w, b)
            out[k, j] = found
