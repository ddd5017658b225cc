"""Where the edge of a gate meets the axis, far from where the tangent at infinity says."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import check_rig, turned
from slopegate.core.rig.axis import infinity_us, solve_axis, time_on_axis
from slopegate.core.rig.rig import Rig, Vector3

LINE_US = 30.0


@pytest.mark.parametrize(
    ("pitch_deg", "offset_m", "least", "most"),
    [
        # the axis leaves the front of the scanner that stands ahead 2.5 cm before the rig's middle, the other's behind
        (0.0, (0.0, -0.1, 0.05), -40.0, 40.0),
        (0.0, (0.0, -0.1, -0.05), -40.0, 40.0),
        # the projector looks up: it never sees the axis close behind the rig, and all of it in front
        (20.0, (0.0, -0.1, 0.0), -1 / (0.05 * math.tan(math.radians(20.0))), math.inf),
    ],
    ids=["projector ahead", "camera ahead", "projector pitched"],
)
@given(late_us=st.floats(-1e6, 1e6))
def test_an_edge_of_any_time_is_found_where_both_scanners_see_the_axis(
    pitch_deg: float, offset_m: Vector3, least: float, most: float, late_us: float
) -> None:
    rig: Rig = turned(check_rig(640), (pitch_deg, 0.0, 0.0), offset_m)
    found = solve_axis(rig, LINE_US, late_us)
    assert least < found.w < most
    made_us = time_on_axis(rig, LINE_US, found.w) - float(infinity_us(rig, LINE_US))
    assert made_us == pytest.approx(late_us, rel=1e-9, abs=1e-9)
