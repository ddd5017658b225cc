"""Poses of a chart that are taken: they equal what their folder gives, and what is wrong with the light is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slopegate.core.calibration.chart_scene import held
from slopegate.core.calibration.sight import look
from slopegate.core.rig.arrays import Counts
from slopegate.drivers.calibrations.pictures import CalibrationError, PoseFrames, pose_folders, read_pose
from slopegate.drivers.calibrations.practice import PracticeRig, PracticeWorld
from slopegate.drivers.calibrations.taking import (
    PoseAttendance,
    frames_of_pose,
    light_advice,
    next_pose_number,
    open_gate,
    pose_name,
    take_pose,
)
from slopegate.drivers.files.durable import StorageError
from small_practice import small_chart, small_rig


@pytest.fixture(scope="module")
def practice() -> PracticeRig:
    rig = PracticeRig(small_rig(), small_chart(), 1)
    rig.move(held(small_chart(), (0.0, 0.02, 0.9), 15.0, -10.0))
    rig.camera.start()
    return rig


def taken(practice: PracticeRig, folder: Path | None = None, attendance: PoseAttendance | None = None) -> PoseFrames:
    gate = open_gate(practice.believed, practice.camera.info)
    pose = take_pose("pose_01", practice.projector, practice.shots(), gate, attendance, folder=folder)
    assert pose is not None
    return pose


def test_a_pose_that_is_kept_reads_back_to_the_same_numbers(practice: PracticeRig, tmp_path: Path) -> None:
    pose = taken(practice, tmp_path / "chart")
    (folder,) = pose_folders(tmp_path / "chart")
    read = read_pose(folder, practice.projector.info.raster)
    assert (read.name, read.order, read.full_scale, read.digest) == (
        pose.name, pose.order, pose.full_scale, pose.digest,
    )  # fmt: skip
    assert (read.frames == pose.frames).all()
    assert read.frames.dtype == pose.frames.dtype == np.uint16
    assert look("pose_01", small_chart(), read.order, read.frames, read.full_scale).faults == ()
    with pytest.raises(StorageError, match="exists already"):
        taken(practice, tmp_path / "chart")
    assert next_pose_number(tmp_path / "chart") == 1


def test_every_frame_is_told_and_counts_to_the_end(practice: PracticeRig) -> None:
    told: list[tuple[int, int]] = []
    shown: list[int] = []

    def see(image: Counts) -> None:
        shown.append(int(image.max()))

    taken(practice, attendance=PoseAttendance(lambda done, count: told.append((done, count)), frame_taken=see))
    count = frames_of_pose(practice.projector.info.raster)
    assert told == [(k, count) for k in range(1, count + 1)]
    assert len(shown) == count
    assert shown[0] > shown[1]


def test_giving_up_leaves_no_folder(practice: PracticeRig, tmp_path: Path) -> None:
    seen: list[int] = []
    attendance = PoseAttendance(lambda done, count: seen.append(done), given_up=lambda: len(seen) >= 5)
    gate = open_gate(practice.believed, practice.camera.info)
    pose = take_pose("pose_01", practice.projector, practice.shots(), gate, attendance, folder=tmp_path / "chart")
    assert pose is None
    assert len(seen) == 5
    assert not (tmp_path / "chart").exists()


def test_a_projector_that_lights_nothing_is_told_at_once(tmp_path: Path) -> None:
    rig = PracticeRig(small_rig(), small_chart(), 1)
    rig.camera.start()  # the chart is not there yet
    with pytest.raises(CalibrationError, match="sees no light of the projector"):
        taken(rig, tmp_path / "chart")
    assert not (tmp_path / "chart").exists()


def test_light_is_judged_by_what_the_picture_shows(practice: PracticeRig) -> None:
    pose = taken(practice)
    assert light_advice(pose) == ""
    glaring = PoseFrames(
        "a", pose.order, np.minimum(3 * pose.frames.astype(np.uint32), 65535).astype(np.uint16), 65535.0, ""
    )
    assert "is saturated" in light_advice(glaring)
    dim = PoseFrames("a", pose.order, pose.frames // 10, 65535.0, "")
    assert "is dark" in light_advice(dim)


def test_rows_against_the_scan_turn_the_pictures() -> None:
    rigs = [
        PracticeRig(small_rig(), small_chart(), 1, PracticeWorld(camera_up=up, projector_up=up)) for up in (False, True)
    ]
    found = []
    for rig in rigs:
        rig.move(held(small_chart(), (0.02, 0.03, 0.9), 15.0, -10.0))
        rig.camera.start()
        pose = taken(rig)
        seen = look("pose_01", small_chart(), pose.order, pose.frames, pose.full_scale)
        assert seen.view is not None
        found.append(seen.view)
    size = {"camera": np.array([320.0, 240.0]), "projector": np.array([256.0, 192.0])}
    for side, whole in size.items():
        one, other = (getattr(view, side) for view in found)
        # the chart turned by half a turn looks the same, but for its colours: its corners may come in either order
        turned = whole - other
        gap = min(np.abs(one - turned).max(), np.abs(one - turned[::-1]).max())
        assert gap < 0.15


def test_poses_have_names_that_sort() -> None:
    assert [pose_name(number) for number in (0, 9, 10)] == ["pose_01", "pose_10", "pose_11"]
