"""Small steps through every place where a formula could break: parallel planes, infinity, blanking, the wrap.

"Small" is one unit in the last place of the setting that is walked, then ten times as much, and so on: whatever jumps,
jumps somewhere on such a walk.
"""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from inverse_depth_bounds import inverse_depth_bounds
from rigs import bent, turned
from slopegate.core.gating.gate import complement, discrete_weights, row_windows, slab, weights
from slopegate.core.gating.plan import plan
from slopegate.core.rig.axis import infinity_us
from slopegate.core.rig.rig import Lens, RigCamera, RigProjector, ideal_rig
from slopegate.core.rig.settings import MAX_TIME_US, gate
from slopegate.drivers.files.rig_files import load_rig

CHECK = load_rig(None)
T = CHECK.projector.period_us
V_P = CHECK.projector.rows_per_us
LAST_LIT_US = 720 / V_P
FLAT_US = 1000 / (V_P * CHECK.camera.lens.fy)
TURNED = turned(CHECK, (math.degrees(0.05), 0.0, 0.0), (0.01, -0.1, 0.02))
BENT = bent(TURNED, (-0.1, 0.01, 1e-3, 1e-3), ())
RIGS = pytest.mark.parametrize("rig", [CHECK, TURNED, BENT], ids=["ideal", "turned", "bent"])


def steps_about(middle, decades=10, each=3):
    """Rising values either side of `middle`, the nearest one unit in the last place away, `middle` among them."""
    unit = math.ulp(middle)
    away = [count * unit * 10**decade for decade in range(decades) for count in range(1, each + 1)]
    return sorted({middle, *(middle + part for part in away), *(middle - part for part in away)})


def numbers(found):
    planes = [(plane.A, *plane.normal, plane.offset_m) for plane in (found.near, found.centre, found.far)]
    distances = [found.distance_m, found.near_m, found.far_m, found.thickness_m, found.hinge_y_m]
    inverse = [found.inverse_near_per_m, found.inverse_distance_per_m, found.inverse_far_per_m]
    flat = [number for plane in planes for number in plane] + [d for d in distances if d is not None] + inverse
    return [*flat, found.B, found.tilt_deg, found.hinge_curvature_per_m]


def exact_B_minus_1(rig, line_time):
    projector = rig.projector
    period = Fraction(projector.active_fraction) * Fraction(projector.period_us) / projector.lens.height
    return Fraction(line_time) * Fraction(rig.camera.lens.fy) / period / Fraction(projector.lens.fy) - 1


@RIGS
def test_b_through_one(rig):
    slabs = [
        slab(rig, gate(line_time, 2028.2 - (line_time - FLAT_US) * 600, 300)) for line_time in steps_about(FLAT_US)
    ]
    assert all(math.isfinite(number) for found in slabs for number in numbers(found))
    for one, next_one in pairwise(slabs):
        assert one.B <= next_one.B
        assert one.tilt_deg <= next_one.tilt_deg + 1e-12
        assert one.hinge_curvature_per_m <= next_one.hinge_curvature_per_m + 1e-14 / rig.baseline_m
        assert abs(one.inverse_distance_per_m - next_one.inverse_distance_per_m) < 1e-3
    if rig.is_ideal:
        for found in slabs:
            sign = exact_B_minus_1(rig, found.line_time_us)
            assert np.sign(found.tilt_deg) == np.sign(found.hinge_curvature_per_m) == np.sign(float(sign))
            assert found.hinge_y_m is None or found.hinge_y_m * found.hinge_curvature_per_m == pytest.approx(1)


@RIGS
def test_inverse_design_through_b_equal_to_one(rig):
    tilts = [sign * 10.0**-decade for sign in (-1, 1) for decade in range(0, 18)] + [0.0, 5e-324]
    designs = [plan(rig, tilt, 1.05, 0.1) for tilt in sorted(tilts)]
    for one, next_one in pairwise(designs):
        assert one.line_time_us <= next_one.line_time_us * (1 + 1e-15)
        for name in ("delay_us", "exposure_us"):
            assert abs(getattr(one, name) - getattr(next_one, name)) < 200


