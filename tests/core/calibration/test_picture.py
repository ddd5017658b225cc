"""What is said of the projector's picture."""

from __future__ import annotations

import numpy as np

from slopegate.core.calibration.focus import TypicalFocus
from slopegate.core.calibration.picture import picture_advice, picture_told
from slopegate.core.calibration.response import LEVELS, LevelResponse


def focused(blur_px: float, softest_px: float) -> TypicalFocus:
    fields = np.full((6, 8), blur_px)
    fields[:, 6:] = softest_px
    return TypicalFocus(blur_px, 0.05, fields)


def answering(gamma: float) -> LevelResponse:
    return LevelResponse(gamma, 0.002, 0.0, LEVELS, tuple(float((v / 255) ** gamma) for v in LEVELS), 0.0)


def test_blur_and_gamma_are_told_with_their_errors() -> None:
    told = picture_told(focused(0.5, 0.6), answering(1.0), 0.4, "+-")
    assert told == "blur 0.50 +- 0.05 px (0.50 to 0.60 over the picture; the rig file has 0.4), gamma 1.0000 +- 0.0020"
    assert picture_told(None, None, 0.0, "+-") == ""
    assert list(picture_advice(focused(0.5, 0.6), answering(1.0))) == []
    assert list(picture_advice(None, None)) == []


def test_what_could_be_better_is_named() -> None:
    blurred, uneven, curved = (
        list(picture_advice(*pair))
        for pair in ((focused(2.0, 2.0), None), (focused(0.5, 1.1), None), (None, answering(2.2)))
    )
    assert [len(one) for one in (blurred, uneven, curved)] == [1, 1, 1]
    assert "blurred by 2.0 of its pixels" in blurred[0]
    assert "sharper in one part" in uneven[0]
    assert "gamma 2.20 +- 0.00" in curved[0]
