"""Inverses of normal equations: exact in units that are far apart, and 0 for what nothing tells."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from slopegate.core.calibration.normal import scaled_inverse


@pytest.mark.parametrize("seed", range(5))
def test_units_that_are_far_apart_do_no_harm(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(40, 5)) * np.array([1e-9, 1e-3, 1.0, 1e4, 1e8])
    with mpmath.workdps(50):
        exact = mpmath.inverse(mpmath.matrix(slopes.T.tolist()) * mpmath.matrix(slopes.tolist()))
    found = scaled_inverse(slopes.T @ slopes)
    unit = np.sqrt(np.diag(found))
    apart = (found - np.array(exact.tolist(), np.float64)) / np.outer(unit, unit)
    assert np.abs(apart).max() < 1e-13


def test_what_nothing_tells_has_no_say() -> None:
    normal = np.diag([4.0, 0.0, 1e-6])
    assert scaled_inverse(normal) == pytest.approx(np.diag([0.25, 0.0, 1e6]))