@RIGS
@pytest.mark.parametrize("line_time", [FLAT_US * 0.8, np.nextafter(FLAT_US, 0), FLAT_US, FLAT_US * 1.1])
def test_a_through_zero_and_distance_through_infinity(rig, line_time):
    line_time = float(line_time)
    infinity = float(infinity_us(rig, line_time))
    low, high = infinity - 1, infinity + 1
    for _ in range(100):
        middle = (low + high) / 2
        beyond = slab(rig, gate(line_time, middle, 300)).inverse_distance_per_m < 0
        low, high = (middle, high) if beyond else (low, middle)
    slabs = [slab(rig, gate(line_time, delay, 300)) for delay in steps_about(high)]
    assert high == pytest.approx(infinity, abs=1e-9)
    assert {found.frame for found in slabs} == {0}
    assert all(math.isfinite(number) or number == math.inf for found in slabs for number in numbers(found))
    signs = [(found.inverse_distance_per_m > 0) - (found.inverse_distance_per_m < 0) for found in slabs]
    assert signs == sorted(signs)
    assert {-1, 1} <= set(signs)
    for one, next_one in pairwise(slabs):
        noise = 0 if rig is not BENT else 1e-13
        assert next_one.inverse_distance_per_m - one.inverse_distance_per_m >= -noise
        turned_by = next_one.centre.A - one.centre.A
        assert turned_by >= -noise
        if abs(line_time / FLAT_US - 1) > 0.05:  # else the plane at infinity, which has no normal, is met
            assert max(abs(a - b) for a, b in zip(one.centre.normal, next_one.centre.normal, strict=True)) < 0.05
            assert abs(one.tilt_deg - next_one.tilt_deg) < 5
    for found in slabs:
        assert (found.distance_m is None) == (found.inverse_distance_per_m <= 0)
        assert found.near_m is not None, "half the exposure on, the near surface is at a finite distance"
        assert found.far_m is None
        assert found.thickness_m is None
    if rig.is_ideal and line_time != FLAT_US:
        delays = steps_about(high)
        exactly = Fraction(360) * Fraction(0.92) * Fraction(T) / 720 - Fraction(line_time) * 600
        exact = [np.sign(float(Fraction(delay) - exactly)) for delay in delays]
        assert exact == signs, "the sign is that of exact arithmetic, one unit in the last place from infinity too"


def test_the_plane_at_infinity_itself():
    lens_c, lens_p = Lens(8, 64, 100.0, 100.0, 4.0, 32.0), Lens(8, 64, 100.0, 100.0, 4.0, 32.0)
    rig = ideal_rig(RigCamera(lens_c, CHECK.camera.shutter), RigProjector(lens_p, 16384.0, 0.5), 0.25)
    found = slab(rig, gate(128.0, 0.0, 4096.0))
    assert (found.B, found.centre.A, found.tilt_deg, found.hinge_curvature_per_m) == (1.0, 0.0, 0.0, 0.0)
    assert (found.centre.normal, found.centre.offset_m) == ((0.0, 0.0, 1.0), math.inf)
    assert (found.distance_m, found.inverse_distance_per_m, found.hinge_y_m) == (None, 0.0, None)
    assert found.inverse_far_per_m == -found.inverse_near_per_m < 0


def test_bounds_pass_through_infinity_without_a_step():
    row = 600
    infinity = (360 + 0.5 * 0.6) / V_P - (row + 0.5) * FLAT_US
    bounds = [inverse_depth_bounds(CHECK, gate(FLAT_US, d, 300)) for d in steps_about(infinity + 150)]
    for name, side in (("low", 0), ("high", 1)):
        values = [bound[side][row, 0] for bound in bounds]
        assert all(value >= 0 and math.isfinite(value) for value in values), name
        assert values == sorted(values), name
    low = [bound[0][row, 0] for bound in bounds]
    assert low[0] == 0 < low[-1]
    assert min(value for value in low if value > 0) < 1e-12, "no gap between infinity and the first finite plane"


EDGES = [0.0, LAST_LIT_US, T, 2 * T, -T, LAST_LIT_US - T, 100 / V_P]


