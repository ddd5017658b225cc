"""The compiled look-up of indirect light: what each camera row's window holds of the cells, spread over its pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.kernels_bake import Grid
from slopegate.core.light.spreading import Spread, between
from slopegate.core.rig.arrays import Bytes, Doubles, Ints, Singles


class CellSums(NamedTuple):
    """Light of all bands of projector rows before each, (R, B + 1, C, W), of R x W cells in C channels.

    matt is to be multiplied by a pixel's colour, plain is not; plain (R, 0, C, W) where there is none, and of one
    channel where the image is luminance.
    """

    matt: Singles
    plain: Singles


class CellWindows(NamedTuple):
    """The windows of the camera rows (H,): low and high edges as shares of the projector's rows, and how often they
    record what lies inside and outside."""

    low: Doubles
    high: Doubles
    inside: Ints
    outside: Ints


class Room(NamedTuple):
    """Room for one camera row: cells of the rows above and below (2, C, W), the same for every pixel of matt and
    plain light (4, (W + 2) pitch), and the row's light (width,)."""

    lines: Singles
    wide: Singles
    light: Singles


class CellPass(NamedTuple):
    """Cells ready for `add_light`: their sums, what pixels multiply them by, how they take them, and room for it."""

    sums: CellSums
    tint: Singles
    spread: Spread
    grid: Grid
    room: Room


def cell_pass(sums: CellSums, tint: Singles, spread: Spread, grid: Grid) -> CellPass:
    """A pass with room of its own."""
    lines = np.empty((2, sums.matt.shape[2], grid.columns), np.float32)
    wide = np.zeros((4, (grid.columns + 2) * grid.pitch), np.float32)
    return CellPass(sums, tint, spread, grid, Room(lines, wide, np.empty(grid.width, np.float32)))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz", "contract"})
def sum_columns(table: Singles, shares: Singles, scale: Singles, out: Singles) -> None:
    """out (R, B, C, W) = both halves of a table (2, R, B, K, C, W) together, each part of the raster times its share
    (B, K), summed over the K columns, and each cell times scale (R, W)."""
    out[...] = 0
    for r in range(out.shape[0]):
        for b in range(out.shape[1]):
            for i in range(shares.shape[1]):
                share = shares[b, i]
                if share == 0:
                    continue
                for k in range(out.shape[2]):
                    one, other, line = table[0, r, b, i, k], table[1, r, b, i, k], out[r, b, k]
                    for c in range(line.shape[0]):
                        line[c] += share * (one[c] + other[c])
            for k in range(out.shape[2]):
                for c in range(out.shape[3]):
                    out[r, b, k, c] *= scale[r, c]


