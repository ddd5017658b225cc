from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

import waiting
from interrupts import caught
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo, FrameStamp, Modes
from slopegate.drivers.stream import stream as stream_module
from slopegate.drivers.stream.stream import Stream

until = partial(waiting.until, seconds=60.0)
next_frame = partial(waiting.next_frame, seconds=60.0)


class Counting:
    """A camera whose frame n is n everywhere, written slowly so that a torn frame would show."""

    def __init__(self, height: int = 40, width: int = 60, pause_s: float = 0.0) -> None:
        self.info = CameraInfo("counting", width, height, "mono12", 4095, 0.0, None)
        self.pause_s = pause_s
        self.sequence = 0
        self.skip = 0
        self.end = 10**9
        """From this number on there are no frames."""
        self.asked: list[GateSettings] = []
        self.started = self.closed = 0
        self.trouble: Callable[[], None] = lambda: None
        self._stopped = threading.Event()

    def configure(self, settings: GateSettings) -> GateSettings:
        if settings.exposure_us == 13:
            raise InputError("exposure_us is 13: it must be anything else")
        self.asked.append(settings)
        return settings

    def start(self) -> None:
        self.started += 1
        self._stopped.clear()

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        self.trouble()
        if self._stopped.wait(self.pause_s if self.sequence < self.end else timeout_s) or self.sequence >= self.end:
            return None
        value = self.sequence % 4096
        buffer[::2] = value
        buffer[1::2] = value
        self.sequence += 1 + self.skip
        applied = self.asked[-1] if self.asked else None
        return FrameStamp(self.sequence - 1 - self.skip, time.monotonic(), applied, applied)

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self.closed += 1


def threads() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name.startswith("slopegate")}


def test_a_lent_frame_never_changes_and_is_never_torn() -> None:
    with Stream(Counting()) as stream:
        last = -1
        for _ in range(200):
            frame = next_frame(stream)
            expected = frame.stamp.sequence % 4096
            for _ in range(5):
                assert (frame.image == expected).all()
            assert frame.stamp.sequence > last
            last = frame.stamp.sequence
        until(lambda: stream.counters.made > last + 50)
        assert (frame.image == expected).all(), "lent while other frames came and went"


def test_a_lent_frame_cannot_be_written() -> None:
    with Stream(Counting()) as stream:
        image = next_frame(stream).image
        with pytest.raises(ValueError, match="read-only"):
            image[0, 0] = 1


def test_counters_add_up() -> None:
    camera = Counting()
    stream = Stream(camera)
    stream.start()
    for _ in range(20):
        next_frame(stream)
    stream.stop()
    counters = stream.counters
    assert counters.made == camera.sequence
    assert (counters.lost, counters.repeated, counters.errors) == (0, 0, 0)


def test_gaps_in_the_sequence_are_lost_frames() -> None:
    camera = Counting(pause_s=0.001)
    camera.skip = 2
    with Stream(camera) as stream:
        until(lambda: stream.counters.made >= 5)
    assert stream.counters.lost == 2 * (stream.counters.made - 1)


def test_no_frame_twice() -> None:
    camera = Counting()
    camera.end = 1
    with Stream(camera) as stream:
        next_frame(stream)
        assert stream.newest() is None


def test_the_latest_settings_win_and_the_last_are_never_lost() -> None:
    camera = Counting(pause_s=0.001)
    busy, free = threading.Event(), threading.Event()

    def trouble() -> None:
        busy.set()
        free.wait(60)

    with Stream(camera) as stream:
        next_frame(stream)
        camera.trouble = trouble
        assert busy.wait(60)
        for exposure in range(100, 200):
            stream.submit(gate(10.0, 0.0, float(exposure)))
        free.set()
        until(lambda: camera.asked)
        assert [settings.exposure_us for settings in camera.asked] == [199]
        until(lambda: next_frame(stream).stamp.applied == gate(10.0, 0.0, 199.0))


