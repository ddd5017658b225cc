"""Frame rates, dropped frames, and the time from a change of settings to the picture that shows it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from statistics import median

from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import FrameStamp

WINDOW_S = 2.0


@dataclass(frozen=True)
class Readings:
    """What the status bar shows; None where it is not known yet."""

    camera_hz: float | None
    shown_hz: float | None
    dropped: int
    latency_ms: float | None
    """From sending settings to painting their first frame: median of the last changes."""
    skipped_fraction: float


class Meter:
    """Measures from every change of settings that is sent and every new frame that is painted."""

    def __init__(self) -> None:
        self._sent: deque[tuple[GateSettings, float]] = deque(maxlen=256)
        self._latencies: deque[float] = deque(maxlen=9)
        self._painted: deque[tuple[float, float, int]] = deque()
        self._dropped = 0
        self._skipped = 0.0

    def restart(self) -> None:
        """Count anew, for another camera."""
        self.interrupt()
        self._dropped, self._skipped = 0, 0.0
        self._latencies.clear()

    def interrupt(self) -> None:
        """Leave out what happens now: frames missed during a pause, or while the window was busy, are not lost."""
        self._painted.clear()
        self._sent.clear()

    def sent(self, settings: GateSettings, now_s: float) -> None:
        """These settings were handed to the stream."""
        self._sent.append((settings, now_s))

    def painted(self, stamp: FrameStamp, now_s: float) -> None:
        """The frame with this stamp was just drawn."""
        if self._painted:
            self._dropped += max(stamp.sequence - self._painted[-1][2] - 1, 0)
        self._painted.append((now_s, stamp.time_s, stamp.sequence))
        while now_s - self._painted[0][0] > WINDOW_S:
            self._painted.popleft()
        self._skipped = stamp.skipped_fraction
        for index, (settings, sent_s) in enumerate(self._sent):
            if settings == stamp.asked:
                self._latencies.append(now_s - sent_s)
                for _ in range(index + 1):
                    self._sent.popleft()
                break

    def readings(self, now_s: float) -> Readings:
        """Rates over the last two seconds."""
        recent = [entry for entry in self._painted if now_s - entry[0] <= WINDOW_S]
        shown = camera = None
        if len(recent) >= 2:
            first, last = recent[0], recent[-1]
            shown = (len(recent) - 1) / max(last[0] - first[0], 1e-9)
            camera = (last[2] - first[2]) / max(last[1] - first[1], 1e-9)
        latency = median(self._latencies) * 1000 if self._latencies else None
        return Readings(camera, shown, self._dropped, latency, self._skipped)
