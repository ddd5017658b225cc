"""The curve of screens."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.exposure.shown import srgb_curve


def test_the_curve_of_the_standard() -> None:
    """IEC 61966-2-1: 18 % grey is 118 of 255, half the light 188; the two parts of the curve meet."""
    assert (255 * srgb_curve(np.array([0.0, 0.18, 0.5, 1.0]))).round().tolist() == [0, 118, 188, 255]
    below, above = srgb_curve(np.array([0.0031308, 0.0031309]))
    assert above == pytest.approx(below, abs=1e-5)


def test_beyond_black_and_white_it_is_clipped() -> None:
    assert srgb_curve(np.array([-1.0, 7.0])) == pytest.approx([0.0, 1.0], abs=1e-15)
