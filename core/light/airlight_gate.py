"""The compiled loops that read a gate's airlight from the table: two profiles a camera row, and a maximum a pixel.

Projector row r is met where g = (Q_y - s Q_z) - w (O_y - s O_z) is 0, s = (r - c_y) / f_y, and rows from r on lie where
g >= 0: one comparison whatever the rig, also where the row hardly changes along the ray. So a window is an interval of
w on each ray. The table rises with w, so clipping by a surface is the larger of two numbers:
light = max(0, P(last) - max(P(first), P(surface))).
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from numba import njit

from slopegate.core.light.airlight_table import TILE, AirTable, Limits, bilinear, node_at, row_nodes
from slopegate.core.rig.arrays import Doubles, Indices, Ints, Singles
from slopegate.core.rig.rig import Vector3


class ProjectorRows(NamedTuple):
    """The projector's rows: the offset in its axes, x/z of its left and right side, and for a distorted lens bend
    (rows, columns): y/z of rows that stand evenly over the raster, at x/z evenly from left to right; (0, 0) else.

    straight: every projector row crosses all rays of a camera row at one w.
    """

    offset: Vector3
    left: float
    right: float
    bend: Doubles
    straight: bool


class RowEdges(NamedTuple):
    """The windows of camera rows (H,): where they begin and end, as slopes y/z of a pinhole and as shares of all
    rows (H, 2); how often what lies between counts beside the rest, and how often the rest counts."""

    slopes: Doubles
    shares: Doubles
    part: Singles
    whole: Singles


class Profiles(NamedTuple):
    """Of one camera row: the continuous nodes at which its window begins and ends and the light beyond these, at each
    coarse column (w,); 0s and all light (w,), for what counts outside the window; the light of the pixels (W,).

    Room for the loops, filled anew for each row.
    """

    start: Singles
    end: Singles
    first: Singles
    last: Singles
    none: Singles
    every: Singles
    pixels: Singles


class EdgePixels(NamedTuple):
    """Pixels whose rays meet surfaces that no plane joins: column (E,), the light up to the surface of each ray
    (E, N, N), row by row of rays; first (H + 1,): where the pixels of each camera row begin."""

    column: Ints
    surface: Singles
    first: Indices


@njit(cache=True, nogil=True, error_model="numpy")
def _change(o: Vector3, slope: float) -> float:
    """How fast a ray leaves the sheet of light of a slope, per unit of w; never 0, so that where it runs along the
    sheet all of it lies to one side."""
    change = o[1] - slope * o[2]
    return change if change != 0.0 else -1e-300


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _fill_nodes(
    seen: Singles,
    r: int,
    t: np.float32,
    raster: ProjectorRows,
    slopes: tuple[float, float],
    rows: tuple[float, float, float, float],
    nodes: int,
    start: Singles,
    end: Singles,
) -> None:
    """Where a window of these slopes begins and ends on coarse rays, as continuous nodes, (w,) each."""
    change_low, change_high = _change(raster.offset, slopes[0]), _change(raster.offset, slopes[1])
    rising_low, rising_high = change_low < 0.0, change_high < 0.0
    # Reciprocals that float32 can hold: a ray that comes no nearer to an edge than this lies to one side of it.
    to_low = np.float32(min(max(1.0 / change_low, -1e30), 1e30))
    to_high = np.float32(min(max(1.0 / change_high, -1e30), 1e30))
    low, high, far = np.float32(slopes[0]), np.float32(slopes[1]), np.float32(1e35)
    a, nearest, p, q = np.float32(rows[0]), np.float32(rows[1]), np.float32(rows[2]), np.float32(rows[3])
    count, k, zero, one, two = np.float32(nodes), np.uint64(r), np.uint64(0), np.uint64(1), np.uint64(2)
    for j in range(zero, np.uint64(start.shape[0])):
        y = seen[k, one, j] + t * (seen[k + one, one, j] - seen[k, one, j])
        z = seen[k, two, j] + t * (seen[k + one, two, j] - seen[k, two, j])
        at_low, at_high = (y - low * z) * to_low, (y - high * z) * to_high
        # Rows rise with w, or fall: an edge is where the window begins, or ends.
        first = max(at_low if rising_low else -far, -far if rising_high else at_high)
        last = min(far if rising_low else at_low, at_high if rising_high else far)
        first, last = min(max(first, a), nearest), min(max(last, a), nearest)
        start[j] = min(count * (first - a) / (p * first + q), count)
        end[j] = min(count * (last - a) / (p * last + q), count)


@njit(cache=True, nogil=True, error_model="numpy")
def _bent_slope(q: Vector3, o: Vector3, slope: float, r: float, raster: ProjectorRows, nearest: float) -> float:
    """y/z of a distorted projector's row where a ray, q in its axes, meets it; r: the row as a place in raster.bend."""
    bend = raster.bend
    i = min(int(r), bend.shape[0] - 2)
    # From the row's slope to the place and back: each step leaves of an error what the slope changes along the row, a
    # tenth or less.
    for _ in range(4):
        w = min(max((q[1] - slope * q[2]) / _change(o, slope), 0.0), nearest)
        z = q[2] - w * o[2]
        x = (q[0] - w * o[0]) / z if z > 0.0 else 0.0
        c = min(max((x - raster.left) / (raster.right - raster.left), 0.0), 1.0) * (bend.shape[1] - 1)
        j = min(int(c), bend.shape[1] - 2)
        slope = bilinear(bend[i, j], bend[i, j + 1], bend[i + 1, j], bend[i + 1, j + 1], r - i, c - j)
    return slope


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_bent_nodes(
    seen: Singles,
    r: int,
    t: float,
    raster: ProjectorRows,
    slopes: tuple[float, float],
    shares: tuple[float, float],
    rows: tuple[float, float, float, float],
    nodes: int,
    start: Singles,
    end: Singles,
) -> None:
    """`_fill_nodes` for a distorted projector; shares: the window's edges as shares of all rows."""
    o, nearest, most = raster.offset, rows[1], raster.bend.shape[0] - 1
    low_row, high_row = min(max(shares[0], 0.0), 1.0) * most, min(max(shares[1], 0.0), 1.0) * most
    for j in range(start.shape[0]):
        q = (
            seen[r, 0, j] + t * (seen[r + 1, 0, j] - seen[r, 0, j]),
            seen[r, 1, j] + t * (seen[r + 1, 1, j] - seen[r, 1, j]),
            seen[r, 2, j] + t * (seen[r + 1, 2, j] - seen[r, 2, j]),
        )
        low = _bent_slope(q, o, slopes[0], low_row, raster, nearest)
        high = _bent_slope(q, o, slopes[1], high_row, raster, nearest)
        change_low, change_high = _change(o, low), _change(o, high)
        at_low, at_high = (q[1] - low * q[2]) / change_low, (q[1] - high * q[2]) / change_high
        first = max(at_low if change_low < 0.0 else -inf, -inf if change_high < 0.0 else at_high)
        last = min(inf if change_low < 0.0 else at_low, at_high if change_high < 0.0 else inf)
        start[j], end[j] = node_at(rows, first, nodes), node_at(rows, last, nodes)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _fill_straight(light: Singles, r: int, t: np.float32, place: np.float32, out: Singles) -> None:
    """`_fill_light` at one place for all columns: four runs of contiguous numbers."""
    i = min(int(place), light.shape[1] - 2)
    u = place - np.float32(i)
    k, m, one = np.uint64(r), np.uint64(i), np.uint64(1)
    for j in range(np.uint64(0), np.uint64(out.shape[0])):
        near = light[k, m, j] + u * (light[k, m + one, j] - light[k, m, j])
        far = light[k + one, m, j] + u * (light[k + one, m + one, j] - light[k + one, m, j])
        out[j] = near + t * (far - near)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _fill_light(light: Singles, r: int, t: np.float32, places: Singles, out: Singles) -> None:
    """The table between coarse rows r and r + 1 at the nodes `places`, one for each coarse column (w,)."""
    k, one, most = np.uint64(r), np.uint64(1), np.int32(light.shape[1] - 2)
    for j in range(np.uint64(0), np.uint64(out.shape[0])):
        i = min(np.int32(places[j]), most)
        u, m = places[j] - np.float32(i), np.uint64(i)
        near = light[k, m, j] + u * (light[k, m + one, j] - light[k, m, j])
        far = light[k + one, m, j] + u * (light[k + one, m + one, j] - light[k + one, m, j])
        out[j] = near + t * (far - near)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_profiles(table: AirTable, raster: ProjectorRows, edges: RowEdges, k: int, y: float, out: Profiles) -> None:
    """The profiles of camera row k at the continuous coarse row y."""
    light, nodes = table.light, table.light.shape[1] - 1
    r = min(int(y), light.shape[0] - 2)
    t, rows = y - r, row_nodes(table.rows, y)
    if edges.whole[k] != 0:
        _fill_straight(light, r, np.float32(t), np.float32(nodes), out.every)
    if edges.part[k] == 0:
        return
    slopes, shares = (edges.slopes[k, 0], edges.slopes[k, 1]), (edges.shares[k, 0], edges.shares[k, 1])
    # Of a straight rig the first column stands for all.
    columns = 1 if raster.straight else light.shape[2]
    start, end = out.start[:columns], out.end[:columns]
    if raster.bend.shape[0] > 0:
        _fill_bent_nodes(table.seen, r, t, raster, slopes, shares, rows, nodes, start, end)
    else:
        _fill_nodes(table.seen, r, np.float32(t), raster, slopes, rows, nodes, start, end)
    if raster.straight:
        _fill_straight(light, r, np.float32(t), start[0], out.first)
        _fill_straight(light, r, np.float32(t), end[0], out.last)
    else:
        _fill_light(light, r, np.float32(t), start, out.first)
        _fill_light(light, r, np.float32(t), end, out.last)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _add_between(
    first: Singles, last: Singles, limits: Limits, line: int, step: int, weight: np.float32, out: Singles
) -> None:
    """Add weight times the light between two profiles and before the surfaces to the pixels of camera row `line`."""
    width = limits.light.shape[1]
    for tile in range(limits.least.shape[1]):
        left, right = tile * TILE, min((tile + 1) * TILE, width)
        c0, c1 = left // step, (right - 1) // step + 1
        low, high, top = first[c0], first[c0], last[c0]
        for c in range(c0 + 1, c1 + 1):
            low, high, top = min(low, first[c]), max(high, first[c]), max(top, last[c])
        if limits.least[line, tile] >= top or low >= top:
            continue  # all surfaces lie in front of the gate's light
        if step % 4 != 0 or TILE % step != 0 or right % step != 0:
            _add_singly(first, last, limits.light, line, step, left, right, weight, out)
        elif limits.greatest[line, tile] <= low:
            _add_unclipped(first, last, step, c0, c1, weight, out)  # all lie beyond it, and need not be looked at
        else:
            _add_clipped(first, last, limits.light, line, step, c0, c1, weight, out)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _add_singly(
    first: Singles,
    last: Singles,
    light: Singles,
    line: int,
    step: int,
    left: int,
    right: int,
    weight: np.float32,
    out: Singles,
) -> None:
    """`_add_between` for the pixels left..right, pixel by pixel."""
    for j in range(left, right):
        c = j // step
        x = np.float32((j - c * step + 0.5) / step)
        nearest = max(first[c] + x * (first[c + 1] - first[c]), light[line, j])
        out[j] += weight * max(last[c] + x * (last[c + 1] - last[c]) - nearest, np.float32(0))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _add_unclipped(
    first: Singles, last: Singles, step: int, c0: int, c1: int, weight: np.float32, out: Singles
) -> None:
    """`_add_between` for the cells c0..c1 of pixels, before surfaces that all lie farther away."""
    one, four, inverse = np.uint64(1), np.uint64(4), np.float32(1 / step)
    for cell in range(np.uint64(c0), np.uint64(c1)):
        a = last[cell] - first[cell]
        change = (last[cell + one] - first[cell + one] - a) * inverse
        a += np.float32(0.5) * change
        j = cell * np.uint64(step)
        for _ in range(np.uint64(step // 4)):
            for i in range(np.uint64(0), four):
                out[j + i] += weight * max(a + np.float32(i) * change, np.float32(0))
            a, j = a + np.float32(4) * change, j + four


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _add_clipped(
    first: Singles,
    last: Singles,
    light: Singles,
    line: int,
    step: int,
    c0: int,
    c1: int,
    weight: np.float32,
    out: Singles,
) -> None:
    """`_add_between` for the cells c0..c1 of pixels, each before its own surface."""
    k, one, four, inverse = np.uint64(line), np.uint64(1), np.uint64(4), np.float32(1 / step)
    for cell in range(np.uint64(c0), np.uint64(c1)):
        da, db = (first[cell + one] - first[cell]) * inverse, (last[cell + one] - last[cell]) * inverse
        a, b = first[cell] + np.float32(0.5) * da, last[cell] + np.float32(0.5) * db
        j = cell * np.uint64(step)
        for _ in range(np.uint64(step // 4)):
            # Four pixels, a number that the compiler knows, become vector code.
            for i in range(np.uint64(0), four):
                x = np.float32(i)
                out[j + i] += weight * max(b + x * db - max(a + x * da, light[k, j + i]), np.float32(0))
            a, b, j = a + np.float32(4) * da, b + np.float32(4) * db, j + four


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"})
def _pour(pixels: Singles, line: int, out: Singles) -> None:
    """Add pixels (W,) to row `line` of out (H, W C), each to its C channels."""
    k, channels = np.uint64(line), np.uint64(out.shape[1] // pixels.shape[0])
    if channels == np.uint64(1):
        for j in range(np.uint64(0), np.uint64(pixels.shape[0])):
            out[k, j] += pixels[j]
        return
    for j in range(np.uint64(0), np.uint64(pixels.shape[0])):
        for c in range(channels):
            out[k, j * channels + c] += pixels[j]


@njit(cache=True, nogil=True, error_model="numpy")
def _mend_edges(
    first: Singles,
    last: Singles,
    limits: Limits,
    among: EdgePixels,
    line: int,
    part: int,
    step: int,
    weight: np.float32,
    out: Singles,
) -> None:
    """In the edge pixels of a camera row, put the mean over a row of rays in the place of the one through the centre.

    part: which row of rays.
    """
    for e in range(among.first[line], among.first[line + 1]):
        j = among.column[e]
        c = j // step
        x = np.float32((j - c * step + 0.5) / step)
        near = first[c] + x * (first[c + 1] - first[c])
        far = last[c] + x * (last[c + 1] - last[c])
        total = np.float32(0)
        for i in range(among.surface.shape[2]):
            total += max(far - max(near, among.surface[e, part, i]), np.float32(0))
        total /= np.float32(among.surface.shape[2])
        out[j] += weight * (total - max(far - max(near, limits.light[line, j]), np.float32(0)))


@njit(cache=True, nogil=True, error_model="numpy")
def add_gate(
    table: AirTable,
    raster: ProjectorRows,
    edges: RowEdges,
    limits: Limits,
    among: EdgePixels,
    samples: int,
    room: Profiles,
    out: Singles,
) -> None:
    """Add what a gate records to out (H, W C), pixels of C equal channels; each row is the mean over `samples` rows of
    rays, of which those through edge pixels have their own surfaces."""
    for k in range(out.shape[0]):
        part, whole = edges.part[k] / np.float32(samples), edges.whole[k] / np.float32(samples)
        if part == 0 and whole == 0:
            continue
        room.pixels[:] = 0
        for i in range(samples):
            _fill_profiles(table, raster, edges, k, (k + (i + 0.5) / samples) / table.step, room)
            if part != 0:
                _add_between(room.first, room.last, limits, k, table.step, part, room.pixels)
                _mend_edges(room.first, room.last, limits, among, k, i, table.step, part, room.pixels)
            if whole != 0:
                _add_between(room.none, room.every, limits, k, table.step, whole, room.pixels)
                _mend_edges(room.none, room.every, limits, among, k, i, table.step, whole, room.pixels)
        _pour(room.pixels, k, out)
