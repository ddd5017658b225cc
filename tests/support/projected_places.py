"""A small projector's picture, and places all over its raster."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.patterns import Raster

RASTER = Raster(13, 7)


def picture() -> NDArray[np.float32]:
    return np.random.default_rng(2).uniform(0, 1, (7, 13)).astype(np.float32)


def places(count: tuple[int, ...] = (40, 50)) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rows and columns all over the raster up to its last float32, every tenth place unlit."""
    rng = np.random.default_rng(3)
    row, column = (rng.uniform(0, length, count).astype(np.float32) for length in (7, 13))
    row[0, :2], column[0, :2] = np.nextafter(np.float32(7), np.float32(0)), np.nextafter(np.float32(13), np.float32(0))
    unlit = rng.random(count) < 0.1
    row[unlit] = column[unlit] = -1
    return row, column