def test_refused_settings_are_told_and_frames_go_on() -> None:
    with Stream(Counting(pause_s=0.001)) as stream:
        stream.submit(gate(10.0, 0.0, 13.0))
        until(lambda: stream.error)
        assert stream.error == "exposure_us is 13: it must be anything else"
        next_frame(stream)
        assert stream.error is not None
        stream.submit(gate(10.0, 0.0, 14.0))
        until(lambda: stream.error is None)
        assert stream.counters.errors == 0


def test_it_recovers_when_the_camera_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_module, "RETRY_S", (0.001,) * 5)
    camera = Counting(pause_s=0.001)
    failures = iter([True] * 3)

    def trouble() -> None:
        if camera.sequence == 5 and next(failures, False):
            raise CameraError("The cable is loose.")

    camera.trouble = trouble
    with Stream(camera) as stream:
        until(lambda: stream.counters.made > 10)
        assert stream.counters.errors == 3
        assert stream.error is None
        assert stream.running


def test_it_ends_when_the_camera_stays_broken_and_can_be_started_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_module, "RETRY_S", (0.001,) * 5)
    camera = Counting(pause_s=0.001)

    def trouble() -> None:
        raise CameraError("The cable is loose.")

    camera.trouble = trouble
    stream = Stream(camera)
    stream.start()
    until(lambda: not stream.running)
    assert stream.error == "The cable is loose."
    assert stream.counters.errors == 6
    camera.trouble = lambda: None
    stream.start()
    next_frame(stream)
    assert stream.error is None
    stream.close()
    assert camera.closed == 1


def test_it_waits_for_a_camera_that_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_module, "RETRY_S", (0.0005,) * 5)
    camera = Counting(pause_s=0.001)
    failures = iter([True] * 40)

    def trouble() -> None:
        if camera.sequence == 5 and next(failures, False):
            raise CameraGoneError("The cable is out.")

    camera.trouble = trouble
    with Stream(camera) as stream:
        until(lambda: stream.error == "The cable is out.")
        until(lambda: stream.counters.made > 10)
        assert stream.counters.errors == 40
        assert stream.error is None


def test_a_bug_in_a_driver_that_stays_ends_the_stream_with_a_sentence(
    monkeypatch: pytest.MonkeyPatch, bugs: list[logging.LogRecord]
) -> None:
    monkeypatch.setattr(stream_module, "RETRY_S", (0.0,) * 5)
    camera = Counting()

    def trouble() -> None:
        raise ZeroDivisionError("division by zero")

    camera.trouble = trouble
    with Stream(camera) as stream:
        until(lambda: not stream.running)
        assert stream.error == "counting failed inside the program (ZeroDivisionError): the log has the details"
    assert [record.exc_info[0] for record in bugs] == [ZeroDivisionError] * 6
    bugs.clear()


def test_a_bug_that_passes_costs_a_frame_and_not_the_stream(
    monkeypatch: pytest.MonkeyPatch, bugs: list[logging.LogRecord]
) -> None:
    monkeypatch.setattr(stream_module, "RETRY_S", (0.0,) * 5)
    camera, errors = Counting(), [KeyError("row")]

    def trouble() -> None:
        if errors:
            raise errors.pop()

    camera.trouble = trouble
    with Stream(camera) as stream:
        until(lambda: stream.counters.made > 3)
        assert stream.error is None
        assert stream.counters.errors == 1
    (record,) = bugs
    assert record.exc_info[0] is KeyError
    bugs.clear()


def test_buffers_survive_failures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_module, "RETRY_S", (0.0,) * 5)
    camera = Counting()
    calls = iter(range(10**9))

    def trouble() -> None:
        if next(calls) % 3 == 1:
            raise CameraError("A packet was lost.")

    camera.trouble = trouble
    with Stream(camera) as stream:
        for _ in range(100):
            next_frame(stream)


def test_close_joins_the_thread_and_leaves_none() -> None:
    before = threads()
    for _ in range(5):
        stream = Stream(Counting(pause_s=600.0))
        stream.start()
        assert len(threads() - before) == 1
        stream.close()
        assert threads() <= before
        stream.close()


