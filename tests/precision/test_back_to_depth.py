"""From rows back to inverse depth, and to instants, against fractions: the bounds that the functions state."""

from fractions import Fraction

import numpy as np
import pytest

from slopegate.core.gating.slab_mesh import window_rows
from slopegate.core.gating.slices import occupied_times
from slopegate.core.rig.rig import Lens, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import gate
from slopegate.core.rig.triangulate import inverse_depth, triangulate
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)


def random_rig(rng):
    f_c, f_p = rng.uniform(200, 4000, 2)
    camera = RigCamera(Lens(12, 60, f_c, f_c, 6.0, float(rng.uniform(-20, 80))), CHECK.camera.shutter)
    projector = RigProjector(Lens(16, 720, f_p, f_p, 8.0, float(rng.uniform(-100, 820))), 16667.0, 0.9)
    return ideal_rig(camera, projector, float(rng.uniform(0.01, 1)))


def exact_inverse_depth(rig, camera_row, projector_row):
    """(kappa_p - kappa_c) / b, and the sum of their sizes over b."""
    lens_c, lens_p = rig.camera.lens, rig.projector.lens
    kappa_c = (Fraction(camera_row) - Fraction(lens_c.cy)) / Fraction(lens_c.fy)
    kappa_p = (Fraction(projector_row) - Fraction(lens_p.cy)) / Fraction(lens_p.fy)
    b = Fraction(rig.baseline_m)
    return (kappa_p - kappa_c) / b, float((abs(kappa_p) + abs(kappa_c)) / b)


@pytest.mark.parametrize("seed", range(20))
def test_rows_give_inverse_depth_to_the_stated_bounds(seed):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    rows = rng.uniform(0, 720, (60, 12)).astype(np.float32)
    found = triangulate(rig, rows)
    lens = rig.camera.lens
    rays = rig.camera_rays(np.arange(12) + 0.5, np.arange(60)[:, None] + 0.5)
    drawn, _ = inverse_depth(rig, rays, rows.astype(np.float64))
    for row, column in zip(rng.integers(0, lens.height, 40), rng.integers(0, 12, 40), strict=True):
        w, terms = exact_inverse_depth(rig, row + 0.5, float(rows[row, column]))
        assert abs(float(Fraction(drawn[row, column]) - w)) <= 1e-15 * terms
        assert abs(float(Fraction(float(found[row, column])) - max(w, 0))) <= 6e-8 * abs(float(w)) + 1e-15 * terms


def test_what_float32_costs_the_check_rig():
    lens, projector = CHECK.camera.lens, CHECK.projector.lens
    w = np.random.default_rng(0).uniform(0, 1 / 0.3, lens.height)[:, None] * np.ones((1, lens.width))
    kappa = (np.arange(lens.height)[:, None] + 0.5 - lens.cy) / lens.fy
    rows = (kappa + CHECK.baseline_m * w) * projector.fy + projector.cy
    lit = (rows >= 0) & (rows < projector.height - 1)
    off = np.abs(triangulate(CHECK, np.where(lit, rows, -1).astype(np.float32)).astype(np.float64) - w)
    assert 1e-7 < (off - 6e-8 * w)[lit].max() <= 3.1e-7


@pytest.mark.parametrize("seed", range(20))
def test_instants_and_windows_to_the_stated_bounds(seed):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    line_us = float(rng.uniform(1, 100))
    rows = rng.uniform(0, 720, (60, 12)).astype(np.float32)
    row_us = Fraction(rig.projector.active_fraction) * Fraction(rig.projector.period_us) / 720
    late = [Fraction(line_us) * (2 * k + 1) / 2 for k in range(60)]
    exact = [Fraction(float(row)) * row_us - late[k] for k in range(60) for row in rows[k]]
    largest = float(720 * row_us + late[-1])
    for found, wanted in zip(occupied_times(rig, line_us, rows), (min(exact), max(exact)), strict=True):
        assert abs(float(Fraction(found) - wanted)) <= 1e-15 * largest
    settings = gate(line_us, float(rng.uniform(-1e6, 1e6)), float(rng.uniform(1, 1e6)))
    start, _ = window_rows(rig, settings, 7, 3)
    parts = Fraction(settings.delay_us), Fraction(line_us) * 7, -3 * Fraction(rig.projector.period_us)
    time = sum(parts) - Fraction(settings.exposure_us) / 2
    terms = float(sum(map(abs, parts)) + Fraction(settings.exposure_us) / 2)
    assert abs(float(Fraction(float(start)) - time / row_us)) <= 1e-15 * terms / float(row_us)
