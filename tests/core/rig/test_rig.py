"""Lenses, poses and projections."""

import math

import cv2
import numpy as np
import pytest

from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)
BENT = Lens(1600, 1200, 1600.0, 1590.0, 790.0, 610.0, (-0.2, 0.05, 1e-3, -1e-3, 0.01))


def test_the_check_rig():
    assert CHECK.is_ideal
    assert CHECK.baseline_m == 0.1
    assert CHECK.projector.rows_per_us == pytest.approx(720 / (0.92 * 16_666.7))
    assert CHECK.camera.lens.fy == pytest.approx(5000 / 3)
    assert np.array_equal(CHECK.camera_centre_m, [0, 0.05, 0])
    assert np.array_equal(CHECK.projector_centre_m, [0, -0.05, 0])


@pytest.mark.parametrize("lens", [BENT, Lens(1600, 1200, 1600.0, 1590.0, 790.0, 610.0)], ids=["bent", "straight"])
def test_normalise_and_project_are_inverse(lens):
    columns, rows = np.meshgrid(np.linspace(0, 1600, 17), np.linspace(0, 1200, 13))
    back = lens.project(*lens.normalise(columns, rows))
    assert np.abs(back[0] - columns).max() < 1e-9
    assert np.abs(back[1] - rows).max() < 1e-9


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_every_distortion_is_opencvs(count):
    bend = (-0.2, 0.05, 2e-3, -1e-3, 0.01, 0.03, -0.02, 0.005, 1e-3, -2e-3, 2e-3, 1e-3, 0.1, -0.07)[:count]
    lens = Lens(5000, 4000, 4000.0, 4100.0, 2480.0, 2030.0, bend)
    x, y = np.random.default_rng(1).uniform(-0.5, 0.5, (2, 7, 9))
    points = np.stack([x.ravel(), y.ravel(), np.ones(63)], axis=-1)
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), lens.matrix, np.array(bend))[0]
    assert np.allclose(np.stack(lens.project(x, y), axis=-1).reshape(-1, 2), pixels[:, 0], rtol=0, atol=5e-12)


def test_points_project_by_the_models_formulas():
    point = np.array([0.2, -0.1, 1.3])
    column, row, depth = CHECK.to_camera(point)
    assert row == pytest.approx(5000 / 3 * (-0.1 - 0.05) / 1.3 + 600)
    assert column == pytest.approx(5000 / 3 * 0.2 / 1.3 + 800)
    assert depth == 1.3
    assert CHECK.to_projector(point)[1] == pytest.approx(1000 * (-0.1 + 0.05) / 1.3 + 360)


def test_a_general_pose_agrees_with_opencv():
    turn = np.array([0.1, -0.05, 0.02])
    rotation = cv2.Rodrigues(turn)[0]
    offset = np.array([0.02, -0.12, 0.03])
    rig = Rig(
        RigCamera(BENT, CHECK.camera.shutter),
        RigProjector(BENT, 16_666.7),
        tuple(offset),
        tuple(map(tuple, rotation.tolist())),
    )
    points = np.random.default_rng(1).uniform([-0.3, -0.3, 1], [0.3, 0.3, 2], (50, 3))
    seen_from_camera = points - rig.camera_centre_m
    pixels = cv2.projectPoints(seen_from_camera, turn, -rotation @ offset, BENT.matrix, np.array(BENT.distortion))[0]
    column, row, _ = rig.to_projector(points)
    assert np.allclose(np.stack([column, row], -1), np.asarray(pixels).reshape(-1, 2), atol=1e-9)
    assert not rig.is_ideal


def test_points_behind_have_no_pixel_and_raise_no_warning():
    column, row, depth = CHECK.to_projector([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])
    assert np.isnan(column).all()
    assert np.isnan(row).all()
    assert np.array_equal(depth, [-1, 0])


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Lens(0, 1200, 1.0, 1.0, 0.0, 0.0), "width"),
        (lambda: Lens(10, 10, math.nan, 1.0, 0.0, 0.0), "fx"),
        (lambda: Lens(10, 10, 1.0, -1.0, 0.0, 0.0), "fy"),
        (lambda: Lens(10, 10, 1.0, 1.0, math.inf, 0.0), "cx"),
        (lambda: Lens(10, 10, 1.0, 1.0, 0.0, 0.0, (0.1,)), "distortion"),
        (lambda: RigProjector(BENT, 0.0), "period_us"),
        (lambda: RigProjector(BENT, 99.0), "period_us"),
        (lambda: RigProjector(BENT, 1.1e6), "period_us"),
        (lambda: RigProjector(BENT, 1000.0, 1.5), "active_fraction"),
        (lambda: ideal_rig(CHECK.camera, CHECK.projector, 0.0), "baseline_m"),
        (lambda: Rig(CHECK.camera, CHECK.projector, (0.0, 0.0, 0.0)), "projector_offset_m"),
        (
            lambda: Rig(
                CHECK.camera, CHECK.projector, (0.0, -0.1, 0.0), ((2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
            ),
            "projector_rotation",
        ),
    ],
)
def test_a_rig_that_cannot_be_is_refused_by_name(make, named):
    with pytest.raises(ValueError, match=f"^{named} is .*: it must be "):
        make()


def test_no_points_are_no_pixels_for_a_distorted_lens_too():
    for call in (BENT.project, BENT.normalise):
        assert [found.shape for found in call(np.empty((2, 0)), 0.0)] == [(2, 0), (2, 0)]


@pytest.mark.parametrize(("width", "height"), [(800, 600), (3200, 1000), (400, 500)])
def test_a_sensor_with_other_pixels_sees_the_same_rays(width, height):
    lens = Lens(1600, 1200, 1700.0, 1650.0, 790.0, 620.0, (0.05, -0.02, 0.001, 0.0))
    small = lens.resized(width, height)
    scale = width / 1600
    columns, rows = np.array([0.0, 300.0, 790.0, 1600.0]), np.array([100.0, 620.0, 900.0, 1200.0])
    seen = small.normalise(columns * scale, height / 2 + (rows - 600.0) * scale)
    np.testing.assert_allclose(seen, lens.normalise(columns, rows), rtol=0, atol=1e-9)
    assert (small.width, small.height) == (width, height)
