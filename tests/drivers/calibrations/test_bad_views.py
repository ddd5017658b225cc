"""Views at the bench that would spoil a fit: each is named with what is wrong, and a fit leaves it out."""

from __future__ import annotations

import pytest

from slopegate.core.calibration.chart_scene import ChartPose, held
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.rig.arrays import Counts
from slopegate.drivers.calibrations.geometry_run import GeometryRun
from slopegate.drivers.calibrations.pictures import PoseFrames
from slopegate.drivers.calibrations.practice import PracticeRig, PracticeWorld
from slopegate.drivers.calibrations.taking import PoseAttendance, light_advice, open_gate, pose_name, take_pose
from small_practice import practice_poses, small_chart, small_rig

POSE = held(small_chart(), (0.0, 0.03, 0.6), 15.0, 10.0)


def taken(rig: PracticeRig, name: str, pose: ChartPose, later: ChartPose | None = None) -> PoseFrames:
    """The pictures of a pose, which the chart leaves for another one halfway."""
    seen: list[int] = []
    rig.move(pose)

    def see(image: Counts) -> None:
        seen.append(1)
        if later is not None and len(seen) == 18:
            rig.move(later)

    rig.camera.start()
    gate = open_gate(rig.believed, rig.camera.info)
    frames = take_pose(name, rig.projector, rig.shots(), gate, PoseAttendance(frame_taken=see))
    assert frames is not None
    return frames


def faults(rig: PracticeRig, pose: ChartPose, later: ChartPose | None = None) -> tuple[str, ...]:
    run = GeometryRun(small_chart(), rig.projector.info.raster)
    return run.add(taken(rig, "pose_01", pose, later)).faults


def practice(world: PracticeWorld | None = None, sensor: SensorModel | None = None) -> PracticeRig:
    return PracticeRig(small_rig(), small_chart(), 3, world, sensor=sensor)


def test_a_good_view_has_no_faults() -> None:
    assert faults(practice(), POSE) == ()


@pytest.mark.parametrize(("aside_m", "shift"), [(0.001, "0.5"), (0.005, "2.7")])
def test_a_chart_that_moves_between_frames_is_named(aside_m: float, shift: str) -> None:
    found = faults(practice(), POSE, held(small_chart(), (aside_m, 0.03, 0.6), 15.0, 10.0))
    assert f"moved by {shift} pixels" in found[0]


def test_a_chart_that_moves_far_has_no_place_in_a_fit() -> None:
    """Halves of its code belong to other places: they fit no corner of either."""
    assert faults(practice(), POSE, held(small_chart(), (0.02, 0.03, 0.6), 15.0, 10.0))


def test_a_blurred_view_is_named() -> None:
    assert "the chart is blurred" in faults(practice(PracticeWorld(blur_px=(4.0, 4.0))), POSE)[0]


def test_a_projector_that_washes_out_its_finest_stripes_is_read_by_the_wider_ones() -> None:
    assert faults(practice(PracticeWorld(blur_px=(1.5, 1.5))), POSE) == ()


def test_a_saturated_view_is_named_and_advised_about() -> None:
    rig = practice(sensor=SensorModel(counts_per_unit=4000.0))
    assert "of the chart is saturated" in faults(rig, POSE)[0]
    assert "lower the camera's gain" in light_advice(taken(rig, "pose_02", POSE))


@pytest.mark.parametrize(
    ("ambient", "said"),
    [(0.5, ("the projector lights only 50 % of the corners",)), (0.05, ("the projector lights only", "seen and lit"))],
)
def test_a_chart_half_out_of_the_projector_is_named(ambient: float, said: tuple[str, ...]) -> None:
    """In a dark room the half that is not lit may not even be seen."""
    low = held(small_chart(), (0.0, 0.17, 0.7), 5.0, 5.0)
    found = faults(practice(PracticeWorld(ambient=ambient)), low)
    assert any(words in found[0] for words in said)


def test_a_fit_is_the_same_with_bad_views_as_without_them() -> None:
    rig, chart = practice(), small_chart()
    good, spoilt = GeometryRun(chart, rig.projector.info.raster), GeometryRun(chart, rig.projector.info.raster)
    poses = practice_poses(rig.truth, chart, 5, 3)
    for number, pose in enumerate(poses):
        frames = taken(rig, pose_name(number), pose)
        good.add(frames)
        spoilt.add(frames)
    for number, pose in enumerate(poses[:2]):
        spoilt.add(taken(rig, f"bad_{number}", pose, poses[3]))
    found, other = good.finish(rig.believed), spoilt.finish(rig.believed)
    assert [one.name for one in other.left_out] == ["bad_0", "bad_1"]
    assert other.geometry.values == pytest.approx(found.geometry.values, rel=1e-6)
