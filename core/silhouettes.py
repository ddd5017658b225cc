"""Where bodies appear to a viewer, drawn a little too large, so that only those rays are cast at them that may hit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from slopegate.core.kernels_draw import fill_triangles, look_up

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bits = NDArray[np.uint32]

MARGIN_CELLS = 0.25
"""By how much silhouettes are drawn too large: far more than float32 misplaces an outline (1e-3 of a cell)."""

NEAREST_M = 1e-3
"""A body nearer than this to the plane of a viewer may be seen anywhere."""

MAX_CELLS = 1 << 22


class Field:
    """What one viewer looks out on: a grid over x/z and y/z in its axes, each cell with a bit for every body there."""

    def __init__(self, centre: Doubles, rotation: Doubles, bounds: tuple[Doubles, Doubles], pitch: float) -> None:
        """bounds: lowest and highest (x/z, y/z) that matter; pitch: the size of a cell, enlarged if there are many."""
        self._centre, self._rotation = centre, rotation
        self._low, high = bounds
        extent = np.maximum(high - self._low, pitch)
        self._scale = 1 / max(pitch, float(np.sqrt(np.prod(extent) / MAX_CELLS)))
        width, height = (np.ceil(extent * self._scale) + 1).astype(int)
        self._grid = np.zeros((height, width), np.uint32)

    def draw(self, outlines: Sequence[tuple[int, Doubles, Ints]]) -> bool:
        """Set each body's bit wherever it may be seen; False when none is anywhere in the field.

        outlines: bit, world points (P, 3) and triangles (T, 3) between them that cover the body.
        """
        self._grid[...] = 0
        for bit, points, faces in outlines:
            local = (points - self._centre) @ self._rotation.T
            depth = local[:, 2]
            if not (depth > 0).any():
                continue
            if (depth <= NEAREST_M).any():
                self._grid |= np.uint32(bit)
                continue
            cells = (local[:, :2] / depth[:, None] - self._low) * self._scale
            fill_triangles(cells, faces, MARGIN_CELLS, np.uint32(bit), self._grid)
        return bool(self._grid.any())

    def bodies(self, directions: Singles) -> Bits:
        """The bits (...) of the bodies that may be seen in directions (..., 2), x/z and y/z; 0 for NaN and outside."""
        bits = np.empty(directions.shape[:-1], np.uint32)
        look_up(directions.reshape(-1, 2), self._low[0], self._low[1], self._scale, self._grid, bits.reshape(-1))
        return bits