@njit(cache=True, nogil=True, error_model="numpy")
def add_light(
    sums: CellSums, windows: CellWindows, grid: Grid, spread: Spread, tint: Singles, room: Room, out: Singles
) -> None:
    """Add to out (H, W, n) what the windows record of the cells.

    tint (T, H, W): what pixels multiply each channel of matt light by. Channel k goes to channel min(k, n - 1) of out,
    and if there is one, to all.
    """
    channels, step = sums.matt.shape[2], out.shape[2]
    flat = out.reshape((out.shape[0], -1))
    for y in range(grid.height):
        if windows.inside[y] == 0 and windows.outside[y] == 0:
            continue
        for o in range(max(channels, step)):
            k, to = min(o, channels - 1), min(o, step - 1)
            colour = tint[min(o, tint.shape[0] - 1), y]
            both = sums.plain.shape[1] > 0 and k < sums.plain.shape[2]
            if o == 0 or channels > 1:
                _fill_wide(sums.matt, windows, y, k, grid, room, 0)
                if both:
                    _fill_wide(sums.plain, windows, y, k, grid, room, 2)
            if step == 1:
                _blend(spread.weights, y, room.wide, both, grid.pitch, colour, flat[y])
            else:
                room.light[:] = 0
                _blend(spread.weights, y, room.wide, both, grid.pitch, colour, room.light)
                for x in range(grid.width):
                    flat[y, to + step * x] += room.light[x]
            for i in range(spread.first[y], spread.first[y + 1]):
                x, cell = spread.odd[i, 0] - y * grid.width, spread.odd[i, 1]
                held = colour[x] * _held_by_cell(sums.matt, cell, k, grid, windows, y)
                if both:
                    held += _held_by_cell(sums.plain, cell, k, grid, windows, y)
                out[y, x, to] += held * spread.share[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_wide(sums: Singles, windows: CellWindows, y: int, k: int, grid: Grid, room: Room, first: int) -> None:
    """room.wide[first] and the next: what camera row y's window records of the cells above and below its pixels."""
    r, _ = between(y, grid.pitch, grid.rows)
    for n in range(2):
        _gate_line(sums[min(r + n, grid.rows - 1)], windows, y, k, room.lines[n, k])
        _widen(room.lines[n, k], grid.pitch, room.wide[first + n])


@njit(cache=True, nogil=True, error_model="numpy")
def _place(share: float, bands: int) -> tuple[int, np.float32]:
    """The band that a share of the projector's rows falls into, and the part of it that lies before."""
    at = min(max(share, 0.0), 1.0) * bands
    band = min(int(at), bands - 1)
    return band, np.float32(at - band)


@njit(cache=True, nogil=True, error_model="numpy")
def _gate_line(sums: Singles, windows: CellWindows, y: int, k: int, line: Singles) -> None:
    """line (W,) = what camera row y's window records of one row of cells, sums (B + 1, C, W), in channel k."""
    bands = sums.shape[0] - 1
    i, s = _place(windows.low[y], bands)
    j, t = _place(windows.high[y], bands)
    outside = np.float32(windows.outside[y])
    more, one = np.float32(windows.inside[y]) - outside, np.float32(1)
    s0, s1, t0, t1 = more * (one - s), more * s, more * (one - t), more * t
    for c in range(line.shape[0]):
        held = t0 * sums[j, k, c] + t1 * sums[j + 1, k, c] - s0 * sums[i, k, c] - s1 * sums[i + 1, k, c]
        line[c] = outside * sums[bands, k, c] + held


@njit(cache=True, nogil=True, error_model="numpy")
def _held_by_cell(sums: Singles, cell: int, k: int, grid: Grid, windows: CellWindows, y: int) -> np.float32:
    """What camera row y's window records of one cell."""
    one_cell = sums[cell // grid.columns, :, :, cell % grid.columns : cell % grid.columns + 1]
    line = np.empty(1, np.float32)
    _gate_line(one_cell, windows, y, k, line)
    return np.float32(line[0])


@njit(cache=True, nogil=True, error_model="numpy")
def _widen(line: Singles, pitch: int, out: Singles) -> None:
    """Every cell of line (W,) pitch times, the first and the last once more, into out ((W + 2) pitch,)."""
    cells = line.shape[0]
    for i in range(pitch):
        out[i], out[(cells + 1) * pitch + i] = line[0], line[cells - 1]
    if pitch == 8:
        for c in range(cells):
            v, o = line[c], 8 * c + 8
            out[o], out[o + 1], out[o + 2], out[o + 3] = v, v, v, v
            out[o + 4], out[o + 5], out[o + 6], out[o + 7] = v, v, v, v
        return
    for c in range(cells):
        for i in range(pitch):
            out[(c + 1) * pitch + i] = line[c]


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz", "contract"}, error_model="numpy")
def _blend(weights: Bytes, y: int, wide: Singles, both: bool, pitch: int, tint: Singles, out: Singles) -> None:
    """Add to out (width,) the cells about each pixel by its weights: matt light times tint, and plain light if both.

    wide: as from `_widen`, so what lies after a pixel's middle stands a pitch after what lies before it.
    """
    up_left, up_right, down_left, down_right = weights[0, y], weights[1, y], weights[2, y], weights[3, y]
    start, unit = pitch - pitch // 2, np.float32(1.0 / 255.0)
    a, c = wide[0, start:], wide[1, start:]
    b, d = a[pitch:], c[pitch:]
    # Straight runs over whole rows, which the compiler turns into vector code.
    if not both:
        for x in range(out.shape[0]):
            light = np.float32(up_left[x]) * a[x] + np.float32(up_right[x]) * b[x]
            light += np.float32(down_left[x]) * c[x] + np.float32(down_right[x]) * d[x]
            out[x] += light * unit * tint[x]
        return
    p, r = wide[2, start:], wide[3, start:]
    q, s = p[pitch:], r[pitch:]
    for x in range(out.shape[0]):
        t = tint[x]
        light = np.float32(up_left[x]) * (a[x] * t + p[x]) + np.float32(up_right[x]) * (b[x] * t + q[x])
        light += np.float32(down_left[x]) * (c[x] * t + r[x]) + np.float32(down_right[x]) * (d[x] * t + s[x])
        out[x] += light * unit
