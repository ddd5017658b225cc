"""Laws of conservation: what must come out the same to the last bit, and what to rounding."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from inverse_depth_bounds import inverse_depth_bounds
from slopegate.core.exposure.gated import gated
from slopegate.core.gating.gate import complement, discrete_weights, row_windows, slab, weights
from slopegate.core.gating.plan import plan
from slopegate.core.rig.rig import Lens, Rig, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)
T = CHECK.projector.period_us

periods = st.one_of(st.floats(1000, 1e6), st.sampled_from([16_666.7, 16_667.0, 20_000.0, 1000.0, 8333.333]))
line_times = st.floats(1e-6, 2000)
delays = st.one_of(st.floats(-1e6, 1e6), st.integers(-33_333, 33_333).map(float))
exposures = st.one_of(st.floats(1e-3, 1e6), st.integers(1, 50_000).map(float))


def rig_of(period_us, active=0.92, rows=64):
    camera = RigCamera(Lens(48, rows, 100.0, 100.0, 24.0, rows / 2), CHECK.camera.shutter)
    return ideal_rig(camera, RigProjector(Lens(1280, 720, 1000.0, 1000.0, 640.0, 360.0), period_us, active), 0.1)


def rows_at_edges(windows, seed):
    """Projector rows (n, 48) float32: a third anywhere, the others on and next to the edges of their camera row."""
    rng = np.random.default_rng(seed)
    count = windows.low.size
    rows = rng.uniform(0, 720, (count, 48)).astype(np.float32)
    for first, edges in ((16, windows.low), (32, windows.high)):
        near = np.repeat(edges.astype(np.float32)[:, None], 16, axis=1)
        near[:, 5:10] = np.nextafter(near[:, 5:10], np.float32(0))
        near[:, 10:] = np.nextafter(near[:, 10:], np.float32(np.inf))
        rows[:, first : first + 16] = near
    return np.clip(rows, 0, np.nextafter(np.float32(720), np.float32(0)))


def image(rig, settings, rows, direct):
    """Counts of `direct` through the float32 kernel."""
    return gated(rows, direct, np.zeros_like(direct), row_windows(rig, settings), 0.0)


@given(periods, line_times, delays, exposures, st.integers(0, 2**32 - 1))
def test_gate_and_complement_are_everything_for_any_settings(period, line_time, delay, exposure, seed):
    rig, settings = rig_of(period), gate(line_time, delay, exposure)
    assume(abs(exposure - round(exposure / period) * period) > 2e-6 or exposure < period / 2)
    rest = complement(settings, period)
    first, second = row_windows(rig, settings), row_windows(rig, rest)
    rows = rows_at_edges(first, seed)
    times = math.ceil(exposure / period)
    exact = np.concatenate([rows.astype(np.float64), first.low[:, None], first.high[:, None]], axis=1)
    assert (weights(first, exact) + weights(second, exact) == times).all()
    light = np.random.default_rng(seed).uniform(0, 1, rows.shape).astype(np.float32)
    ones = np.ones_like(light)
    assert (image(rig, settings, rows, ones) + image(rig, rest, rows, ones) == times).all()
    if times == 1:
        together = image(rig, settings, rows, light) + image(rig, rest, rows, light)
        assert np.array_equal(together, light), "one of the two is 0, so even float32 sums are exact"


@given(periods, delays, exposures)
def test_the_complement_of_the_complement_shares_every_edge(period, delay, exposure):
    assume(abs(exposure - round(exposure / period) * period) > 3e-6)
    rig, settings = rig_of(period), gate(50.0, delay, exposure)
    rest = complement(settings, period)
    windows, again = (row_windows(rig, s) for s in (settings, complement(rest, period)))
    assert np.array_equal(windows.low, again.low)
    assert np.array_equal(windows.high, again.high)
    assert np.ptp(windows.inside - again.inside) == 0, "they differ by the whole periods that the first one has"
    assert np.array_equal(windows.inside - again.inside, windows.outside - again.outside)


@given(
    periods.map(lambda period: min(period, 50_000.0)),
    line_times,
    st.floats(-20_000, 20_000).map(lambda start: round(start, 1)),
    st.lists(st.integers(1, 9999), min_size=1, max_size=12, unique=True),
    st.integers(0, 2**32 - 1),
)
def test_slices_that_tile_a_period_add_up_to_the_floodlit_image(period, line_time, start, cuts, seed):
    """Edges in tenths of a microsecond, as people type them, and the period's own end, which may be any number."""
    rig = rig_of(period)
    edges = [start, *(start + round(cut / 10_000 * period, 1) for cut in sorted(cuts)), start + period]
    slices = [gate(line_time, (a + b) / 2, b - a) for a, b in pairwise(edges) if b > a]
    rng = np.random.default_rng(seed)
    rows = rng.uniform(0, 720, (64, 48)).astype(np.float32)
    light = rng.uniform(0, 1, rows.shape).astype(np.float32)
    total = sum(image(rig, part, rows, light).astype(np.float64) for part in slices)
    flood = image(rig, gate(line_time, start, period), rows, light)
    assert np.array_equal(flood, light)
    assert np.array_equal(total.astype(np.float32), flood)
    whole = sum(discrete_weights(rig, part, np.arange(64)[:, None], np.arange(720)) for part in slices)
    assert np.abs(whole - 1).max() < 1e-9


