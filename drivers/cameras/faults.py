"""Imitates the faults of real rigs: a camera that loses, delays and repeats frames on demand."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import InputError, require, require_finite
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.camera import Camera, CameraGoneError
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp, TriggerEdge


@dataclass(frozen=True)
class Faults:
    """What goes wrong, and how often. Each of the first five is a share of the frames; one at most befalls a frame."""

    missed: float = 0.0
    """Triggers that the camera does not hear: no frame is made, and none is missing from the sequence numbers."""
    dropped: float = 0.0
    """Frames that are made and lost on their way: their sequence numbers are missing."""
    late: float = 0.0
    """Frames that arrive `late_s` after their time; settings may have changed meanwhile."""
    duplicated: float = 0.0
    """Frames that arrive twice."""
    disconnected: float = 0.0
    """Frames at which the cable comes loose: the device is gone for `away_s`."""
    jitter_us: float = 0.0
    """Standard deviation of the trigger's instant: time stamps show it, and a trigger that comes late opens the gate as
    late (of a capture that is played, the frames were taken before)."""
    late_s: float = 0.02
    away_s: float = 1.5

    def __post_init__(self) -> None:
        for name in SHARES:
            share = getattr(self, name)
            require(0 <= share <= 0.5, name, share, "a share of the frames from 0 to 0.5")
        total = sum(getattr(self, name) for name in SHARES)
        require(total <= 0.9, "the sum of all shares", total, "at most 0.9")
        for name in ("jitter_us", "late_s", "away_s"):
            require_finite(name, getattr(self, name))
            require(getattr(self, name) >= 0, name, getattr(self, name), "0 or more")


SHARES: Final = ("missed", "dropped", "late", "duplicated", "disconnected")

PRESETS: Final = {
    "trigger": Faults(missed=0.05, jitter_us=150.0),
    "link": Faults(dropped=0.05, late=0.05, duplicated=0.03),
    "plug": Faults(disconnected=0.005, away_s=2.0),
    "all": Faults(0.03, 0.03, 0.03, 0.02, 0.003, jitter_us=150.0),
}
"""A bad trigger line, an overloaded link, a loose plug, and everything at once."""


def parse_faults(text: str) -> Faults:
    """The faults of a preset's name, or of `name=number` pairs with commas between. Raises InputError."""
    if text in PRESETS:
        return PRESETS[text]
    known = [item.name for item in fields(Faults)]
    numbers: dict[str, float] = {}
    for pair in text.split(","):
        name, _, number = (part.strip() for part in pair.partition("="))
        require(name in known, "faults", pair, f"one of {', '.join(PRESETS)}, or {', '.join(known)} = number")
        try:
            numbers[name] = float(number)
        except ValueError:
            raise InputError(f"faults: {name} is {number!r}: it must be a number") from None
    return Faults(**numbers)


@dataclass(frozen=True)
class FaultCounts:
    """What went wrong so far."""

    missed: int = 0
    dropped: int = 0
    late: int = 0
    duplicated: int = 0
    disconnected: int = 0

    def plus(self, name: str) -> FaultCounts:
        """One more of these."""
        return replace(self, **{name: getattr(self, name) + 1})


@dataclass
class _Held:
    """A copy of a frame, and when it is to be given (again)."""

    image: Counts
    stamp: FrameStamp | None = None
    due_s: float = 0.0


