"""The beat of a triggered camera: period, jitter and missed triggers, from its frames' time stamps and numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Bools, Doubles, Indices
from slopegate.core.rig.spread import robust_deviation

MIN_INTERVALS: Final = 8
"""Fewer intervals say nothing of a beat."""

MAX_GAP: Final = 4
"""Intervals of more triggers than this are silences, and no measure of jitter."""

ON_BEAT: Final = 0.25
"""Share of the period by which a frame may be off and still belong to its trigger."""


@dataclass(frozen=True)
class Cadence:
    """The beat of some frames: period and jitter, microseconds."""

    period_us: float
    """From one trigger to the next: the median, so that neither missed triggers nor late frames count."""
    jitter_us: float
    """Standard deviation of one time stamp about the beat, robust: the intervals' over sqrt(2), for each has two."""
    worst_us: float
    """Largest deviation of an interval from a whole number of periods."""
    frames: int

    @property
    def steady(self) -> bool:
        """Whether there is a beat at all, so that a frame off it means something."""
        return 4 * self.jitter_us < ON_BEAT * self.period_us


def cadence(times_s: Doubles, sequences: Indices, settled: Bools) -> Cadence | None:
    """The beat of frames in the order they came, (N,) each; None where too few say something.

    Lost frames are told from the sequence numbers, missed triggers from intervals near a whole number of periods. What
    lies before a frame that is not settled says nothing: a change may have held it up.
    """
    steps, intervals_us = np.diff(sequences), np.diff(times_s) * 1e6
    counted = (steps > 0) & (intervals_us > 0) & settled[1:]
    if counted.sum() < MIN_INTERVALS:
        return None
    intervals_us, steps = intervals_us[counted], steps[counted]
    rough_us = float(np.median(intervals_us / steps))
    triggers = np.maximum(np.rint(intervals_us / rough_us), 1)
    short = triggers <= MAX_GAP
    intervals_us, triggers = intervals_us[short], triggers[short]
    if intervals_us.size < MIN_INTERVALS:
        return None
    period_us = float(np.median(intervals_us / triggers))
    off_us = intervals_us - triggers * period_us
    jitter_us = robust_deviation(off_us) / math.sqrt(2)
    return Cadence(period_us, jitter_us, float(np.abs(off_us).max()), intervals_us.size + 1)


def missed_triggers(elapsed_us: float, steps: int, period_us: float) -> int | None:
    """Triggers without a frame between two frames, `steps` apart in sequence; None when the later one is off the beat.

    Frames that are missing from the sequence numbers were made, so their triggers were heard.
    """
    triggers = round(elapsed_us / period_us)
    if triggers < steps or abs(elapsed_us - triggers * period_us) > ON_BEAT * period_us:
        return None
    return triggers - steps
