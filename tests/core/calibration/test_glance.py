"""A chart in a live picture is found at about the place where it is, whatever the picture's size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from slopegate.core.calibration.chart import chart_from, picture
from slopegate.core.calibration.glance import glance


@pytest.mark.parametrize("text", ["9x7:30", "charuco:9x7:30"])
@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_a_chart_is_seen_where_it_is(text: str, scale: float) -> None:
    chart = chart_from(text)
    image = np.full((480, 640), 200, np.uint8)
    board = picture(chart, 40, 10)
    image[30 : 30 + board.shape[0], 100 : 100 + board.shape[1]] = board
    large = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    found = glance(chart, large)
    assert found is not None
    assert len(found.index) > 0.6 * chart.count
    expected = scale * (np.array([100.0, 30.0]) + 50 + 40 * chart.points_m[found.index, :2] / chart.square_m)
    order = found.points if np.hypot(*(found.points[0] - expected[0])) < 40 * scale else found.points[::-1]
    assert np.hypot(*(order - expected).T).max() < 2 * scale


def test_nothing_is_seen_in_noise() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (300, 400)).astype(np.uint8)
    assert glance(chart_from("9x7:30"), noise) is None
