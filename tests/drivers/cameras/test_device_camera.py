"""What every SDK's device goes through: hangs, losses, and frames that come twice or late."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

import waiting
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings, LineTimes, ShutterLimits, Steps, gate
from slopegate.drivers.cameras import device_camera as module
from slopegate.drivers.cameras.device_camera import Arrival, DeviceCamera
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.stream.stream import Stream

until = partial(waiting.until, seconds=60.0)

LIMITS = ShutterLimits(LineTimes(1.0, 100.0, 0.1), Steps(-16667, 33334, 1), Steps(100, 50000, 1))
INFO = CameraInfo("Device", 6, 4, "mono12", 4095, 0.0, LIMITS)
GATE = gate(10.0, 500.0, 300.0)


@dataclass
class Script:
    """A device that does as it is told; the same script goes on when it is connected anew."""

    info: CameraInfo = INFO
    arrivals: Iterator[int] = field(default_factory=lambda: iter(range(1, 10**9)))
    lost_packets: int = 0
    clock_s: Callable[[int], float | None] = lambda number: None
    """What the device's own clock says of a frame, by its number."""
    hang: Callable[[], object] = lambda: None
    gone: bool = False
    silent: bool = False
    unsettled: int = 2
    log: list[str] = field(default_factory=list)
    applied: list[GateSettings] = field(default_factory=list)

    def connect(self) -> Script:
        self._reach("connect")
        return self

    def apply(self, settings: GateSettings) -> tuple[GateSettings, int]:
        self._reach("apply")
        if settings.exposure_us > 40000:
            raise InputError("exposure_us is too long")
        self.applied.append(settings)
        return settings, self.unsettled

    def start(self) -> None:
        self._reach("start")

    def stop(self) -> None:
        self.log.append("stop")

    def fetch(self, buffer: NDArray[np.uint16], timeout_s: float) -> Arrival | None:
        self.hang()
        if self.silent:
            time.sleep(timeout_s)
            return None
        self._reach("")
        buffer[:] = number = next(self.arrivals)
        return Arrival(number, self.lost_packets, self.clock_s(number))

    def check(self) -> None:
        self._reach("check")

    def close(self) -> None:
        self.log.append("close")

    def _reach(self, what: str) -> None:
        if what:
            self.log.append(what)
        if self.gone:
            raise CameraGoneError("The cable is out.")


def camera_of(script: Script, clock: Callable[[], float] = time.monotonic) -> DeviceCamera:
    camera = DeviceCamera(script.connect, clock)
    camera.start()
    return camera


def read(camera: DeviceCamera) -> tuple[int, int] | None:
    """Sequence and the device's own number of the next frame."""
    image = np.zeros((4, 6), np.uint16)
    stamp = camera.read(image, 0.01)
    return None if stamp is None else (stamp.sequence, int(image[0, 0]))


def test_gaps_are_kept_and_frames_seen_before_are_not_given() -> None:
    camera = camera_of(Script(arrivals=iter([5, 6, 6, 5, 9, 10])))
    seen = [frame for _ in range(6) if (frame := read(camera)) is not None]
    assert seen == [(0, 5), (1, 6), (4, 9), (5, 10)]


def test_numbers_that_begin_anew_after_a_start_go_on() -> None:
    camera = camera_of(Script(arrivals=iter([7, 8, 1, 2])))
    assert [read(camera), read(camera)] == [(0, 7), (1, 8)]
    camera.stop()
    camera.start()
    assert [read(camera), read(camera)] == [(2, 1), (3, 2)]


def test_a_lost_device_comes_back_with_its_gate_and_a_gap() -> None:
    script = Script(lost_packets=3)
    camera = camera_of(script)
    camera.configure(GATE)
    read(camera)
    script.gone = True
    for _ in range(3):
        with pytest.raises(CameraGoneError):
            read(camera)
    assert camera.info == INFO
    script.gone, script.lost_packets = False, 2
    script.log.clear()
    image = np.zeros((4, 6), np.uint16)
    stamp = camera.read(image, 1.0)
    assert script.log == ["connect", "apply", "start"]
    assert script.applied == [GATE, GATE]
    assert stamp is not None
    assert (stamp.sequence, stamp.settled, stamp.asked, stamp.lost_packets) == (2, False, GATE, 5)


def test_a_device_that_comes_back_as_another_is_refused_until_it_is_itself_again() -> None:
    script = Script()
    camera = camera_of(script)
    script.gone = True
    with pytest.raises(CameraGoneError):
        read(camera)
    script.gone, script.info = False, replace(INFO, width=8)
    with pytest.raises(CameraGoneError, match="came back as another"):
        read(camera)
    assert script.log[-1] == "close"
    script.info = INFO
    assert read(camera) is not None


def test_a_refused_gate_is_not_the_one_that_comes_back() -> None:
    script = Script()
    camera = camera_of(script)
    camera.configure(GATE)
    with pytest.raises(ValueError, match="too long"):
        camera.configure(replace(GATE, exposure_us=50000.0))
    script.gone = True
    with pytest.raises(CameraGoneError):
        camera.configure(replace(GATE, exposure_us=200.0))
    script.gone = False
    read(camera)
    assert script.applied == [GATE, GATE]