def test_start_twice_is_one_thread() -> None:
    camera, before = Counting(pause_s=0.001), threads()
    with Stream(camera) as stream:
        stream.start()
        assert camera.started == 1
        assert len(threads() - before) == 1


def test_stop_keeps_the_lent_frame_and_start_goes_on() -> None:
    stream = Stream(Counting(pause_s=0.0))
    stream.start()
    frame = next_frame(stream)
    stream.stop()
    value = frame.image[0, 0]
    stream.start()
    until(lambda: stream.counters.made > frame.stamp.sequence + 20)
    assert (frame.image == value).all()
    stream.close()


class Cropping(Counting):
    """It cannot be told to read the last rows only, as a camera whose trigger delay does not reach that far."""

    def __init__(self) -> None:
        super().__init__(pause_s=0.001)
        self.info = replace(self.info, can=Abilities(rows=Ability()))
        self.rows: list[tuple[int, int]] = []

    def set_rows(self, first: int, last: int) -> tuple[int, int]:
        if first > 20:
            raise InputError("the delay is too long")
        self.rows.append((first, last))
        return first, last


def test_where_fewer_rows_cannot_be_read_all_of_them_are() -> None:
    camera = Cropping()
    with Stream(camera) as stream:
        for rows, applied in (((10, 20), (10, 20)), ((30, 40), (0, 40)), ((0, 5), (0, 5)), (None, (0, 40))):
            stream.submit(gate(10.0, 0.0, 100.0), rows)
            until(lambda applied=applied: camera.rows[-1:] == [applied])
        assert stream.error is None


class OnDemand(Counting):
    """It makes a frame whenever one is asked for."""

    def __init__(self, pause_s: float = 0.0) -> None:
        super().__init__(pause_s=pause_s)
        self.info = replace(self.info, modes=Modes(on_demand=True))


class Collecting:
    """A tap that keeps every frame's stamp, and may hold the gate."""

    def __init__(self, wanted: GateSettings | None = None) -> None:
        self.wanted = wanted
        self.stamps: list[FrameStamp] = []
        self.sentence = ""

    def wants(self) -> GateSettings | None:
        return self.wanted

    def see(self, image: NDArray[np.uint16], stamp: FrameStamp) -> None:
        self.stamps.append(stamp)

    def fail(self, sentence: str) -> None:
        self.sentence = sentence


def test_frames_on_demand_are_made_when_the_last_one_was_taken() -> None:
    camera = OnDemand()
    with Stream(camera) as stream:
        for index in range(50):
            until(lambda index=index: camera.sequence == index + 1)
            time.sleep(0.002)  # time enough for hundreds
            assert next_frame(stream).stamp.sequence == index
        assert stream.counters.late == 0


def test_after_another_gate_no_frame_on_demand_of_the_one_seen_before_is_shown() -> None:
    with Stream(OnDemand()) as stream:
        next_frame(stream)
        for index in range(100):
            wanted = gate(10.0, 0.0, 100.0 + index)
            stream.submit(wanted)
            # the next frame of the old gate is ready every other time, else perhaps under way
            frame = next_frame(stream)
            assert frame.stamp.asked == wanted
            if index % 2:
                until(lambda number=frame.stamp.sequence: stream.counters.made == number + 2)


def test_a_gate_that_changes_faster_than_frames_are_made_is_shown_all_the_same() -> None:
    shown: list[GateSettings | None] = []
    exposures = iter(range(100, 10**6))
    with Stream(OnDemand(pause_s=0.005)) as stream:

        def drag() -> bool:
            frame = stream.newest()
            if frame is not None:
                shown.append(frame.stamp.asked)
            stream.submit(gate(10.0, 0.0, float(next(exposures))))
            return len(shown) >= 20

        until(drag)
    assert len(set(shown)) == 20, "every one shows another gate"


