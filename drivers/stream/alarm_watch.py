"""Watches every frame of a stream for a proximity alarm."""

from __future__ import annotations

import threading
from collections import deque

from slopegate.core.measure.alarm import Alarm, AlarmZone, Trip
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import Frame, FrameStamp
from slopegate.drivers.stream.sieve import Sieve

MOST_WAITING = 8
"""Frames of events that wait to be taken; when more come the oldest are let go."""


class AlarmTap:
    """A tap that looks for the alarm and leaves the gate alone. It keeps a copy of the first frame of each event.

    Only settled frames of the gate that it was made for are judged: with another gate the level means nothing. `alarm`,
    `held`, `failure` and `take` may be used from any thread.
    """

    def __init__(self, watch: AlarmZone, gate: GateSettings | None) -> None:
        """`gate`: as it was asked for; None for a camera that has none."""
        self._lock = threading.Lock()
        self._gate = gate
        self._sieve = Sieve()
        self._alarm = Alarm(watch)
        self._held = False
        self._caught: deque[tuple[Trip, Frame]] = deque(maxlen=MOST_WAITING)
        self._failure = ""

    @property
    def alarm(self) -> Alarm:
        """The state after the last frame."""
        with self._lock:
            return self._alarm

    @property
    def held(self) -> bool:
        """Whether frames of another gate come, which are not judged."""
        with self._lock:
            return self._held

    @property
    def failure(self) -> str:
        """Why nothing is watched any more; empty while all is well."""
        with self._lock:
            return self._failure

    def take(self) -> list[tuple[Trip, Frame]]:
        """The events since the last call, each with a copy of its first frame."""
        with self._lock:
            found = list(self._caught)
            self._caught.clear()
        return found

    def wants(self) -> GateSettings | None:
        """See `Tap`."""
        return None

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """See `Tap`."""
        other = stamp.asked != self._gate
        if other:
            # the next frame of its own gate is one after a change again
            self._sieve.begin()
        if not self._sieve.take(stamp, self._gate):
            with self._lock:
                self._held = other
            return
        # only this thread changes the alarm
        alarm = self._alarm.after(image, stamp.sequence, stamp.time_s)
        new = alarm.trip if alarm.trips > self._alarm.trips else None
        with self._lock:
            self._alarm, self._held = alarm, False
            if new is not None:
                self._caught.append((new, Frame(image.copy(), stamp)))

    def fail(self, sentence: str) -> None:
        """See `Tap`."""
        with self._lock:
            self._failure = sentence
