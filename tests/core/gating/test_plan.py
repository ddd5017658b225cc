"""Inverse design inverts the read-outs, for ideal and general rigs."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from slopegate.core.gating.gate import slab
from slopegate.core.gating.plan import plan, plan_on_hardware, plan_plane
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector
from slopegate.core.rig.settings import LineTimes, PixelClocks, ShutterLimits, Steps, gate
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)

tilts = st.floats(-80, 80)
distances = st.floats(0.3, 8)
thicknesses = st.floats(0.001, 1)


@st.composite
def rigs(draw, general):
    b = draw(st.floats(0.03, 0.5))
    period = draw(st.floats(5000, 40_000))
    f_p, f_c = draw(st.floats(500, 3000)), draw(st.floats(300, 4000))
    projector = Lens(1280, 720, f_p, f_p, 640.0, draw(st.floats(200, 520)))
    camera = Lens(1600, 1200, f_c, f_c, 800.0, draw(st.floats(400, 800)))
    active = draw(st.floats(0.5, 1))
    limits = CHECK.camera.shutter
    if not general:
        return Rig(RigCamera(camera, limits), RigProjector(projector, period, active), (0.0, -b, 0.0))
    angles = np.array([draw(st.floats(-0.15, 0.15)) for _ in range(3)])
    bend = draw(st.floats(-0.1, 0.1))
    camera = Lens(1600, 1200, f_c, f_c, 800.0, camera.cy, (bend, 0.01, 1e-3, -1e-3))
    rotation = tuple(map(tuple, cv2.Rodrigues(angles)[0].tolist()))
    offset = (draw(st.floats(-0.1, 0.1)) * b, -b, draw(st.floats(-0.1, 0.1)) * b)
    return Rig(RigCamera(camera, limits), RigProjector(projector, period, active), offset, rotation)


@pytest.mark.parametrize("general", [False, True], ids=["ideal", "general"])
@given(data=st.data(), tilt=tilts, distance=distances, thickness=thicknesses)
def test_slab_of_a_plan_is_what_was_wanted(general, data, tilt, distance, thickness):
    rig = data.draw(rigs(general))
    assume(abs(math.tan(math.radians(tilt))) * rig.baseline_m < 1.2 * distance)
    settings = plan(rig, tilt, distance, thickness)
    assume(settings.exposure_us < 0.3 * rig.projector.period_us)
    found = slab(rig, settings)
    assume(found.frame == 0)  # a wish outside the projector's raster comes back as its copy one period away
    assert found.tilt_deg == pytest.approx(tilt, abs=1e-6)
    assert found.distance_m == pytest.approx(distance, rel=1e-7)
    assert found.thickness_m == pytest.approx(thickness, rel=1e-4 if general else 1e-6)


@given(st.floats(12, 128), st.floats(200, 6000), st.floats(50, 1500))
def test_plan_of_a_slab_is_the_gate_that_made_it(clock, delay, exposure):
    settings = gate(CHECK.camera.shutter.line.line_time_us(clock), delay, exposure)
    found = slab(CHECK, settings)
    assume(found.thickness_m is not None and found.frame == 0 and found.distance_m is not None)
    # the centre plane is the middle in time; near and far surround it
    back = plan(CHECK, found.tilt_deg, found.distance_m, found.thickness_m)
    assert back.line_time_us == pytest.approx(settings.line_time_us, rel=1e-9)
    assert back.delay_us == pytest.approx(settings.delay_us, abs=1e-6)
    assert back.exposure_us == pytest.approx(settings.exposure_us, rel=1e-6)


def test_hardware_rounding_keeps_distance_and_thickness_for_the_clock_it_got():
    planned = plan_on_hardware(CHECK, 20.0, 1.2, 0.1)
    assert CHECK.camera.shutter.line.clock_mhz(planned.applied.line_time_us) == pytest.approx(76)
    assert CHECK.camera.shutter.line.clock_mhz(planned.exact.line_time_us) == pytest.approx(75.67, abs=0.01)
    assert planned.residual_tilt_deg == pytest.approx(-2.69, abs=0.01)
    assert abs(planned.residual_distance_m) < 3e-4
    assert abs(planned.residual_thickness_m) < 5e-4
    assert planned.applied.delay_us == round(planned.applied.delay_us)


@pytest.mark.parametrize("distance", [0.0, 5e-324, 9e-10, 1.1e9, 1e300, math.inf, math.nan])
def test_lengths_beyond_any_rig_are_refused(distance):
    with pytest.raises(ValueError, match=r"distance_m is .* it must be from 1e-09 to 1e"):
        plan(CHECK, 10.0, distance, 0.1)
    with pytest.raises(ValueError, match="thickness_m is"):
        plan(CHECK, 10.0, 1.0, distance if distance > 1 else distance * 1e-7)


@pytest.mark.parametrize("offset", [0.0, 5e-324, -5e-324, 1e-16])
@pytest.mark.parametrize("behind_m", [0.0, 0.02])
def test_a_plane_through_the_rig_is_refused_in_a_sentence(offset, behind_m):
    rig = Rig(CHECK.camera, CHECK.projector, (0.0, -0.1, behind_m))
    with np.errstate(all="raise"), pytest.raises(ValueError, match=r"offset_m is .* it must be"):
        plan_plane(rig, (0.0, 0.0, 1.0), offset, 0.1)


def test_residuals_are_from_what_was_asked_where_no_gate_can_do_it():
    planned = plan_on_hardware(CHECK, 10.0, 0.03, 0.01)  # would take an exposure of two periods
    assert planned.slab.distance_m - planned.residual_distance_m == pytest.approx(0.03)
    assert planned.slab.thickness_m - planned.residual_thickness_m == pytest.approx(0.01)
    assert planned.slab.tilt_deg - planned.residual_tilt_deg == pytest.approx(10)
    assert any("longer than the projector's period" in warning for warning in planned.slab.warnings)


def test_a_plane_at_infinity_but_for_rounding_says_that_its_tilt_means_nothing():
    upright = CHECK.camera.shutter.line.line_time_us(78.0)
    said = [slab(CHECK, gate(upright, delay, 195.0)).warnings for delay in (0.0, 1.0)]
    assert [any("its tilt means nothing" in warning for warning in warnings) for warnings in said] == [True, False]


def test_a_line_time_camera_gets_nearer_to_the_wanted_tilt():
    lines = ShutterLimits(LineTimes(5.0, 100.0, 0.01), Steps(-16_667, 33_334, 1), Steps(100, 50_000, 1))
    finer = Rig(RigCamera(CHECK.camera.lens, lines), CHECK.projector, CHECK.projector_offset_m)
    assert abs(plan_on_hardware(finer, 20.0, 1.2, 0.1).residual_tilt_deg) < 0.3


@pytest.mark.parametrize(
    ("wish", "named"),
    [
        ((math.nan, 1.0, 0.1), "tilt_deg"),
        ((90.0, 1.0, 0.1), "tilt_deg"),
        ((89.0, 0.3, 0.1), "tilt_deg"),
        ((-88.9, 0.5, 0.1), "tilt_deg"),
        ((0.0, 0.0, 0.1), "distance_m"),
        ((0.0, -1.0, 0.1), "distance_m"),
        ((0.0, math.inf, 0.1), "distance_m"),
        ((0.0, 1.0, 0.0), "thickness_m"),
        ((0.0, 1.0, math.nan), "thickness_m"),
    ],
)
def test_an_impossible_wish_is_refused_by_name(wish, named):
    with pytest.raises(ValueError, match=f"^{named} is .*: it must be "):
        plan(CHECK, *wish)


def test_the_ladder_is_the_papers():
    assert isinstance(CHECK.camera.shutter.line, PixelClocks)
    ladder = CHECK.camera.shutter.line.ladder_mhz
    assert ladder == tuple(float(c) for c in [*range(10, 50), *range(50, 100, 2), *range(100, 129, 4)])


@given(st.floats(-70, 70), st.floats(0.4, 5), st.floats(0.005, 0.2))
def test_a_plane_by_its_coefficients_is_the_plane_by_its_tilt(tilt, distance, thickness):
    lean = math.radians(tilt)
    normal = (0.0, math.sin(lean), math.cos(lean))
    by_tilt = plan(CHECK, tilt, distance, thickness)
    by_plane = plan_plane(CHECK, normal, distance * math.cos(lean), thickness)
    assert by_plane.line_time_us == pytest.approx(by_tilt.line_time_us, rel=1e-9)
    assert by_plane.delay_us == pytest.approx(by_tilt.delay_us, abs=1e-5)


@pytest.mark.parametrize("lean_deg", [-2.0, -0.01, 0.0, 0.01, 2.0, 30.0])
def test_a_floor_that_never_meets_the_axis_is_gated_all_along(lean_deg):
    lean = math.radians(lean_deg)
    normal, offset = (0.0, math.cos(lean), math.sin(lean)), 0.8
    settings = plan_plane(CHECK, normal, offset, 0.02)
    rows = np.arange(620, 1200, 20)
    kappa = (rows + 0.5 - 600) / CHECK.camera.lens.fy
    w = (normal[1] * kappa + normal[2]) / (offset - normal[1] * 0.05)
    lit_row = 1000 * (kappa + 0.1 * w) + 360
    centre = (settings.delay_us + (rows + 0.5) * settings.line_time_us) * CHECK.projector.rows_per_us
    assert np.allclose((lit_row - centre)[w > 0.05], 0, atol=1e-8)
    # across: points 11 mm above and below lie outside, 9 mm inside, at the depth where the thickness holds
    middle = int(np.argmin(np.abs(w - np.median(w[w > 0]))))
    for shift, inside in ((-0.013, False), (-0.007, True), (0.007, True), (0.013, False)):
        shifted = (normal[1] * kappa[middle] + normal[2]) / (offset + shift - normal[1] * 0.05)
        row = 1000 * (kappa[middle] + 0.1 * shifted) + 360
        assert (abs(row - centre[middle]) < settings.exposure_us * CHECK.projector.rows_per_us / 2) == inside


@given(
    data=st.data(),
    lean_deg=st.floats(-30, 30),
    aside=st.floats(-0.3, 0.3),
    offset=st.floats(0.5, 4),
    pivot=st.none() | st.floats(0.8, 1.2),
)
def test_a_general_rigs_gate_touches_the_plane_in_the_middle_of_the_picture(data, lean_deg, aside, offset, pivot):
    """There the plane's light comes at the gate's own instant, along the plane too, and the slab is as thick as asked.
    With a line time given, the plane pivots about that point."""
    rig, lean = data.draw(rigs(True)), math.radians(lean_deg)
    normal, thickness = (aside, math.sin(lean), math.cos(lean)), 1e-4
    lens, eye = rig.camera.lens, rig.camera_centre_m
    slopes = lens.normalise(lens.cx, np.array([0.0, lens.height / 2, lens.height]))[1]
    assume((normal[1] * slopes + normal[2] > 1e-6).all())  # every row sees the plane: their middle is the picture's
    slope = float(slopes[1])
    depth = (offset - np.dot(normal, eye)) / (normal[1] * slope + normal[2])
    middle = np.array([0.0, slope * depth + eye[1], depth + eye[2]])
    settings = plan_plane(rig, normal, offset, thickness)
    if pivot is not None:
        settings = plan_plane(rig, normal, offset, thickness, pivot * settings.line_time_us)

    def late_us(away_m):
        point = middle + away_m
        lit_us = rig.to_projector(point)[1] / rig.projector.rows_per_us
        return float(lit_us - rig.to_camera(point)[1] * settings.line_time_us - settings.delay_us)

    def gradient(direction):
        return (late_us(1e-5 * direction) - late_us(-1e-5 * direction)) / 2e-5

    across = math.hypot(gradient(np.array([0.0, 1.0, 0.0])), gradient(np.array([0.0, 0.0, 1.0])))
    assert abs(late_us(np.zeros(3))) < 1e-6 * (1 + across)
    assert settings.exposure_us == pytest.approx(thickness * across, rel=1e-4)
    if pivot is None:
        assert abs(gradient(np.array([0.0, normal[2], -normal[1]]))) < 1e-4 * across


@pytest.mark.parametrize(
    ("normal", "offset", "named"),
    [
        ((1.0, 0.0, 0.0), 1.0, "normal"),
        ((0.0, math.nan, 1.0), 1.0, "normal"),
        ((0.0, 1.0, 0.0), 0.0, "normal"),
        ((0.0, 0.0, 1.0), -1.0, "offset_m"),
        ((0.0, 0.0, 1.0), math.inf, "offset_m"),
    ],
)
def test_a_plane_that_no_gate_follows_is_refused_by_name(normal, offset, named):
    with pytest.raises(ValueError, match=f"^{named} is .*: it must be "):
        plan_plane(CHECK, normal, offset, 0.02)


def test_a_refused_tilt_has_few_digits():
    with pytest.raises(ValueError, match=r"^tilt_deg is 89\.12: "):
        plan(CHECK, 89.123456789, 0.3, 0.1)


@pytest.mark.parametrize(("exposure_us", "warned"), [(16_666.0, False), (16_667.0, False), (16_668.0, True)])
def test_the_exposure_nearest_to_a_period_is_none_too_long(exposure_us, warned):
    found = slab(CHECK, gate(12.820512820512821, 2000.0, exposure_us)).warnings
    assert any("longer than the projector's period" in warning for warning in found) == warned
