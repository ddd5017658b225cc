"""Smoothing of baked cells by their likes."""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.cells import CellGuides, likeness
from slopegate.core.light.kernels_bake import Grid
from slopegate.core.rig.arrays import Singles

REACH: Final = 0.08
"""Cells are averaged over this share of the mean distance (harmonic) to what their light comes from: so far it hardly
changes (Ward, Rubinstein and Clear 1988)."""


@njit(cache=True, nogil=True, error_model="numpy")
def smoothing_weights(grid: Grid, cells: CellGuides, nearness: Singles, radius: int, out: Singles) -> None:
    """Weights out (R, W, (2 radius + 1)^2) of the cells about each cell: a bell over cells times their likeness.

    They are symmetric and add up to 1 at every cell, so smoothing never moves the sum over the picture.
    """
    across = 2 * radius + 1
    sums = np.zeros((grid.rows, grid.columns), np.float32)
    for r in range(grid.rows):
        for c in range(grid.columns):
            own = r * grid.columns + c
            x, y, z = cells.point[own, 0], cells.point[own, 1], cells.point[own, 2]
            nx, ny, nz = cells.normal[own, 0], cells.normal[own, 1], cells.normal[own, 2]
            for dr in range(-radius, radius + 1):
                for dc in range(-radius, radius + 1):
                    a, b = r + dr, c + dc
                    w = 0.0
                    if 0 <= a < grid.rows and 0 <= b < grid.columns and (dr != 0 or dc != 0):
                        other = a * grid.columns + b
                        size = max(cells.size[own], cells.size[other])
                        w = likeness(x, y, z, nx, ny, nz, other, size, cells)
                        w *= np.exp(-1.5 * (dr * dr + dc * dc) / (radius * radius))
                        dx, dy, dz = cells.point[other, 0] - x, cells.point[other, 1] - y, cells.point[other, 2] - z
                        far = max(nearness[r, c], nearness[a, b]) / REACH
                        w *= np.exp(-0.5 * (dx * dx + dy * dy + dz * dz) * far * far)
                    out[r, c, (dr + radius) * across + dc + radius] = w
                    sums[r, c] += w
    for r in range(grid.rows):
        for c in range(grid.columns):
            total = 0.0
            for dr in range(-radius, radius + 1):
                for dc in range(-radius, radius + 1):
                    n = (dr + radius) * across + dc + radius
                    if out[r, c, n] > 0:
                        out[r, c, n] /= 1.0 + max(sums[r, c], sums[r + dr, c + dc])
                        total += out[r, c, n]
            out[r, c, radius * across + radius] = 1.0 - total


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz", "contract"})
def smooth(light: Singles, weights: Singles, radius: int, out: Singles) -> None:
    """out (R, B, C, W) = the cells of `light` averaged by the weights (R, W, (2 radius + 1)^2)."""
    rows, bands, channels, columns = light.shape
    across = 2 * radius + 1
    line = np.empty(columns, np.float32)
    out[...] = 0
    for r in range(rows):
        for n in range(across * across):
            a, dc = r + n // across - radius, n % across - radius
            if a < 0 or a >= rows:
                continue
            low, high = max(0, -dc), min(columns, columns - dc)
            for c in range(columns):
                line[c] = weights[r, c, n]
            share = line[low:high]
            for b in range(bands):
                for k in range(channels):
                    to, other = out[r, b, k, low:high], light[a, b, k, low + dc : high + dc]
                    for c in range(to.shape[0]):
                        to[c] += share[c] * other[c]
