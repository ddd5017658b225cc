"""How far the float32 kernel misplaces the gate's edges, against the bound derived in `edges.kernel_windows`."""

import math

import mpmath
import numpy as np
import pytest

from slopegate.core.exposure.gated import gated
from slopegate.core.gating.gate import row_windows
from slopegate.core.render.render import render
from slopegate.core.rig.rig import Lens, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import gate
from slopegate.core.scene.scene import Mesh, Scene
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)
FOCAL_C, FOCAL_P, V_P = CHECK.camera.lens.fy, 1000.0, CHECK.projector.rows_per_us
ALLOWED_CAMERA_ROWS = 0.01


def bound_in_camera_rows(rig):
    step = 2.0 ** (math.ceil(math.log2(rig.projector.lens.height)) - 25)
    return step * rig.camera.lens.fy / rig.projector.lens.fy


def recorded(rig, settings, rows):
    light = np.ones_like(rows)
    return gated(rows, light, np.zeros_like(light), row_windows(rig, settings), 0.0)


@pytest.mark.parametrize("clock", [50.0, 76.0, 78.0, 80.0, 108.0])
@pytest.mark.parametrize("depth_m", [0.3, 0.5, 1.05, 3.0, 10.0, 100.0, 1e4, math.inf])
def test_the_edge_of_the_kernel_is_where_50_digits_put_it(clock, depth_m):
    """Pixels whose rows run past the edge of their camera row's window in steps down to 1e-7 rows."""
    mpmath.mp.dps = 50
    mpf = mpmath.mpf
    line_time = CHECK.camera.shutter.line.line_time_us(clock)
    w, row = (0.0 if math.isinf(depth_m) else 1 / depth_m), 400
    kappa_c = (mpf(row) + mpf(0.5) - 600) / mpf(FOCAL_C)
    lit = mpf(FOCAL_P) * (kappa_c + mpf("0.1") * mpf(w)) + 360
    assert 0 < lit < 720, "the row sees this depth lit"
    speed = 720 / (mpf(0.92) * mpf(16_666.7))
    # the edge exactly at this point, as near as float64 settings allow
    settings = gate(line_time, float(lit / speed - (mpf(row) + mpf(0.5)) * mpf(line_time)) + 150, 300.0)
    edge = speed * (mpf(settings.delay_us) - 150 + (mpf(row) + mpf(0.5)) * mpf(line_time))
    off = np.concatenate([sign * np.logspace(-7, 0, 400) for sign in (-1, 1)])
    exact = [edge + mpf(float(part)) * FOCAL_P / FOCAL_C for part in off]  # `off` is in camera rows
    rows = np.full((1200, off.size), -1, np.float32)
    rows[row] = [np.float32(float(value)) for value in exact]
    wrong = recorded(CHECK, settings, rows)[row] != (off >= 0)
    worst = np.abs(off[wrong]).max(initial=0.0)
    assert worst <= bound_in_camera_rows(CHECK) < ALLOWED_CAMERA_ROWS / 100
    assert not wrong[np.abs(off) > 6e-5].any()


@pytest.mark.parametrize("rows", [480, 720, 1080, 2160, 4320, 8192])
def test_every_raster_keeps_the_bound(rows):
    rng = np.random.default_rng(rows)
    camera = RigCamera(Lens(2000, 300, 3000.0, 3000.0, 1000.0, 150.0), CHECK.camera.shutter)
    projector = RigProjector(Lens(1280, rows, 1000.0, 1000.0, 640.0, rows / 2), 16_666.7)
    rig = ideal_rig(camera, projector, 0.1)
    settings = gate(0.6 * 16_666.7 / 300, 5000.0, 300.0)
    low = row_windows(rig, settings).low
    off = 10 ** rng.uniform(-8, 0, (300, 2000)) * rng.choice([-1, 1], (300, 2000))
    exact = low[:, None] + off / 3.0
    lit = (exact >= 0) & (exact < rows)
    found = recorded(rig, settings, np.where(lit, exact, -1).astype(np.float32)) > 0
    wrong = lit & (found != (off >= 0))
    worst = np.abs(off[wrong]).max(initial=0.0)
    assert worst <= bound_in_camera_rows(rig) + 1e-9 < ALLOWED_CAMERA_ROWS
    assert worst > bound_in_camera_rows(rig) / 20, "the bound is not far above what happens"


@pytest.mark.parametrize("tilt_deg", [0.0, 40.0, -40.0])
@pytest.mark.parametrize("depth_m", [0.3, 1.05, 10.0, 1e3, 1e5])
def test_rendered_rows_are_exact_to_half_a_float32_step(depth_m, tilt_deg):
    """Through the renderer: camera ray, triangle, projection, in float64 until the row is stored."""
    camera = RigCamera(Lens(160, 120, FOCAL_C / 10, FOCAL_C / 10, 80.0, 60.0), CHECK.camera.shutter)
    rig = ideal_rig(camera, CHECK.projector, 0.1)
    lean, size = math.tan(math.radians(tilt_deg)), 2 * depth_m
    corners = np.array([[x, y, depth_m - y * lean] for x in (-size, size) for y in (-0.5 * size, 0.5 * size)])
    faces = np.array([[0, 1, 3], [0, 3, 2]], np.int32)
    found = render(rig, Scene("wall", objects=(Mesh("wall", corners, faces),))).projector_row
    kappa = (np.arange(120) + 0.5 - 60) / (FOCAL_C / 10)
    w = (1 + lean * kappa) / (depth_m - 0.05 * lean)  # the wall z = depth - lean y, seen from y = 0.05
    exact = np.broadcast_to((FOCAL_P * (kappa + 0.1 * w) + 360)[:, None], (120, 160))
    lit = found >= 0
    assert lit.mean() > 0.2
    assert np.abs(found - exact)[lit].max() <= 2.0**-15 + 1e-9