def test_a_tap_sees_every_frame_on_demand_though_nobody_takes_any() -> None:
    tap = Collecting()
    with Stream(OnDemand()) as stream:
        until(lambda: stream.counters.made == 1)
        stream.attach(tap)
        until(lambda: len(tap.stamps) >= 200)
        stream.detach(tap)
    assert [stamp.sequence for stamp in tap.stamps] == list(range(1, 1 + len(tap.stamps)))


def test_the_gate_comes_back_after_a_tap_though_nobody_takes_frames_on_demand() -> None:
    own, other = gate(10.0, 0.0, 100.0), gate(10.0, 0.0, 200.0)
    camera, tap = OnDemand(), Collecting(other)
    with Stream(camera) as stream:
        stream.submit(own)
        stream.attach(tap)
        until(lambda: any(stamp.asked == other for stamp in tap.stamps))
        stream.detach(tap)
        until(lambda: camera.asked[-1] == own)
        until(lambda: next_frame(stream).stamp.asked == own)


def test_frames_on_demand_go_on_behind_a_tap_that_holds_the_gate() -> None:
    own, other = gate(10.0, 0.0, 100.0), gate(10.0, 0.0, 200.0)
    with Stream(OnDemand()) as stream:
        stream.attach(Collecting(other))
        until(lambda: next_frame(stream).stamp.asked == other)
        stream.submit(own)  # waits until the tap is gone
        for _ in range(5):
            assert next_frame(stream).stamp.asked == other


def test_a_stream_that_rests_stops_at_once() -> None:
    stream = Stream(OnDemand())
    stream.start()
    until(lambda: stream.counters.made == 1)
    stream.close()
    assert stream.counters.made == 1


@pytest.mark.skipif(os.name == "nt", reason="no thread can be sent a signal there")
def test_an_interrupted_close_closes_the_camera_behind_the_last_read() -> None:
    camera, last, reading = Counting(), threading.Event(), threading.Event()
    closed_at: list[int] = []

    def last_read() -> None:
        if last.is_set() and not reading.is_set():
            reading.set()
            interrupt.strike()
            closed_at.append(camera.closed)

    camera.trouble = last_read
    stream = Stream(camera)
    with caught() as interrupt:
        stream.start()
        next_frame(stream)
        last.set()
        assert reading.wait(30)
        stream.close()
    assert not interrupt.early
    assert (closed_at, camera.closed) == ([0], 1)
    assert not stream.running


def test_watchers_see_every_frame_beside_a_tap_that_sets_the_gate() -> None:
    own, other = gate(10.0, 0.0, 100.0), gate(10.0, 0.0, 200.0)
    tap, first, second = Collecting(other), Collecting(), Collecting()
    with Stream(OnDemand()) as stream:
        stream.submit(own)
        stream.watch(first)
        until(lambda: len(first.stamps) >= 10)
        stream.attach(tap)
        stream.watch(second)
        until(lambda: len(tap.stamps) >= 10 and len(second.stamps) >= 10)
        assert stream.tapped is tap
        stream.detach(tap)
        until(lambda: first.stamps[-1].asked == own)
        stream.detach(second)
        seen = len(second.stamps)
        until(lambda: len(first.stamps) >= seen + 50)
        assert len(second.stamps) <= seen + 1, "one may have been on its way"
    numbers = [stamp.sequence for stamp in first.stamps]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert {own, other} <= {stamp.asked for stamp in first.stamps}
    assert first.sentence.endswith(" was stopped")
    assert tap.sentence == second.sentence == ""


def test_a_watcher_that_fails_takes_nothing_from_the_others(bugs: list[logging.LogRecord]) -> None:
    class Failing(Collecting):
        def see(self, image: NDArray[np.uint16], stamp: FrameStamp) -> None:
            raise ZeroDivisionError

    failing, other = Failing(), Collecting()
    with Stream(OnDemand()) as stream:
        stream.watch(failing)
        stream.watch(other)
        until(lambda: len(other.stamps) >= 10)
    assert failing.sentence.startswith("Taking the frames ")
    assert len(bugs) == 1
    bugs.clear()
