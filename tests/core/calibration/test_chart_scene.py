"""A chart held before a rig: its rendered corners are where the lenses' law puts them, and are found there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slopegate.core.calibration.chart import Chart, chart_from, find_corners
from slopegate.core.calibration.chart_scene import ChartPose, chart_scene, held, seen_by_both
from slopegate.core.exposure.blur import blurred
from slopegate.core.exposure.sensor import mono
from slopegate.core.render.render import render
from slopegate.core.rig.arrays import Bytes, Doubles
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.rig_files import load_rig


def small_rig() -> Rig:
    rig = load_rig("check")
    lens = rig.camera.lens.resized(640, 480)
    bent = replace(lens, fy=0.98 * lens.fy, cx=lens.cx + 5, cy=lens.cy - 4, distortion=(-0.1, 0.05, 1e-3, -2e-3, 0.01))
    return replace(rig, camera=replace(rig.camera, lens=bent))


def seen(rig: Rig, chart: Chart, pose: ChartPose, blur_px: float) -> Bytes:
    light = blurred(mono(render(rig, chart_scene(rig, chart, pose)).direct), blur_px)
    return np.asarray(250 * light / light.max(), np.uint8)


def apart(chart: Chart, found: Doubles, wanted: Doubles) -> Doubles:
    """A checkerboard of odd sides looks the same from below."""
    turned = wanted[::-1] if chart.kind == "checkerboard" else wanted
    return min(found - wanted, found - turned, key=lambda gap: float(np.abs(gap).max()))


@pytest.mark.parametrize("blur_px", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("text", ["9x7:30", "6x5:40", "charuco:6x5:40"])
def test_corners_of_a_rendered_chart_are_found_where_they_are(text: str, blur_px: float) -> None:
    rig, chart = small_rig(), chart_from(text)
    for tilt, yaw, roll in ((0.0, 0.0, 3.0), (25.0, -20.0, 0.0), (-10.0, 30.0, -8.0)):
        pose = held(chart, (0.02, 0.05, 0.85), tilt, yaw, roll)
        corners = find_corners(chart, seen(rig, chart, pose, blur_px))
        assert corners is not None
        # some markers are too small to be read
        assert len(corners.index) >= (chart.count if chart.kind == "checkerboard" else 0.4 * chart.count)
        gap = apart(chart, corners.points, seen_by_both(rig, pose.placed(chart.points_m))[0][corners.index])
        assert np.abs(gap.mean(axis=0)).max() < 0.02
        # beside a marker less of a crossing is seen
        assert float(np.sqrt((gap**2).mean())) < (0.02 if chart.kind == "checkerboard" else 0.06)


def test_the_projector_sees_corners_by_its_own_lens_and_pose() -> None:
    rig = small_rig()
    chart = chart_from("6x5:40")
    pose = held(chart, (0.0, 0.0, 1.0), 20.0, 10.0)
    _, lit = seen_by_both(rig, pose.placed(chart.points_m))
    world = pose.placed(chart.points_m) + rig.camera_centre_m
    column, row, _ = rig.to_projector(world)
    assert lit == pytest.approx(np.stack([column, row], axis=-1))


def test_a_wall_asks_for_interreflection_and_hides_nothing_of_the_chart() -> None:
    rig, chart = small_rig(), chart_from("6x5:40")
    for tilt, yaw in ((0.0, 0.0), (20.0, 25.0), (-20.0, -25.0)):
        pose = held(chart, (-0.03, 0.02, 0.9), tilt, yaw)
        alone, beside = chart_scene(rig, chart, pose), chart_scene(rig, chart, pose, wall=True)
        assert (alone.indirect, beside.indirect) == (False, True)
        corners = seen_by_both(rig, pose.placed(chart.points_m))[0].astype(int)
        one, other = (render(rig, scene).inverse_depth for scene in (alone, beside))
        assert (one[corners[:, 1], corners[:, 0]] == other[corners[:, 1], corners[:, 0]]).all()
        assert (one != other).any()
