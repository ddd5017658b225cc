"""Frames with the whole projector lit and with it black: a slice's light, its noise, and whether there is any."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.measure.stack import DARK_SIGMAS
from slopegate.core.rig.arrays import Counts, Singles, Words
from slopegate.core.transport.noise import FrameNoise

ROUNDING_VARIANCE: Final = 1 / 12
"""counts^2: of rounding to whole counts, which is left where there is no other noise."""
_SQUARE: Final = 8
"""Pixels along a side that are looked at together for faint light."""


class RepeatedFrames:
    """Adds up frames (H, W) of one view: their mean, and how they differ from each other."""

    def __init__(self, shape: tuple[int, int], max_count: int) -> None:
        """max_count: of the sensor; pixels that have it are saturated."""
        self.count = 0
        self._max_count = max_count
        self._first = np.zeros(shape, np.uint16)
        self._total = np.zeros(shape, np.uint32)
        self._squares = np.zeros(shape, np.float32)
        self._saturated = 0

    def add(self, image: Counts) -> None:
        """One frame more."""
        if self.count == 0:
            self._first[:] = image
        self._saturated += int(_add(image, self._first, self._max_count, self._total, self._squares))
        self.count += 1

    @property
    def mean(self) -> Singles:
        """Mean counts (H, W) float32."""
        return (self._total / np.float64(self.count)).astype(np.float32)

    @property
    def saturated_share(self) -> float:
        """Share of the pixels, over all frames, at the sensor's largest count."""
        return self._saturated / (self.count * self._total.size)

    @property
    def variance(self) -> float:
        """counts^2, of a pixel from frame to frame: mean over the image. Needs two frames."""
        off = self._total.astype(np.float32) - np.float32(self.count) * self._first
        scatter = self._squares.sum(dtype=np.float64) - (off.astype(np.float64) ** 2).sum() / self.count
        return float(scatter / ((self.count - 1) * off.size))


def measured_noise(black: RepeatedFrames, white: RepeatedFrames) -> FrameNoise:
    """Noise of one frame, from at least two with the projector black and two with all lit.

    Never below that of rounding to whole counts.
    """
    read = max(black.variance, ROUNDING_VARIANCE)
    light = float((white.mean - black.mean).mean(dtype=np.float64))
    return FrameNoise(read, max(white.variance - read, 0.0) / light if light > 0 else 0.0)


@dataclass(frozen=True, eq=False)
class EvenLight:
    """What a gate sees with the projector black, and what all of its light adds to that.

    black and light (H, W) float32 counts; frames: how many each is the mean of; noise: of a single frame.
    """

    black: Singles
    light: Singles
    frames: int
    noise: FrameNoise

    @property
    def is_dark(self) -> bool:
        """Whether no light of the projector stands out of the noise, in a pixel or in a small square of them."""
        floor = DARK_SIGMAS * float(np.sqrt(2 * self.noise.read_variance / self.frames))
        side = min(_SQUARE, *self.light.shape)
        return float(self.light.max()) <= floor and float(cv2.blur(self.light, (side, side)).max()) <= floor / side


def even_light(black: RepeatedFrames, white: RepeatedFrames, noise: FrameNoise) -> EvenLight:
    """From as many frames with the projector black as with all lit."""
    return EvenLight(black.mean, white.mean - black.mean, white.count, noise)


def nonlinear_share(pair: Singles, even: EvenLight) -> float:
    """What a pattern and its inverse, frames that were added up to (H, W) counts, differ from all on, over all on.

    Less what noise alone may make of it, 0 where that is all.
    """
    whole = float(even.light.sum(dtype=np.float64))
    summed = float((pair - 2 * even.black).sum(dtype=np.float64))
    variance = 8 * even.noise.read_variance * even.light.size + 2 * even.noise.variance_per_count * max(whole, 0.0)
    beyond = abs(summed - whole) - DARK_SIGMAS * float(np.sqrt(variance))
    return max(beyond, 0.0) / whole if whole > 0 else 0.0


@njit(cache=True, nogil=True)
def _add(image: Counts, first: Counts, max_count: int, total: Words, squares: Singles) -> int:
    """Add an image (H, W) to the total and the squares of its difference from the first; how many are saturated."""
    saturated = 0
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            count = image[row, column]
            off = np.float32(count) - np.float32(first[row, column])
            total[row, column] += count
            squares[row, column] += off * off
            saturated += count >= max_count
    return saturated
