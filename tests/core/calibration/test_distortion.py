"""Coefficients of distortion that views do not determine are named, with what they do in the corner of the picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chart_views import hidden_pair, point_view, poses
from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.distortion import COEFFICIENTS, corner_distortions
from slopegate.core.calibration.geometry import Geometry, calibrate
from slopegate.core.rig.plus_minus import plus_minus
from slopegate.core.rig.rig import Lens

CHART = chart_from("9x7:22")
CAMERA, PROJECTOR = (640, 480), (512, 384)


def geometry(**errors: float) -> Geometry:
    """A camera whose coefficients have these standard errors, and a projector that is known exactly."""
    covariance = np.zeros((24, 24))
    for name, error in errors.items():
        place = 4 + COEFFICIENTS.index(name)
        covariance[place, place] = error**2
    camera = Lens(*CAMERA, 800.0, 820.0, 300.0, 250.0, (0.1, -0.2, 0.001, -0.002, 0.3))
    return Geometry(camera, Lens(*PROJECTOR, 600.0, 600.0, 256.0, 192.0), ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
                    (0, -0.1, 0), covariance, 0.0, 0.0, 0.0, ())  # fmt: skip


def test_every_coefficient_moves_the_corner_by_what_the_lens_does() -> None:
    camera, projector = corner_distortions(geometry(k3=0.5))
    lens = geometry().camera
    x, y = (640 - lens.cx) / lens.fx, -lens.cy / lens.fy  # the farthest corner is the upper right one
    bent = Lens(*CAMERA, lens.fx, lens.fy, lens.cx, lens.cy, (0, 0, 0, 0, 0.5))
    (column,), (row,) = bent.project(np.array([x]), np.array([y]))
    assert camera.alone_px["k3"] == pytest.approx(np.hypot(column - 640, row - 0), rel=1e-9)
    assert camera.standard_error_px == pytest.approx(camera.alone_px["k3"])
    assert [camera.alone_px[name] for name in COEFFICIENTS[:4]] == [0, 0, 0, 0]
    assert (projector.corner_px, projector.remark) == (0, "")


def test_the_farthest_corner_is_found_on_every_side() -> None:
    base = geometry(k1=1.0)
    for column, row in ((300, 250), (340, 250), (300, 230), (340, 230)):
        lens = replace(base.camera, cx=column, cy=row)
        corner = np.array([0 if column > 320 else 640, 0 if row > 240 else 480])
        x, y = (corner - (column, row)) / (lens.fx, lens.fy)
        moved = np.hypot(*(np.ravel(lens.project(np.array([x]), np.array([y]))) - corner))
        assert corner_distortions(replace(base, camera=lens))[0].corner_px == pytest.approx(moved)


def test_only_what_is_not_determined_is_named() -> None:
    loose = corner_distortions(geometry(k1=0.001, k2=2.0, k3=20.0))[0]
    assert loose.undetermined == ("k2", "k3")
    assert loose.remark.startswith("the camera's k2 and k3 are not determined by these views")
    assert f"k3 alone is {loose.alone_px['k3']:.3g} px" in loose.remark
    assert f"{plus_minus(loose.corner_px, loose.standard_error_px)} px" in loose.remark
    assert "the camera's k3 is not determined" in corner_distortions(geometry(k3=20.0))[0].remark
    assert corner_distortions(geometry(k1=0.001, k2=0.01, k3=0.05))[0].remark == ""


def test_few_views_are_remarked_on_and_many_are_not() -> None:
    pair = hidden_pair(4, CAMERA, PROJECTOR)
    rng = np.random.default_rng(4)
    views = [point_view(pair, CHART, pose, f"pose_{k:02d}", rng) for k, pose in enumerate(poses(pair, CHART, 20, 4))]
    known = corner_distortions(calibrate(views, CAMERA, PROJECTOR, held_out=False))
    few = corner_distortions(calibrate(views[:3], CAMERA, PROJECTOR, held_out=False))
    assert [one.remark for one in known] == ["", ""]
    assert "the projector's k2 and k3 are not determined" in few[1].remark
