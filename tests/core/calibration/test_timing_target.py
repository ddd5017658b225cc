"""Gates on a plane tell that it has another size where they can, and never where it has the one that is believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slopegate.core.calibration.target import FlatTarget
from slopegate.core.calibration.timing_target import ActiveRange, better_size
from tests.support.gated_target import GatedTarget, drawn_timing, measured, small_rig


def found_size(size: float, facing: bool = False, active_fraction: float = 0.92) -> float | None:
    """How many times as large as believed a plane looks that really is so many times as large."""
    random = np.random.default_rng(4)
    x, y = (0.0, 0.0) if facing else (0.25, -0.15)
    target = FlatTarget((x, y, 1 / 0.9))
    believed = FlatTarget((x * size, y * size, size / 0.9))
    rig = small_rig(active_fraction)
    rig_file = replace(rig, projector=replace(rig.projector, active_fraction=0.92))
    camera = GatedTarget(rig, target, drawn_timing(random, jitter_us=3.0), random, rig_file, believed)
    timing, shots = measured(camera, most=48, every=18)
    assert timing is not None
    return better_size(shots, rig_file, believed, timing)


@pytest.mark.parametrize("size", [0.7, 1.15, 1.4])
def test_another_size_is_told_by_a_plane_that_is_panned(size: float) -> None:
    assert found_size(size) == pytest.approx(size, rel=0.03)


@pytest.mark.parametrize("active_fraction", [0.8, 0.92, 0.99])
def test_the_size_that_is_right_stays_whatever_the_timing(active_fraction: float) -> None:
    assert found_size(1.0, active_fraction=active_fraction) is None


def test_a_plane_that_faces_the_rig_tells_no_size() -> None:
    assert found_size(1.3, facing=True) is None


def test_active_fractions_end_at_one_and_far_from_the_rig_s() -> None:
    allowed = ActiveRange(0.92)
    assert (allowed.least, allowed.most) == pytest.approx((0.736, 1.0))
    assert [allowed.beyond(found, 0.002) for found in (0.72, 0.73, 0.8, 1.0, 1.005, 1.02)] == [
        True, False, False, False, False, True,
    ]  # fmt: skip
    assert not allowed.beyond(0.6, 0.05)
