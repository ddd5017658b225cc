"""What each camera row records, against counting the instants one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inverse_depth_bounds import inverse_depth_bounds
from rigs import bent, turned
from slopegate.core.gating.gate import (
    complement,
    discrete_weights,
    exact_upright_line_time,
    phase_us,
    recorded_times,
    row_windows,
    rows_at_phase,
    slope_ratio,
    upright_line_time,
    weights,
)
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)
T = CHECK.projector.period_us
V_P = CHECK.projector.rows_per_us

clocks = st.floats(10, 128)
delays = st.floats(-20_000, 40_000)
exposures = st.floats(1, 60_000)


def line_time(clock_mhz):
    return CHECK.camera.shutter.line.line_time_us(clock_mhz)


def count_instants(settings, projector_rows, camera_rows=None):
    """Recordings of projector rows (N_c, n) by testing every frame's instant against the window, in float64."""
    if camera_rows is None:
        camera_rows = np.arange(projector_rows.shape[0])[:, None]
    centre = settings.delay_us + (camera_rows + 0.5) * settings.line_time_us
    counts = np.zeros(projector_rows.shape, int)
    nearest_edge = np.full(projector_rows.shape, np.inf)
    for frame in range(-12, 20):
        instant = projector_rows / V_P + frame * T
        start, end = centre - settings.exposure_us / 2, centre + settings.exposure_us / 2
        counts += (instant >= start) & (instant < end)
        nearest_edge = np.minimum(nearest_edge, np.minimum(abs(instant - start), abs(instant - end)))
    return counts, nearest_edge


@given(clocks, delays, exposures, st.integers(0, 2**32 - 1))
def test_weights_count_every_frame(clock, delay, exposure, seed):
    settings = gate(line_time(clock), delay, exposure)
    rows = np.random.default_rng(seed).uniform(0, 720, (1200, 3))
    counted, edge = count_instants(settings, rows)
    found = weights(row_windows(CHECK, settings), rows)
    assert np.array_equal(found[edge > 1e-6], counted[edge > 1e-6])


@given(clocks, delays, exposures, st.integers(0, 2**32 - 1))
def test_the_phase_tells_what_is_recorded(clock, delay, exposure, seed):
    """A gate counts the periods at which a point's phase lies in the exposure of row coordinate 0."""
    settings = gate(line_time(clock), delay, exposure)
    rng = np.random.default_rng(seed)
    camera_rows, rows = rng.integers(0, 1200, 500), rng.uniform(0, 720, 500)
    phases = phase_us(CHECK, settings.line_time_us, camera_rows + 0.5, rows)
    turns = (np.array([[settings.end_us], [settings.start_us]]) - phases) / T
    clear = np.abs(turns - np.rint(turns)).min(axis=0) > 1e-9
    found = recorded_times(row_windows(CHECK, settings), camera_rows, rows)
    assert np.array_equal(found[clear], (np.floor(turns[0]) - np.floor(turns[1]))[clear])
    back = rows_at_phase(CHECK, settings.line_time_us, camera_rows + 0.5, phases)
    np.testing.assert_allclose(back, rows, rtol=0, atol=1e-8)


def test_weights_of_an_image_are_those_of_its_points():
    windows = row_windows(CHECK, gate(line_time(70), 500.0, 3000.0))
    image = np.random.default_rng(1).uniform(-100, 720, (1200, 4)).astype(np.float32)
    row, column = np.indices(image.shape)
    counts = recorded_times(windows, row, image)
    assert np.array_equal(weights(windows, image), counts)
    assert np.array_equal(weights(windows, image[:, 2]), counts[:, 2])
    assert (counts[image < 0] == 0).all()
    assert set(counts[column == 3]) == {0, 1}


def test_the_upright_line_time_is_the_one_at_which_b_is_one():
    exact = exact_upright_line_time(CHECK.camera.lens, CHECK.projector)
    assert slope_ratio(CHECK, exact) == pytest.approx(1, abs=3e-16)
    assert upright_line_time(CHECK) == line_time(78)


def test_windows_of_the_papers_masking_settings_wrap_round_the_frame():
    settings = gate(line_time(76), 21_270, 16_400)
    windows = row_windows(CHECK, settings)
    assert set(windows.inside) == {0, 1}, "some rows see a gap, others a stretch"
    assert np.array_equal(windows.inside + windows.outside, np.ones(1200))


@given(clocks, st.integers(-16_667, 33_334), st.integers(1, 50_000), st.integers(0, 2**32 - 1))
def test_a_gate_and_its_complement_record_everything_once(clock, delay, exposure, seed):
    settings = gate(line_time(clock), float(delay), float(exposure))
    rows = np.random.default_rng(seed).uniform(0, 720, (1200, 5)).astype(np.float32)
    first = row_windows(CHECK, settings)
    rows[:, 0] = np.clip(first.low, 0, 719.9)  # exactly on an edge, where rounding would show
    rest = complement(settings, T)
    both = weights(first, rows) + weights(row_windows(CHECK, rest), rows)
    assert (both == np.ceil(exposure / T)).all()


def test_whole_periods_have_no_complement():
    with pytest.raises(ValueError, match=r"exposure_us is 33333\.4.*whole number of projector periods"):
        complement(gate(line_time(78), 0, 2 * T), T)


