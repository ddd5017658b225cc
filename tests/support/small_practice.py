"""A small rig to calibrate in tests: 320 x 240 pixels of camera, 256 x 192 of projector."""

from __future__ import annotations

from dataclasses import replace

from slopegate.core.calibration.chart import Chart, chart_from
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.rig_files import load_rig

CHART = "6x4:40"


def small_chart() -> Chart:
    return chart_from(CHART)


def small_rig() -> Rig:
    """The check rig with fewer pixels; the projector's picture is as wide as the camera's."""
    rig = load_rig("check")
    camera = rig.camera.lens.resized(320, 240)
    projector = replace(rig.projector.lens, width=256, height=192, fx=250.0, fy=250.0, cx=128.0, cy=96.0)
    return replace(
        rig, camera=replace(rig.camera, lens=camera), projector=replace(rig.projector, lens=projector), name="Small rig"
    )
