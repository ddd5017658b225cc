"""What is said of the projector's picture: how sharp it is, how it answers grey levels, and what to do about either."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from slopegate.core.calibration.focus import MOST_BLUR_PX, TypicalFocus
from slopegate.core.calibration.response import LevelResponse
from slopegate.core.rig.plus_minus import plus_minus

MOST_BLUR_APART_PX: Final = 0.5
"""Between the sharpest and the softest part of the picture."""


def picture_told(sharp: TypicalFocus | None, response: LevelResponse | None, rig_blur_px: float, sign: str) -> str:
    """Blur and gamma with their standard errors; empty where neither is known. rig_blur_px: that of the rig file."""
    parts = []
    if sharp is not None:
        parts.append(
            f"blur {sharp.blur_px:.2f} {sign} {sharp.standard_error:.2f} px ({sharp.sharpest_px:.2f} to "
            f"{sharp.softest_px:.2f} over the picture; the rig file has {rig_blur_px:g})"
        )
    if response is not None:
        parts.append(f"gamma {plus_minus(response.gamma, response.standard_error, sign)}")
    return ", ".join(parts)


def picture_advice(sharp: TypicalFocus | None, response: LevelResponse | None) -> Iterator[str]:
    """A sentence for each thing that could be better."""
    if sharp is not None and sharp.blur_px > MOST_BLUR_PX:
        yield (
            f"the projector's picture is blurred by {sharp.blur_px:.1f} of its pixels, and the edges of gates with it: "
            "focus it where the chart is held"
        )
    elif sharp is not None and sharp.softest_px - sharp.sharpest_px > MOST_BLUR_APART_PX:
        yield (
            f"the projector is sharper in one part of the picture (blur {sharp.sharpest_px:.1f} px) than in another "
            f"({sharp.softest_px:.1f} px): focus it for the middle of the distances that matter"
        )
    if response is not None and not response.linear:
        yield (
            f"the projector's light follows grey levels with gamma {response.gamma:.2f} +- "
            f"{response.standard_error:.2f}: gates, stripes and this calibration do not mind, grey patterns do; set "
            "its gamma to 1 or linear, if it has such a mode"
        )
