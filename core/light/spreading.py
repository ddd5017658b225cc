"""How pixels take their light from the cells about them: in between, but only from surfaces like their own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.cells import CellGuides, likeness
from slopegate.core.light.kernels_bake import Grid, SeenPixels
from slopegate.core.rig.arrays import Bools, Bytes, Doubles, Indices, Singles

_LIKE_ENOUGH = 0.02


class Spread(NamedTuple):
    """Weights (4, H, W), parts of 255, of the cells above left, above right, below left and below right of each pixel.

    odd (N, 2): pixels, row by row, that see something else than these cells, and the cell that they take instead, with
    the weight share (N,) beside the four; first (H + 1,): where the odd pixels of each row begin.
    """

    weights: Bytes
    odd: Indices
    share: Singles
    first: Indices


class SubPixels(NamedTuple):
    """What the camera sees through one place of every pixel, and how much that counts in each, (H, W) float32."""

    view: SeenPixels
    amount: Singles


def make_spread(grid: Grid, cells: CellGuides, camera: Doubles, places: Iterable[SubPixels]) -> Spread:
    """The weights of the cells in every pixel: means over places in the pixel, by how much these count."""
    sums = np.zeros((4, grid.height, grid.width), np.float32)
    total = np.zeros((grid.height, grid.width), np.float32)
    pixels, homes, shares = [], [], []
    for view, amount in places:
        odd = np.zeros((grid.height, grid.width), np.bool_)
        _add_weights(grid, view, cells, camera, amount, sums, odd)
        total += amount
        found = np.flatnonzero(odd & (amount > 0))
        pixels.append(found)
        homes.append(view.home[found].astype(np.int64))
        shares.append(amount.ravel()[found])
    flat = np.concatenate(pixels)
    order = np.argsort(flat, kind="stable")
    odd_pixels = np.stack([flat, np.concatenate(homes)], axis=1)[order]
    whole = np.where(total > 0, total, np.float32(1))
    share = np.concatenate(shares)[order] / whole.ravel()[odd_pixels[:, 0]]
    first = np.searchsorted(odd_pixels[:, 0], np.arange(grid.height + 1) * grid.width)
    weights = np.empty(sums.shape, np.uint8)
    sums /= whole
    _round_weights(sums, weights)
    return Spread(weights, odd_pixels, share.astype(np.float32), first)


@njit(cache=True, nogil=True, error_model="numpy")
def between(pixel: int, pitch: int, count: int) -> tuple[int, float]:
    """The cell before a pixel's middle, and how far the pixel is on the way to the next one's middle, 0 to 1."""
    place = min(max((pixel + 0.5) / pitch - 0.5, 0.0), count - 1.0)
    cell = min(int(place), max(count - 2, 0))
    return cell, place - cell


@njit(cache=True, nogil=True, error_model="numpy")
def _add_weights(
    grid: Grid, view: SeenPixels, cells: CellGuides, camera: Doubles, amount: Singles, sums: Singles, odd: Bools
) -> None:
    w = np.empty(4)
    for y in range(grid.height):
        r, down = between(y, grid.pitch, grid.rows)
        for x in range(grid.width):
            p = y * grid.width + x
            c, right = between(x, grid.pitch, grid.columns)
            depth = view.depth[p]
            total = 0.0
            for n in range(4):
                other = min(r + n // 2, grid.rows - 1) * grid.columns + min(c + n % 2, grid.columns - 1)
                w[n] = (down if n >= 2 else 1.0 - down) * (right if n % 2 else 1.0 - right)
                if view.kind[p] >= 0:
                    px, py = camera[0] + depth * view.rays[p, 0], camera[1] + depth * view.rays[p, 1]
                    nx, ny, nz = view.normal[p, 0], view.normal[p, 1], view.normal[p, 2]
                    w[n] *= likeness(px, py, camera[2] + depth, nx, ny, nz, other, cells.size[other], cells)
                total += w[n]
            if total < _LIKE_ENOUGH:
                odd[y, x] = True
                continue
            for n in range(4):
                sums[n, y, x] += np.float32(amount[y, x] * w[n] / total)


@njit(cache=True, nogil=True, error_model="numpy")
def _round_weights(exact: Singles, out: Bytes) -> None:
    """To parts of 255 whose sum is right: what rounding leaves goes to the largest."""
    for y in range(out.shape[1]):
        for x in range(out.shape[2]):
            total, most, given = 0.0, 0, 0
            for n in range(4):
                total += exact[n, y, x]
                out[n, y, x] = int(255.0 * exact[n, y, x])
                given += int(out[n, y, x])
                if exact[n, y, x] > exact[most, y, x]:
                    most = n
            out[most, y, x] += max(round(255.0 * total) - given, 0)
