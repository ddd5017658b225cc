"""A small rig to calibrate in tests: 320 x 240 pixels of camera, 256 x 192 of projector."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopegate.core.calibration.chart import Chart, chart_from
from slopegate.core.calibration.chart_scene import ChartPose, held, seen_by_both
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.rig_files import load_rig

CHART = "6x4:40"
_STRIDE = 0.382
"""Of a turn, from one pose's tilt to the next: sides that follow each other are far apart."""
_TRIES = 2000
_SHARES = (0.45, 0.85)
"""Diagonal of the chart's squares, in diagonals of the camera's picture."""
_TILTS_DEG = (12.0, 38.0)


def small_chart() -> Chart:
    return chart_from(CHART)


def small_rig(size: int = 1) -> Rig:
    """The check rig with fewer pixels, of `size` times 320 x 240 and 256 x 192; both pictures are about as wide."""
    rig = load_rig("check")
    camera = rig.camera.lens.resized(320 * size, 240 * size)
    lens = replace(rig.projector.lens, width=256 * size, height=192 * size, fx=250.0 * size, fy=250.0 * size)
    projector = replace(lens, cx=128.0 * size, cy=96.0 * size)
    return replace(
        rig, camera=replace(rig.camera, lens=camera), projector=replace(rig.projector, lens=projector), name="Small rig"
    )


def practice_poses(rig: Rig, chart: Chart, count: int, seed: int) -> list[ChartPose]:
    """Poses that somebody who knows how would choose: the chart all over both pictures, near and far, turned each way.

    rig: that the poses are seen by.
    """
    draw = np.random.default_rng((seed, 0xB0A2D))
    found: list[ChartPose] = []
    for number in range(count):
        around = 2 * np.pi * _STRIDE * number + draw.uniform(-0.3, 0.3)
        pose = _seen_pose(rig, chart, around, draw)
        assert pose is not None, f"{chart} is nowhere seen whole"
        found.append(pose)
    return found


def _seen_pose(rig: Rig, chart: Chart, around: float, draw: np.random.Generator) -> ChartPose | None:
    """A pose tilted to this side, at a place and a size by chance, that both lenses see whole."""
    lens, wide = rig.camera.lens, float(np.hypot(*chart.size_m))
    for _ in range(_TRIES):
        share = draw.uniform(*_SHARES)
        tilt = draw.uniform(*_TILTS_DEG)
        depth = wide * lens.fx / (share * float(np.hypot(lens.width, lens.height)))
        x, y = lens.normalise(*(draw.uniform(0.15, 0.85, 2) * (lens.width, lens.height)))
        middle = (float(x) * depth, float(y) * depth, depth)
        turned = tilt * np.array([np.sin(around), np.cos(around)])
        pose = held(chart, middle, float(turned[0]), float(turned[1]), float(draw.uniform(-12, 12)))
        if _sees(rig, chart, pose):
            return pose
    return None


def _sees(rig: Rig, chart: Chart, pose: ChartPose) -> bool:
    """Whether both pictures show all corners, with a square's room round them."""
    room = 1
    wider = Chart("checkerboard", chart.columns + 2 * room, chart.rows + 2 * room, chart.square_m)
    corner = np.array([-room * chart.square_m, -room * chart.square_m, 0.0])
    shift = pose.placed(corner)
    around = ChartPose(pose.rotation, (float(shift[0]), float(shift[1]), float(shift[2])))
    for lens, points in zip(
        (rig.camera.lens, rig.projector.lens), seen_by_both(rig, around.placed(wider.points_m)), strict=True
    ):
        inside = (points > 1).all() and (points < np.array([lens.width, lens.height]) - 1).all()
        if not inside:
            return False
    return True
