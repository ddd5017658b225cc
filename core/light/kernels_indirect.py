"""The compiled look-up of indirect light: what each camera row's window holds of the cells, spread over its pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from slopegate.core.light.kernels_bake import Grid
from slopegate.core.light.smoothing import Spread, between
from slopegate.core.rig.arrays import Doubles, Ints, Singles


@njit(cache=True, nogil=True, error_model="numpy")
def add_light(
    sums: Singles,
    edges: tuple[Doubles, Doubles],
    times: tuple[Ints, Ints],
    grid: Grid,
    spread: Spread,
    tint: Singles,
    lines: Singles,
    out: Singles,
) -> None:
    """Add to out (H, W, n) what the windows record of the cells.

    sums (R, B + 1, C, W): light of all bands before each; edges: low and high (H,) of every camera row's window, in
    bands; times: how often it records what is inside and outside; tint (T, H, W): what pixels multiply each channel
    by, T = 0 for nothing; lines (2, C, W): room. Channel k goes to channel min(k, n - 1) of out, and if C is 1 to all.
    """
    low, high = edges
    inside, outside = times
    channels = sums.shape[2]
    for y in range(grid.height):
        if inside[y] == 0 and outside[y] == 0:
            continue
        r, _ = between(y, grid.pitch, grid.rows)
        for n in range(2):
            row = min(r + n, grid.rows - 1)
            _gate_line(sums[row], low[y], high[y], np.float32(inside[y]), np.float32(outside[y]), lines[n])
        for o in range(max(channels, out.shape[2])):
            k, to = min(o, channels - 1), min(o, out.shape[2] - 1)
            _spread_line(y, grid, spread, tint, k if channels > 1 else to, lines[:, k], to, out)
        for i in range(spread.first[y], spread.first[y + 1]):
            x, cell = spread.odd[i, 0] - y * grid.width, spread.odd[i, 1]
            cells = sums[cell // grid.columns]
            for o in range(max(channels, out.shape[2])):
                k, to = min(o, channels - 1), min(o, out.shape[2] - 1)
                light = _gate_cell(cells, k, cell % grid.columns, low[y], high[y], inside[y], outside[y])
                if tint.shape[0] > 0:
                    light *= tint[min(o, tint.shape[0] - 1), y, x]
                out[y, x, to] += light


@njit(cache=True, nogil=True, error_model="numpy")
def _gate_line(sums: Singles, low: float, high: float, inside: np.float32, outside: np.float32, line: Singles) -> None:
    """line (C, W) = what a window records of one row of cells, sums (B + 1, C, W)."""
    bands = sums.shape[0] - 1
    a, b = min(max(low, 0.0), float(bands)), min(max(high, 0.0), float(bands))
    i, j = min(int(a), bands - 1), min(int(b), bands - 1)
    s, t = np.float32(a - i), np.float32(b - j)
    more = inside - outside
    s0, s1, t0, t1 = more * (np.float32(1) - s), more * s, more * (np.float32(1) - t), more * t
    for k in range(line.shape[0]):
        for c in range(line.shape[1]):
            held = t0 * sums[j, k, c] + t1 * sums[j + 1, k, c] - s0 * sums[i, k, c] - s1 * sums[i + 1, k, c]
            line[k, c] = outside * sums[bands, k, c] + held


@njit(cache=True, nogil=True, error_model="numpy")
def _gate_cell(sums: Singles, k: int, c: int, low: float, high: float, inside: int, outside: int) -> float:
    """What a window records of one cell."""
    bands = sums.shape[0] - 1
    a, b = min(max(low, 0.0), float(bands)), min(max(high, 0.0), float(bands))
    i, j = min(int(a), bands - 1), min(int(b), bands - 1)
    before = sums[i, k, c] + (a - i) * (sums[i + 1, k, c] - sums[i, k, c])
    after = sums[j, k, c] + (b - j) * (sums[j + 1, k, c] - sums[j, k, c])
    return float(outside * sums[bands, k, c] + (inside - outside) * (after - before))


@njit(cache=True, nogil=True, error_model="numpy")
def _spread_line(
    y: int, grid: Grid, spread: Spread, tint: Singles, which: int, lines: Singles, to: int, out: Singles
) -> None:
    """Add one camera row: lines (2, W), the rows of cells above and below it, by the pixels' weights."""
    weights = spread.weights
    unit = np.float32(1.0 / 255.0)
    half = grid.pitch // 2
    end = 0
    for c in range(grid.columns):
        # Pixels whose middle lies between the middles of cells c and c + 1; the first and last take the margins.
        begin = end
        end = min((c + 1) * grid.pitch + half, grid.width) if c < grid.columns - 2 else grid.width
        d = min(c + 1, grid.columns - 1)
        a0, a1 = lines[0, c] * unit, lines[0, d] * unit
        b0, b1 = lines[1, c] * unit, lines[1, d] * unit
        for x in range(begin, end):
            light = (
                np.float32(weights[0, y, x]) * a0
                + np.float32(weights[1, y, x]) * a1
                + np.float32(weights[2, y, x]) * b0
                + np.float32(weights[3, y, x]) * b1
            )
            if tint.shape[0] > 0:
                light *= tint[which, y, x]
            out[y, x, to] += light
