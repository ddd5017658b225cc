"""The compiled loops of the airlight that runs live: a table of prefix sums, and what a gate reads from it.

Coarse rays stand at every `step`-th corner of pixels. Along each stand n + 1 nodes in inverse depth; the table holds,
per coarse row, node and coarse column, the light scattered beyond the node: prefix sums from infinity to the camera.
Within a coarse row all rays have the same nodes, w = (a + q u) / (1 - p u) for u = 0, 1/n, .. 1: from a, the farthest
place that fog and raster hold in that row, to the nearest, half of them beyond the place that p and q set by the fog's
density. Between coarse rays and between nodes the table is linear.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from slopegate.core.light.airlight_kernels import Optics, density, lit_span, make_ray, tau_of
from slopegate.core.render.fog import Medium
from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.rig import Vector3

Box = tuple[int, int, int, int]
"""First row, row after the last, first column, column after the last."""

TILE: Final = 64
_NEAR: Final = 0.5 - 0.5 / sqrt(3.0)
"""Place of the first of Gauss and Legendre's two nodes in an interval of 0..1."""
_BEYOND: Final = np.float32(3e38)
"""Stands for the light up to a surface where a pixel's ray is lit nowhere."""


class AirTable(NamedTuple):
    """light (h, n + 1, w): prefix sums; rows (h, 4): a, nearest w, p and q of each coarse row; directions (h, w, 3):
    of the coarse rays, z = 1; seen (h, 3, w): the same in the projector's axes; step: pixels from ray to ray."""

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


class Limits(NamedTuple):
    """The light up to the surface of each pixel (H, W), and the least and greatest of each tile (H, tiles)."""

    light: Singles
    least: Singles
    greatest: Singles


# Building.


@njit(cache=True, nogil=True, error_model="numpy")
def fill_spans(optics: Optics, medium: Medium, directions: Doubles, spans: Doubles) -> None:
    """Least and greatest w (h, w, 2) at which the coarse rays are lit and inside the fog; 0 and 0 where nowhere."""
    for k in range(spans.shape[0]):
        for j in range(spans.shape[1]):
            d = directions[k, j]
            spans[k, j, 0], spans[k, j, 1] = lit_span(optics, medium, (d[0], d[1], d[2]))


@njit(cache=True, nogil=True, error_model="numpy")
def fill_cells(optics: Optics, medium: Medium, table: AirTable, spans: Doubles, coarse: int, cells: Singles) -> None:
    """Light (n, w) scattered between the nodes of one coarse row, without shadows: two nodes of Gauss in each cell."""
    nodes, columns = cells.shape
    a, p, q = table.rows[coarse, 0], table.rows[coarse, 2], table.rows[coarse, 3]
    for j in range(columns):
        d = table.directions[coarse, j]
        ray = make_ray(optics, medium, (d[0], d[1], d[2]))
        first, last = tau_of(spans[coarse, j, 0], optics.kappa), tau_of(spans[coarse, j, 1], optics.kappa)
        before = _node(a, p, q, 0.0, optics.kappa)
        for i in range(nodes):
            after = _node(a, p, q, (i + 1) / nodes, optics.kappa)
            start, end = max(before, first), min(after, last)
            total = 0.0
            if start < end:
                total = density(optics, medium, ray, start + _NEAR * (end - start))
                total += density(optics, medium, ray, end - _NEAR * (end - start))
                total *= 0.5 * (end - start)
            cells[i, j] = total
            before = after


@njit(cache=True, nogil=True, error_model="numpy")
def _node(a: float, p: float, q: float, u: float, kappa: float) -> float:
    """tau of the node at share u of a coarse row."""
    e, f = kappa * max(1.0 - p * u, 0.0), a + q * u
    return f / (f + e)


@njit(cache=True, nogil=True, error_model="numpy")
def crossing(optics: Optics, table: AirTable, shade: ShadeMap, box: Box, coarse: int) -> tuple[int, int]:
    """First coarse column of a row, and one past the last, whose ray the projector sees within a box of shade's cells;
    (0, 0) for none."""
    a, p, q = table.rows[coarse, 0], table.rows[coarse, 2], table.rows[coarse, 3]
    start, end = table.seen.shape[2], 0
    for j in range(table.seen.shape[2]):
        # The ray's picture is a straight line: between its ends in both directions.
        x0, y0 = _shade_cell(optics, table, shade, coarse, j, _node(a, p, q, 0.0, optics.kappa))
        x1, y1 = _shade_cell(optics, table, shade, coarse, j, _node(a, p, q, 1.0, optics.kappa))
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
    optics: Optics, table: AirTable, shade: ShadeMap, coarse: int, columns: tuple[int, int], cells: Singles
) -> None:
    """Prefix sums of one coarse row from its cells (n, w), of which only what the projector sees counts."""
    a, p, q = table.rows[coarse, 0], table.rows[coarse, 2], table.rows[coarse, 3]
    nodes = cells.shape[0]
    shaded = shade.nearest.shape[0] > 0
    for j in range(columns[0], columns[1]):
        total = 0.0
        table.light[coarse, 0, j] = 0.0
        for i in range(nodes):
            value = np.float64(cells[i, j])
            if shaded and value > 0.0:
                lit = 0
                for part in range(2):
                    tau = _node(a, p, q, (i + 0.25 + 0.5 * part) / nodes, optics.kappa)
                    lit += _is_lit(optics, table, shade, coarse, j, tau)
                value *= 0.5 * lit
            total += value
            table.light[coarse, i + 1, j] = total