def test_an_exposure_too_short_to_record_leaves_everything_to_its_complement():
    nothing = gate(line_time(78), 2000.0, 1e-12)
    rest = complement(nothing, T)
    assert rest.exposure_us == T
    rows = np.random.default_rng(1).uniform(0, 720, (1200, 5))
    assert (weights(row_windows(CHECK, nothing), rows) == 0).all()
    assert (weights(row_windows(CHECK, rest), rows) == 1).all()


@given(clocks, delays, st.integers(1, 40))
def test_slices_that_tile_the_period_record_every_row_once(clock, delay, count):
    width = T / count
    total = np.zeros((1200, 6), int)
    rows = np.random.default_rng(count).uniform(0, 720, (1200, 6))
    for k in range(count):
        total += weights(row_windows(CHECK, gate(line_time(clock), delay + k * width, width)), rows)
    _, edge = count_instants(gate(line_time(clock), delay, width), rows)
    off_edges = np.abs((edge / width) - np.round(edge / width)) * width > 1e-6
    assert (total[off_edges] == 1).all()
    assert np.mean(total == 1) > 0.99


@given(clocks, delays, exposures, st.integers(0, 1199))
def test_discrete_rows_are_a_trapezoid_within_a_row_of_the_continuous_window(clock, delay, exposure, row):
    settings = gate(line_time(clock), delay, exposure)
    trapezoid = discrete_weights(CHECK, settings, row, np.arange(720))
    hard, edge = count_instants(settings, np.arange(720)[None, :] + 0.5, row)
    inner = edge[0] * V_P > 0.5 + 1e-6
    assert np.allclose(trapezoid[inner], hard[0][inner], atol=1e-6)
    assert abs(trapezoid.sum() - hard.sum()) <= 2 * (2 + exposure // T)


@given(clocks, st.integers(2, 900), st.integers(1, 50))
def test_discrete_rows_sum_over_all_delays_to_the_exposure(clock, count, width):
    step = T / count
    delays_us = np.arange(count) * step
    totals = [discrete_weights(CHECK, gate(line_time(clock), d, width * step), 600, [0, 300, 719]) for d in delays_us]
    assert np.allclose(np.sum(totals, axis=0), width, rtol=1e-9)


def general_rig(distortion=()):
    camera = RigCamera(Lens(160, 120, 170.0, 168.0, 83.0, 58.0), CHECK.camera.shutter)
    projector = RigProjector(Lens(1280, 720, 1000.0, 990.0, 630.0, 355.0), T)
    moved = turned(ideal_rig(camera, projector, 0.1), (np.degrees(0.06), 0.0, 0.0), (0.02, -0.11, 0.01))
    return bent(moved, distortion, tuple(0.3 * k for k in distortion))


@pytest.mark.parametrize("distortion", [(), (-0.2, 0.05, 1e-3, -2e-3)], ids=["undistorted", "distorted"])
@pytest.mark.parametrize(
    ("delay", "exposure"), [(2000.0, 700.0), (600.0, 9000.0), (18_600.0, 500.0), (3000.0, 30_000.0)]
)
def test_bounds_per_pixel_agree_with_the_row_that_lights_each_point(distortion, delay, exposure):
    rig = general_rig(distortion)
    lens = rig.camera.lens
    settings = gate(9.9 * 13, delay, exposure)
    rng = np.random.default_rng(5)
    rows, columns = np.mgrid[0:120, 0:160] + 0.5
    depth = rng.uniform(0.3, 4, (120, 160))
    points = rig.camera_centre_m + rig.camera_rays(columns, rows) * depth[..., None]
    _, lit_row, ahead = rig.to_projector(points)
    inside = (ahead > 0) & (lit_row >= 0) & (lit_row < 720)
    recorded = weights(row_windows(rig, settings), np.where(inside, lit_row, -1.0))
    bounded = np.zeros((lens.height, lens.width), int)
    for frame in range(-4, 8):
        low, high = inverse_depth_bounds(rig, settings, frame)
        assert low.shape == (120, 160)
        bounded += (1 / depth >= low) & (1 / depth < high)
    assert inside.mean() > 0.5
    assert np.array_equal(bounded[inside], recorded[inside])


def test_bounds_of_the_ideal_rig_are_one_pair_a_row_and_affine_in_it():
    settings = gate(line_time(76), 2000.0, 600.0)
    low, high = inverse_depth_bounds(CHECK, settings)
    assert low.shape == high.shape == (1200, 1)
    middle = (low[:, 0] > 0) & (np.arange(1200) > 100) & (np.arange(1200) < 900)
    for bound in (low[middle, 0], high[middle, 0]):
        assert np.abs(np.diff(bound, 2)).max() < 1e-12
    width = (high - low)[middle, 0]
    assert np.allclose(width, 600.0 * V_P / 1000.0 / CHECK.baseline_m, rtol=1e-12)


def test_general_and_ideal_bounds_agree_on_the_same_rig():
    nearly = Rig(CHECK.camera, CHECK.projector, (0.0, -0.1, 1e-12))
    settings = gate(line_time(80), 2194.5, 400.0)
    ideal, general = inverse_depth_bounds(CHECK, settings), inverse_depth_bounds(nearly, settings)
    for exact, found in zip(ideal, general, strict=True):
        assert np.allclose(found[:, ::200], exact, rtol=0, atol=1e-9)
