"""Direct light under a projector's picture."""

from __future__ import annotations

from math import erf, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from projected_places import picture, places
from slopegate.core.exposure.patterned import patterned
from slopegate.core.exposure.sensor import Plates, SensorModel


def test_colours_are_lit_alike_and_all_on_is_the_light_itself() -> None:
    row, column = places()
    direct = np.random.default_rng(4).uniform(0, 1, (40, 50, 3)).astype(np.float32)
    lit = patterned(direct, row, column, picture())
    for c in range(3):
        np.testing.assert_array_equal(lit[..., c], patterned(direct[..., c], row, column, picture()))
    assert patterned(direct, row, column, None) is direct


def test_plates_show_what_the_light_of_the_pattern_would_make_of_them() -> None:
    row, column = places()
    direct = np.where(row >= 0, np.random.default_rng(4).uniform(0, 3, row.shape), 0).astype(np.float32)
    dark, sensor = np.zeros_like(direct), SensorModel()
    plates = Plates(row, direct, dark, sensor)
    full = plates.planes.direct.copy()
    plates.light_with(direct, column, picture())
    asked = Plates(row, patterned(direct, row, column, picture()), dark, sensor)
    np.testing.assert_array_equal(plates.planes.direct, asked.planes.direct)
    plates.light_with(direct, column, None)
    np.testing.assert_array_equal(plates.planes.direct, full)


def smeared(shown: NDArray[np.float32], blur_px: float, row: float, column: float) -> float:
    """What a blurred projector sends to a place: the mean of its pixels by the Gaussian's part that falls on each."""
    weights = []
    for at, length in zip((row, column), shown.shape, strict=True):
        edges = np.array([erf((edge - at) / (blur_px * sqrt(2))) for edge in range(length + 1)])
        weights.append(np.diff(edges) / (edges[-1] - edges[0]))
    return float(weights[0] @ shown @ weights[1])


@pytest.mark.parametrize(("blur_px", "most", "usual"), [(0.5, 0.08, 0.016), (1.0, 0.025, 0.006), (2.0, 0.011, 0.002)])
def test_a_blurred_lens_errs_by_no_more_than_is_said(blur_px: float, most: float, usual: float) -> None:
    rng = np.random.default_rng(1)
    shown = np.kron(rng.integers(0, 2, (10, 10)), np.ones((6, 8))).astype(np.float32)
    row, column = (rng.uniform(0, length, (30, 40)).astype(np.float32) for length in shown.shape)
    ones = np.ones_like(row)
    found = patterned(ones, row, column, shown, blur_px)
    expected = [smeared(shown, blur_px, *place) for place in zip(row.ravel(), column.ravel(), strict=True)]
    error = found.ravel() - expected
    assert abs(error).max() < most
    assert usual / 3 < np.sqrt((error**2).mean()) < usual
    np.testing.assert_allclose(patterned(ones, row, column, np.ones_like(shown), blur_px), 1, atol=1e-6)
    assert (patterned(ones, row * 0 - 1, column, shown, blur_px) == 0).all()