def test_frames_under_way_during_a_change_are_not_settled() -> None:
    script = Script(unsettled=2)
    camera = camera_of(script)
    camera.configure(GATE)
    image = np.zeros((4, 6), np.uint16)
    settled = []
    for _ in range(4):
        stamp = camera.read(image, 1.0)
        assert stamp is not None
        settled.append(stamp.settled)
    assert settled == [False, False, True, True]


def test_silence_makes_it_ask_whether_the_device_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SILENCE_S", 0.05)
    script = Script(silent=True)
    begun = time.monotonic()
    camera = camera_of(script)
    while (asked := script.log.count("check")) < 5:
        assert read(camera) is None
    assert asked <= (time.monotonic() - begun) / 0.05
    script.gone = True
    time.sleep(0.06)
    with pytest.raises(CameraGoneError):
        camera.read(np.zeros((4, 6), np.uint16), 5.0)


def test_stop_does_not_wait_for_a_device_that_hangs() -> None:
    hangs, answers = threading.Event(), threading.Event()

    def hang() -> None:
        hangs.set()
        answers.wait(60)

    script = Script(hang=hang)
    camera = camera_of(script)
    reader = threading.Thread(target=lambda: camera.read(np.zeros((4, 6), np.uint16), 30.0))
    reader.start()
    assert hangs.wait(60)
    started = time.monotonic()
    camera.stop()
    assert time.monotonic() - started < 30
    assert "stop" not in script.log
    answers.set()
    reader.join()
    assert script.log[-1] == "stop", "the reader stopped the device when it was free again"
    assert read(camera) is None


def test_a_stream_goes_on_through_losses_and_closes_the_device_once() -> None:
    script = Script()
    stream = Stream(DeviceCamera(script.connect))
    with stream:
        for _ in range(3):
            made = stream.counters.made
            until(lambda made=made: stream.counters.made > made + 10)
            script.gone = True
            until(lambda: stream.error == "The cable is out.")
            script.gone = False
            until(lambda: stream.error is None)
    assert stream.counters.lost == 3
    assert script.log[-2:] == ["stop", "close"]


def test_a_closed_camera_says_so() -> None:
    camera = camera_of(Script())
    camera.close()
    for use in (camera.start, lambda: camera.configure(GATE)):
        with pytest.raises(CameraError, match="Device was closed"):
            use()


def stamps_at(arrivals_s: list[float], made_s: list[float] | None, changed_at: int | None = None) -> list[float]:
    """What frames are stamped with that arrive at these times; the device's clock says when it made them."""
    now = [0.0]
    script = Script(unsettled=0)
    if made_s is not None:
        script.clock_s = lambda number: made_s[number - 1]
    camera = camera_of(script, lambda: now[0])
    camera.configure(GATE)
    times_s = []
    for k, arrival_s in enumerate(arrivals_s):
        if k == changed_at:
            camera.configure(replace(GATE, exposure_us=20_300.0))
        now[0] = arrival_s
        stamp = camera.read(np.zeros((4, 6), np.uint16), 0.0)
        assert stamp is not None
        times_s.append(stamp.time_s)
    return times_s


LASTED_S = 300e-6 + 3 * 10e-6


def test_without_a_clock_of_its_own_a_frame_began_before_it_arrived() -> None:
    np.testing.assert_allclose(stamps_at([1.0, 1.1, 1.25], None), np.array([1.0, 1.1, 1.25]) - LASTED_S)
    later = stamps_at([1.0, 1.1, 1.25], None, changed_at=2)[2]
    assert later == pytest.approx(1.25 - 20_300e-6 - 3 * 10e-6), "a longer exposure began earlier"


def test_the_devices_clock_tells_the_intervals_whatever_holds_frames_up() -> None:
    beat_s = 0.05 * np.arange(200)
    held_up_s = np.random.default_rng(1).exponential(0.01, 200)
    times_s = np.array(stamps_at(list(10.0 + beat_s + held_up_s), list(7000.0 + beat_s)))
    assert (times_s <= 10.0 + beat_s + held_up_s - LASTED_S + 1e-12).all(), "never later than it can have been"
    assert np.abs(np.diff(times_s[50:]) - 0.05).max() < 0.002
    assert np.abs(np.diff(held_up_s[50:])).max() > 0.02, "by which arrivals alone would be off"


def test_a_clock_that_drifts_or_begins_anew_is_followed() -> None:
    beat_s = 0.05 * np.arange(2000)
    drifting = np.array(stamps_at(list(10.0 + beat_s), list(beat_s * (1 - 2e-4))))
    assert np.abs(drifting - (10.0 + beat_s - LASTED_S)).max() < 1e-3
    other_meaning = [*map(float, beat_s[:10]), *(beat_s[10:20] + 500.0)]
    np.testing.assert_allclose(
        stamps_at(list(10.0 + beat_s[:20]), other_meaning, changed_at=10)[10:], 10.0 + beat_s[10:20] - 20_330e-6
    )
