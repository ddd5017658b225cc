"""Watches a stream's stamps for triggers that were missed and frames that came late or twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from slopegate.core.cadence import Cadence, cadence, missed_triggers
from slopegate.drivers.frame import FrameStamp

KEPT: Final = 128
"""Frames that the beat is measured over."""

MEASURE_EVERY: Final = 16

REANCHOR_AFTER: Final = 3
"""Frames in a row off the beat: it has begun anew."""


@dataclass(frozen=True)
class Judgement:
    """What one frame's stamp shows."""

    missed: int = 0
    """Triggers since the frame before that made no frame."""
    late: bool = False
    """It came off the beat."""
    repeated: bool = False
    """It, or a later one, has been here before."""


class TriggerWatch:
    """Judges every frame by its stamp, in the order in which they come. The stream's thread feeds it."""

    def __init__(self) -> None:
        self._times_s, self._sequences = np.zeros(KEPT), np.zeros(KEPT, np.int64)
        self._count = 0
        self._pace: tuple[object, ...] = ()
        self._beat: Cadence | None = None
        self._last: int | None = None
        self._anchor: tuple[float, int] | None = None
        self._off = 0

    @property
    def beat(self) -> Cadence | None:
        """The beat lately; None after a change of what may change it, until enough frames have come."""
        return self._beat

    def judge(self, stamp: FrameStamp) -> Judgement:
        """Note one frame and say what its stamp shows; of the first after a change nothing, for it may be held up."""
        if self._last is not None and stamp.sequence <= self._last:
            self._last = stamp.sequence
            return Judgement(repeated=True)
        self._last = stamp.sequence
        self._follow(stamp)
        self._times_s[self._count % KEPT], self._sequences[self._count % KEPT] = stamp.time_s, stamp.sequence
        self._count += 1
        if self._count % MEASURE_EVERY == 0:
            self._beat = self._measure()
        anchor, beat = self._anchor, self._beat
        if anchor is None or beat is None or not beat.steady or not stamp.settled:
            self._anchor, self._off = (stamp.time_s, stamp.sequence), 0
            return Judgement()
        missed = missed_triggers((stamp.time_s - anchor[0]) * 1e6, stamp.sequence - anchor[1], beat.period_us)
        self._off = self._off + 1 if missed is None else 0
        if missed is not None or self._off >= REANCHOR_AFTER:
            self._anchor, self._off = (stamp.time_s, stamp.sequence), 0
        return Judgement(missed or 0, missed is None)

    def _follow(self, stamp: FrameStamp) -> None:
        """A camera may be slower or faster with another line time, exposure or number of rows: measure anew."""
        applied = stamp.applied
        pace = (applied and (applied.line_time_us, applied.exposure_us), stamp.rows)
        if pace != self._pace:
            self._pace, self._count, self._beat, self._anchor = pace, 0, None, None

    def _measure(self) -> Cadence | None:
        kept = min(self._count, KEPT)
        order = np.arange(self._count - kept, self._count) % KEPT
        return cadence(self._times_s[order], self._sequences[order])
