"""Single frames that certainly saw one pattern through one gate: of a camera of one's own, or behind a stream."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.camera import Camera, CameraError, CameraGoneError
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp
from slopegate.drivers.contract.projector import Showing
from slopegate.drivers.stream.frame_watch import FrameWatch
from slopegate.drivers.stream.sieve import Sieve, Tally
from slopegate.drivers.stream.stream import Stream

TIMEOUT_S: Final = 20.0
MAX_WASTED: Final = 1000
"""Frames in a row that do not count before a camera is given up."""
DOUBTFUL_WITHOUT_GATE: Final = 2
"""Frames left out after a pattern is certain, where no stamp tells when the exposure began: one may have begun before
that, and another may have been on its way."""
_SLICE_S: Final = 0.1


@dataclass(frozen=True)
class Order:
    """What a frame has to have seen."""

    gate: GateSettings | None
    """None: the camera has no gate."""
    showing: Showing
    number: int
    """Of the frame; on the bench its noise follows from it."""


class Shots(Protocol):
    """Where frames come from, one by one."""

    @property
    def info(self) -> CameraInfo:
        """Fixed facts of the camera."""
        ...

    @property
    def tally(self) -> Tally:
        """Frames that did not count, of all orders so far."""
        ...

    def take(self, order: Order, buffer: Counts, given_up: Callable[[], bool]) -> FrameStamp | None:
        """Fill the buffer (height, width) with the next frame that fits the order; None when given up.

        Frames that were lost, came twice, or may have seen something else are let go, and the next one is waited for.
        Raises CameraError when the camera fails or none comes in time.
        """
        ...


class _Judge:
    """Says which frames fit the order."""

    def __init__(self, transfer_us: float) -> None:
        self._transfer_us = transfer_us
        self._sieve = Sieve()
        self._order: Order | None = None
        self._tally = Tally()
        self._unsure = 0

    @property
    def tally(self) -> Tally:
        """Of all orders so far."""
        return self._tally.plus(self._sieve.tally).plus(Tally(discarded=self._unsure))

    def begin(self, order: Order) -> None:
        """From the next frame on this is wanted."""
        self._tally = self._tally.plus(self._sieve.tally)
        self._sieve.begin(DOUBTFUL_WITHOUT_GATE if order.gate is None else 0)
        self._order = order

    def fits(self, stamp: FrameStamp, at_once: bool = False) -> bool:
        """Whether this frame, of which the stream or a watch has said what it knows, is the one.

        at_once: every frame sees what was shown before it was asked for.
        """
        assert self._order is not None
        if not at_once and not self._order.showing.certainly_in(stamp, self._transfer_us):
            self._unsure += 1
            return False
        return self._sieve.take(stamp, stamp.asked if self._order.gate is None else self._order.gate)


class CameraShots:
    """Frames of a started camera that nobody else uses."""

    def __init__(
        self,
        camera: Camera,
        transfer_us: float = 0.0,
        number_frames_from: Callable[[int], None] | None = None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        """transfer_us: how long a frame may be on its way to the program.

        `number_frames_from`: of a virtual camera, whose frames see what its projector shows when they are asked for.
        timeout_s: the longest wait for a frame.
        """
        self._camera, self._number_from, self._timeout_s = camera, number_frames_from, timeout_s
        self._judge = _Judge(transfer_us)
        self._watch = FrameWatch()
        self._gate: GateSettings | None = None

    @property
    def info(self) -> CameraInfo:
        """See `Shots`."""
        return self._camera.info

    @property
    def tally(self) -> Tally:
        """See `Shots`."""
        return self._judge.tally

    def take(self, order: Order, buffer: Counts, given_up: Callable[[], bool]) -> FrameStamp | None:
        """See `Shots`."""
        self._judge.begin(order)
        end_s, wasted = time.monotonic() + self._timeout_s, 0
        gone: CameraGoneError | None = None
        while time.monotonic() < end_s and wasted < MAX_WASTED:
            if given_up():
                return None
            try:
                stamp = self._read(order, buffer)
            except CameraGoneError as error:  # it may come back
                gone = error
                time.sleep(_SLICE_S)
                continue
            if stamp is None:
                continue
            gone = None
            if self._number_from is None:
                fits = self._judge.fits(self._watch.judge(stamp))
            else:  # none of its frames gets lost
                fits = self._judge.fits(stamp, at_once=True)
            if fits:
                return stamp
            wasted += 1
        raise gone or CameraError(too_late(self.info, self._timeout_s))

    def _read(self, order: Order, buffer: Counts) -> FrameStamp | None:
        if order.gate is not None and order.gate != self._gate:
            self._camera.configure(order.gate)
            self._gate = order.gate
        if self._number_from is not None:
            self._number_from(order.number)
        return self._camera.read(buffer, 1.0)


class StreamShots:
    """A tap: picks the frames out of a running stream, which goes on showing them. Made by `shots_behind`."""

    def __init__(self, info: CameraInfo, transfer_us: float = 0.0) -> None:
        self._info = info
        self._judge = _Judge(transfer_us)
        self._order: Order | None = None
        self._buffer: Counts | None = None
        self._got: FrameStamp | None = None
        self._gate: GateSettings | None = None
        self._failure = ""
        self._change = threading.Condition()

    @property
    def info(self) -> CameraInfo:
        """See `Shots`."""
        return self._info

    @property
    def tally(self) -> Tally:
        """See `Shots`."""
        with self._change:
            return self._judge.tally

    def wants(self) -> GateSettings | None:
        """See `Tap`."""
        with self._change:
            return self._gate

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """See `Tap`."""
        with self._change:
            if self._buffer is not None and self._got is None and self._judge.fits(stamp):
                np.copyto(self._buffer, image)
                self._got = stamp
                self._change.notify_all()

    def fail(self, sentence: str) -> None:
        """See `Tap`."""
        with self._change:
            self._failure = sentence
            self._change.notify_all()

    def take(self, order: Order, buffer: Counts, given_up: Callable[[], bool]) -> FrameStamp | None:
        """See `Shots`."""
        with self._change:
            self._judge.begin(order)
            self._gate, self._buffer, self._got = order.gate, buffer, None
            try:
                return self._wait(given_up)
            finally:
                self._buffer = None

    def _wait(self, given_up: Callable[[], bool]) -> FrameStamp | None:
        end_s = time.monotonic() + TIMEOUT_S
        while time.monotonic() < end_s:
            if given_up():
                return None
            if self._failure:
                raise CameraError(self._failure)
            if self._got is not None:
                return self._got
            self._change.wait(_SLICE_S)
        raise CameraError(too_late(self._info, TIMEOUT_S))


@contextmanager
def shots_behind(stream: Stream, info: CameraInfo, transfer_us: float = 0.0) -> Iterator[StreamShots]:
    """Frames of a running stream, whose own gate comes back at the end.

    Raises InputError while something else takes every frame.
    """
    tap = StreamShots(info, transfer_us)
    stream.attach(tap)
    try:
        yield tap
    finally:
        stream.detach(tap)


def too_late(info: CameraInfo, timeout_s: float) -> str:
    """The sentence for a camera of which no frame fits."""
    return f"{info.name} gave no frame that surely saw the pattern through the gate asked for, within {timeout_s:g} s."
