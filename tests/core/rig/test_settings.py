"""Settings, conventions and what hardware makes of them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.rig.settings import (
    LineTimes,
    PixelClocks,
    ShutterLimits,
    Steps,
    from_trigger,
    gate,
    quantise,
    residual,
    to_trigger,
)

LIMITS = ShutterLimits(PixelClocks(1000.0, (10.0, 50.0, 100.0)), Steps(0, 30_000, 1), Steps(100, 20_000, 5))
T = 16_666.7


@pytest.mark.parametrize("bad", [math.nan, math.inf, 0.0, -3.0])
@pytest.mark.parametrize("position", [0, 2])
def test_times_that_make_no_gate_are_refused_by_name(bad, position):
    values = [13.0, 2000.0, 300.0]
    values[position] = bad
    field = ("line_time_us", "delay_us", "exposure_us")[position]
    with pytest.raises(ValueError, match=rf"^{field} is {bad!r}: it must be a finite number above 0$"):
        gate(*values)


@pytest.mark.parametrize(
    ("delays", "exposures", "named"),
    [
        (Steps(0, 2e6, 1), Steps(100, 20_000, 5), "delay_us"),
        (Steps(-1.5e6, 0, 1), Steps(100, 20_000, 5), "delay_us"),
        (Steps(0, 30_000, 1), Steps(100, 1e7, 5), "exposure_us"),
        (Steps(0, 30_000, 1), Steps(100, 50, 5), "exposure_us"),
    ],
)
def test_a_shutter_reaches_no_further_than_gates_do(delays, exposures, named):
    with pytest.raises(ValueError, match=f"^{named} is .*: it must be within -1000000 to 1000000 us$"):
        ShutterLimits(LIMITS.line, delays, exposures)


def test_a_delay_may_be_negative_but_not_infinite():
    assert gate(13.0, -1697.2, 300.0).delay_us == -1697.2
    with pytest.raises(ValueError, match=r"^delay_us is nan: it must be a finite number$"):
        gate(13.0, math.nan, 300.0)


@given(st.floats(-1e4, 1e5), st.floats(1, 1e5))
def test_centre_and_start_conventions_convert_back_and_forth(delay, exposure):
    settings = gate(13.0, delay, exposure)
    trigger = to_trigger(settings)
    assert trigger.start_us == delay - exposure / 2
    assert from_trigger(trigger).delay_us == pytest.approx(delay, abs=1e-9)


@given(st.floats(5, 200), st.floats(-1e5, 1e5), st.floats(1, 1e5))
def test_rounding_stays_within_half_a_step_and_whole_periods(line_time, delay, exposure):
    asked = gate(line_time, delay, exposure)
    applied = quantise(LIMITS, asked, T)
    assert 1000.0 / applied.line_time_us in LIMITS.line.ladder_mhz
    assert 0 <= applied.delay_us <= 30_000
    assert applied.delay_us == round(applied.delay_us)
    turns = (applied.delay_us - delay) / T
    assert abs(turns - round(turns)) * T <= 0.5 + 1e-6
    assert 100 <= applied.exposure_us <= 20_000
    assert (applied.exposure_us - 100) % 5 == 0
    if 100 <= exposure <= 20_000:
        assert abs(residual(applied, asked).exposure_us) <= 2.5 + 1e-9
    assert quantise(LIMITS, applied, T) == applied


def test_the_nearest_clock_is_nearest_in_megahertz():
    clocks = PixelClocks(1000.0, (10.0, 50.0))
    assert clocks.clock_mhz(clocks.nearest(1000.0 / 29)) == pytest.approx(10)
    assert clocks.clock_mhz(clocks.nearest(1000.0 / 31)) == pytest.approx(50)


@pytest.mark.parametrize("ladder", [(), (2.0, 1.0), (1.0, 1.0), (-1.0, 2.0), (1.0, math.inf)])
def test_a_ladder_must_rise(ladder):
    with pytest.raises(ValueError, match="ladder_mhz"):
        PixelClocks(1000.0, ladder)


def test_line_times_go_in_steps():
    lines = LineTimes(5.0, 20.0, 0.25)
    assert lines.nearest(7.1) == pytest.approx(7.0)
    assert lines.nearest(99.0) == 20.0
    with pytest.raises(ValueError, match="max_us"):
        LineTimes(5.0, 4.0, 0.25)
