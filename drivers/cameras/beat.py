"""When a paced camera's frames are due, and what instant of a moving scene each of them shows."""

from __future__ import annotations

import math
from collections.abc import Callable

from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings


def frame_rate_hz(rig: Rig, settings: GateSettings, rows: int, rate_hz: float) -> float:
    """Frames a second that a camera whose whole frames come at `rate_hz` makes when it reads this many rows.

    The link to the computer carries as many rows a second as it does of whole frames. The projector triggers the camera
    once a period, when the last row of the frame before has been exposed and read: exposure + rows line times. Reading
    fewer rows never makes it slower.
    """
    height, period_us = rig.camera.lens.height, rig.projector.period_us
    if rows >= height:
        return rate_hz
    busy_us = settings.exposure_us + rows * settings.line_time_us
    triggered_hz = 1e6 / (period_us * math.ceil(busy_us / period_us - 1e-9))
    return max(rate_hz, min(rate_hz * height / max(rows, 1), triggered_hz))


class Beat:
    """Waits for a frame's turn. Scene time is frames made / rate, and the clock's when running free."""

    def __init__(self, rate_hz: float | None, clock: Callable[[], float], sleep: Callable[[float], object]) -> None:
        """rate_hz None: as fast as it can."""
        self._rate_hz, self._clock, self._sleep = rate_hz, clock, sleep
        self._due_s = 0.0
        self._since = (0, 0.0)
        self._first_s: float | None = None

    def start(self) -> None:
        """The next frame is due now."""
        self._due_s = self._clock()

    def set_rate(self, rate_hz: float, sequence: int) -> None:
        """Paced from frame number `sequence` on. Running free stays as it is."""
        if self._rate_hz is None or rate_hz == self._rate_hz:
            return
        self._since = (sequence, self.scene_time_s(sequence))
        self._due_s += 1.0 / rate_hz - 1.0 / self._rate_hz
        self._rate_hz = rate_hz

    def wait(self, timeout_s: float) -> bool:
        """Sleep until the frame is due; False when that takes longer than the time-out."""
        if self._rate_hz is None:
            return True
        wait_s = self._due_s - self._clock()
        if wait_s > 0:
            self._sleep(min(wait_s, timeout_s))
        return wait_s <= timeout_s

    def advance(self) -> float:
        """The frame is being made: the next one is due a period of the rate later. The instant that triggered it.

        A camera that fell behind by a frame or more has missed the triggers meanwhile, and does not rush to catch up.
        """
        now_s = self._clock()
        if self._rate_hz is None:
            return now_s
        late = math.floor((now_s - self._due_s) * self._rate_hz)
        trigger_s = self._due_s + max(late, 0) / self._rate_hz
        self._due_s = trigger_s + 1.0 / self._rate_hz
        return trigger_s

    def scene_time_s(self, sequence: int) -> float:
        """The instant of the scene that frame number `sequence`, the next one, shows."""
        if self._rate_hz is not None:
            first, since_s = self._since
            return since_s + (sequence - first) / self._rate_hz
        now_s = self._clock()
        if self._first_s is None:
            self._first_s = now_s
        return now_s - self._first_s
