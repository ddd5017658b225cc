"""Numba loops that draw: silhouettes of bodies into cells, surface nets into maps of inverse depth."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bits = NDArray[np.uint32]


@njit(cache=True, nogil=True)
def fill_triangles(points: Doubles, faces: Ints, margin: float, bit: np.uint32, grid: Bits) -> None:
    """Set `bit` in every cell of `grid` that a triangle touches, or passes by less than `margin` cells.

    points (P, 2): column and row coordinates; cell (r, c) covers [r, r + 1) x [c, c + 1).
    """
    height, width = grid.shape
    for f in range(faces.shape[0]):
        y0, y1, y2 = points[faces[f, 0], 1], points[faces[f, 1], 1], points[faces[f, 2], 1]
        first = int(max(np.floor(min(y0, y1, y2) - margin), 0.0))
        last = int(min(np.floor(max(y0, y1, y2) + margin), height - 1.0))
        for row in range(first, last + 1):
            low, high = row - margin, row + 1.0 + margin
            left, right = np.inf, -np.inf
            for edge in range(3):
                ax, ay = points[faces[f, edge], 0], points[faces[f, edge], 1]
                bx, by = points[faces[f, (edge + 1) % 3], 0], points[faces[f, (edge + 1) % 3], 1]
                if max(ay, by) < low or min(ay, by) > high:
                    continue
                slope = (bx - ax) / (by - ay) if ay != by else 0.0
                for y, x in ((ay, ax), (by, bx)):
                    cut = min(max(y, low), high)
                    at = x + (cut - y) * slope
                    left, right = min(left, at), max(right, at)
            start = int(max(np.floor(left - margin), 0.0))
            end = int(min(np.floor(right + margin), width - 1.0))
            for column in range(start, end + 1):
                grid[row, column] |= bit


@njit(cache=True, nogil=True)
def look_up(directions: Singles, left: float, top: float, scale: float, grid: Bits, out: Bits) -> None:
    """out (R,) = the cell of `grid` in which directions (R, 2), x/z and y/z, lie; 0 outside it and for NaN.

    left, top: where the grid starts; scale: cells per unit of x/z.
    """
    for i in range(out.shape[0]):
        column, row = (directions[i, 0] - left) * scale, (directions[i, 1] - top) * scale
        inside = 0.0 <= column < grid.shape[1] and 0.0 <= row < grid.shape[0]
        out[i] = grid[int(row), int(column)] if inside else 0


@njit(cache=True, nogil=True)
def _joined(a: float, b: float, share: float, step: float) -> bool:
    return a > 0 and b > 0 and abs(a - b) <= max(share * max(a, b), step)


@njit(cache=True, nogil=True)
def _draw_triangle(net: Singles, i: int, j: int, k: int, m: int, n: int, o: int, out: Singles) -> None:
    """Draw net[i, j], net[k, m], net[n, o] into the cells of `out` whose centres it covers, nearest surface kept."""
    x0, y0, w0 = np.float64(net[i, j, 0]) - 0.5, np.float64(net[i, j, 1]) - 0.5, np.float64(net[i, j, 2])
    ax, ay, aw = net[k, m, 0] - 0.5 - x0, net[k, m, 1] - 0.5 - y0, net[k, m, 2] - w0
    bx, by, bw = net[n, o, 0] - 0.5 - x0, net[n, o, 1] - 0.5 - y0, net[n, o, 2] - w0
    area = ax * by - ay * bx
    if abs(area) < 1e-9:
        return
    left = max(int(np.ceil(x0 + min(0.0, ax, bx) - 1e-3)), 0)
    right = min(int(np.floor(x0 + max(0.0, ax, bx) + 1e-3)), out.shape[1] - 1)
    top = max(int(np.ceil(y0 + min(0.0, ay, by) - 1e-3)), 0)
    bottom = min(int(np.floor(y0 + max(0.0, ay, by) + 1e-3)), out.shape[0] - 1)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            px, py = column - x0, row - y0
            s, t = (px * by - py * bx) / area, (ax * py - ay * px) / area
            # Float32 places a corner to 1e-4 of a cell: neighbours overlap by a little more than that.
            if s >= -1e-3 and t >= -1e-3 and s + t <= 1.001:
                w = w0 + s * aw + t * bw
                out[row, column] = max(out[row, column], w)


@njit(cache=True, nogil=True)
def draw_net(net: Singles, share: float, step: float, out: Singles) -> None:
    """Draw a surface net (H, W, 3) of cell column, cell row, inverse depth (0 = none) into `out`, nearest kept.

    Neighbours are joined unless they differ by more than `share` of the larger and more than `step`. Every pixel
    covers at least the cell that it falls into.
    """
    height, width = net.shape[0], net.shape[1]
    for i in range(height):
        for j in range(width):
            w = net[i, j, 2]
            if not w > 0:
                continue
            if 0 <= net[i, j, 0] < out.shape[1] and 0 <= net[i, j, 1] < out.shape[0]:
                row, column = int(net[i, j, 1]), int(net[i, j, 0])
                out[row, column] = max(out[row, column], w)
            if i + 1 == height or j + 1 == width:
                continue
            right, down, across = net[i, j + 1, 2], net[i + 1, j, 2], net[i + 1, j + 1, 2]
            if _joined(right, down, share, step):
                if _joined(w, right, share, step) and _joined(w, down, share, step):
                    _draw_triangle(net, i, j, i, j + 1, i + 1, j, out)
                if _joined(across, right, share, step) and _joined(across, down, share, step):
                    _draw_triangle(net, i + 1, j + 1, i, j + 1, i + 1, j, out)
