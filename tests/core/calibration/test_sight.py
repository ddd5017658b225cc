"""What is wrong with a view is named: each fault is made in pictures of a chart whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chart_views import HiddenPair, Look, Pose, code_of, hidden_pair, pictures, poses, seen
from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.sight import ChartSight, look

CHART = chart_from("6x5:30")
PAIR = hidden_pair(4, (400, 300), (320, 240))
POSE, CUT_OFF = poses(PAIR, CHART, 2, 9)[0], poses(PAIR, CHART, 1, 4)[0]


def taken(seed: int = 0, pair: HiddenPair = PAIR, pose: Pose = POSE, how: Look | None = None) -> np.ndarray:
    return pictures(pair, CHART, pose, np.random.default_rng(seed), how)


@pytest.fixture(scope="module")
def good() -> np.ndarray:
    return taken()


def sight(frames: np.ndarray) -> ChartSight:
    return look("here", CHART, code_of(PAIR), frames, 255)


def off(found: ChartSight) -> tuple[float, float]:
    """Rms distances of its corners from the truth, camera and projector; a checkerboard has two right ways up."""
    assert found.view is not None
    ways = []
    for points in (found.view.points_m, CHART.points_m.max(axis=0) - found.view.points_m):
        both = zip(seen(PAIR, points, POSE), (found.view.camera, found.view.projector), strict=True)
        ways.append([np.sqrt(((true - at) ** 2).sum(axis=1).mean()) for true, at in both])
    camera, projector = min(ways)
    return float(camera), float(projector)


def test_a_good_view_has_no_fault_and_its_corners_where_they_are(good: np.ndarray) -> None:
    found = sight(good)
    assert found.faults == ()
    camera, projector = off(found)
    assert camera < 0.06
    assert projector < 0.06
    assert found.shift_px < 0.05
    assert found.lit_share == 1
    # 10 to 90 % of an edge are 2.56 standard deviations of its blur, and a pixel has its own width
    assert found.blur_px == pytest.approx(2.56 * np.hypot(0.6, 0.29), rel=0.15)


@pytest.mark.parametrize(
    "how",
    [
        Look(projector_blur_px=1.5),
        Look(camera_blur_px=1.5),
        Look(bounced=0.4),
        Look(bounced=0.3, bounce_px=3.0),
        Look(white=50.0),
        Look(white=3000.0, full_scale=4095, ambient=100.0),
    ],
    ids=["defocused projector", "soft camera", "light comes round", "light comes round nearby", "dark", "12 bits"],
)
def test_what_does_no_harm_is_no_fault(how: Look) -> None:
    found = look("here", CHART, code_of(PAIR), taken(how=how), how.full_scale)
    assert found.faults == ()
    camera, projector = off(found)
    assert camera < 0.1
    assert projector < 0.15


@pytest.mark.parametrize("part", [slice(4, None), slice(17, None), slice(26, None), slice(30, None), slice(14, 18)])
def test_a_chart_that_moved_is_named_whenever_it_did(good: np.ndarray, part: slice) -> None:
    frames = good.copy()
    moved = (POSE[0], POSE[1] + [0.002, 0.001, 0.0])
    frames[part] = taken(pose=moved)[part]
    apart = np.hypot(*(seen(PAIR, CHART.points_m, moved)[0] - seen(PAIR, CHART.points_m, POSE)[0]).T)
    (fault,) = sight(frames).faults
    assert fault.startswith("here: chart or camera moved by ")
    assert float(fault.split(" by ")[1].split()[0]) == pytest.approx(np.median(apart), abs=0.2)


def test_a_chart_that_moved_by_less_than_matters_is_not_named(good: np.ndarray) -> None:
    frames = good.copy()
    frames[17:] = taken(pose=(POSE[0], POSE[1] + [0.00005, 0.0, 0.0]))[17:]
    assert sight(frames).faults == ()


def faults(frames: np.ndarray) -> str:
    return "; ".join(sight(frames).faults)


def test_what_spoils_a_view_is_named(good: np.ndarray) -> None:
    assert "here: the chart is blurred, its edges are" in faults(taken(how=Look(camera_blur_px=5)))
    assert "% of the chart is saturated" in faults(taken(how=Look(white=600)))
    middle = seen(PAIR, CHART.points_m, POSE)[1][:, 0].mean()
    aside = replace(PAIR, projector=replace(PAIR.projector, cx=PAIR.projector.cx + PAIR.projector.width - middle))
    assert "here: the projector lights only" in faults(taken(pair=aside))
    hidden = good.copy()
    hidden[10:12, :, 100:300] = 0
    assert "here: the projector lights only" in faults(hidden)
    assert "no 6x5:30 was found" in faults(np.full_like(good, 90))
    half_as_wide = np.ascontiguousarray(good[:, ::2, ::2])
    assert "no 11x8:10 was found" in look("here", chart_from("11x8:10"), code_of(PAIR), half_as_wide, 255).faults[0]


def test_corners_that_opencv_makes_up_are_not_believed() -> None:
    """The chart's upper squares are cut off by the picture's edge: its search then gives rows that are not there."""
    found = sight(taken(pose=CUT_OFF))
    if found.view is not None:
        apart = [
            np.abs(seen(PAIR, points, CUT_OFF)[0] - found.view.camera).max()
            for points in (found.view.points_m, CHART.points_m.max(axis=0) - found.view.points_m)
        ]
        assert min(apart) < 0.3


def test_a_smaller_projector_than_the_codes_is_named() -> None:
    """320 columns take 9 bits, as 260 do; their codes from 260 on are beyond."""
    middle = seen(PAIR, CHART.points_m, POSE)[1][:, 0].mean()
    aside = replace(PAIR, projector=replace(PAIR.projector, cx=PAIR.projector.cx + 260 - middle))
    order = replace(code_of(PAIR), raster=replace(code_of(PAIR).raster, width=260))
    said = "; ".join(look("here", CHART, order, taken(pair=aside), 255).faults)
    assert "% of the pixels that it lights have a code beyond a projector of 260 x 240 pixels" in said


def test_a_view_in_the_dark_holds_nothing() -> None:
    found = look("here", CHART, code_of(PAIR), taken(how=Look(white=0.0, ambient=60.0)), 255)
    assert found.view is None
    assert "the projector lights only 0 % of the corners" in found.faults[0]
