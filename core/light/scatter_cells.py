"""The compiled loops of the live halo: pixels to cells, cells to weights of Gaussians, and the sums of one gate.

A cell is a block of pixels of the camera. It keeps two lots of light apart, that of lower and that of higher projector
rows: where an edge in depth runs through a block, what is before it and what is behind it have different rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.kernels import TILE
from slopegate.core.light.scatter_kernels import HaloLaw, halo_of
from slopegate.core.rig.arrays import Doubles, Singles


class HaloCells(NamedTuple):
    """Blocks of pixels, two lots each: (2, H, W) float32 and light (2, H, W, C).

    first, last: the projector rows that a lot spans; light: its sum over the lot's pixels; place (2, H, W, 7): the mean
    of x, y, inverse depth, gradients of its logarithm by x and by y, steradians of one pixel, and its number of pixels.
    border (H, W): the projector row above which light is the second lot's, infinite where there is one lot.
    """

    first: Singles
    last: Singles
    light: Singles
    place: Singles
    border: Singles


class HaloLots(NamedTuple):
    """One lot of every cell as `gather_spans` takes it: (H, W), and tile bounds (H, tiles) as in `kernels.Planes`.

    light is spread evenly over rows first .. first + 1 / scale. leaning: by how much more of it falls on each row below
    (a tilted surface sends more light to one side).
    """

    first: Singles
    last: Singles
    scale: Singles
    light: Singles
    leaning: Singles
    tile_low: Singles
    tile_high: Singles


@njit(cache=True, nogil=True)
def _extent(
    row: Singles, spans: Singles, block: tuple[int, int, int, int]
) -> tuple[np.float32, np.float32, np.float32]:
    """Least and greatest lit row of the block top, bottom, left, right, and the widest span."""
    low, high, span = np.float32(np.inf), np.float32(-np.inf), np.float32(0)
    for m in range(block[0], block[1]):
        for n in range(block[2], block[3]):
            if row[m, n] >= 0:
                low, high, span = min(low, row[m, n]), max(high, row[m, n]), max(span, spans[m, n])
    return low, high, span


@njit(cache=True, nogil=True)
def fill_cells(
    law: HaloLaw, light: Singles, row: Singles, spans: Singles, size: tuple[int, int], cells: HaloCells
) -> None:
    """Sort the light (H, W, C) of pixels lit by `row` (H, W), each of which spans `spans` of them, into cells."""
    height, width = row.shape
    for k in range(cells.first.shape[1]):
        for j in range(cells.first.shape[2]):
            top, left = k * size[0], j * size[1]
            block = (top, min(top + size[0], height), left, min(left + size[1], width))
            low, high, span = _extent(row, spans, block)
            if low > high:
                continue
            # Two lots where the rows differ by more than a surface's own slope explains.
            split = high - low > 2 * span * size[0]
            cells.border[k, j] = np.float32(0.5) * (low + high) if split else np.float32(np.inf)
            for m in range(block[0], block[1]):
                for n in range(block[2], block[3]):
                    if row[m, n] >= 0:
                        lot = 1 if row[m, n] > cells.border[k, j] else 0
                        _put(law, light, row, spans, (m, n), (lot, k, j), cells)
            for lot in range(2):
                for i in range(6):
                    cells.place[lot, k, j, i] /= max(cells.place[lot, k, j, 6], np.float32(1))


@njit(cache=True, nogil=True)
def relight(light: Singles, row: Singles, size: tuple[int, int], border: Singles, out: Singles) -> None:
    """Sum the light (H, W, C) of pixels lit by `row` into the lots out (2, h, w, C) of cells."""
    out[...] = 0
    for m in range(row.shape[0]):
        k = m // size[0]
        for n in range(row.shape[1]):
            if row[m, n] >= 0:
                j = n // size[1]
                lot = 1 if row[m, n] > border[k, j] else 0
                for c in range(light.shape[2]):
                    out[lot, k, j, c] += light[m, n, c]


@njit(cache=True, nogil=True)
def _put(
    law: HaloLaw,
    light: Singles,
    row: Singles,
    spans: Singles,
    pixel: tuple[int, int],
    cell: tuple[int, int, int],
    cells: HaloCells,
) -> None:
    """Add one pixel to one lot of a cell."""
    half, place, source = np.float32(0.5) * spans[pixel], cells.place[cell], law.source
    fresh = place[6] == 0
    cells.first[cell] = row[pixel] - half if fresh else min(cells.first[cell], row[pixel] - half)
    cells.last[cell] = row[pixel] + half if fresh else max(cells.last[cell], row[pixel] + half)
    for c in range(light.shape[2]):
        cells.light[cell][c] += light[pixel][c]
    place[0] += source.x[pixel]
    place[1] += source.y[pixel]
    place[2] += source.inverse_depth[pixel]
    place[3] += source.log_x[pixel]
    place[4] += source.log_y[pixel]
    place[5] += source.steradian[pixel]
    place[6] += 1


@njit(cache=True, nogil=True, error_model="numpy")
def weigh_cells(
    law: HaloLaw,
    cells: HaloCells,
    size: tuple[int, int],
    steps: Doubles,
    fit: tuple[Doubles, Doubles],
    weights: Doubles,
) -> None:
    """Weights (2, H, W, J, 2) of the Gaussians that make the halo of each lot, and by how much they lean down a row.

    steps (S,): tangents at which the halo is looked at, in four directions; fit (J, S): from their mean, and from half
    of what goes down more than up, to weights. Neighbours that hardly differ share theirs: they are off by 1 % at most.
    """
    even, odd = fit
    values, last, near = np.zeros((len(steps), 2)), np.zeros(7), np.zeros(7)
    for lot in range(2):
        for k in range(cells.first.shape[1]):
            known = False
            for j in range(cells.first.shape[2]):
                if cells.place[lot, k, j, 6] == 0 or cells.place[lot, k, j, 2] <= 0:
                    continue
                m = min(k * size[0] + size[0] // 2, law.sink.first.shape[0] - 1)
                n = min(j * size[1] + size[1] // 2, law.sink.first.shape[1] - 1)
                for i in range(5):
                    near[i] = cells.place[lot, k, j, i]
                x, y, w = near[0], near[1], near[2]
                distance = np.sqrt(1 + x * x + y * y) / w
                # Where fog ends before the surface, it does so for the lot as well; else the surface itself ends rays.
                near[5], near[6] = law.sink.first[m, n], law.sink.last[m, n]
                if near[6] > 0.99 * distance:
                    near[6] = np.inf
                if not (known and _alike(near, last)):
                    _halo_values(law, near, steps, values)
                    last[:] = near
                    known = True
                steradian = np.float64(cells.place[lot, k, j, 5])
                for g in range(even.shape[0]):
                    total, lean = 0.0, 0.0
                    for s in range(len(steps)):
                        total += even[g, s] * values[s, 0]
                        lean += odd[g, s] * values[s, 1]
                    weights[lot, k, j, g, 0] = total * steradian * law.scattering
                    weights[lot, k, j, g, 1] = lean * steradian * law.scattering


@njit(cache=True, nogil=True, error_model="numpy")
def _alike(a: Doubles, b: Doubles) -> bool:
    """Whether two places have the same halo, to 1 %: x, y, inverse depth, two slopes, where fog begins and ends."""
    if abs(a[0] - b[0]) + abs(a[1] - b[1]) > 0.03 or abs(a[2] - b[2]) > 0.005 * b[2]:
        return False
    if abs(a[3] - b[3]) + abs(a[4] - b[4]) > 0.05:
        return False
    # Against the depth of fog before the surface, or behind it; equal when both are infinite.
    deep = 1 / b[2] - b[5]
    ends = a[6] == b[6] or abs(a[6] - b[6]) < 0.005 * abs(1 / b[2] - b[6])
    return bool(abs(a[5] - b[5]) <= 0.005 * max(deep, 0.0) and ends)


@njit(cache=True, nogil=True, error_model="numpy")
def _halo_values(law: HaloLaw, near: Doubles, steps: Doubles, values: Doubles) -> None:
    place, slope, first, last = (near[0], near[1], near[2]), (near[3], near[4]), near[5], near[6]
    for s in range(len(steps)):
        step = steps[s]
        right = halo_of(law, place, slope, (step, 0.0), first, last)
        left = halo_of(law, place, slope, (-step, 0.0), first, last)
        below = halo_of(law, place, slope, (0.0, step), first, last)
        above = halo_of(law, place, slope, (0.0, -step), first, last)
        values[s, 0], values[s, 1] = 0.25 * (left + right + above + below), 0.5 * (below - above)


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def gather_spans(
    lots: HaloLots, windows: tuple[Singles, Singles, Singles, Singles], taps: Singles, out: Singles
) -> None:
    """out[k, j] += SUM over m of taps[R + k - m] weight_k(m, j) (light[m, j] + (k - m) leaning[m, j]), all (H, W).

    windows: low, high, weight inside and weight outside of every row k. A lot counts by the share of its span that the
    window takes.
    """
    start, until, scale, light, leaning = lots.first, lots.last, lots.scale, lots.light, lots.leaning
    lows, highs, hits, misses = windows
    height, reach = out.shape[0], taps.shape[0] // 2
    for tile in range(lots.tile_low.shape[1]):
        first, last = np.uint64(tile * TILE), np.uint64(min((tile + 1) * TILE, out.shape[1]))
        for line in range(height):
            k = np.uint64(line)
            low, high, hit, miss = lows[k], highs[k], hits[k], misses[k]
            if hit == 0 and miss == 0:
                continue
            for other in range(max(line - reach, 0), min(line + reach + 1, height)):
                m = np.uint64(other)
                least, greatest = lots.tile_low[m, tile], lots.tile_high[m, tile]
                tap, step = taps[reach + line - other], np.float32(line - other)
                if least > greatest:
                    continue
                apart = greatest <= low or least >= high or hit == miss
                if apart or (least >= low and greatest <= high):
                    weight = tap * (miss if apart else hit)
                    if weight != 0:
                        for j in range(first, last):
                            out[k, j] += weight * (light[m, j] + step * leaning[m, j])
                    continue
                for j in range(first, last):
                    share = (min(high, until[m, j]) - max(low, start[m, j])) * scale[m, j]
                    share = min(max(share, np.float32(0)), np.float32(1))
                    out[k, j] += tap * (miss + (hit - miss) * share) * (light[m, j] + step * leaning[m, j])


@njit(cache=True, nogil=True)
def widen(coarse: Singles, fine: Singles) -> None:
    """Add a plane (H, ceil(W / 2)) to one of twice its columns (H, W), linear between its cells."""
    last = coarse.shape[1] - 1
    for k in range(fine.shape[0]):
        for j in range(fine.shape[1]):
            n = j // 2
            beside = max(n - 1, 0) if j % 2 == 0 else min(n + 1, last)
            fine[k, j] += np.float32(0.75) * coarse[k, n] + np.float32(0.25) * coarse[k, beside]


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def enlarge(cells: Singles, size: int, lines: Singles, out: Singles) -> None:
    """Add cells of size x size pixels (size odd) to out (H, W), linear between their middles; lines (2, W') is scratch.

    W' is the number of columns of cells times size.
    """
    rows, middle = cells.shape[0], size // 2
    _stretch(cells, 0, size, lines[1])
    for row in range(rows + 1):
        # Between the middles of row - 1 and of row; beyond the outer ones nothing changes any more.
        lines[0, :] = lines[1]
        _stretch(cells, min(row, rows - 1), size, lines[1])
        for k in range(max((row - 1) * size + middle, 0), min(row * size + middle, out.shape[0])):
            b = np.float32(k - (row - 1) * size - middle) / np.float32(size)
            line = np.uint64(k)
            for j in range(np.uint64(out.shape[1])):
                out[line, j] += (1 - b) * lines[0, j] + b * lines[1, j]


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def _stretch(cells: Singles, row: int, size: int, line: Singles) -> None:
    """One row of cells at the columns of pixels (W',)."""
    last, middle = cells.shape[1] - 1, size // 2
    for j in range(cells.shape[1]):
        before, here, after = cells[row, max(j - 1, 0)], cells[row, j], cells[row, min(j + 1, last)]
        for i in range(size):
            a = np.float32(i - middle) / np.float32(size)
            line[j * size + i] = here + (a * (after - here) if a > 0 else a * (here - before))
