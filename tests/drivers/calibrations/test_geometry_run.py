"""Poses of a chart become a rig: what is used, what is left out and named, and what the rig keeps of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from slopegate.core.calibration.chart import chart_from
from slopegate.core.rig.patterns import Raster
from slopegate.drivers.calibrations.geometry_run import GeometryRun
from slopegate.drivers.calibrations.pictures import CalibrationError, pose_folders, read_pose
from slopegate.drivers.calibrations.practice import PracticeRig
from slopegate.drivers.calibrations.taking import open_gate, pose_name, take_pose
from slopegate.drivers.files.rig_files import load_rig
from small_practice import practice_poses, small_chart, small_rig


def test_real_captures_become_a_rig_with_facts(shared: Callable[[str], Path]) -> None:
    run = GeometryRun(chart_from("9x7:75"), Raster(1024, 768))
    for folder in pose_folders(shared("data/procam")):
        run.add(read_pose(folder, run.projector))
    base = load_rig(None)
    found = run.finish(base)
    assert found.geometry.rms_px <= 0.31
    assert found.rig.camera.lens == found.geometry.camera
    assert found.rig.camera.shutter == base.camera.shutter
    assert found.rig.calibration is not None
    facts = dict(found.rig.calibration.facts)
    assert facts["geometry.chart"] == "9x7:75"
    assert facts["geometry.views"] == "kamino_capture_0, kamino_capture_1, kamino_capture_2"
    assert len(facts["geometry.pictures_sha256"]) == 64
    # the chart's own error is an error of the offset along itself
    exact = run.finish(base, chart_error_percent=0.0).geometry
    rough = run.finish(base, chart_error_percent=1.0).geometry
    gained = rough.covariance - exact.covariance
    assert float(gained[21:, 21:].trace()) == pytest.approx((0.01 * base_length(rough.offset_m)) ** 2)
    with pytest.raises(
        CalibrationError, match=r"2 of 3 views can be used \(kamino_capture_1: left out as asked\): at least 3"
    ):
        run.finish(base, leave_out=["kamino_capture_1"])


def base_length(offset_m: tuple[float, float, float]) -> float:
    return float(sum(value**2 for value in offset_m)) ** 0.5


def taken(run: GeometryRun, believed: Raster, blur_px: float | None = None) -> None:
    """Three poses of a practice rig, as whoever believes in a projector of other pixels reads them."""
    practice = PracticeRig(small_rig(), small_chart(), 2)
    if blur_px is not None:
        rig = practice.truth
        practice._true = replace(rig, projector=replace(rig.projector, blur_px=blur_px))
    practice.camera.start()
    for number, pose in enumerate(practice_poses(practice.truth, small_chart(), 3, 1)):
        practice.move(pose)
        gate = open_gate(practice.believed, practice.camera.info)
        frames = take_pose(pose_name(number), practice.projector, practice.shots(), gate, number=number)
        assert frames is not None
        run.add(replace(frames, order=replace(frames.order, raster=believed)))


def test_codes_beyond_the_projector_in_several_views_mean_that_it_is_another_one() -> None:
    run = GeometryRun(small_chart(), Raster(140, 130))
    taken(run, run.projector)
    beyond = [view.name for view in run.views if view.beyond_share > 0.05]
    assert len(beyond) > 1
    with pytest.raises(
        CalibrationError, match=rf"{', '.join(beyond)} show codes that a projector of 140 x 130 pixels does not have"
    ):
        run.finish(small_rig())


def test_what_is_wrong_with_several_views_is_said_once() -> None:
    run = GeometryRun(chart_from("7x5:40"), small_rig().projector.raster)
    taken(run, run.projector)
    with pytest.raises(
        CalibrationError,
        match=r"0 of 3 views can be used \(pose_01, pose_02, pose_03: no 7x5:40 was found in it: [^;]*\)",
    ):
        run.finish(small_rig())


def test_a_projector_out_of_focus_is_told_where_its_views_cannot_be_used() -> None:
    run = GeometryRun(small_chart(), small_rig().projector.raster)
    taken(run, run.projector, blur_px=6.0)
    with pytest.raises(CalibrationError, match=r"stripes are blurred by [56]\.\d of its pixels: focus it"):
        run.finish(small_rig())
