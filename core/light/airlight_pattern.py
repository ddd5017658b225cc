"""Airlight under a projector's pattern: what is kept between the nodes of its table, times the pattern there.

Between two nodes a coarse ray crosses some of the projector's rows, and from ray to ray lie some of its columns: what
is kept there is taken times the pattern's mean over these rows, one at least, and these columns.

Root of the mean square against rays whose every point asks the pattern, as a share of the lit mean, at 1600 x 1200 with
random patterns: of n bands of rows 0.001 for n = 32 and 0.007 for 512; of n x n blocks 0.001 (n = 8), 0.005 (32), 0.013
(128), 0.022 (512) on a rig of any pose. Where each camera ray lies in one column of the projector, as on ideal rigs,
edges of columns stand sharp in the image and are blurred here over two coarse rays: 0.01 to 0.04 for blocks, and 0.06
(n = 32) to 0.36 (512) for stripes of columns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.airlight_exact import make_optics
from slopegate.core.light.airlight_kernels import Optics
from slopegate.core.light.airlight_table import AirTable, node_places
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.rig import Rig


class PatternSums(NamedTuple):
    """A pattern as the coarse rays of a table meet it.

    sums (h + 1, w) float32: its rows before each one, summed, each a mean over the columns between coarse rays. Row r
    covers (y/z - top) scale_y in [r, r + 1) in the projector's axes, column c likewise with left and scale_x. aligned:
    columns are not these but those of the coarse rays, which keep theirs wherever a place lies on them.
    """

    left: float
    top: float
    scale_x: float
    scale_y: float
    sums: Singles
    aligned: bool


def pattern_sums(rig: Rig, table: AirTable, pattern: Singles) -> PatternSums:
    """A pattern (raster's height, width) for a table's rays."""
    left, top, picture = _undistorted(rig, pattern)
    lens, seen, offset = rig.projector.lens, table.seen, rig.rotation @ np.array(rig.projector_offset_m)
    wide = table.step * lens.fx / rig.camera.lens.fx
    straight = bool((seen[:, 1:] == seen[:, 1:, :1]).all()) and bool((seen[:, 0] == seen[0, 0]).all())
    aligned = straight and bool((seen[:, 2] == 1).all()) and offset[0] == 0 and offset[2] == 0
    columns = (seen[0, 0] - left) * lens.fx if aligned else np.arange(picture.shape[1]) + 0.5
    lines = _means(picture, np.asarray(columns, np.float64), max(wide, 1.0))
    sums = np.zeros((len(lines) + 1, lines.shape[1]))
    np.cumsum(lines, axis=0, out=sums[1:])
    return PatternSums(left, top, lens.fx, lens.fy, sums.astype(np.float32), aligned)


def _undistorted(rig: Rig, pattern: Singles) -> tuple[float, float, Singles]:
    """Left and top side, x/z and y/z, of a pattern as a pinhole would throw it, and that picture."""
    lens, optics = rig.projector.lens, make_optics(rig)
    left, top = optics.low
    if not lens.distorted:
        return left, top, pattern
    width, height = (
        int(np.ceil((high - low) * focal))
        for low, high, focal in zip(optics.low, optics.high, (lens.fx, lens.fy), strict=True)
    )
    x, y = left + (np.arange(width) + 0.5) / lens.fx, top + (np.arange(height) + 0.5) / lens.fy
    column, row = lens.project(*(a.ravel() for a in np.meshgrid(x, y)))
    # What lies beside the raster is not lit: there the pattern may be that of its border.
    j, i = np.clip(column.astype(int), 0, lens.width - 1), np.clip(row.astype(int), 0, lens.height - 1)
    return left, top, pattern[i, j].reshape(height, width)


def _means(picture: Singles, middles: Doubles, wide: float) -> Doubles:
    """Means (h, n) of a picture's rows over `wide` columns about places (n,), as far as they are in it."""
    width = picture.shape[1]
    sums = np.zeros((len(picture), width + 1))
    np.cumsum(picture, axis=1, out=sums[:, 1:])
    low = np.clip(middles - 0.5 * wide, 0, width - 1)
    high = np.clip(middles + 0.5 * wide, low + 1, width)
    return np.asarray((_at(sums, high) - _at(sums, low)) / (high - low))


def _at(sums: Doubles, places: Doubles) -> Doubles:
    """Sums (h, W + 1) between their columns."""
    before = np.minimum(places.astype(np.int64), sums.shape[1] - 2)
    share = places - before
    return np.asarray(sums[:, before] * (1 - share) + sums[:, before + 1] * share)


@njit(cache=True, nogil=True, error_model="numpy")
def show(optics: Optics, table: AirTable, everything: Singles, pattern: PatternSums) -> None:
    """Fill table.light from `everything` (h, n + 1, w), the same sums with the whole raster lit."""
    columns = everything.shape[2]
    room = np.empty((5, columns), np.float32)
    for k in range(everything.shape[0]):
        places = node_places(table, k, everything.shape[1] - 1, optics.kappa)
        if pattern.aligned:
            _show_aligned(optics, table, everything, pattern, k, places, room[0])
        else:
            _show_row(optics, table, everything, pattern, k, places, room)


@njit(cache=True, nogil=True, error_model="numpy")
def _rows_between(one: float, other: float, rows: int) -> tuple[float, float]:
    """The rows between two places of the raster, one row wide at least and within it."""
    half = min(max(0.5 * abs(other - one), 0.5), 0.5 * rows)
    middle = min(max(0.5 * (one + other), half), rows - half)
    return middle - half, middle + half


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz", "contract"})
def _show_aligned(
    optics: Optics,
    table: AirTable,
    everything: Singles,
    pattern: PatternSums,
    k: int,
    places: Doubles,
    share: Singles,
) -> None:
    """`show` of one coarse row whose rays all meet a node at the same row, and each in a column of its own."""
    light, sums, r = table.light, pattern.sums, np.uint64(k)
    columns, rows = np.uint64(light.shape[2]), sums.shape[0] - 1
    across = optics.rotation[1]
    rise = across[0] * optics.offset[0] + across[1] * optics.offset[1] + across[2] * optics.offset[2]
    y = np.float64(table.seen[k, 1, 0])
    last = everything.shape[1] - 1
    light[k, last, :] = everything[k, last]
    before = _row_at(pattern, y, rise, places[last], optics.kappa, rows)
    for node in range(last - 1, -1, -1):
        here = _row_at(pattern, y, rise, places[node], optics.kappa, rows)
        low, high = _rows_between(before, here, rows)
        before = here
        a, b = min(int(low), rows - 1), min(int(high), rows - 1)
        u, v, scale = np.float32(low - a), np.float32(high - b), np.float32(1.0 / (high - low))
        m, n, one, i = np.uint64(a), np.uint64(b), np.uint64(1), np.uint64(node)
        for j in range(np.uint64(0), columns):
            top = sums[m, j] + u * (sums[m + one, j] - sums[m, j])
            share[j] = (sums[n, j] + v * (sums[n + one, j] - sums[n, j]) - top) * scale
        for j in range(np.uint64(0), columns):
            light[r, i, j] = light[r, i + one, j] + share[j] * (everything[r, i, j] - everything[r, i + one, j])


@njit(cache=True, nogil=True, error_model="numpy")
def _row_at(pattern: PatternSums, y: float, rise: float, tau: float, kappa: float, rows: int) -> float:
    """The pattern's row at a place of an aligned ray, at most one raster beside it."""
    e, f = 1.0 - tau, kappa * tau
    along = (e * y - f * rise) / e if e > 0.0 else np.inf
    return float(min(max((along - pattern.top) * pattern.scale_y, -rows), 2.0 * rows))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz", "contract"})
def _fill_places(
    optics: Optics, table: AirTable, pattern: PatternSums, k: int, tau: float, row: Singles, column: Singles
) -> None:
    """The pattern's row and column (w,) at the place tau of coarse row k's rays, at most a raster beside it."""
    r, o = optics.rotation, optics.offset
    e, f = np.float32(1.0 - tau), optics.kappa * tau
    ox = np.float32(f * (r[0][0] * o[0] + r[0][1] * o[1] + r[0][2] * o[2]))
    oy = np.float32(f * (r[1][0] * o[0] + r[1][1] * o[1] + r[1][2] * o[2]))
    oz = np.float32(f * (r[2][0] * o[0] + r[2][1] * o[1] + r[2][2] * o[2]))
    left, top = np.float32(pattern.left), np.float32(pattern.top)
    scale_x, scale_y, least = np.float32(pattern.scale_x), np.float32(pattern.scale_y), np.float32(1e-9)
    rows, columns = np.float32(pattern.sums.shape[0] - 1), np.float32(pattern.sums.shape[1])
    seen, one, two = table.seen, np.uint64(1), np.uint64(2)
    c, zero = np.uint64(k), np.uint64(0)
    for j in range(zero, np.uint64(row.shape[0])):
        scale = np.float32(1) / max(e * seen[c, two, j] - oz, least)
        x, y = (e * seen[c, zero, j] - ox) * scale, (e * seen[c, one, j] - oy) * scale
        row[j] = min(max((y - top) * scale_y, -rows), rows + rows)
        column[j] = min(max((x - left) * scale_x, np.float32(0)), columns - np.float32(1))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz", "contract"})
def _show_row(
    optics: Optics,
    table: AirTable,
    everything: Singles,
    pattern: PatternSums,
    k: int,
    places: Doubles,
    room: Singles,
) -> None:
    """`show` of one coarse row of any rig; room (5, w)."""
    light, sums = table.light, pattern.sums
    rows, last, half, one = np.float32(sums.shape[0] - 1), everything.shape[1] - 1, np.float32(0.5), np.uint64(1)
    most = np.int64(sums.shape[0] - 2)
    light[k, last, :] = everything[k, last]
    _fill_places(optics, table, pattern, k, places[last], room[0], room[1])
    c = np.uint64(k)
    for node in range(last - 1, -1, -1):
        near, here = (last - node) % 2 * 2, (last - node + 1) % 2 * 2
        # Nodes alternate between the two halves of the room.
        old, new = room[here], room[near]
        _fill_places(optics, table, pattern, k, places[node], new, room[near + 1])
        beside, place = room[here + 1], room[near + 1]
        i = np.uint64(node)
        for j in range(np.uint64(0), np.uint64(old.shape[0])):
            wide = min(max(half * abs(new[j] - old[j]), half), half * rows)
            middle = min(max(half * (old[j] + new[j]), wide), rows - wide)
            low, high = middle - wide, middle + wide
            a, b = min(np.int64(low), most), min(np.int64(high), most)
            m, n = np.uint64(a), np.uint64(b)
            at = np.uint64(half * (beside[j] + place[j]))
            top = sums[m, at] + (low - np.float32(a)) * (sums[m + one, at] - sums[m, at])
            end = sums[n, at] + (high - np.float32(b)) * (sums[n + one, at] - sums[n, at])
            share = (end - top) / (high - low)
            light[c, i, j] = light[c, i + one, j] + share * (everything[c, i, j] - everything[c, i + one, j])
