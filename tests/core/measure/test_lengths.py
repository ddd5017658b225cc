"""Lengths in space against points that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigs import check_rig
from slopegate.core.gating.gate import slab
from slopegate.core.gating.plan import plan_on_hardware, whole_period
from slopegate.core.measure.lengths import at_depth, in_slab, length_text, metres_per_pixel, round_length

RIG = check_rig(320)
MIDDLE = (RIG.camera.lens.cx, RIG.camera.lens.cy)


def test_a_spot_at_its_depth_is_where_the_camera_sees_it() -> None:
    spot = (200.25, 31.5)
    point = at_depth(RIG, spot, 1 / 1.3)
    assert point is not None
    column, row, depth = RIG.to_camera(point)
    assert (float(column), float(row), float(depth)) == pytest.approx((*spot, 1.3))
    assert at_depth(RIG, spot, 0.0) is None
    assert at_depth(RIG, spot, math.nan) is None


@pytest.mark.parametrize("tilt_deg", [0.0, 20.0])
def test_a_spot_in_the_slab_lies_on_the_plane_in_its_middle(tilt_deg: float) -> None:
    settings = plan_on_hardware(RIG, tilt_deg, 1.1, 0.1).applied
    centre = slab(RIG, settings).centre
    for spot in (MIDDLE, (10.0, 20.0), (300.0, 200.0)):
        point = in_slab(RIG, settings, spot)
        assert point is not None
        assert float(np.dot(centre.normal, point)) == pytest.approx(centre.offset_m, rel=1e-6)


def test_without_a_slab_no_spot_lies_in_it() -> None:
    assert in_slab(RIG, whole_period(RIG, 15.0), MIDDLE) is None


def test_a_pixel_is_as_long_as_what_it_sees() -> None:
    per_pixel = metres_per_pixel(RIG, 1.25)
    ends = [at_depth(RIG, (column, MIDDLE[1]), 1 / 1.25) for column in (160.0, 161.0)]
    assert per_pixel == pytest.approx(float(np.linalg.norm(ends[1] - ends[0])))
    assert per_pixel == pytest.approx(1.25 / RIG.camera.lens.fx)
    assert metres_per_pixel(RIG, -1.0) is None
    assert metres_per_pixel(RIG, math.inf) is None


def test_round_lengths_and_their_texts() -> None:
    assert [round_length(x) for x in (0.99, 1.0, 2.2, 0.0499, 73.0)] == pytest.approx([0.5, 1.0, 2.0, 0.02, 50.0])
    texts = [length_text(x) for x in (0.0005, 0.0123, 0.3124, 1.5, 2500.0)]
    assert texts == [
        "0.5 mm",
        "1.23 cm",
        "31.24 cm",
        "1.5 m",
        "2.5 km",
    ]
