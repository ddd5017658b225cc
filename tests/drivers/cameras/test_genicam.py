from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from slopegate.drivers.cameras.device_camera import trigger_delay, widened
from slopegate.drivers.cameras.genicam import probe
from slopegate.drivers.cameras.genicam_device import frames_since
from slopegate.drivers.files.rig_files import load_rig

PERIOD_US = 16666.7


@given(
    st.floats(-50000, 50000),
    st.floats(0, 20000),
    st.floats(13, 200000),
    st.sampled_from([0.0, 1.0, 12.5]),
)
def test_a_trigger_delay_is_in_range_and_off_by_whole_periods(
    exact_us: float, low: float, length: float, step: float
) -> None:
    first_us = exact_us + math.ceil((low - exact_us) / PERIOD_US) * PERIOD_US
    assume(abs(first_us - low - length) > 1e-6)
    if first_us > low + length:
        with pytest.raises(ValueError, match="the camera's goes from"):
            trigger_delay((low, low + length, step), exact_us, PERIOD_US)
        return
    delay_us, turns = trigger_delay((low, low + length, step), exact_us, PERIOD_US)
    assert low <= delay_us <= low + length
    assert delay_us - turns * PERIOD_US == pytest.approx(exact_us, abs=max(step, 1e-6))
    if low <= exact_us <= low + length:
        assert turns == 0, "a delay within the range is told as it is"


def test_an_unreachable_delay_names_what_the_camera_has() -> None:
    with pytest.raises(ValueError, match="goes from 0 to 1000 us"):
        trigger_delay((0.0, 1000.0, 0.0), 12000.0, PERIOD_US)


@pytest.mark.parametrize(
    ("last", "now", "step"),
    [
        (-1, 65300, 1),
        (-1, 0, 1),
        (1, 2, 1),
        (7, 10, 3),
        (65535, 1, 1),  # 0 is left out
        (65534, 2, 3),
        (65535, 65536, 1),  # numbers of 64 bits
        (70000, 69990, -10),
        (10, 10, 0),
        (10, 9, -1),
    ],
)
def test_frame_numbers_go_on_when_16_bits_wrap(last: int, now: int, step: int) -> None:
    assert frames_since(last, now) == step


@given(st.integers(1, 400), st.integers(1, 16), st.integers(1, 16), st.data())
def test_rows_are_widened_to_what_the_camera_can_do_and_no_further(
    units: int, step: int, least_units: int, data: st.DataObject
) -> None:
    height, least = units * step, min(least_units, units) * step
    first = data.draw(st.integers(0, height))
    last = data.draw(st.integers(first, height))
    low, high = widened((first, last), height, least, step)
    assert 0 <= low <= first <= last <= high <= height or first == last
    assert 0 <= low < high <= height
    assert low % step == high % step == 0
    assert high - low >= least
    assert high - low <= max(least, last - first + 2 * step - 1)


class Numbers:
    """A camera with numbers of these names, all of which can be written."""

    def __init__(self, *names: str) -> None:
        self._names = names

    def has(self, name: str) -> bool:
        return name in self._names

    writable = has

    def span(self, name: str) -> tuple[float, float, float]:
        return 0.0, 1e6, 1.0


@pytest.mark.parametrize(
    ("names", "no_trigger", "said"),
    [
        (("ExposureTime", "TriggerDelay", "OffsetY", "Height"), "", ""),
        (("ExposureTime", "TriggerDelay", "Height"), "", "no region of interest"),
        (("ExposureTime", "OffsetY", "Height"), "", "no trigger delay to make up for"),
        (("ExposureTime", "OffsetY", "Height"), "It runs by itself.", ""),
    ],
)
def test_fewer_rows_are_read_only_where_each_keeps_its_gate(names: tuple[str, ...], no_trigger: str, said: str) -> None:
    shutter = probe(Numbers(*names), load_rig(None), no_trigger)  # type: ignore[arg-type]
    assert shutter is not None
    assert said in shutter.can.rows.missing
    assert bool(shutter.can.rows) == (not said)
