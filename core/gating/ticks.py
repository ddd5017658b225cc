"""Exposures as whole numbers of ticks, so that windows meet to the last bit and no period is lost to rounding.

A tick is the 2^53rd to 2^54th part of the projector's period, chosen so that the period is a whole number of ticks. The
two ends of row coordinate 0's exposure, taken modulo the period exactly, are put on a grid of 2^-30 us (a
femtosecond): settings that meet on paper, such as 2000.1 + 300.3 / 2 and 2300.4 - 300.3 / 2, then meet here, although
their float64 values miss each other by a rounding. From there on everything is whole numbers, except that a row's own
offset (k + 1/2) * line_time is rounded to a tick.

Error of an edge: half a grid step, 4.7e-10 us, plus half a tick, 2^-54 of the period, plus one rounding of the result:
together below 5e-13 of a period of 1000 us and more, whatever the delay, the exposure, the line time and the row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig.settings import GateSettings

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_GRID_BITS = 30
"""The ends of an exposure are whole multiples of 2^-30 us."""

_PERIOD_BITS = 54


@dataclass(frozen=True)
class Ticks:
    """The exposure of row coordinate 0 in ticks: from `start` until `start + exposure`, modulo `period`."""

    period: int
    per_us: Fraction
    start: int
    exposure: int


def in_ticks(settings: GateSettings, period_us: float) -> Ticks:
    """The exposure of row coordinate 0, its ends on the grid."""
    mantissa, exponent = math.frexp(period_us)
    period, per_us = int(math.ldexp(mantissa, _PERIOD_BITS)), Fraction(2) ** (_PERIOD_BITS - exponent)
    grid = 1 << (_PERIOD_BITS - exponent - _GRID_BITS)
    centre, half = Fraction(settings.delay_us), Fraction(settings.exposure_us) / 2

    def on_grid(time_us: Fraction) -> int:
        nearest = round(time_us * per_us % period / grid) * grid
        return 0 if nearest >= period else nearest  # a grid step that reaches beyond the period's end is its start

    start, end = on_grid(centre - half), on_grid(centre + half)
    periods = round((2 * half * per_us - (end - start)) / period)
    return Ticks(period, per_us, start, periods * period + end - start)


@dataclass(frozen=True, eq=False)
class RowTimes:
    """Exposures of camera rows, by the phase within the projector's period; arrays of one value per row.

    start_us and end_us in [0, period]; the exposure lasts from start_us to end_us plus `periods` (int64) whole periods,
    at least one where end_us comes before start_us; `wraps` says where it does.
    """

    start_us: Floats
    end_us: Floats
    periods: Integers
    wraps: NDArray[np.bool_]


def row_times(settings: GateSettings, period_us: float, rows: Integers) -> RowTimes:
    """When the camera rows `rows`, an array (n,) of whole numbers from 0 to 2^20, are exposed."""
    ticks = in_ticks(settings, period_us)
    start = _phases(ticks, settings.line_time_us, rows)
    periods, rest = divmod(ticks.exposure, ticks.period)
    end = start + rest
    wraps = end >= ticks.period
    end -= ticks.period * wraps.astype(np.int64)
    start_us, end_us = (phase.astype(np.float64) / float(ticks.per_us) for phase in (start, end))
    return RowTimes(start_us, end_us, periods + wraps.astype(np.int64), wraps)


def _phases(ticks: Ticks, line_time_us: float, rows: Integers) -> Integers:
    """Start of each row's exposure modulo the period, 0 <= phase < period, (n,) ticks."""
    whole, part = divmod(Fraction(line_time_us) / 2 * ticks.per_us, 1)
    whole %= ticks.period
    odd = 2 * rows + 1
    offset: Integers = np.rint(odd * float(part)).astype(np.int64) + ticks.start
    # The products leave int64 and wrap round. Only their small difference is kept, which does not mind.
    turns = np.floor(odd * (whole / ticks.period) + offset / ticks.period).astype(np.int64)
    phases: Integers = (odd * np.int64(whole) + offset - turns * np.int64(ticks.period)) % ticks.period
    return phases
