"""How like a fog-free image a gate's image is, at every exposure: the paper's figure 10, measured and predicted.

A short exposure leaves out what it is to show and is noisy, a long one lets in the light of the fog. Between the two
lies an exposure at which the image is most like the same scene without fog. It is found by measuring, on any camera,
or from the light that is expected, before a frame is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.measure.quality import Image, bright_and_dark, contrast, contrast_to_noise, ncc
from slopegate.core.rig.arrays import Bools, Counts, Singles
from slopegate.core.rig.checks import require, require_rectangle
from slopegate.core.rig.settings import GateSettings, ShutterLimits, gate

Rectangle = tuple[int, int, int, int]

_ROUNDING_VARIANCE = 1 / 12
"""counts^2: what a sensor's rounding to whole counts adds."""


@dataclass(frozen=True, eq=False)
class FogTarget:
    """What images are compared with, inside a rectangle: the same scene without fog."""

    region: Rectangle
    """x0, y0, x1, y1 in pixels, without x1 and y1 themselves."""
    reference: Image
    """(h, w), the region's pixels; counts or light, with any black level."""
    bright: Bools
    """(h, w): pixels above the reference's mean, and the others, whose contrast is told."""
    dark: Bools

    def cut(self, image: Image) -> Image:
        """The region's pixels of an image (H, W), as a view."""
        x0, y0, x1, y1 = self.region
        return image[y0:y1, x0:x1]


@dataclass(frozen=True)
class Likeness:
    """What one setting's image says: NCC with the reference, contrast of its bright and dark pixels, and that over the
    noise of a pixel."""

    ncc: float
    contrast: float
    cnr: float


def fog_target(reference: Image, region: Rectangle | None = None) -> FogTarget:
    """A target from an image (H, W) of the scene without fog; region None is all of it.

    Raises InputError, one sentence, for a region outside the image or one that shows a single value.
    """
    height, width = reference.shape
    region = (0, 0, width, height) if region is None else region
    require_rectangle("region", region, width, height)
    x0, y0, x1, y1 = region
    cut = reference[y0:y1, x0:x1].copy()
    bright, dark = bright_and_dark(cut)
    return FogTarget(region, cut, bright, dark)


def exposures_us(shutter: ShutterLimits, period_us: float, count: int) -> tuple[float, ...]:
    """At most `count` exposures at equal ratios, from the least of the shutter up to one period, rising.

    Each as the shutter can make it. Fewer where the shutter's steps make neighbours equal, or where it cannot expose as
    long.
    """
    require(count >= 2, "count", count, "a whole number of at least 2")
    steps = shutter.exposure_us
    least = max(steps.min, steps.step)
    wanted = np.geomspace(least, max(period_us, least), count)
    return tuple(sorted({steps.nearest(float(value)) for value in wanted}))


def sweep_gates(
    shutter: ShutterLimits, period_us: float, line_time_us: float, delay_us: float, count: int
) -> tuple[GateSettings, ...]:
    """The gates of a sweep: one line time and (centre) delay, the exposures of `exposures_us`."""
    return tuple(gate(line_time_us, delay_us, exposure) for exposure in exposures_us(shutter, period_us, count))


def measured_likeness(frames: Sequence[Counts], target: FogTarget, black_count: float) -> Likeness:
    """Of two or more frames of one setting, each the target's region (h, w): NCC and CNR of single ones, averaged."""
    require(len(frames) >= 2, "frames", len(frames), "at least 2, for noise shows in the difference of two")
    pairs = [contrast_to_noise(one, other, target.bright, target.dark) for one, other in pairwise(frames)]
    mean = np.mean(np.stack(frames), axis=0)
    return Likeness(
        ncc=float(np.mean([ncc(frame, target.reference) for frame in frames])),
        contrast=contrast(mean, target.bright, target.dark, black_count),
        cnr=float(np.mean(pairs)),
    )


def expected_likeness(light: Singles, target: FogTarget, sensor: SensorModel) -> Likeness:
    """What a frame of this light, of the target's region (h, w), will say: no noise is drawn.

    With m the mean count of each pixel, v its variance (shot, read and rounding) and r the reference, the expected NCC
    is cov(m, r) / sqrt((var(m) + mean(v)) var(r)): noise adds to the image's variance and to nothing else. Off by
    terms of 1 / pixels. Saturated pixels stand at full scale without noise.
    """
    lit = light.astype(np.float64) * sensor.counts_per_unit
    room = sensor.max_count - sensor.black_count
    per_pixel = lit / sensor.electrons_per_count + (sensor.read_noise_e / sensor.electrons_per_count) ** 2
    variance = np.where(lit < room, per_pixel + _ROUNDING_VARIANCE, 0.0)
    mean = np.minimum(lit, room)
    noise = float(variance.mean())
    own = float(mean.var())
    shown = ncc(mean, target.reference) * math.sqrt(own / (own + noise)) if own > 0 else 0.0
    apart = abs(float(mean[target.bright].mean() - mean[target.dark].mean()))
    return Likeness(
        ncc=shown,
        contrast=contrast(mean, target.bright, target.dark),
        cnr=apart / math.sqrt(noise) if noise > 0 else math.inf,
    )


def best_exposure_us(exposures: Sequence[float], seen: Sequence[Likeness]) -> float:
    """The exposure whose image is most like the reference; the shortest of several."""
    return exposures[int(np.argmax([one.ncc for one in seen]))]