class FaultyCamera(Camera):
    """Another camera with faults added to it; equal seeds make equal faults."""

    def __init__(
        self,
        inner: Camera,
        faults: Faults,
        *,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] | None = None,
        trigger_late: Callable[[float], object] = lambda late_us: None,
    ) -> None:
        """Owns `inner` from here on. `sleep` None: wait, or until `stop`.

        `trigger_late`: of a virtual camera, whose gates open when the trigger comes.
        """
        self._inner, self._faults, self._clock = inner, faults, clock
        self._trigger_late = trigger_late
        self._random = np.random.default_rng(seed)
        self._stopped = threading.Event()
        self._sleep = self._stopped.wait if sleep is None else sleep
        self._bounds = np.cumsum([getattr(faults, name) for name in SHARES])
        self._counts = FaultCounts()
        self._held = _Held(np.zeros((inner.info.height, inner.info.width), np.uint16))
        self._back_s: float | None = None
        self._shift = 0
        self._unsettled = False
        self._last_s = -np.inf
        self._late_us: float | None = None
        """Of the trigger of the next frame; None until it is known."""

    @property
    def info(self) -> CameraInfo:
        """Fixed facts of the camera. Its frames count as new ones: else nobody would see the faults."""
        inner = self._inner.info
        return replace(inner, modes=replace(inner.modes, replayed=False))

    @property
    def trouble(self) -> str:
        """As the camera says."""
        return self._inner.trouble

    @property
    def counts(self) -> FaultCounts:
        """The faults imitated so far."""
        return self._counts

    def configure(self, settings: GateSettings) -> GateSettings:
        """As the camera does; raises CameraGoneError while it is away."""
        self._need()
        return self._inner.configure(settings)

    def set_rows(self, first: int, last: int) -> tuple[int, int]:
        """As the camera does; raises CameraGoneError while it is away."""
        self._need()
        return self._inner.set_rows(first, last)

    def cover(self, covered: bool) -> None:
        """As the camera does."""
        self._inner.cover(covered)

    def trigger_on(self, edge: TriggerEdge) -> None:
        """As the camera does; raises CameraGoneError while it is away."""
        self._need()
        self._inner.trigger_on(edge)

    def start(self) -> None:
        """Begin to make frames, none of them left over from before."""
        self._need()
        self._held.stamp = None
        self._stopped.clear()
        self._inner.start()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """The next frame that gets through. Raises CameraGoneError while the device is away."""
        end_s = self._clock() + timeout_s
        while not self._stopped.is_set():
            self._need()
            left_s = max(end_s - self._clock(), 0.0)
            if self._held.stamp is not None:
                return self._give_held(self._held.stamp, buffer, left_s)
            if self._late_us is None:
                self._late_us = self._faults.jitter_us * float(self._random.standard_normal())
                self._trigger_late(self._late_us)
            stamp = self._inner.read(buffer, left_s)
            if stamp is None:
                return None
            stamp = self._spoil(self._restamp(stamp, self._late_us), buffer)
            self._late_us = None
            if stamp is not None:
                return stamp
            if left_s == 0.0:
                return None
        return None

    def stop(self) -> None:
        """Make no more frames; wakes a waiting `read`. May come from any thread."""
        self._stopped.set()
        self._inner.stop()

    def close(self) -> None:
        """Stop and let the camera go."""
        self.stop()
        self._inner.close()

    def _need(self) -> None:
        """Raise while the device is away; what it was doing when it went has to be begun anew."""
        if self._back_s is None:
            return
        if self._clock() < self._back_s:
            raise CameraGoneError(f"{self.info.name} does not answer (the loose plug that is being imitated)")
        self._back_s = None
        self._unsettled = True

    def _restamp(self, stamp: FrameStamp, late_us: float) -> FrameStamp:
        self._last_s = max(self._last_s, stamp.time_s + late_us * 1e-6)
        return replace(stamp, time_s=self._last_s, sequence=stamp.sequence + self._shift)

    def _spoil(self, stamp: FrameStamp, buffer: Counts) -> FrameStamp | None:
        """Do one fault to a frame, or none; None when no frame is to be given now."""
        which = int(np.searchsorted(self._bounds, self._random.random(), side="right"))
        fault = SHARES[which] if which < len(SHARES) else ""
        if fault:
            self._counts = self._counts.plus(fault)
        if fault == "missed":
            self._shift -= 1
            self._unsettled = self._unsettled or not stamp.settled
            return None
        if fault == "disconnected":
            self._back_s = self._clock() + self._faults.away_s
        if fault in ("disconnected", "dropped"):
            return None
        stamp = replace(stamp, settled=stamp.settled and not self._unsettled)
        self._unsettled = False
        if fault in ("late", "duplicated"):
            late_s = self._faults.late_s if fault == "late" else 0.0
            np.copyto(self._held.image, buffer)
            # a camera without a clock of its own counts back from where its frames arrive
            self._held.stamp = replace(stamp, time_s=stamp.time_s + late_s)
            self._held.due_s = self._clock() + late_s
        return None if fault == "late" else stamp

    def _give_held(self, stamp: FrameStamp, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        wait_s = self._held.due_s - self._clock()
        if wait_s > 0:
            self._sleep(min(wait_s, timeout_s))
        if wait_s > timeout_s or self._stopped.is_set():
            return None
        np.copyto(buffer, self._held.image)
        self._held.stamp = None
        self._last_s = max(self._last_s, stamp.time_s)
        return replace(stamp, time_s=self._last_s)
