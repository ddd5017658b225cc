"""Watches every frame of a stream for a proximity alarm."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Literal

from slopegate.core.measure.alarm import Alarm, AlarmZone, Trip
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import Frame, FrameStamp
from slopegate.drivers.stream.sieve import Sieve

Held = Literal["", "gate", "light"]
"""What is another than it was when the alarm was armed, so that frames are not judged; empty while they are."""

MOST_WAITING = 8
"""Frames of events that wait to be taken; when more come the oldest are let go."""


class AlarmWatcher:
    """A `Watcher` that looks for the alarm and keeps a copy of the first frame of each event.

    Only settled frames of the gate and the light that it was made for are judged: with others the level means nothing.
    `alarm`, `held`, `failure` and `take` may be used from any thread.
    """

    def __init__(self, watch: AlarmZone, gate: GateSettings | None, light: Callable[[], object] = lambda: None) -> None:
        """`gate`: as it was asked for; None for a camera that has none. `light`: equal as long as the light is."""
        self._lock = threading.Lock()
        self._gate = gate
        self._light, self._lit = light, light()
        self._sieve = Sieve()
        self._alarm = Alarm(watch)
        self._held: Held = ""
        self._caught: deque[tuple[Trip, Frame]] = deque(maxlen=MOST_WAITING)
        self._failure = ""

    @property
    def gate(self) -> GateSettings | None:
        """The gate whose frames are judged, as it was asked for; None for a camera that has none."""
        return self._gate

    @property
    def alarm(self) -> Alarm:
        """The state after the last frame."""
        with self._lock:
            return self._alarm

    @property
    def held(self) -> Held:
        """Why the frames that come now are not judged."""
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

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """See `Watcher`."""
        other: Held = "gate" if stamp.asked != self._gate else "light" if self._light() != self._lit else ""
        if other:
            # the next frame of its own gate is one after a change again; that of its own light may hold both
            self._sieve.begin(int(other == "light"))
        if not self._sieve.take(stamp, self._gate):
            with self._lock:
                self._held = other
            return
        # only this thread changes the alarm
        alarm = self._alarm.after(image, stamp.sequence, stamp.time_s)
        new = alarm.trip if alarm.trips > self._alarm.trips else None
        with self._lock:
            self._alarm, self._held = alarm, ""
            if new is not None:
                self._caught.append((new, Frame(image.copy(), stamp)))

    def fail(self, sentence: str) -> None:
        """See `Watcher`."""
        with self._lock:
            self._failure = sentence
