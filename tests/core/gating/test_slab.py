"""Planes, hinge and read-outs of the slab."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.gating.gate import row_windows, slab, weights
from slopegate.core.gating.plan import plan
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)
T = CHECK.projector.period_us


def line_time(clock_mhz):
    return CHECK.camera.shutter.line.line_time_us(clock_mhz)


@pytest.mark.parametrize(
    ("clock", "tilt_deg", "delay_us"),
    [(50, 77.7, -1697.2), (76, 15.3, 1853.2), (78, 0.0, 2028.2), (80, -14.9, 2194.5), (108, -73.6, 3876.2)],
)
def test_the_models_check_figures(clock, tilt_deg, delay_us):
    settings = plan(CHECK, 0.0, 1.05, 0.1, line_time(clock))
    assert round(settings.delay_us, 1) == delay_us
    found = slab(CHECK, settings)
    assert round(found.tilt_deg, 1) == tilt_deg
    B = 78 / clock
    assert found.tilt_deg == pytest.approx(math.degrees(math.atan2(B - 1, 0.1 * (B + 1) / 2 / 1.05)), abs=1e-9)
    assert pytest.approx(1.05, rel=1e-12) == found.distance_m


@given(st.floats(20, 128), st.floats(-1500, 6000), st.floats(10, 2000), st.integers(0, 1199))
def test_points_on_an_edge_plane_sit_on_the_edge_of_every_row(clock, delay, exposure, row):
    settings = gate(line_time(clock), delay, exposure)
    found = slab(CHECK, settings)
    kappa_c = (row + 0.5 - 600) / CHECK.camera.lens.fy
    # the camera ray of this row: y = b/2 + kappa_c z, put into normal . X = offset
    for plane, sign in ((found.near, 1), (found.far, -1)):
        _, n_y, n_z = plane.normal
        w = (n_y * kappa_c + n_z) / (plane.offset_m - n_y * CHECK.baseline_m / 2)
        lit_row = (kappa_c + CHECK.baseline_m * w) * 1000 + 360
        edge = delay + sign * exposure / 2 + (row + 0.5) * settings.line_time_us - found.frame * T
        assert lit_row / CHECK.projector.rows_per_us == pytest.approx(edge, abs=1e-6)


@given(st.floats(20, 77), st.floats(0, 4000), st.floats(10, 500))
def test_all_planes_of_a_clock_pass_through_its_hinge(clock, delay, exposure):
    found = slab(CHECK, gate(line_time(clock), delay, exposure))
    for plane in (found.near, found.centre, found.far):
        assert plane.normal[1] * found.hinge_y_m == pytest.approx(plane.offset_m, rel=1e-12)


@given(st.floats(-3, 3))
def test_nothing_breaks_as_the_clock_passes_the_parallel_one(offset):
    clock = 78 * (1 + math.copysign(10 ** (-1 - abs(offset) * 5), offset))
    found = slab(CHECK, plan(CHECK, 0.0, 1.05, 0.1, line_time(clock)))
    assert found.distance_m == pytest.approx(1.05, rel=1e-9)
    assert (found.hinge_y_m is None) == (abs(found.B - 1) < 1e-9)
    assert math.copysign(1, found.tilt_deg) == math.copysign(1, -offset) or abs(found.tilt_deg) < 1e-6
    assert all(math.isfinite(v) for p in (found.near, found.centre, found.far) for v in (p.A, *p.normal, p.offset_m))


def test_planes_pass_smoothly_through_infinity():
    delays = np.linspace(-40, 40, 81)
    slabs = [slab(CHECK, gate(line_time(77), delay - 100.0, 100)) for delay in delays]
    normals = np.array([found.centre.normal for found in slabs])
    assert np.abs(np.diff(normals, axis=0)).max() < 0.2, "no sign flips"
    assert {found.distance_m is None for found in slabs} == {True, False}
    beyond = slab(CHECK, gate(line_time(78), -400.0, 100))
    assert (beyond.near_m, beyond.distance_m, beyond.far_m, beyond.thickness_m) == (None, None, None, None)
    assert any("beyond infinity" in warning for warning in beyond.warnings)


@given(st.floats(10, 128), st.floats(-16_000, 33_000), st.floats(1, 50_000))
def test_what_may_be_infinite_has_a_finite_form_beside_it(clock, delay, exposure):
    found = slab(CHECK, gate(line_time(clock), delay, exposure))
    for name in ("near", "distance", "far"):
        distance, inverse = getattr(found, f"{name}_m"), getattr(found, f"inverse_{name}_per_m")
        assert (distance is None) == (inverse <= 0)
        assert distance is None or distance * inverse == pytest.approx(1, rel=1e-15)
    assert found.inverse_far_per_m <= found.inverse_distance_per_m <= found.inverse_near_per_m
    assert found.hinge_y_m is None or found.hinge_y_m * found.hinge_curvature_per_m == pytest.approx(1, rel=1e-14)
    assert found.hinge_curvature_per_m == pytest.approx(2 * (found.B - 1) / (0.1 * (found.B + 1)), rel=1e-12, abs=1e-15)
    assert all(type(value) is float for value in (found.B, found.tilt_deg, found.inverse_near_per_m))


def test_a_projector_beside_the_camera_is_refused_in_a_sentence():
    """Its rows say nothing about distance, so there is no slab."""
    rig = Rig(CHECK.camera, CHECK.projector, (0.1, 0.0, 0.0))
    with pytest.raises(InputError, match=r"^This rig's gates are no slabs: .* along its own rows, .* instead$"):
        slab(rig, gate(line_time(78), 2028.2, 300.0))


@given(st.floats(20, 128), st.floats(-16_000, 33_000), st.floats(1, 50_000))
def test_read_outs_and_image_speak_of_the_same_slab(clock, delay, exposure):
    settings = gate(line_time(clock), delay, exposure)
    found = slab(CHECK, settings)
    if found.near_m is None or found.thickness_m is None or found.far_m > 50:
        return
    middle = 2 / (1 / found.near_m + 1 / found.far_m)  # the axis as one camera row sees it
    kappa_c = -CHECK.baseline_m / 2 / middle
    row_c, row_p = kappa_c * CHECK.camera.lens.fy + 600, -kappa_c * 1000 + 360
    if not (0 <= row_c < 1200 and 0 <= row_p < 720) or exposure * CHECK.projector.rows_per_us < 3:
        return
    rows = np.full(1200, row_p)
    assert weights(row_windows(CHECK, settings), rows)[int(row_c)] >= 1


@pytest.mark.parametrize(
    ("delay", "exposure", "windows"),
    [
        (2000.0, 300.0, [(1850.0, 2150.0)]),
        (0.0, 300.0, [(0.0, 150.0), (16_516.7, 16_666.7)]),
        (-1697.0, 300.0, [(14_819.7, 15_119.7)]),
        (8333.35, 16_666.7, [(0.0, 16_666.7)]),
        (2000.0, 16_966.7, [(0.0, 16_666.7), (10_183.35, 10_483.35)]),
    ],
)
def test_windows_modulo_the_period(delay, exposure, windows):
    found = slab(CHECK, gate(line_time(78), delay, exposure)).windows_us
    assert np.allclose(found, windows, atol=1e-6)


def test_a_whole_period_of_delay_changes_nothing():
    one, other = (slab(CHECK, gate(line_time(76), d, 300)) for d in (1853.2, 1853.2 + T))
    assert other.distance_m == pytest.approx(one.distance_m, rel=1e-9)
    assert other.frame == one.frame + 1
    assert any("shorter than one projector row" in w for w in slab(CHECK, gate(line_time(76), 1853.2, 5)).warnings)
    assert any("counts 2 times or more" in w for w in slab(CHECK, gate(line_time(76), 1853.2, 40_000)).warnings)


def test_a_tilt_beyond_infinity_is_said_to_mean_nothing():
    """The window reaches from in front of the rig to beyond infinity, its centre too."""
    found = slab(CHECK, gate(line_time(80.0), 0.0, 400.0))
    assert found.near_m is not None
    assert found.distance_m is None
    assert any("its tilt means nothing" in warning for warning in found.warnings)
