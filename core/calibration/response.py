"""How a projector answers grey levels: the exponent of its response, from pictures of a few levels.

Every pixel of the camera that the projector lights gives, for level v, the share (picture - black) / (white - black) of
its light. Ambient light, the sensor's pedestal and what the projector sends at level 0 are in all three and fall out.
The share is (v / 255)^gamma: gamma 1 for a linear projector, 2.2 and near for one that shows pictures as a screen does.
Gates, stripes and Gray code are black and white, so that no gamma changes them; grey patterns it does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Bytes, Counts, Doubles
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.patterns import LIT

LEVELS: Final = (0, 40, 80, 120, 160, 200, 230, 255)
"""That are shown, black first and white last."""
LINEAR: Final = 0.03
"""A gamma within so much of 1 is that of a linear projector."""
_LEAST_LIGHT: Final = 0.2
"""Of the most that white adds, in pixels that count."""
_SATURATED: Final = 0.98
_STEPS: Final = 50
_TOLERANCE: Final = 1e-9


@dataclass(frozen=True)
class LevelResponse:
    """gamma and its standard error; dark_share: what is left at level 0, ambient light with it, as a share of white.

    shares: the light at each of the levels as a share of white's. misfit: rms of the shares about (v / 255)^gamma.
    """

    gamma: float
    standard_error: float
    dark_share: float
    levels: tuple[int, ...]
    shares: tuple[float, ...]
    misfit: float

    @property
    def linear(self) -> bool:
        """Whether levels are light, for all that can be told."""
        return abs(self.gamma - 1) <= max(LINEAR, 3 * self.standard_error)


def response(levels: Sequence[int], frames: Bytes | Counts, full_scale: float) -> LevelResponse:
    """The response from frames (N, H, W) of even pictures of N levels, black first and white last.

    Raises InputError where levels are too few or in no order, where white saturates, or adds too little to black.
    """
    values = np.array(levels, np.float64) / LIT
    ordered = len(values) >= 4 and values[0] == 0 and values[-1] == 1 and bool((np.diff(values) > 0).all())
    require(ordered, "levels", tuple(levels), f"at least 4, rising from 0 to {LIT}")
    require(len(frames) == len(levels), "number of pictures", len(frames), f"{len(levels)}, one of each level")
    black, white = frames[0].astype(np.float64), frames[-1].astype(np.float64)
    own = white - black
    lit = (own > _LEAST_LIGHT * np.percentile(own, 99)) & (own > 1)
    if not lit.any() or float(np.percentile(own, 99)) < 0.01 * full_scale:
        raise InputError("white is hardly brighter than black: see that the camera sees what the projector lights")
    clear = lit & (white < _SATURATED * full_scale)
    if clear.sum() < 0.5 * lit.sum():
        raise InputError(
            f"white saturates {1 - clear.sum() / lit.sum():.0%} of what the projector lights: expose less, for the "
            "brightest levels to be told apart"
        )
    shares = np.array([(frame[clear] - black[clear]).sum() / own[clear].sum() for frame in frames])
    gamma, error, misfit = _fit(values[1:-1], shares[1:-1])
    dark = float(black[clear].sum() / white[clear].sum())
    return LevelResponse(gamma, error, dark, tuple(levels), tuple(shares.tolist()), misfit)


def _fit(values: Doubles, shares: Doubles) -> tuple[float, float, float]:
    """gamma, its standard error from how far the shares lie off, and that distance, rms."""
    gamma, log = 1.0, np.log(values)
    for _ in range(_STEPS):
        slope = values**gamma * log
        step = float(slope @ (shares - values**gamma) / (slope @ slope))
        gamma = min(max(gamma + min(max(step, -0.5), 0.5), 0.1), 10.0)
        if abs(step) < _TOLERANCE:
            break
    left, slope = shares - values**gamma, values**gamma * log
    variance = float(left @ left) / (len(shares) - 1)
    # black and white err as the others do, and every share has their errors
    weights = slope / float(slope @ slope)
    times = float(weights @ weights) + float(weights @ shares) ** 2 + float(weights @ (1 - shares)) ** 2
    return gamma, math.sqrt(variance * times), math.sqrt(float(left @ left) / len(shares))
