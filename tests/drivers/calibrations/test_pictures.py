"""Calibration pictures of others, read pose by pose, and what they calibrate to."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.geometry import calibrate
from slopegate.core.calibration.sight import look
from slopegate.core.rig.patterns import Raster
from slopegate.drivers.calibrations.pictures import pose_folders, read_pose


def test_the_kamino_captures_calibrate_as_others_did(shared: Callable[[str], Path]) -> None:
    chart, projector = chart_from("9x7:75"), Raster(1024, 768)
    views = []
    for folder in pose_folders(shared("data/procam")):
        pose = read_pose(folder, projector)
        seen = look(pose.name, chart, pose.order, pose.frames, pose.full_scale)
        assert seen.faults == ()
        assert seen.view is not None
        views.append(seen.view)
    found = calibrate(views, (1280, 1024), (1024, 768))
    assert found.rms_px <= 0.31
    known = json.loads(shared("data/procam/kamino_recomputed_012.json").read_text())
    camera, lit = np.array(known["cam_K"]), np.array(known["proj_K"])
    # that file counts pixel centres from 0
    lenses = [
        [matrix[0, 0], matrix[1, 1], matrix[0, 2] + 0.5, matrix[1, 2] + 0.5, *known[bent]]
        for matrix, bent in ((camera, "cam_dist"), (lit, "proj_dist"))
    ]
    errors = found.standard_errors
    assert (np.abs(found.values[:9] - lenses[0]) <= 3 * errors[:9]).all()
    assert (np.abs(found.values[9:18] - lenses[1]) <= 3 * errors[9:18]).all()
