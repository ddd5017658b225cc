"""What the counts of a region tell, and those along a line."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bools, Counts, Doubles

MOST_SAMPLES = 400_000
"""Of a profile: a wide, long line is sampled in fewer lines beside one another."""


@dataclass(frozen=True)
class RegionCounts:
    """Figures of the counts of a region, in counts; shares from 0 to 1."""

    pixels: int
    mean: float
    std: float
    """Standard deviation from pixel to pixel."""
    least: int
    median: float
    most: int
    saturated: float
    """Share of the pixels at the camera's greatest count."""
    dark: float
    """Share of the pixels with at most the count that is called too dark."""


def region_counts(counts: Counts, inside: Bools | None, max_count: int, dark_count: int) -> RegionCounts | None:
    """Exact figures of the pixels (H, W) of `counts` that are `inside` (None: all); None where there is no pixel."""
    mask = None if inside is None else np.ascontiguousarray(inside, np.uint8)
    size = max_count + 1
    # of 12 or 16 bits this is the quickest pass over the pixels, and all figures follow from it without rounding
    found = cv2.calcHist([np.ascontiguousarray(counts)], [0], mask, [size], [0, size])
    many = found.ravel().astype(np.float64)
    pixels = round(float(many.sum()))
    if pixels == 0:
        return None
    values = np.arange(size, dtype=np.float64)
    mean = float(many @ values) / pixels
    variance = float(many @ (values - mean) ** 2) / pixels
    present, rising = np.flatnonzero(many), np.cumsum(many)
    middle = np.searchsorted(rising, [(pixels - 1) // 2 + 0.5, pixels // 2 + 0.5])
    return RegionCounts(
        pixels,
        mean,
        math.sqrt(max(variance, 0.0)),
        int(present[0]),
        float(middle.mean()),
        int(present[-1]),
        float(many[max_count]) / pixels,
        float(many[: dark_count + 1].sum()) / pixels,
    )


def mosaic_parts(counts: Counts, inside: Bools | None, pattern: str) -> dict[str, tuple[Counts, Bools | None]]:
    """The pixels of each filter of a mosaic (H, W), by its letter; both greens together, as (2, H/2, W/2).

    pattern: the filters of the first two rows, as RGGB.
    """
    places: dict[str, list[tuple[int, int]]] = {}
    for index, letter in enumerate(pattern):
        places.setdefault(letter, []).append((index // 2, index % 2))
    height, width = counts.shape[0] // 2 * 2, counts.shape[1] // 2 * 2

    def part(pixels: Counts | Bools, letter: str) -> np.ndarray:
        found = [pixels[y:height:2, x:width:2] for y, x in places[letter]]
        return np.concatenate(found)

    return {
        letter: (part(counts, letter), None if inside is None else part(inside, letter)) for letter in sorted(places)
    }


def line_counts(counts: Counts, start: tuple[float, float], end: tuple[float, float], width_px: int = 1) -> Doubles:
    """Counts along a line from start to end (continuous column and row): (N,) or (N, 3) as `counts` is (H, W[, 3]).

    One value a pixel of its length, from the first end to the last, between pixels by the four around; the mean of
    `width_px` lines beside one another, a pixel apart. Beyond the image the nearest pixel counts.
    """
    start_xy, end_xy = np.asarray(start, np.float64), np.asarray(end, np.float64)
    length = float(np.hypot(*(end_xy - start_xy)))
    steps = max(round(length), 1) + 1
    along = start_xy + np.linspace(0.0, 1.0, steps)[:, None] * (end_xy - start_xy)
    across = np.array([-(end_xy - start_xy)[1], (end_xy - start_xy)[0]]) / max(length, 1e-9)
    beside = np.arange(width_px) - (width_px - 1) / 2
    beside = beside[:: max(1, -(-steps * width_px // MOST_SAMPLES))]
    x, y = np.moveaxis(along[:, None] + beside[:, None] * across, -1, 0)
    return np.asarray(_between(counts, x - 0.5, y - 0.5).mean(axis=1), np.float64)


def _between(counts: Counts, x: Doubles, y: Doubles) -> Doubles:
    """Counts between pixel centres, which lie at whole numbers here: of the shape of x and y, (..., 3) of colour."""
    x, y = np.clip(x, 0.0, counts.shape[1] - 1.0), np.clip(y, 0.0, counts.shape[0] - 1.0)
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, below = np.minimum(column + 1, counts.shape[1] - 1), np.minimum(row + 1, counts.shape[0] - 1)
    u, v = x - column, y - row
    if counts.ndim == 3:
        u, v = u[..., None], v[..., None]
    upper = counts[row, column] * (1 - u) + counts[row, right] * u
    lower = counts[below, column] * (1 - u) + counts[below, right] * u
    return np.asarray(upper * (1 - v) + lower * v, np.float64)
