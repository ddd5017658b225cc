"""Rigs with larger pixels and with the projector beside: what they see is what the full rig sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import calibrated, check_rig
from slopegate.core.gating.gate import slab
from slopegate.core.gating.plan import plan
from slopegate.core.rig.axis import no_slabs
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import LineTimes
from slopegate.core.rig.variants import beside_rig, binned_gate, binned_rig

RIG = check_rig(320)


@given(tilt=st.floats(-40, 40), distance=st.floats(0.5, 5.0), by=st.sampled_from([2, 3, 4, 5]))
def test_the_binned_gate_is_the_same_slab(tilt: float, distance: float, by: int) -> None:
    asked = plan(RIG, tilt, distance, 0.1)
    full, small = slab(RIG, asked), slab(binned_rig(RIG, by), binned_gate(asked, by))
    for name in ("tilt_deg", "distance_m", "thickness_m", "B"):
        assert getattr(small, name) == pytest.approx(getattr(full, name), rel=1e-9)


def test_a_large_pixel_looks_where_its_pixels_look() -> None:
    small = binned_rig(RIG, 4)
    assert (small.camera.lens.width, small.camera.lens.height) == (80, 60)
    corner, same = RIG.camera_rays([8.0], [12.0]), small.camera_rays([2.0], [3.0])
    assert np.allclose(corner, same, atol=1e-12)
    lines = replace(RIG, camera=replace(RIG.camera, shutter=replace(RIG.camera.shutter, line=LineTimes(1, 500, 0.25))))
    assert binned_rig(lines, 4).camera.shutter.line == LineTimes(4, 2000, 1.0)
    with pytest.raises(InputError, match="by"):
        binned_rig(RIG, 0)


def test_the_projector_beside_stands_as_far_and_has_no_slabs() -> None:
    aside = beside_rig(RIG)
    assert aside.baseline_m == RIG.baseline_m
    assert no_slabs(aside)
    assert beside_rig(calibrated(RIG)).calibration is None, "it was calibrated elsewhere"
    assert not no_slabs(RIG)
