"""Smoothing of baked cells by their likes, and how pixels take their light from the cells about them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from slopegate.core.light.cells import CellGuides, likeness
from slopegate.core.light.kernels_bake import Grid, SeenPixels
from slopegate.core.rig.arrays import Bools, Bytes, Doubles, Indices, Singles


@njit(cache=True, nogil=True, error_model="numpy")
def smoothing_weights(grid: Grid, cells: CellGuides, radius: int, out: Singles) -> None:
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


@njit(cache=True, nogil=True, error_model="numpy")
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
            for b in range(bands):
                for k in range(channels):
                    for c in range(low, high):
                        out[r, b, k, c] += line[c] * light[a, b, k, c + dc]


class Spread(NamedTuple):
    """How pixels take light from cells: weights (4, H, W), parts of 255, of the cells above left, above right, below
    left and below right of each pixel; odd (N, 2): pixels, row by row, that are like none of them, and the cell that
    they take instead; their weights are 0. first (H + 1,): where the odd pixels of each row begin."""

    weights: Bytes
    odd: Indices
    first: Indices


def make_spread(grid: Grid, view: SeenPixels, cells: CellGuides, camera: Doubles) -> Spread:
    """Linear weights between the middles of cells times how like the pixel's surface is to theirs."""
    weights = np.zeros((4, grid.height, grid.width), np.uint8)
    odd = np.zeros((grid.height, grid.width), np.bool_)
    _pixel_weights(grid, view, cells, camera, weights, odd)
    places = np.flatnonzero(odd)
    first = np.searchsorted(places, np.arange(grid.height + 1) * grid.width)
    pairs = np.stack([places, view.home[places].astype(np.int64)], axis=1)
    return Spread(weights, pairs, first)


@njit(cache=True, nogil=True, error_model="numpy")
def between(pixel: int, pitch: int, count: int) -> tuple[int, float]:
    """The cell before a pixel's middle, and how far the pixel is on the way to the next one's middle, 0 to 1."""
    place = min(max((pixel + 0.5) / pitch - 0.5, 0.0), count - 1.0)
    cell = min(int(place), max(count - 2, 0))
    return cell, place - cell


@njit(cache=True, nogil=True, error_model="numpy")
def _pixel_weights(
    grid: Grid, view: SeenPixels, cells: CellGuides, camera: Doubles, weights: Bytes, odd: Bools
) -> None:
    w = np.empty(4)
    for y in range(grid.height):
        r, down = between(y, grid.pitch, grid.rows)
        for x in range(grid.width):
            p = y * grid.width + x
            c, right = between(x, grid.pitch, grid.columns)
            depth = view.depth[p]
            surface = view.kind[p] >= 0
            total = 0.0
            for n in range(4):
                a, b = min(r + n // 2, grid.rows - 1), min(c + n % 2, grid.columns - 1)
                w[n] = (down if n >= 2 else 1.0 - down) * (right if n % 2 else 1.0 - right)
                if surface:
                    other = a * grid.columns + b
                    w[n] *= likeness(
                        camera[0] + depth * view.rays[p, 0],
                        camera[1] + depth * view.rays[p, 1],
                        camera[2] + depth,
                        view.normal[p, 0],
                        view.normal[p, 1],
                        view.normal[p, 2],
                        other,
                        cells.size[other],
                        cells,
                    )
                total += w[n]
            if total < 0.02:
                odd[y, x] = True
                continue
            # Rounded so that the four add up to 255: what is left goes to the largest.
            rest, most = 255, 0
            for n in range(4):
                weights[n, y, x] = int(255.0 * w[n] / total)
                rest -= int(weights[n, y, x])
                if w[n] > w[most]:
                    most = n
            weights[most, y, x] += rest
