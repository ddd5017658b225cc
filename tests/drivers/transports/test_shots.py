"""Frames that surely saw their pattern: lost, repeated, late and unsettled ones are let go, and others taken."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from numpy.typing import NDArray

from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp
from slopegate.drivers.contract.projector import Showing
from slopegate.drivers.stream.sieve import Tally
from slopegate.drivers.stream.stream import Stream
from slopegate.drivers.transports import shots as shots_module
from slopegate.drivers.transports.shots import CameraShots, Order, Shots, StreamShots, shots_behind

ASKED, OTHER = gate(20.0, 1000.0, 500.0), gate(20.0, 2000.0, 500.0)
SHAPE = 6, 8
INFO = CameraInfo("scripted", SHAPE[1], SHAPE[0], "mono12", 4095, 40.0, None)


class Script:
    """A camera that gives these stamps, one after the other, as frames of the same number; then it waits."""

    def __init__(self, stamps: list[FrameStamp]) -> None:
        self.info, self.stamps = INFO, stamps
        self.told: list[GateSettings] = []
        self._stopped = threading.Event()

    def configure(self, settings: GateSettings) -> GateSettings:
        self.told.append(settings)
        return settings

    def start(self) -> None:
        self._stopped.clear()

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        if not self.stamps:
            self._stopped.wait(min(timeout_s, 0.001))
            return None
        stamp = self.stamps.pop(0)
        buffer[:] = stamp.sequence
        return stamp

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self.stop()


class LoosePlug(Script):
    """Gone for so many calls before every frame."""

    def __init__(self, stamps: list[FrameStamp], calls: int) -> None:
        super().__init__(stamps)
        self._calls = self._left = calls

    def _need(self) -> None:
        if self._left:
            self._left -= 1
            raise CameraGoneError("scripted does not answer")
        self._left = self._calls

    def configure(self, settings: GateSettings) -> GateSettings:
        self._need()
        return super().configure(settings)

    def read(self, buffer: NDArray[np.uint16], timeout_s: float) -> FrameStamp | None:
        self._need()
        return super().read(buffer, timeout_s)


def stamp(sequence: int, time_s: float, asked: GateSettings | None = ASKED, settled: bool = True) -> FrameStamp:
    return FrameStamp(sequence, time_s, asked, asked, settled)


def order(since_s: float, asked: GateSettings | None = ASKED) -> Order:
    return Order(asked, Showing(0, since_s - 1, since_s), 0)


def never() -> bool:
    return False


@contextmanager
def alone(camera: Script, transfer_us: float) -> Iterator[CameraShots]:
    yield CameraShots(camera, transfer_us, timeout_s=shots_module.TIMEOUT_S)


@contextmanager
def behind_a_stream(camera: Script, transfer_us: float) -> Iterator[StreamShots]:
    with Stream(camera) as stream, shots_behind(stream, INFO, transfer_us) as shots:
        yield shots


def take(shots: Shots, camera: Script, wanted: Order, stamps: list[FrameStamp]) -> tuple[int, int]:
    """Sequence number and pixels of the frame taken out of those that come once it has been asked for."""
    begun, buffer, found = threading.Event(), np.zeros(SHAPE, np.uint16), []

    def given_up() -> bool:
        begun.set()
        return False

    taker = threading.Thread(target=lambda: found.append(shots.take(wanted, buffer, given_up)))
    taker.start()
    assert begun.wait(30)
    camera.stamps.extend(stamps)
    taker.join(30)
    assert np.ptp(buffer) == 0
    return found[0].sequence, int(buffer[0, 0])


WAYS = pytest.mark.parametrize("way", [alone, behind_a_stream])


@WAYS
def test_only_a_frame_that_surely_saw_the_pattern_through_the_gate_is_taken(way: Callable) -> None:
    stamps = [
        stamp(0, 4.0),  # begun before the pattern was certain
        stamp(1, 5.0001),  # may have begun before that, by what it was on its way
        stamp(2, 5.1, OTHER),
        stamp(3, 5.2, settled=False),
        stamp(3, 5.3),  # has come before
        stamp(4, 5.4),
        stamp(5, 5.5),
    ]
    camera = Script([])
    with way(camera, 1000.0) as shots:
        assert take(shots, camera, order(5.0), stamps) == (4, 4)
        assert shots.tally.duplicated == 1
        assert shots.tally.discarded == 4


@WAYS
def test_what_may_have_been_made_before_frames_got_lost_is_taken_again(way: Callable) -> None:
    camera = Script([])
    with way(camera, 0.0) as shots:
        assert take(shots, camera, order(1.0), [stamp(1, 1.0)]) == (1, 1)
        assert take(shots, camera, order(2.0), [stamp(4, 4.0), stamp(5, 5.0), stamp(6, 6.0)]) == (6, 6)
        assert shots.tally == Tally(lost=2, discarded=2)


@WAYS
def test_without_a_gate_frames_that_may_have_begun_earlier_are_left_out(way: Callable) -> None:
    camera = Script([])
    with way(camera, 0.0) as shots:
        stamps = [stamp(number, 4.5 + number, None) for number in range(4)]
        assert take(shots, camera, order(5.0, None), stamps) == (3, 3)


@WAYS
def test_it_is_given_up_on_request(way: Callable) -> None:
    with way(Script([]), 0.0) as shots:
        assert shots.take(order(0.0), np.zeros(SHAPE, np.uint16), lambda: True) is None


@WAYS
def test_a_camera_that_gives_no_such_frame_is_told_in_a_sentence(
    way: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shots_module, "TIMEOUT_S", 0.05)
    with way(Script([]), 0.0) as shots, pytest.raises(CameraError, match="scripted gave no frame that surely saw"):
        shots.take(order(0.0), np.zeros(SHAPE, np.uint16), never)


def test_a_stream_that_ends_is_told() -> None:
    camera = Script([])
    stream = Stream(camera)
    with stream, shots_behind(stream, INFO) as shots:
        stream.stop()
        with pytest.raises(CameraError, match="scripted was stopped"):
            shots.take(order(0.0), np.zeros(SHAPE, np.uint16), never)


def test_a_stream_that_something_else_uses_is_not_taken_from_it() -> None:
    stream = Stream(Script([]))
    with (
        stream,
        shots_behind(stream, INFO),
        pytest.raises(InputError, match="something else"),
        shots_behind(stream, INFO),
    ):
        pass


def test_a_virtual_camera_is_told_the_numbers_of_its_frames() -> None:
    camera, told = Script([stamp(7, -5.0)]), []
    shots = CameraShots(camera, 0.0, told.append)
    taken = shots.take(Order(ASKED, Showing(0, 0.0, 0.0), 77), np.zeros(SHAPE, np.uint16), never)
    assert taken is not None
    assert told == [77]
    assert camera.told == [ASKED]


def test_a_camera_that_comes_back_goes_on_with_the_gate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shots_module, "_SLICE_S", 0.0)
    camera = LoosePlug([stamp(0, 1.0, settled=False), stamp(1, 2.0)], calls=2)
    shots = CameraShots(camera)  # type: ignore[arg-type]
    buffer = np.zeros(SHAPE, np.uint16)
    taken = shots.take(Order(ASKED, Showing(-1, 0.0, 0.0), 0), buffer, lambda: False)
    assert taken is not None
    assert taken.sequence == 1
    assert camera.told == [ASKED]


def test_a_camera_that_stays_away_is_named_as_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shots_module, "_SLICE_S", 0.0)
    shots = CameraShots(LoosePlug([], calls=10**9), timeout_s=0.05)  # type: ignore[arg-type]
    with pytest.raises(CameraGoneError, match="scripted does not answer"):
        shots.take(Order(ASKED, Showing(-1, 0.0, 0.0), 0), np.zeros(SHAPE, np.uint16), lambda: False)
