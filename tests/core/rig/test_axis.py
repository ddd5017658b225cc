"""Where the edge of a gate meets the axis, far from where the tangent at infinity says."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import check_rig, turned
from slopegate.core.gating.gate import slab_if_any, upright_line_time
from slopegate.core.rig.axis import (
    LEAST_ROWS,
    infinity_us,
    no_slab,
    no_slabs,
    rows_to_baseline,
    solve_axis,
    time_on_axis,
)
from slopegate.core.rig.rig import Rig, Vector3
from slopegate.core.rig.settings import gate

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


@given(
    angle_deg=st.floats(-180, 180),
    baseline_m=st.floats(0.01, 1.0),
    rows=st.floats(0.0, 4.0),
)
def test_the_law_of_slabs_is_the_angle_between_rows_and_baseline_in_rows(
    angle_deg: float, baseline_m: float, rows: float
) -> None:
    """f_p sin(angle) rows, whatever the baseline's length and wherever the pair is turned to."""
    rig = check_rig(640)
    slope = math.asin(rows / rig.projector.lens.fy)
    along = math.radians(angle_deg)
    # the projector is rolled with the baseline, so only the angle between the two counts
    offset = (baseline_m * math.cos(along + slope), baseline_m * math.sin(along + slope), 0.0)
    turned_rig = turned(rig, (0.0, 0.0, -angle_deg), offset)
    assert rows_to_baseline(turned_rig) == pytest.approx(rows, abs=1e-9)
    if abs(rows - LEAST_ROWS) > 1e-9:
        assert bool(no_slabs(turned_rig)) == (rows < LEAST_ROWS)


def test_a_projector_that_looks_away_has_no_slabs_and_says_so() -> None:
    away = turned(check_rig(640), (0.0, 120.0, 0.0), (0.0, -0.1, 0.0))
    assert math.isnan(rows_to_baseline(away))
    assert "does not look where the camera looks" in no_slabs(away)


def test_slabs_of_opposed_scans_are_told_but_at_the_line_time_at_which_they_lie_along_the_axis() -> None:
    opposed = turned(check_rig(640), (0.0, 0.0, 180.0), (0.0, -0.1, 0.0))
    upright_us = upright_line_time(opposed)
    assert no_slabs(opposed) == ""
    assert no_slab(opposed, 1.1 * upright_us) == ""
    assert "run along the axis" in no_slab(opposed, upright_us)
    assert slab_if_any(opposed, gate(upright_us, 0.0, 300.0)).why == no_slab(opposed, upright_us)


def test_the_ideal_rig_always_has_slabs() -> None:
    assert no_slabs(check_rig(640)) == no_slab(check_rig(640), LINE_US) == ""
    assert rows_to_baseline(check_rig(640)) == pytest.approx(1000.0)
