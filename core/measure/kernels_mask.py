"""The loops behind masks and depth sweeps, compiled; nothing else."""

from __future__ import annotations

import numpy as np
from numba import njit
from slopegate.core.rig.arrays import Bools, Bytes, Counts, Doubles, Indices, Ints, Singles


@njit(cache=True, nogil=True)
def count_phases(lit_us: Singles, camera_rows: Ints, line_time_us: float, period_us: float, counts: Indices) -> None:
    """Add to counts (bins,) the phases (lit_us - (row + 1/2) line_time) mod period of n pixels, in equal bins.

    The law of `gate.phase_us`, repeated here because arrays of phases would be made and thrown away for every line time
    that is tried; a test holds the two together.
    """
    bins = counts.size
    scale = bins / period_us
    for i in range(lit_us.size):
        turns = (lit_us[i] - (camera_rows[i] + 0.5) * line_time_us) / period_us
        at = int((turns - np.floor(turns)) * period_us * scale)
        counts[at if at < bins else 0] += 1


@njit(cache=True, nogil=True)
def best_interval(wanted: Doubles, other: Doubles) -> tuple[int, int, float]:
    """The circular run of bins with the greatest intersection over union; start, length and that ratio.

    wanted, other (bins,): pixels inside and outside the region. Ratio maximised by Dinkelbach's iteration: for a trial
    ratio q the run of greatest sum(wanted - q other) is a largest circular subarray (Kadane), whose own ratio is the
    next q; it rises until the maximum, exactly, is reached.
    """
    bins = wanted.size
    total = wanted.sum()
    start, length = 0, bins
    ratio = total / max(total + other.sum(), 1.0)
    for _ in range(60):
        best, low, sum_all = 0.0, 0.0, 0.0
        best_from, best_to, low_from, low_to = 0, 0, 0, 0
        rise, fall, rise_from, fall_from = 0.0, 0.0, 0, 0
        for i in range(bins):
            value = wanted[i] - ratio * other[i]
            sum_all += value
            if rise <= 0.0:
                rise, rise_from = 0.0, i
            rise += value
            if rise > best:
                best, best_from, best_to = rise, rise_from, i + 1
            if fall >= 0.0:
                fall, fall_from = 0.0, i
            fall += value
            if fall < low:
                low, low_from, low_to = fall, fall_from, i + 1
        if sum_all - low > best:
            first, count = low_to % bins, bins - (low_to - low_from)
        else:
            first, count = best_from, best_to - best_from
        inside, extra = 0.0, 0.0
        for i in range(count):
            k = (first + i) % bins
            inside += wanted[k]
            extra += other[k]
        found = inside / max(total + extra, 1.0)
        if found <= ratio:
            break
        start, length, ratio = first, count, found
    # bins without wanted pixels at either end only add others
    while length > 0 and wanted[(start + length - 1) % bins] == 0:
        length -= 1
    while length > 0 and wanted[start] == 0:
        start, length = (start + 1) % bins, length - 1
    return start, length, ratio


@njit(cache=True, nogil=True)
def decide(
    counts: Counts | Singles,
    half: Singles,
    ambient: Singles,
    exposure_us: float,
    places: tuple[Ints, Ints],
    wrong: tuple[Bools, Bools],
    labels: Ints,
    strikes: Bytes,
    population: Indices,
) -> None:
    """Move each pixel, all (n,), to the interval that its answer in this frame names; population counts who is where.

    A pixel is lit when counts > half + ambient * exposure. By label: places says where a dark and where a lit pixel
    goes, wrong which of the two answers contradicts what is known of it (a strike). Labels below 0 are not looked at.
    """
    exposure = np.float32(exposure_us)
    for i in range(labels.size):
        label = labels[i]
        if label < 0:
            continue
        if np.float32(counts[i]) > half[i] + ambient[i] * exposure:
            target, bad = places[1][label], wrong[1][label]
        else:
            target, bad = places[0][label], wrong[0][label]
        labels[i] = target
        population[target] += 1
        if bad and strikes[i] < 255:
            strikes[i] += 1
