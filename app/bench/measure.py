"""Run time and memory of anything that can be called; variants take turns, so that load on the machine hits all."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Timing:
    """Milliseconds of a whole unit of work: median, quartiles and quietest of so many repeats."""

    median_ms: float
    low_ms: float
    high_ms: float
    best_ms: float
    repeats: int


@dataclass(frozen=True)
class Job:
    """A call to time; one unit of work is `units` calls' worth (below 1: the call does that share of it)."""

    call: Callable[[], object]
    units: float = 1.0
    repeats: int = 9


def time_all(jobs: Sequence[Job]) -> list[Timing]:
    """Run every job once to warm up, then all in turn, each as often as it wants."""
    for job in jobs:
        job.call()
    times_s: list[list[float]] = [[] for _ in jobs]
    for turn in range(max(job.repeats for job in jobs)):
        for job, kept in zip(jobs, times_s, strict=True):
            if turn < job.repeats:
                start_s = time.perf_counter()
                job.call()
                kept.append(time.perf_counter() - start_s)
    return [_timing(np.array(kept) * (1e3 / job.units)) for job, kept in zip(jobs, times_s, strict=True)]


def _timing(times_ms: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Timing:
    low, median, high = np.percentile(times_ms, (25, 50, 75))
    return Timing(float(median), float(low), float(high), float(times_ms.min()), len(times_ms))


def peak_bytes(call: Callable[[], object]) -> int:
    """The most memory that a call holds at once beside what it found, as Python and numpy allocate it."""
    tracing = tracemalloc.is_tracing()
    if not tracing:
        tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    call()
    peak = tracemalloc.get_traced_memory()[1] - before
    if not tracing:
        tracemalloc.stop()
    return max(0, peak)
