"""What a camera sees with all of the projector's light: what gated pictures of a plane are measured against."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.gating.gate import upright_line_time
from slopegate.core.rig.arrays import Bools, Counts, Doubles, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate, quantise
from slopegate.drivers.calibrations.pictures import CalibrationError

FRAMES: Final = 9
"""With everything lit, and as many without light."""
NEARLY_WHOLE: Final = 0.7
"""Of a period: three gates at least this long light everything twice, so that the middle one of their pictures holds
neither the gap that an exposure leaves nor the rows that it counts twice."""
MOST_GATES: Final = 12
_MARGIN: Final = 0.9


@dataclass(frozen=True, eq=False)
class LitView:
    """The projector's light, and what every frame has besides.

    full (H, W) float32: counts of everything lit once, above the dark. ambient (H, W) float32: counts of other light a
    microsecond of exposure. black: counts in the dark, of all pixels or of each (H, W). noise: standard deviation of a
    pixel of one frame, counts. saturated (H, W): pixels that were.
    """

    full: Singles
    ambient: Singles
    black: float | Singles
    noise: float
    saturated: Bools

    def light(self, counts: Counts | Singles, exposure_us: float) -> Singles:
        """What a frame (H, W) of this exposure has of the projector's light."""
        other = np.asarray(self.black, np.float32) + np.float32(exposure_us) * self.ambient
        return np.asarray(counts - other, np.float32)


def whole_gates(rig: Rig) -> list[GateSettings]:
    """Gates that record everything between them, as the camera can do them: see `LitView.full`.

    Raises CalibrationError where the camera's exposures are too short for it.
    """
    period, shutter = rig.projector.period_us, rig.camera.shutter
    line_us = upright_line_time(rig)
    longest = quantise(shutter, gate(line_us, 0.0, period), period).exposure_us
    count = 3 if longest >= NEARLY_WHOLE * period else math.ceil(period / (_MARGIN * longest))
    if count > MOST_GATES:
        raise CalibrationError(
            f"the camera's longest exposure is {longest:g} us: it must be at least {period / MOST_GATES / _MARGIN:.0f} "
            "us, so that a few pictures show the plane fully lit"
        )
    delays = period * (np.arange(count) + 0.5) / count
    return [quantise(shutter, gate(line_us, delay, period), period) for delay in delays.tolist()]


def see_lit(
    lit: Callable[[GateSettings], Counts | None],
    dark: Callable[[GateSettings], Counts | None] | None,
    rig: Rig,
    counts: tuple[float, int],
) -> LitView | None:
    """Take frames with all of the projector's light, and without any where that can be had; None when given up.

    lit, dark: take a frame (H, W) through a gate, valid until the next one; None when given up. counts: the camera's in
    the dark, and its largest.
    """
    gates = whole_gates(rig)
    taken = _means(lit, gates, counts[1])
    if taken is None:
        return None
    means, noise, saturated = taken
    whole = np.median(means, axis=0) if gates[0].exposure_us >= NEARLY_WHOLE * rig.projector.period_us else means.max(0)
    black, exposure_us = np.float32(counts[0]), np.float32(gates[0].exposure_us)
    ambient = np.zeros(whole.shape, np.float32)
    if dark is not None:
        unlit = _means(dark, gates, counts[1])
        if unlit is None:
            return None
        ambient = (unlit[0].mean(axis=0) - black) / exposure_us
    full = np.asarray(whole - black - exposure_us * ambient, np.float32)
    return LitView(full, ambient, counts[0], noise, saturated)


def _means(
    take: Callable[[GateSettings], Counts | None], gates: list[GateSettings], max_count: int
) -> tuple[Singles, float, Bools] | None:
    """Mean of some frames of each gate (N, H, W) float32, the noise of one frame, and which pixels were saturated."""
    means: list[Singles] = []
    variances: list[float] = []
    saturated: Bools | None = None
    for one in gates:
        frames: list[Singles] = []
        for _ in range(max(2, -(-FRAMES // len(gates)))):
            image = take(one)
            if image is None:
                return None
            frames.append(image.astype(np.float32))
            full = image >= max_count
            saturated = full if saturated is None else saturated | full
        stacked = np.stack(frames)
        means.append(stacked.mean(axis=0))
        variances.append(_variance(stacked))
    assert saturated is not None
    return np.stack(means), math.sqrt(float(np.median(variances))), saturated


def _variance(frames: Singles) -> float:
    """Of the brighter half of the pixels from frame to frame (N, H, W), their mean."""
    levels = frames.mean(axis=0)
    bright = levels >= np.median(levels)
    spread: Doubles = frames.var(axis=0, ddof=1, dtype=np.float64)
    return float(spread[bright].mean())
