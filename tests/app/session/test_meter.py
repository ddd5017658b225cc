"""Rates, losses and latencies from made-up clocks."""

from __future__ import annotations

import pytest

from slopegate.app.session.meter import Meter
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.drivers.contract.frame import FrameStamp


def stamp(sequence: int, time_s: float, asked: GateSettings | None = None) -> FrameStamp:
    return FrameStamp(sequence, time_s, asked, asked, True, 0.25)


def test_camera_and_screen_rates_differ_and_gaps_are_counted() -> None:
    meter = Meter()
    assert meter.readings(0.0).shown_hz is None
    for index in range(30):  # a camera at 100, every fourth frame shown
        meter.painted(stamp(4 * index, 0.04 * index), 0.04 * index + 0.01)
    now = meter.readings(1.2)
    assert now.camera_hz == pytest.approx(100)
    assert now.shown_hz == pytest.approx(25)
    assert now.dropped == 29 * 3
    assert now.skipped_fraction == 0.25
    assert meter.readings(10.0).shown_hz is None
    meter.interrupt()
    meter.painted(stamp(500, 10.0), 10.0)
    assert meter.readings(10.0).dropped == 29 * 3
    meter.restart()
    assert meter.readings(10.0).dropped == 0


def test_latency_is_from_the_change_to_the_frame_that_shows_it() -> None:
    meter = Meter()
    a, b, c = (gate(10.0, delay, 100.0) for delay in (1.0, 2.0, 3.0))
    meter.painted(stamp(0, 0.0, a), 0.0)
    assert meter.readings(0.0).latency_ms is None
    meter.sent(b, 1.000)
    meter.sent(c, 1.010)
    meter.painted(stamp(1, 1.0, a), 1.015)  # an old one on its way
    assert meter.readings(1.0).latency_ms is None
    meter.painted(stamp(2, 1.0, c), 1.030)  # b was overtaken
    assert meter.readings(1.0).latency_ms == pytest.approx(20.0)
    meter.painted(stamp(3, 1.1, c), 1.080)  # the same again is no news
    assert meter.readings(1.0).latency_ms == pytest.approx(20.0)
