"""Run time and memory of anything that can be called; variants take turns, so that load on the machine hits all."""

from __future__ import annotations

import sys
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slopegate.core.rig.arrays import Doubles


@dataclass(frozen=True)
class Timing:
    """Milliseconds that a unit of work takes, over all repeats.

    wall_ms: median by the clock on the wall. core_ms: median of the time that cores spent, all threads together, with
    its quartiles and least; what else the machine does stretches the former and hardly the latter.
    """

    wall_ms: float
    core_ms: float
    low_ms: float
    high_ms: float
    least_ms: float
    repeats: int


@dataclass(frozen=True)
class TimedCall:
    """A call to time; one unit of work is `units` calls' worth (below 1: the call does that share of it)."""

    call: Callable[[], object]
    units: float = 1.0
    repeats: int = 9


def time_all(jobs: Sequence[TimedCall]) -> list[Timing]:
    """Run every job once to warm up, then all in turn, each as often as it wants."""
    for job in jobs:
        job.call()
    times_s: list[list[tuple[float, float]]] = [[] for _ in jobs]
    for turn in range(max(job.repeats for job in jobs)):
        for job, kept in zip(jobs, times_s, strict=True):
            if turn < job.repeats:
                wall_s, core_s = time.perf_counter(), core_clock()
                job.call()
                kept.append((time.perf_counter() - wall_s, core_clock() - core_s))
    return [_timing(np.array(kept) * (1e3 / job.units)) for job, kept in zip(jobs, times_s, strict=True)]


def core_clock() -> float:
    """Seconds that cores have spent on this process; of the wall's clock where Python counts them in ticks of 16 ms."""
    return time.perf_counter() if sys.platform == "win32" else time.process_time()


def _timing(times_ms: Doubles) -> Timing:
    wall, cores = times_ms.T
    low, middle, high = np.percentile(cores, (25, 50, 75))
    return Timing(float(np.median(wall)), float(middle), float(low), float(high), float(cores.min()), len(times_ms))


def peak_bytes(call: Callable[[], object]) -> int:
    """The most memory that a call holds at once beside what it found, as Python and numpy allocate it.

    It is called once before, for a first call also compiles.
    """
    call()
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
