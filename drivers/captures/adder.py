"""Sums the frames of one slice and writes down what belongs to them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

import numpy as np
from slopegate.core.gating.gate import slab
from slopegate.core.measure.stack import accumulate
from slopegate.core.rig.arrays import Counts, Words
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.model import Gate, SlabFacts, SliceRecord
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.stream.sieve import Tally


@dataclass(frozen=True)
class CaptureTask:
    """One thing to take: the dark frame, a slice, or a look for light through several slices at once."""

    kind: Literal["dark", "probe", "slice"]
    index: int | None
    gate: GateSettings
    frames: int


class Adder:
    """Takes the frames that count for one task."""

    def __init__(self, task: CaptureTask, total: Words, max_count: int) -> None:
        """`total` (H, W) is filled anew."""
        self._task, self._max_count = task, max_count
        self.total = total
        self._taken = self._saturated = 0
        self._stamps: tuple[FrameStamp, FrameStamp] | None = None
        self._times: tuple[datetime, datetime] | None = None
        self._first_dark: Counts | None = None
        self.noise_counts: float | None = None
        """Of a complete dark frame: standard deviation of a pixel from frame to frame."""

    def add(self, image: Counts, stamp: FrameStamp, now: datetime) -> bool:
        """Add a frame (H, W); True when it was the last one. A camera that changes its mind starts the sum anew."""
        if self._stamps is None or self._times is None or stamp.applied != self._stamps[0].applied:
            self.total.fill(0)
            self._taken = self._saturated = 0
            self._stamps, self._times = (stamp, stamp), (now, now)
            self._first_dark = image.copy() if self._task.kind == "dark" else None
        self._stamps, self._times = (self._stamps[0], stamp), (self._times[0], now)
        self._saturated += accumulate(image, self.total, self._max_count)
        self._taken += 1
        if self._taken < self._task.frames:
            return False
        if self._first_dark is not None:
            self.noise_counts = float(np.std(image.astype(np.float32) - self._first_dark) / np.sqrt(2))
        return True

    def record(self, rig: Rig, tally: Tally) -> SliceRecord:
        """What is known of the complete sum."""
        assert self._stamps is not None
        assert self._times is not None
        first, last = self._stamps
        applied = last.applied or self._task.gate
        return SliceRecord(
            index=self._task.index,
            asked=Gate.of(self._task.gate),
            applied=Gate.of(applied),
            slab=SlabFacts.of(slab(rig, applied)),
            frames=self._taken,
            saturated_share=self._saturated / (self._taken * self.total.size),
            noise_counts=self.noise_counts,
            started=_iso(self._times[0]),
            ended=_iso(self._times[1]),
            first_time_s=first.time_s,
            last_time_s=last.time_s,
            first_sequence=first.sequence,
            last_sequence=last.sequence,
            lost=tally.lost,
            duplicated=tally.duplicated,
            discarded=tally.discarded,
        )


def empty_record(rig: Rig, index: int, asked: GateSettings, now: datetime) -> SliceRecord:
    """Of a slice in which no light was seen."""
    return SliceRecord(
        index=index,
        asked=Gate.of(asked),
        applied=Gate.of(asked),
        slab=SlabFacts.of(slab(rig, asked)),
        frames=0,
        empty=True,
        saturated_share=0.0,
        started=_iso(now),
        ended=_iso(now),
    )


def _iso(time: datetime) -> str:
    return time.astimezone(UTC).isoformat(timespec="milliseconds")
