"""Lenses against OpenCV's distortion model at 50 digits, and back."""

import mpmath
import numpy as np
import pytest

from inverse_depth_bounds import inverse_depth_bounds
from slopegate.core.gating.gate import exact_upright_line_time
from slopegate.core.rig.axis import scanners
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)
COUNTS = (0, 4, 5, 8, 12)


def random_lens(rng, count):
    """Coefficients that change the radius by up to a third at the corners."""
    spread = [0.2, 0.05, 2e-3, 2e-3, 0.01, 0.05, 0.02, 0.005, 2e-3, 2e-3, 2e-3, 2e-3]
    bend = (rng.uniform(-1, 1, 12) * spread)[:count].tolist()
    return Lens(5000, 4000, 4000.0, 4100.0, 2480.0, 2030.0, tuple(bend))


def exact_pixel(lens, x, y):
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = (
        mpmath.mpf(value) for value in (*lens.distortion, *[0.0] * (12 - len(lens.distortion)))
    )
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + r2 * s2)
    bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + r2 * s4)
    return bent_x * mpmath.mpf(lens.fx) + mpmath.mpf(lens.cx), bent_y * mpmath.mpf(lens.fy) + mpmath.mpf(lens.cy)


@pytest.mark.parametrize("count", COUNTS)
def test_project_is_exact_to_1e_12_pixels_and_normalise_leads_back(count):
    mpmath.mp.dps = 50
    rng = np.random.default_rng(count)
    for _ in range(10):
        lens = random_lens(rng, count)
        x, y = rng.uniform(-0.6, 0.6, 20), rng.uniform(-0.5, 0.5, 20)
        columns, rows = lens.project(x, y)
        for k in range(20):
            column, row = exact_pixel(lens, mpmath.mpf(x[k]), mpmath.mpf(y[k]))
            assert abs(mpmath.mpf(columns[k]) - column) < 2e-12
            assert abs(mpmath.mpf(rows[k]) - row) < 2e-12
        back = lens.project(*lens.normalise(columns, rows))
        assert np.abs(back[0] - columns).max() < 1e-10
        assert np.abs(back[1] - rows).max() < 1e-10


@pytest.mark.parametrize("count", COUNTS)
def test_slopes_of_rows_are_exact_to_1e_14(count):
    mpmath.mp.dps = 50
    rng = np.random.default_rng(100 + count)
    for _ in range(10):
        lens = random_lens(rng, count)
        rig = Rig(RigCamera(lens, CHECK.camera.shutter), RigProjector(lens, 16_666.7), (0.0, -0.1, 0.0))
        direction = (rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4), 1.0)
        found = scanners(rig, 0.0, direction).camera

        def row(part, at=direction, lens=lens):
            moved = [mpmath.mpf(value) for value in at]

            def along(step):
                x, y, z = (value + step * (index == part) for index, value in enumerate(moved))
                return exact_pixel(lens, x / z, y / z)[1]

            return mpmath.diff(along, 0)

        for part, slope in enumerate((found.x, found.y, found.z)):
            assert abs(slope - row(part)) < 1e-14 * lens.fy


def test_a_ray_that_never_comes_to_a_row_has_empty_bounds():
    """A strong barrel turns round at y/z = 1: rows beyond its greatest one are met by no ray, however near."""
    projector = RigProjector(Lens(1280, 1200, 900.0, 900.0, 640.0, 360.0, (-1 / 3, 0.0, 0.0, 0.0)), 1e4, 0.9)
    camera = RigCamera(Lens(6, 60, 70.0, 70.0, 3.0, 30.0), CHECK.camera.shutter)
    rig = ideal_rig(camera, projector, 0.5)
    line_time = 0.02 * exact_upright_line_time(camera.lens, projector)
    greatest = 360 + 900 * 2 / 3
    for centre, some in ((700.0, True), (1050.0, False)):
        settings = gate(line_time, centre / projector.rows_per_us, 20 / projector.rows_per_us)
        low, high = inverse_depth_bounds(rig, settings)
        lit = high > low
        assert lit.any() == some == (centre < greatest)
        rays = rig.camera_rays(np.arange(6)[None, :] + 0.5, np.arange(60)[:, None] + 0.5)
        for part in (0.01, 0.5, 0.99):
            points = rays - (low + part * (high - low))[..., None] * np.array(rig.projector_offset_m)
            rows = projector.lens.project(points[..., 0] / points[..., 2], points[..., 1] / points[..., 2])[1]
            times = settings.delay_us + (np.arange(60)[:, None] + 0.5) * line_time
            assert np.all(np.abs(rows / projector.rows_per_us - times)[lit] <= settings.exposure_us / 2)
