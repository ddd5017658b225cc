"""Lengths of time in words, and how long work will still take. Imported by every command, so nothing heavy here."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

_TELLING_S, _TELLING_SHARE = 1.0, 0.01
"""Work has to go on for so long, and so far, before it tells how long the rest takes."""


def time_text(seconds: float) -> str:
    """Hours and minutes, or minutes and seconds, rounded up."""
    whole = math.ceil(seconds)
    if whole >= 3600:
        minutes = math.ceil(seconds / 60)
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60} s"


class TimeLeft:
    """How long work will still take, as it has gone so far: measured, never assumed."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began: tuple[float, float] | None = None
        self._done = 0.0
        self._ends_s: float | None = None
        """When all would be done, by what was told last."""

    def seconds(self, done: float, whole: float = 1.0) -> float | None:
        """Seconds until all is done; None before enough is done to tell. When less is done than before it begins anew.

        whole: how much there is to do, in the unit of `done`; it may become more or less meanwhile.
        """
        now_s = self._clock()
        if self._began is None or done < self._done:
            self._began = now_s, done
        self._done = done
        gone_s, since = now_s - self._began[0], done - self._began[1]
        if gone_s < _TELLING_S or since < _TELLING_SHARE * whole:
            return None
        return gone_s / since * max(whole - done, 0.0)

    def text(self, done: float, whole: float = 1.0) -> str:
        """The same to be read; empty before it is known."""
        left = self.seconds(done, whole)
        self._ends_s = None if left is None else self._clock() + left
        return "" if left is None else f"{time_text(left)} left"

    def later_text(self) -> str:
        """What `text` told last, less the time since; empty once that is over: then nobody knows."""
        left = 0.0 if self._ends_s is None else self._ends_s - self._clock()
        return f"{time_text(left)} left" if left > 0 else ""
