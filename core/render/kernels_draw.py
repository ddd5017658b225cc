"""Numba loops that draw surface nets into maps of inverse depth."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Singles = NDArray[np.float32]


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
