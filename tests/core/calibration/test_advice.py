"""What is advised during a calibration: poses that both pictures see whole and that tell the most, words, lights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs import CAMERA_BARREL, PROJECTOR_BARREL, check_rig
from slopegate.core.calibration.advice import (
    CELLS,
    ENOUGH_VIEWS,
    Light,
    candidates,
    coverage,
    covered,
    distance_error,
    hint,
    is_there,
    next_pose,
    outline_m,
    verdict,
    view_verdict,
)
from slopegate.core.calibration.chart import Chart, chart_from
from slopegate.core.calibration.chart_scene import ChartPose, held, pose_of, seen_by_both
from slopegate.core.calibration.geometry import ChartView, Geometry, calibrate
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.rig_files import load_rig

CHART = chart_from("9x7:30")
RIG = check_rig(640)


def barrel(rig: Rig) -> Rig:
    camera = replace(rig.camera, lens=replace(rig.camera.lens, distortion=CAMERA_BARREL))
    projector = replace(rig.projector, lens=replace(rig.projector.lens, distortion=PROJECTOR_BARREL))
    return replace(rig, camera=camera, projector=projector)


def views_of(rig: Rig, poses: list[ChartPose], noise_px: float = 0.2) -> list[ChartView]:
    random = np.random.default_rng(4)
    seen = [seen_by_both(rig, pose.placed(CHART.points_m)) for pose in poses]
    return [
        ChartView(f"view {number}", CHART.points_m, *(side + random.normal(0, noise_px, side.shape) for side in sides))
        for number, sides in enumerate(seen, 1)
    ]


def fitted(rig: Rig, poses: list[ChartPose]) -> Geometry:
    lenses = (rig.camera.lens, rig.projector.lens)
    return calibrate(views_of(rig, poses), *((lens.width, lens.height) for lens in lenses), held_out=False)


def advised(rig: Rig, count: int) -> list[ChartPose]:
    taken: list[ChartPose] = []
    for _ in range(count):
        pose = next_pose(rig, CHART, taken)
        assert pose is not None
        taken.append(pose)
    return taken


# Poses


@pytest.mark.parametrize("rig", [RIG, barrel(RIG), load_rig("beside")], ids=["check", "barrel", "beside"])
@pytest.mark.parametrize("chart", ["9x7:30", "charuco:11x8:12", "4x3:60"])
def test_both_pictures_show_the_whole_chart_in_every_pose(rig: Rig, chart: str) -> None:
    made = chart_from(chart)
    found = candidates(rig, made)
    assert len(found) > 20
    for pose in found:
        for points, lens in zip(
            seen_by_both(rig, pose.placed(outline_m(made))), (rig.camera.lens, rig.projector.lens), strict=True
        ):
            assert (points > 0).all()
            assert (points < (lens.width, lens.height)).all()


def test_a_chart_that_no_pose_shows_has_no_advice() -> None:
    assert next_pose(RIG, Chart("checkerboard", 60, 60, 0.001), []) is None


def test_advised_poses_differ_and_tell_more_than_careless_ones() -> None:
    poses = advised(RIG, 5)
    middles = np.array([pose.placed(CHART.points_m.mean(axis=0)) for pose in poses])
    assert np.ptp(middles[:, 2]) > 0.2
    assert np.ptp(middles[:, 0]) > 0.1
    normals = np.array([np.array(pose.rotation)[:, 2] for pose in poses])
    assert np.degrees(np.arccos((normals @ normals.T).clip(-1, 1))).max() > 25
    random = np.random.default_rng(2)
    careless = [held(CHART, (0.0, 0.05, 0.8 + 0.02 * k), *random.uniform(-10, 10, 2)) for k in range(5)]
    good, poor = (fitted(RIG, some).standard_errors for some in (poses, careless))
    assert good[0] < 0.5 * poor[0]
    assert good[9] < 0.5 * poor[9]
    assert np.median(good / poor) < 0.5


@given(
    st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.5, 2.0), st.floats(-40, 40), st.floats(-40, 40),
    st.floats(-60, 60),
)  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_a_pose_is_found_from_its_corners(x: float, y: float, z: float, tilt: float, yaw: float, roll: float) -> None:
    pose = held(CHART, (x, y, z), tilt, yaw, roll)
    rig = barrel(RIG)
    seen, _ = seen_by_both(rig, pose.placed(CHART.points_m))
    found = pose_of(rig.camera.lens, CHART.points_m, seen)
    assert found is not None
    assert np.array(found.rotation) == pytest.approx(np.array(pose.rotation), abs=1e-3)
    assert found.shift_m == pytest.approx(pose.shift_m, abs=1e-3)
    assert is_there(rig, CHART, found, pose)


def test_an_upside_down_chart_is_there_and_tilted_the_same_way() -> None:
    wanted = held(CHART, (0.1, 0.0, 0.8), 10.0, 30.0)
    flipped = held(CHART, (0.1, 0.0, 0.8), 10.0, 30.0, 180.0)
    assert is_there(RIG, CHART, flipped, wanted)
    assert "hold it still" in hint(CHART, flipped, wanted)


def test_a_chart_elsewhere_is_not_there() -> None:
    wanted = held(CHART, (0.0, 0.0, 0.8), 0.0, 30.0)
    for other in (
        held(CHART, (0.1, 0.0, 0.8), 0.0, 30.0),
        held(CHART, (0.0, 0.0, 1.2), 0.0, 30.0),
        held(CHART, (0.0, 0.0, 0.8), 0.0, -30.0),
    ):
        assert not is_there(RIG, CHART, other, wanted)


def test_corners_in_a_line_tell_no_pose() -> None:
    line = np.array([[1.0, 1], [2, 1], [3, 1]])
    assert pose_of(RIG.camera.lens, CHART.points_m[:3], line) is None


# Words


@pytest.mark.parametrize(
    ("now", "wanted", "words"),
    [
        (held(CHART, (0, 0, 1.0)), held(CHART, (0, 0, 0.7)), ["30 cm nearer"]),
        (held(CHART, (0, 0, 0.7)), held(CHART, (0, 0, 1.0)), ["30 cm farther"]),
        (held(CHART, (0, 0, 1.0)), held(CHART, (-0.2, 0.15, 1.0)), ["20 cm to the left", "15 cm down"]),
        (held(CHART, (0, 0, 1.0)), held(CHART, (0.2, -0.15, 1.0)), ["20 cm to the right", "15 cm up"]),
        (held(CHART, (0, 0, 1.0)), held(CHART, (0, 0, 1.0), 0, 25), ["its right edge 25\u00b0"]),
        (held(CHART, (0, 0, 1.0)), held(CHART, (0, 0, 1.0), 25, 0), ["its top edge 25\u00b0"]),
        (held(CHART, (0, 0, 1.0)), held(CHART, (0, 0, 1.0), -25, -20), ["left edge", "bottom edge"]),
        (held(CHART, (0, 0, 1.0), 25), held(CHART, (0, 0, 1.0)), ["facing the camera"]),
        (held(CHART, (0, 0, 1.0)), held(CHART, (0.01, 0, 1.02), 3), ["hold it still"]),
        (None, held(CHART, (-0.4, -0.3, 1.5)), ["1.50 m", "upper left"]),
        (None, held(CHART, (0, 0, 0.5)), ["0.50 m", "in the middle"]),
    ],
)
def test_words_say_how_to_move(now: ChartPose | None, wanted: ChartPose, words: list[str]) -> None:
    said = hint(CHART, now, wanted)
    assert all(word in said for word in words), said
    others = {"nearer", "farther", "left", "right", " up", " down", "still", "facing", "top", "bottom"}
    spoken = " ".join(words)
    assert not [word for word in others if word in said and word not in spoken and now is not None], said


# Coverage


@given(st.lists(st.tuples(st.floats(-50, 700), st.floats(-50, 500)), max_size=60))
@settings(deadline=None)
def test_every_point_inside_counts_in_one_cell(places: list[tuple[float, float]]) -> None:
    points: Doubles = np.array(places, np.float64).reshape(-1, 2)
    count = coverage([points, np.full((2, 2), np.nan)], (640, 480))
    assert count.shape == (CELLS[1], CELLS[0])
    inside = (points >= 0).all(axis=1) & (points < (640, 480)).all(axis=1)
    assert count.sum() == inside.sum()
    assert covered(count) <= min(1.0, len(places) / count.size)


def test_a_corner_of_the_picture_is_the_corner_of_the_map() -> None:
    assert coverage([np.array([[639.5, 0.5]])], (640, 480))[0, -1] == 1


# Lights


@dataclass(frozen=True)
class SomeView:
    """A view with nothing wrong, unless told otherwise."""

    view: ChartView | None
    name: str = "a"
    faults: tuple[str, ...] = ()
    shift_px: float = 0.02
    edge_px: float = 2.0
    lit_share: float = 1.0


def sight_of(**more: Any) -> SomeView:
    return replace(SomeView(views_of(RIG, [held(CHART, (0.0, 0.0, 0.8))])[0]), **more)


@pytest.mark.parametrize(
    ("more", "outlier", "light", "word"),
    [
        ({}, False, "green", "63 corners"),
        ({}, True, "red", "does not fit"),
        ({"faults": ("a: the chart is blurred",)}, False, "red", "the chart is blurred"),
        ({"view": None}, False, "red", "too few"),
        ({"lit_share": 0.8}, False, "amber", "80 %"),
        ({"shift_px": 0.2}, False, "amber", "moved"),
        ({"edge_px": 12.0}, False, "amber", "blurred"),
    ],
)
def test_lights_of_a_view(more: dict[str, Any], outlier: bool, light: Light, word: str) -> None:
    found = view_verdict(sight_of(**more), outlier)
    assert found.light == light
    assert word in found.text
    assert not found.text.startswith("a: ")


def test_lights_of_all_views_turn_green_in_the_end() -> None:
    poses = advised(RIG, ENOUGH_VIEWS)
    full, none = np.ones((CELLS[1], CELLS[0]), np.int32), np.zeros((CELLS[1], CELLS[0]), np.int32)
    assert verdict(2, none, None, np.inf).light == "red"
    geometry = fitted(RIG, poses)
    assert verdict(8, full, geometry, 0.02).light == "red"
    assert verdict(8, full, geometry, 0.005).light == "amber"
    assert verdict(4, full, geometry, 0.001).light == "amber"
    assert verdict(8, none, geometry, 0.001).light == "amber"
    assert verdict(8, full, geometry, 0.001).light == "green"


def test_the_error_of_distances_is_what_calibrations_scatter() -> None:
    from slopegate.core.calibration.applied import with_geometry

    poses = advised(RIG, 6)
    points = np.array([pose.placed(CHART.points_m.mean(axis=0)) for pose in poses])
    told = distance_error(with_geometry(RIG, fitted(RIG, poses), ()), points)
    assert 1e-5 < told < 0.01
    assert distance_error(RIG, points) == np.inf
