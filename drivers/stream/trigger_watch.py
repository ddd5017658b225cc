"""Watches a stream's stamps for triggers that were missed and frames that came late or twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from slopegate.core.rig.cadence import Cadence, cadence, missed_triggers
from slopegate.drivers.contract.frame import FrameStamp

KEPT: Final = 128
"""Frames that the beat is measured over."""

MEASURE_EVERY: Final = 8

GIVE_UP_AFTER: Final = 3
"""Frames that do not come at the old pace after a change: it is another one."""


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
    """Judges every frame by its stamp, in the order in which they come. The stream's thread feeds it.

    A change of settings may hold up the frame that follows, which is not judged. It may also make the camera slower:
    then nothing is judged until a frame has come at the old pace, or the new one has been measured.
    """

    def __init__(self) -> None:
        self._times_s, self._sequences = np.zeros(KEPT), np.zeros(KEPT, np.int64)
        self._settled = np.zeros(KEPT, np.bool_)
        self._count = 0
        self._pace: tuple[object, ...] = ()
        self._beat: Cadence | None = None
        self._last: int | None = None
        self._anchor = self._before = (0.0, 0)
        self._doubts = 0

    @property
    def beat(self) -> Cadence | None:
        """The beat lately; None until enough frames have come."""
        return self._beat

    def judge(self, stamp: FrameStamp) -> Judgement:
        """Note one frame and say what its stamp shows."""
        last, self._last = self._last, stamp.sequence
        if last is not None and stamp.sequence <= last:
            return Judgement(repeated=True)
        self._note(stamp)
        here, before = (stamp.time_s, stamp.sequence), self._before
        self._before = here
        if self._beat is None or not self._beat.steady or not stamp.settled:
            self._anchor = here
            return Judgement()
        missed = self._missed_since(self._anchor, stamp)
        if self._doubts:
            self._reconsider(stamp, confirmed=missed == 0)
            return Judgement()
        if missed is None:
            # in step with the one before: the beat has begun anew with that one
            missed = self._missed_since(before, stamp)
        if missed is None:
            return Judgement(late=True)
        self._anchor = here
        return Judgement(missed)

    def _missed_since(self, then: tuple[float, int], stamp: FrameStamp) -> int | None:
        assert self._beat is not None
        return missed_triggers((stamp.time_s - then[0]) * 1e6, stamp.sequence - then[1], self._beat.period_us)

    def _note(self, stamp: FrameStamp) -> None:
        applied = stamp.applied
        pace = (applied and (applied.line_time_us, applied.exposure_us), stamp.rows)
        if pace != self._pace:
            self._pace, self._doubts = pace, GIVE_UP_AFTER
        at = self._count % KEPT
        self._times_s[at], self._sequences[at], self._settled[at] = stamp.time_s, stamp.sequence, stamp.settled
        self._count += 1
        if self._count % MEASURE_EVERY == 0:
            kept = min(self._count, KEPT)
            order = np.arange(self._count - kept, self._count) % KEPT
            self._beat = cadence(self._times_s[order], self._sequences[order], self._settled[order])

    def _reconsider(self, stamp: FrameStamp, confirmed: bool) -> None:
        """Whether the pace is still the old one."""
        self._anchor = (stamp.time_s, stamp.sequence)
        self._doubts = 0 if confirmed else self._doubts - 1
        if not confirmed and not self._doubts:
            self._count, self._beat = 0, None
