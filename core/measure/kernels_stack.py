"""The loops over frames and slices of a capture, compiled; nothing else. They allocate nothing and release the lock."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Singles = NDArray[np.float32]


@njit(cache=True, nogil=True)
def accumulate(image: NDArray[np.uint16], total: NDArray[np.uint32], max_count: int) -> int:
    """Add an image (H, W) to a total; returns how many pixels are at max_count or above."""
    height, width = image.shape
    saturated = 0
    for row in range(height):
        for column in range(width):
            count = image[row, column]
            total[row, column] += count
            saturated += count >= max_count
    return saturated


@njit(cache=True, nogil=True)
def count_above(image: NDArray[np.uint16], floor: Singles) -> int:
    """How many pixels (H, W) lie above their floor."""
    height, width = image.shape
    found = 0
    for row in range(height):
        for column in range(width):
            found += np.float32(image[row, column]) > floor[row, column]
    return found


@njit(cache=True, nogil=True)
def add_slice(
    light: Singles,
    index: int,
    colour: Singles,
    floor: float,
    total: Singles,
    overlay: Singles,
    last: Singles,
    best: Singles,
    before: Singles,
    after: Singles,
    best_index: NDArray[np.int32],
) -> None:
    """Take slice `index` (H, W) of a sequence into the sums and into what is known about each pixel's brightest one.

    total (H, W) += light; overlay (H, W, 3) += light * colour (3,). best, before and after (H, W): the brightest value
    and those of its neighbours in the sequence, 0 below `floor`; best_index (H, W): its index, -1 before any. last
    (H, W) holds the slice before.
    """
    height, width = light.shape
    for row in range(height):
        for column in range(width):
            value = light[row, column]
            total[row, column] += value
            for channel in range(3):
                overlay[row, column, channel] += value * colour[channel]
            clipped = value if value >= floor else np.float32(0.0)
            if clipped > best[row, column]:
                best[row, column] = clipped
                before[row, column] = last[row, column]
                after[row, column] = 0.0
                best_index[row, column] = index
            elif best_index[row, column] == index - 1 and index > 0:
                after[row, column] = clipped
            last[row, column] = clipped
