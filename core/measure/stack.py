"""A stack of slices in a few images: their sum, an overlay with a colour a slice, and the depth of every pixel."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import cv2
import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.gating.gate import rows_at_phase
from slopegate.core.rig.arrays import Counts, Ints, Singles, Words
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.triangulate import triangulate


@njit(cache=True, nogil=True)
def accumulate(image: Counts, total: Words, max_count: int) -> int:
    """Add an image (H, W) to a total; returns how many pixels are at max_count or above."""
    height, width = image.shape
    saturated = 0
    for row in range(height):
        for column in range(width):
            count = image[row, column]
            total[row, column] += count
            saturated += count >= max_count
    return saturated


DARK_SIGMAS: Final = 6.0
"""A pixel that stands out of the dark by this many standard deviations is lit. One false alarm in 500 frames of two
million pixels costs a few frames and loses nothing; fainter surfaces count as dark."""


@njit(cache=True, nogil=True)
def count_above(image: Counts, floor: Singles) -> int:
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
    best_index: Ints,
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
            # Noise beside the brightest slice would pull the centroid towards it.
            clipped = value if value >= floor else np.float32(0.0)
            if clipped > best[row, column]:
                best[row, column] = clipped
                before[row, column] = last[row, column]
                after[row, column] = 0.0
                best_index[row, column] = index
            elif best_index[row, column] == index - 1 and index > 0:
                after[row, column] = clipped
            last[row, column] = clipped


@dataclass(frozen=True, eq=False)
class StackSummary:
    """A stack of slices as four images (H, W[, 3]) float32; light in counts.

    total: the plain sum, which for slices that share edges is the fully lit image. overlay: the same with a colour per
    slice. projector_row: which projector row lights the pixel, -1 where no slice shows light. inverse_depth: 1/z from
    the camera in 1/m, 0 where unknown.
    """

    total: Singles
    overlay: Singles
    projector_row: Singles
    inverse_depth: Singles


class Stack:
    """Takes slices one by one, in the order of their delays, and keeps a handful of images, however many they are."""

    def __init__(self, rig: Rig, slices: tuple[GateSettings, ...], floor: float) -> None:
        """`slices` as applied, by rising delay. Light below `floor` counts tells nothing about depth."""
        if any(a.delay_us > b.delay_us for a, b in pairwise(slices)):
            raise ValueError("slices are not in the order of their delays")
        self._rig, self._slices, self._floor = rig, slices, max(floor, 1e-6)
        self._colours = slice_colours(len(slices))
        lens = rig.camera.lens
        shape = (lens.height, lens.width)
        self._total, self._last, self._best, self._before, self._after = (np.zeros(shape, np.float32) for _ in range(5))
        self._overlay = np.zeros((*shape, 3), np.float32)
        self._index = np.full(shape, -1, np.int32)
        self._count = 0

    def add(self, light: Singles) -> None:
        """The next slice (H, W) float32: counts with what is counted in the dark taken off."""
        add_slice(
            light,
            self._count,
            self._colours[self._count],
            self._floor,
            self._total,
            self._overlay,
            self._last,
            self._best,
            self._before,
            self._after,
            self._index,
        )
        self._count += 1

    def summary(self) -> StackSummary:
        """All slices so far. A pixel's phase is the centroid of its brightest slice and that one's neighbours."""
        rows = self._projector_rows()
        return StackSummary(self._total, self._overlay, rows, triangulate(self._rig, rows))

    def _projector_rows(self) -> Singles:
        """The projector row (H, W) that lights each pixel, -1 where no slice shows light."""
        delays = np.array([float(item.delay_us) for item in self._slices])
        lines = np.array([item.line_time_us for item in self._slices])
        here = np.maximum(self._index, 0)
        early, late = np.maximum(here - 1, 0), np.minimum(here + 1, len(delays) - 1)
        mass = self._before + self._best + self._after
        moment = self._before * delays[early] + self._best * delays[here] + self._after * delays[late]
        seen = mass > 0
        phases = np.divide(moment, mass, out=np.zeros(mass.shape), where=seen)
        camera_rows = self._rig.camera.lens.row_centres[:, None]
        period_rows = self._rig.projector.period_rows
        rows = np.mod(rows_at_phase(self._rig, lines[here], camera_rows, phases), period_rows)
        # a slice that reaches over the frame's edge may have its middle just outside
        height = self._rig.projector.lens.height
        rows = np.where(rows >= height, np.where(rows > (height + period_rows) / 2, 0.0, height), rows)
        return np.where(seen, rows, -1.0).astype(np.float32)


def slice_colours(count: int) -> Singles:
    """A colour (count, 3) RGB float32, 0..1, per slice, from blue (shortest delay, farthest) to red."""
    steps = np.rint(np.linspace(16, 239, count) if count > 1 else np.array([128.0])).astype(np.uint8)
    table = cv2.applyColorMap(steps[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1]
    colours: Singles = np.divide(table, 255, dtype=np.float32)
    return colours
