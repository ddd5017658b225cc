"""Counts what goes wrong with a stream's frames: lost, repeated or late ones, and triggers that made none."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from slopegate.core.rig.cadence import Cadence, cadence, missed_triggers
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.contract.tap import Counters

KEPT: Final = 128
"""Frames that the beat is measured over."""

MEASURE_EVERY: Final = 8

GIVE_UP_AFTER: Final = 3
"""Frames that do not come at the old pace after a change: it is another one."""

RESTART_AFTER: Final = 5
"""So many frames in a row from before the newest one: the camera counts anew (it was plugged in again)."""


class FrameWatch:
    """Judges every frame by its stamp, in the order in which they come. The stream's thread feeds it.

    Lost and repeated frames are told from the sequence numbers, late ones and missed triggers from the times. A change
    of settings may hold up the frame that follows, whose time is not judged. It may also make the camera slower: then
    no time is judged until a frame has come at the old pace, or the new one has been measured. Frames made on demand
    come whenever somebody takes them, so that their times are never judged; those that are replayed have no beat.
    """

    def __init__(self, on_demand: bool = False, replayed: bool = False) -> None:
        self._on_demand, self._replayed = on_demand, replayed
        self._times_s, self._sequences = np.zeros(KEPT), np.zeros(KEPT, np.int64)
        self._settled = np.zeros(KEPT, np.bool_)
        self._count = 0
        self._pace: tuple[object, ...] = ()
        self._beat: Cadence | None = None
        self._last: int | None = None
        self._behind = 0
        self._anchor = self._before = (0.0, 0)
        self._doubts = 0
        self._counters = Counters()

    @property
    def counters(self) -> Counters:
        """What has come so far. May be read from any thread."""
        return self._counters

    @property
    def beat(self) -> Cadence | None:
        """The beat lately; None until enough frames have come. May be read from any thread."""
        return self._beat

    def judge(self, stamp: FrameStamp) -> FrameStamp:
        """Count one frame; its stamp, with how many were lost before it and whether it came again."""
        was = self._counters
        gap = self._gap(stamp.sequence)
        if gap is None:
            self._counters = replace(was, made=was.made + 1, repeated=was.repeated + 1)
            return replace(stamp, repeated=True)
        missed = self._judge_time(stamp)
        self._counters = replace(
            was,
            made=was.made + 1,
            lost=was.lost + gap,
            missed=was.missed + (missed or 0),
            late=was.late + (missed is None),
        )
        return replace(stamp, lost=gap) if gap else stamp

    def count_error(self) -> None:
        """The camera failed."""
        self._counters = replace(self._counters, errors=self._counters.errors + 1)

    def _gap(self, sequence: int) -> int | None:
        """How many frames are missing before this one; None for one that is not new."""
        last = self._last
        if last is not None and sequence <= last:
            self._behind += 1
            if sequence == last or self._behind < RESTART_AFTER:
                return None
            last = None
        self._behind = 0
        self._last = sequence
        return 0 if last is None else sequence - last - 1

    def _judge_time(self, stamp: FrameStamp) -> int | None:
        """Triggers since the frame before that made no frame; None for a frame off the beat."""
        if self._replayed:
            return 0
        self._note(stamp)
        here, before = (stamp.time_s, stamp.sequence), self._before
        self._before = here
        if self._on_demand or self._beat is None or not self._beat.steady or not stamp.settled:
            self._anchor = here
            return 0
        missed = self._missed_since(self._anchor, stamp)
        if self._doubts:
            self._reconsider(stamp, confirmed=missed == 0)
            return 0
        if missed is None:
            # in step with the one before: the beat has begun anew with that one
            missed = self._missed_since(before, stamp)
        if missed is not None:
            self._anchor = here
        return missed

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
