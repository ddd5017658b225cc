"""Windows and planes in the form that the kernels take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from slopegate.core.gate import RowWindows
from slopegate.core.kernels import TILE, Pixels, Planes, Singles, Windows, tile_bounds


def kernel_windows(windows: RowWindows) -> Windows:
    """Round the edges up to float32: then r < edge and r >= edge have the same truth for every float32 r.

    So float32 kernels decide exactly as float64 ones would, and windows that share an edge still share it.
    """
    return Windows(_round_up(windows.low), _round_up(windows.high), windows.inside, windows.outside)


def _round_up(edges: NDArray[np.float64]) -> Singles:
    nearest = edges.astype(np.float32)
    return np.where(nearest < edges, np.nextafter(nearest, np.float32(np.inf)), nearest)


def make_planes(projector_row: Singles, direct: Pixels, ambient: Pixels, skip: bool = True) -> Planes:
    """Planes (H, W) with their tile tables; the arrays are kept, not copied. Without `skip` no tile is left out."""
    height, width = projector_row.shape
    low = np.empty((height, -(-width // TILE)), np.float32)
    high = np.empty_like(low)
    if skip:
        tile_bounds(projector_row, (0, height), low, high)
    else:
        low[...], high[...] = -1, np.inf
    return Planes(projector_row, direct, ambient, low, high, np.empty(low.shape, np.int32))


def some_rows(planes: Planes, windows: Windows, first: int, last: int) -> tuple[Planes, Windows]:
    """What belongs to camera rows first .. last - 1, as views."""
    rows = slice(first, last)
    cut = Planes(
        planes.projector_row[rows],
        planes.direct[rows],
        planes.ambient[rows],
        planes.tile_low[rows],
        planes.tile_high[rows],
        planes.tile_weight[rows],
    )
    return cut, Windows(windows.low[rows], windows.high[rows], windows.inside[rows], windows.outside[rows])
