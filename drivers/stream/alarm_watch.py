"""Watches every frame of a stream for a proximity alarm."""

from __future__ import annotations

import threading

from slopegate.core.measure.alarm import Alarm, AlarmZone
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import Frame, FrameStamp


class AlarmTap:
    """A tap that looks for the alarm and leaves the gate alone. It keeps a copy of the frame that sets the alarm off.

    Frames that have not settled after a change of the gate are not judged. `alarm`, `caught` and `failure` may be read
    from any thread.
    """

    def __init__(self, watch: AlarmZone) -> None:
        self._lock = threading.Lock()
        self._alarm = Alarm(watch)
        self._caught: Frame | None = None
        self._failure = ""

    @property
    def alarm(self) -> Alarm:
        """The state after the last frame."""
        with self._lock:
            return self._alarm

    @property
    def caught(self) -> Frame | None:
        """A copy of the frame that set the alarm off; None while nothing did."""
        with self._lock:
            return self._caught

    @property
    def failure(self) -> str:
        """Why nothing is watched any more; empty while all is well."""
        with self._lock:
            return self._failure

    def wants(self) -> GateSettings | None:
        """See `Tap`."""
        return None

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """See `Tap`."""
        if not stamp.settled:
            return
        # only this thread changes the alarm
        alarm = self._alarm.after(image, stamp.sequence, stamp.time_s)
        caught = self._caught
        if caught is None and alarm.trip is not None:
            caught = Frame(image.copy(), stamp)
        with self._lock:
            self._alarm, self._caught = alarm, caught

    def fail(self, sentence: str) -> None:
        """See `Tap`."""
        with self._lock:
            self._failure = sentence