@pytest.mark.parametrize("edge_us", EDGES)
@pytest.mark.parametrize("exposure", [1.0, 400.0, LAST_LIT_US, T - 400.0, T + 400.0])
@pytest.mark.parametrize("side", [-1, 1], ids=["start", "end"])
def test_a_window_edge_through_blanking_and_wrap(edge_us, exposure, side):
    row = 600
    middle = edge_us - (row + 0.5) * 12.0 - side * exposure / 2
    rows = np.append(np.arange(0, 720, 7.5), np.nextafter(720.0, 0))
    periods = T * V_P
    contents, counts, trapezoids = [], [], []
    for delay in steps_about(middle, decades=9):
        settings = gate(12.0, delay, exposure)
        windows = row_windows(CHECK, settings)
        low, high = windows.low[row], windows.high[row]
        assert 0 <= low <= high <= periods * (1 + 1e-15)
        assert abs(int(windows.inside[row]) - int(windows.outside[row])) == 1
        contents.append((high - low) * windows.inside[row] + (periods - high + low) * windows.outside[row])
        counts.append(weights(windows, np.tile(rows, (1200, 1)))[row])
        trapezoids.append(discrete_weights(CHECK, settings, row, np.arange(720)))
    assert np.allclose(contents, exposure * V_P, rtol=0, atol=1e-9), "light of a whole period, blanking included"
    assert np.ptp(np.array(counts), axis=0).max() <= 1
    assert (np.abs(np.diff(counts, axis=0)).sum(axis=0) <= 1).all(), "each point is gained or lost once, for good"
    moved = np.abs(np.diff(np.array(steps_about(middle, decades=9)))) * V_P
    assert (np.abs(np.diff(trapezoids, axis=0)).max(axis=1) <= moved + 1e-9).all()


def test_read_outs_over_two_periods_of_delay():
    """Within a projector frame, shorter delay is farther; from one frame to the next everything repeats."""
    before = None
    for delay in np.arange(-T, T, 13.0):
        found = slab(CHECK, gate(FLAT_US * 1.1, float(delay), 300))
        assert all(math.isfinite(number) or number == math.inf for number in numbers(found))
        if before is not None:
            assert found.frame in (before.frame, before.frame + 1)
            if found.frame == before.frame:
                assert found.inverse_distance_per_m > before.inverse_distance_per_m
        before = found


@pytest.mark.parametrize("periods", [1, 2, 3])
def test_exposures_through_whole_periods(periods):
    for exposure in steps_about(periods * T, decades=11):
        settings = gate(12.0, 2000.0, exposure)
        windows = row_windows(CHECK, settings)
        content = (windows.high - windows.low) * (windows.inside - windows.outside) + windows.outside * T * V_P
        assert np.allclose(content, exposure * V_P, rtol=0, atol=1e-9)
        if abs(exposure - periods * T) > 1.1e-6:
            rest = complement(settings, T)
            assert rest.exposure_us == pytest.approx(-exposure % T, abs=1e-8)
        elif abs(exposure - periods * T) < 0.9e-6:
            with pytest.raises(ValueError, match="exposure_us"):
                complement(settings, T)


@RIGS
def test_the_corners_of_the_domain_stay_finite(rig):
    for line_time in (1e-6, FLAT_US, 1e6):
        for delay in (-MAX_TIME_US, -0.0, 5e-324, MAX_TIME_US):
            for exposure in (5e-324, 1e-9, T, MAX_TIME_US):
                settings = gate(line_time, delay, exposure)
                found = slab(rig, settings)
                assert all(math.isfinite(number) or number == math.inf for number in numbers(found))
                windows = row_windows(rig, settings)
                assert (windows.low <= windows.high).all()
                assert (windows.low >= 0).all()
                assert (windows.outside >= 0).all()
                assert (windows.inside >= 0).all()
                assert np.isfinite(discrete_weights(rig, settings, [0, 1199], [0, 719])).all()


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ((12.0, 1.1e6, 1.0), "delay_us is 1100000.0: it must be from -1000000 to 1000000 us"),
        ((12.0, -9e9, 1.0), "delay_us is -9000000000.0: it must be from -1000000 to 1000000 us"),
        ((12.0, 0.0, 9e9), "exposure_us is 9000000000.0: it must be at most 1000000 us"),
        ((1e-7, 0.0, 1.0), "line_time_us is 1e-07: it must be from 1e-06 to 1000000 us"),
        ((1e300, 0.0, 1.0), r"line_time_us is 1e\+300: it must be from 1e-06 to 1000000 us"),
    ],
)
def test_beyond_the_domain_one_sentence(values, named):
    with pytest.raises(ValueError, match=f"^{named}$"):
        gate(*values)