@pytest.mark.parametrize("exposure_rows", [1, 7, 400, 799, 800, 1700])
def test_pi_summed_over_all_delays_is_the_exposure_everywhere(exposure_rows):
    """The paper's Pi in whole rows (model section 5): a period of 800 rows, 720 of them lit."""
    period = 16_000.0
    rig = rig_of(period, active=0.9)
    row_us = period / 800
    total = np.zeros((64, 720))
    for delay in range(800):
        pi = discrete_weights(
            rig, gate(row_us, delay * row_us, exposure_rows * row_us), np.arange(64)[:, None], range(720)
        )
        assert (pi >= 0).all()
        total += pi
    assert np.allclose(total, exposure_rows, rtol=1e-12)


@given(st.floats(1, 50), st.floats(1, 2000), st.floats(0.5, 200))
def test_doubling_the_period_changes_nothing_within_a_frame(line_time, late, exposure):
    """Twice the blanking, the same scan: a gate inside the lit part records the same rows and makes the same slab."""
    once, twice = rig_of(T, 0.92), rig_of(2 * T, 0.46)
    assert once.projector.rows_per_us == twice.projector.rows_per_us
    infinity = 360 / once.projector.rows_per_us - 32 * line_time
    settings = gate(line_time, infinity + late + exposure / 2, exposure)
    one, two = row_windows(once, settings), row_windows(twice, settings)
    for name in ("inside", "outside"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
    for name in ("low", "high"):  # rows' own offsets are rounded to ticks, and ticks are shares of the period
        assert np.allclose(getattr(one, name), getattr(two, name), rtol=0, atol=1e-12), name
    found, same = slab(once, settings), slab(twice, settings)
    assert found.frame == 0
    assert found == replace(same, windows_us=found.windows_us, warnings=found.warnings)
    wish = (10.0, 1.05, 0.1)
    assert plan(once, *wish) == plan(twice, *wish)


@given(st.floats(-5e5, 5e5), st.floats(1, 5e4), st.integers(-20, 20))
def test_whole_periods_of_delay_change_nothing(delay, exposure, frames):
    """Exactly, for a period and a delay that float64 adds exactly."""
    period, delay = 16_384.0, math.ldexp(round(math.ldexp(delay, 20)), -20)
    rig = rig_of(period)
    one, other = (row_windows(rig, gate(37.3, d, exposure)) for d in (delay, delay + frames * period))
    for name in ("low", "high", "inside", "outside"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


NARROW = replace(CHECK, camera=replace(CHECK.camera, lens=replace(CHECK.camera.lens, width=8, cx=4.0)))


def nearly_ideal(turn=0.0, bend=0.0, sideways=0.0):
    c, s = math.cos(turn), math.sin(turn)
    lens_c, lens_p = (
        replace(part.lens, distortion=(bend, 0.0, 0.0, 0.0)) for part in (NARROW.camera, NARROW.projector)
    )
    return Rig(
        replace(NARROW.camera, lens=lens_c),
        replace(NARROW.projector, lens=lens_p),
        (sideways, -0.1, 0.0),
        ((1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c)),
    )


@pytest.mark.parametrize(
    ("rig", "off"),
    [(nearly_ideal(turn=1e-12), 2e-11), (nearly_ideal(bend=1e-15), 1e-12), (nearly_ideal(sideways=1e-14), 1e-12)],
    ids=["turned by 1e-12", "bent by 1e-15", "shifted by 1e-14"],
)
@pytest.mark.parametrize("tilt", [-70.0, -1e-9, 0.0, 15.0, 70.0])
@pytest.mark.parametrize("distance", [0.3, 1.05, 8.0])
def test_ideal_and_general_rig_agree(rig, off, tilt, distance):
    """A turn by 1e-12 moves rows by 1e-9, that is inverse distances by 1e-12 / b; the others by rounding only."""
    assert not rig.is_ideal
    thickness = distance / 10
    if abs(math.tan(math.radians(tilt))) * 0.1 > 1.8 * distance:
        return
    wanted, got = plan(CHECK, tilt, distance, thickness), plan(rig, tilt, distance, thickness)
    assert got.line_time_us == pytest.approx(wanted.line_time_us, rel=10 * off)
    assert got.delay_us == pytest.approx(wanted.delay_us, abs=1e5 * off)
    assert got.exposure_us == pytest.approx(wanted.exposure_us, rel=100 * off)
    ideal, general = slab(CHECK, wanted), slab(rig, wanted)
    for name in ("inverse_near_per_m", "inverse_distance_per_m", "inverse_far_per_m", "hinge_curvature_per_m", "B"):
        assert getattr(general, name) == pytest.approx(getattr(ideal, name), abs=50 * off), name
    assert general.tilt_deg == pytest.approx(ideal.tilt_deg, abs=1000 * off)
    for name in ("near", "centre", "far"):
        one, other = getattr(ideal, name), getattr(general, name)
        assert np.allclose(one.normal, other.normal, rtol=0, atol=50 * off)
        assert other.offset_m == pytest.approx(one.offset_m, rel=1000 * off)
    for exact, found in zip(inverse_depth_bounds(NARROW, wanted), inverse_depth_bounds(rig, wanted), strict=True):
        assert np.allclose(found, exact, rtol=0, atol=1e-8 if rig.camera.lens.distorted else 50 * off)
    assert np.array_equal(row_windows(CHECK, wanted).low, row_windows(rig, wanted).low)