@njit(cache=True, nogil=True, error_model="numpy")
def _is_lit(optics: Optics, table: AirTable, shade: ShadeMap, coarse: int, j: int, tau: float) -> int:
    """1 where the projector sees the place tau of a coarse ray, else 0."""
    x, y, z = _seen_at(optics, table, coarse, j, tau)
    if not z > 0.0:
        return 0
    column, row = (x / z - shade.left) * shade.scale_x, (y / z - shade.top) * shade.scale_y
    if not (0.0 <= column < shade.nearest.shape[1] and 0.0 <= row < shade.nearest.shape[0]):
        return 1  # rays just beside the raster carry on what is inside it
    return 1 if shade.nearest[int(row), int(column)] * z <= optics.kappa * tau else 0


# Looking up.


@njit(cache=True, nogil=True, error_model="numpy")
def row_nodes(rows: Doubles, y: float) -> tuple[float, float, float, float]:
    """a, nearest w, p and q at a continuous coarse row, such that the last node stands at the nearest w."""
    k = min(int(y), rows.shape[0] - 2)
    t = y - k
    a = rows[k, 0] + t * (rows[k + 1, 0] - rows[k, 0])
    nearest = rows[k, 1] + t * (rows[k + 1, 1] - rows[k, 1])
    p = rows[k, 2] + t * (rows[k + 1, 2] - rows[k, 2])
    q = rows[k, 3] + t * (rows[k + 1, 3] - rows[k, 3])
    scale = (nearest - a) / (p * nearest + q)
    return a, nearest, p * scale, q * scale


@njit(cache=True, nogil=True, error_model="numpy")
def node_at(parameters: tuple[float, float, float, float], w: float, nodes: int) -> float:
    """The continuous node of an inverse depth, cut to 0..nodes."""
    a, nearest, p, q = parameters
    if w <= a:
        return 0.0
    if w >= nearest:
        return float(nodes)
    return min(max(nodes * (w - a) / (p * w + q), 0.0), float(nodes))


@njit(cache=True, nogil=True, error_model="numpy")
def _read(light: Singles, y: float, place: float, x: float) -> float:
    """The table at a continuous coarse row, node and coarse column."""
    k, i, j = min(int(y), light.shape[0] - 2), min(int(place), light.shape[1] - 2), min(int(x), light.shape[2] - 2)
    t, u, v = y - k, place - i, x - j
    near = bilinear(light[k, i, j], light[k, i, j + 1], light[k, i + 1, j], light[k, i + 1, j + 1], u, v)
    far = bilinear(light[k + 1, i, j], light[k + 1, i, j + 1], light[k + 1, i + 1, j], light[k + 1, i + 1, j + 1], u, v)
    return float(near + t * (far - near))


@njit(cache=True, nogil=True, error_model="numpy")
def bilinear(a: float, b: float, c: float, d: float, u: float, v: float) -> float:
    """Between the rows a b and c d at share u down and v across."""
    top, bottom = a + v * (b - a), c + v * (d - c)
    return top + u * (bottom - top)


@njit(cache=True, nogil=True, error_model="numpy")
def _along(directions: Doubles, y: float, x: float) -> Vector3:
    """The direction at a continuous coarse row and column."""
    k, j = min(int(y), directions.shape[0] - 2), min(int(x), directions.shape[1] - 2)
    t, v = y - k, x - j
    d = directions
    return (
        bilinear(d[k, j, 0], d[k, j + 1, 0], d[k + 1, j, 0], d[k + 1, j + 1, 0], t, v),
        bilinear(d[k, j, 1], d[k, j + 1, 1], d[k + 1, j, 1], d[k + 1, j + 1, 1], t, v),
        1.0,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def light_before(
    optics: Optics, medium: Medium, table: AirTable, partly: bool, column: float, row: float, w: float
) -> float:
    """The light beyond inverse depth w on the ray through a place of the image, or _BEYOND where none is lit.

    partly: whether there are rays that are lit nowhere.
    """
    y, x = row / table.step, column / table.step
    if partly and lit_span(optics, medium, _along(table.directions, y, x))[1] == 0.0:
        return np.float64(_BEYOND)
    return _read(table.light, y, node_at(row_nodes(table.rows, y), w, table.light.shape[1] - 1), x)


@njit(cache=True, nogil=True, error_model="numpy")
def fill_limits(
    optics: Optics,
    medium: Medium,
    table: AirTable,
    partly: bool,
    inverse_depth: Singles,
    box: Box,
    out: Limits,
) -> None:
    """The light up to the surface, inverse depth (H, W), of the pixels in rows box[0]..box[1], columns box[2]..box[3].

    Tiles that the box touches are judged anew as a whole.
    """
    for k in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            w = np.float64(inverse_depth[k, j])
            out.light[k, j] = light_before(optics, medium, table, partly, j + 0.5, k + 0.5, w)
        if box[2] < box[3]:
            for tile in range(box[2] // TILE, (box[3] - 1) // TILE + 1):
                least, greatest = np.float32(inf), np.float32(-inf)
                for j in range(tile * TILE, min((tile + 1) * TILE, out.light.shape[1])):
                    least, greatest = min(least, out.light[k, j]), max(greatest, out.light[k, j])
                out.least[k, tile], out.greatest[k, tile] = least, greatest


@njit(cache=True, nogil=True, error_model="numpy")
def fill_edge_pixels(
    optics: Optics,
    medium: Medium,
    table: AirTable,
    partly: bool,
    places: Doubles,
    inverse_depth: Doubles,
    out: Singles,
) -> None:
    """The light up to the surfaces of rays through places (R, 2), column and row, at inverse depths (R,)."""
    for i in range(out.shape[0]):
        out[i] = light_before(optics, medium, table, partly, places[i, 0], places[i, 1], inverse_depth[i])


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
