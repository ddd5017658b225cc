"""Which gate to take next for the timing, and when it is known well enough.

Each gate that the rig accepts would show edges at places that follow from the timing so far. What they would add to
what is known (their Fisher information) says which gate brings down the standard errors most. Candidates are drawn
anew every time: edges then fall on other places between the camera's rows, and what a row hides evens out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.calibration.edges import LEAST_ROWS, profiles
from slopegate.core.calibration.law import EdgeTable, EdgeWeights, Nominal, Shot, edge_table, equations, usable
from slopegate.core.calibration.timing import OUTLIER, GateTiming
from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate, quantise

FIRST: Final = 12
"""Gates that are taken before anything is fitted."""
LEAST_LEAD: Final = 4.0
"""Factor by which edges have to miss the law by less than with any other directions."""
_LINES: Final = 10
_GATES: Final = 24
"""Candidates: line times, and gates of each."""
_SPANS: Final = (0.1, 1.5)
"""Time that the camera takes for all its rows, as a share of the projector's period."""
_LEAST_JITTER_US: Final = 0.5
"""Jitter that is reckoned with, however steady the pictures so far look."""
_PLASTIC: Final = (0.7548776662466927, 0.5698402909980532)
"""Multiples of these two, less whole numbers, fill a square evenly."""
_WIDE: Final = 0.6
_NARROW: Final = 0.3
"""Of the most that can pass over the picture; and where just one line time has that."""
_MARGIN_ROWS: Final = 5 * LEAST_ROWS
_PASSINGS: Final = 8.0
"""Between an edge and the next, and half of it to the end of the target: rows, and times the softness of an edge."""
_TAILS: Final = 4.0
"""Rows over which the light of an edge passes, by its softness."""


@dataclass(frozen=True)
class TimingGoal:
    """Standard errors that are asked for.

    A third of what may be wrong: a microsecond of the offset, a thousandth of the line time and of the active fraction.
    """

    offset_us: float = 0.33
    line_share: float = 3.3e-4
    active_fraction: float = 3.3e-4


GOAL: Final = TimingGoal()


@dataclass(frozen=True)
class TimingVerdict:
    """Whether the timing is known well enough, and a sentence that says why or what lacks how much."""

    enough: bool
    reason: str


@dataclass(frozen=True, eq=False)
class TargetSight:
    """The target in strips of the picture, (H, S) float64 each, NaN where it is not seen: projector row and its range
    over the strip's columns."""

    projector_row: Doubles
    across: Doubles


def sight_of(projector_row: Singles, known: Bools) -> TargetSight:
    """The strips of a target, from the projector rows (H, W) that light its known pixels (H, W)."""
    flat = np.ones(projector_row.shape, np.float32)
    found = profiles(flat, flat, projector_row, known, 0.0)
    return TargetSight(
        *(np.stack(part, axis=1) for part in zip(*((p.projector_row, p.across) for p in found), strict=True))
    )


def nominal_of(rig: Rig, period_error_us: float) -> Nominal:
    """What the rig file says, with the standard error of its period, microseconds."""
    projector = rig.projector
    return Nominal(
        projector.lens.height, rig.camera.lens.height, projector.period_us, period_error_us, projector.active_fraction
    )


def enough(timing: GateTiming | None, goal: TimingGoal = GOAL) -> TimingVerdict:
    """Whether every number is known as well as the goal asks."""
    if timing is None:
        return TimingVerdict(False, "the gates so far do not tell a timing yet")
    if timing.lead < LEAST_LEAD:
        return TimingVerdict(False, "the gates so far do not tell in which direction rows are drawn and read")
    errors, wanted = _errors(timing.covariance[None], timing)[0], _wanted(goal)
    missing = [
        f"{name} is known to {error * scale:.2g}{unit} and should be to {most * scale:.2g}{unit}"
        for (name, scale, unit), error, most in zip(_TOLD, errors, wanted, strict=True)
        if error > most
    ]
    if missing:
        return TimingVerdict(False, "; ".join(missing))
    told = ", ".join(
        f"{name} to {error * scale:.2g}{unit}" for (name, scale, unit), error in zip(_TOLD, errors, strict=True)
    )
    return TimingVerdict(True, f"known well enough: {told}")


def lacking(timing: GateTiming, goal: TimingGoal = GOAL) -> tuple[float, float, float]:
    """Standard errors of delay offset, line time and active fraction, over those that the goal asks for."""
    offset, line, active = (_errors(timing.covariance[None], timing)[0] / _wanted(goal)).tolist()
    return offset, line, active


def gates_needed(timing: GateTiming, frames: int, goal: TimingGoal = GOAL) -> int:
    """About how many gates will do, two digits of them, after so many: errors fall with the root of their number."""
    wanted = frames * max(1.0, *lacking(timing, goal)) ** 2
    digits = 10.0 ** max(0, math.floor(math.log10(wanted)) - 1)
    return int(math.ceil(wanted / digits) * digits)


_TOLD: Final = (("the delay offset", 1.0, " us"), ("the line time", 100.0, " %"), ("the active fraction", 100.0, " %"))


def _wanted(goal: TimingGoal) -> Doubles:
    return np.array([goal.offset_us, goal.line_share, goal.active_fraction])


def _errors(covariances: Doubles, timing: GateTiming) -> Doubles:
    """Standard errors of `TimingGoal`'s numbers (C, 3) from covariances of `NAMES` (C, 5, 5)."""
    period, fraction = timing.period_us, timing.active_fraction
    change = np.zeros((3, 5))
    change[0, 2], change[1, 1] = 1.0, 1.0
    change[2, 0], change[2, 4] = timing.nominal.projector_rows / period, -fraction / period
    variances: Doubles = np.einsum("ip,cpq,iq->ci", change, covariances, change)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)), np.float64)


def next_gate(
    rig: Rig, sight: TargetSight, shots: Sequence[Shot], timing: GateTiming | None, goal: TimingGoal = GOAL
) -> GateSettings:
    """The first of `next_gates`."""
    return next_gates(rig, sight, shots, timing, 1, goal)[0]


def next_gates(
    rig: Rig, sight: TargetSight, shots: Sequence[Shot], timing: GateTiming | None, count: int, goal: TimingGoal = GOAL
) -> list[GateSettings]:
    """The gates to take next, of those that the rig accepts: each tells most beside those before it.

    shots: those that there are. timing: what was fitted to them, or to the first of them; None: gates are spread over
    all that they could show.
    """
    spread = [_spread(rig, sight, len(shots) + number) for number in range(count)]
    if timing is None or timing.lead < LEAST_LEAD:
        return spread
    candidates = _candidates(rig, sight, timing, np.random.default_rng(len(shots)))
    table = _predicted(sight, timing, candidates, _softness(shots, timing))
    normal, gained = _known(shots, timing), _information(table, len(candidates), timing)
    left = np.isin(np.arange(len(candidates)), table.shot)
    chosen: list[GateSettings] = []
    for _ in range(min(count, int(left.sum()))):
        scale = np.sqrt(np.diag(normal))
        covariances = np.linalg.inv((normal + gained) / np.outer(scale, scale)) / np.outer(scale, scale)
        lacking = ((_errors(covariances, timing) / _wanted(goal)) ** 2).sum(axis=1)
        best = int(np.where(left, lacking, np.inf).argmin())
        chosen.append(candidates[best])
        normal = normal + gained[best]
        left[best] = False
    return chosen + spread[len(chosen) :]


def _spread(rig: Rig, sight: TargetSight, number: int) -> GateSettings:
    """A gate where nothing is known yet: line times and delays in turn, none like one before.

    Of the line times those count over which the gate moves most: the more of a period passes over the picture, the more
    delays show an edge. Two there are at least: one alone does not tell line time and active fraction apart. An
    exposure of as long hardly ever hides both edges.
    """
    period, rows = rig.projector.period_us, sight.projector_row[np.isfinite(sight.projector_row)]
    every = np.array(_every_line(rig))
    passing = np.abs((np.ptp(rows) if len(rows) else 0.0) / rig.projector.rows_per_us - every * rig.camera.lens.height)
    second = max(np.sort(passing)[-2:].min(), _NARROW * passing.max())
    wide = np.flatnonzero(passing >= min(_WIDE * passing.max(), second))
    line = wide[int(number * _PLASTIC[0] % 1 * len(wide))]
    exposure = min(0.5 * period, 0.9 * float(passing[line]))
    delay = (number * _PLASTIC[1] % 1 - 0.5) * period
    return quantise(rig.camera.shutter, gate(float(every[line]), delay, exposure), period)


def _every_line(rig: Rig) -> list[float]:
    """The line times that the camera can have and whose rows, all together, take about a period."""
    line = rig.camera.shutter.line
    if isinstance(line, PixelClocks):
        every = line.clocks_per_line / np.array(line.ladder_mhz)
    else:
        every = np.array([line.nearest(value) for value in np.geomspace(line.min_us, line.max_us, 200)])
    span = every * rig.camera.lens.height / rig.projector.period_us
    some = np.unique(every[(span > _SPANS[0]) & (span < _SPANS[1])])
    return [float(value) for value in (some if len(some) else np.unique(every))]


def _phases(sight: TargetSight, timing: GateTiming, line_us: float) -> Doubles:
    """Phase (H, S) at which light comes to the strips' rows in scan order: row_us r - line k."""
    rows = sight.projector_row
    rows = timing.nominal.projector_rows - rows if timing.projector == "up" else rows
    rows = rows[::-1] if timing.camera == "up" else rows
    k = np.arange(len(rows)) + 0.5
    return np.asarray(timing.values[0] * rows - timing.stretch * line_us * k[:, None], np.float64)


def _candidates(rig: Rig, sight: TargetSight, timing: GateTiming, random: np.random.Generator) -> list[GateSettings]:
    """Gates with an edge on the target, as the camera can do them: short ones and what short ones leave out."""
    period, found = timing.period_us, []
    for line in random.permutation(_every_line(rig))[:_LINES].tolist():
        phases = _phases(sight, timing, line)
        low, high = np.nanmin(phases), np.nanmax(phases)
        exposures = (high - low) * random.uniform(0.1, 0.9, _GATES)
        exposures = np.where(random.random(_GATES) < 0.5, exposures, period - exposures)
        sides = random.choice([-0.5, 0.5], _GATES)
        delays = random.uniform(low, high, _GATES) - timing.offset_us + sides * exposures
        for delay, exposure in zip(delays.tolist(), exposures.tolist(), strict=True):
            if exposure > 0:
                found.append(quantise(rig.camera.shutter, gate(line, delay % period, exposure), period))
    return found


@dataclass(frozen=True)
class _Softness:
    """Of the edges that were found: the standard error of their place for one row that light passes on, to be taken by
    the root of the rows, and the standard deviation of the time in which it passes, microseconds."""

    error_rows: float
    passing_us: float


def _softness(shots: Sequence[Shot], timing: GateTiming) -> _Softness:
    table = edge_table(shots).turned(timing.nominal, timing.projector, timing.camera)
    passing = table.soft_rows * np.abs(table.rate_us(timing.values[0], timing.stretch))
    errors = table.error_rows / np.sqrt(LEAST_ROWS + _TAILS * table.soft_rows)
    return _Softness(float(np.median(errors)), float(np.median(passing)))


@dataclass(frozen=True, eq=False)
class _Track:
    """A strip of the target at one line time, in scan order: rows k where it is seen, the projector row and the phase
    of its light there, how fast that rises, projector rows per camera row, and their range over the strip, all (N,)."""

    k: Doubles
    projector_row: Doubles
    phase: Doubles
    rate: Doubles
    slope: Doubles
    across: Doubles


def _tracks(sight: TargetSight, timing: GateTiming, line_us: float) -> list[_Track]:
    """The strips over which the gate's edge moves one way and not along with the rows."""
    across = sight.across[::-1] if timing.camera == "up" else sight.across
    tracks = []
    for phases, wide in zip(_phases(sight, timing, line_us).T, across.T, strict=True):
        seen = np.flatnonzero(np.isfinite(phases))
        if len(seen) < 2 * _MARGIN_ROWS:
            continue
        k, phase = seen + 0.5, phases[seen]
        rate = np.asarray(np.gradient(phase, k), np.float64)
        projector_row = (phase + timing.stretch * line_us * k) / timing.values[0]
        slope = (rate + timing.stretch * line_us) / timing.values[0]
        if rate.min() > 0 or rate.max() < 0:
            tracks.append(
                _Track(np.asarray(k, np.float64), projector_row, phase, rate, np.asarray(slope, np.float64), wide[seen])
            )
    return tracks


def _predicted(
    sight: TargetSight, timing: GateTiming, candidates: Sequence[GateSettings], soft: _Softness
) -> EdgeTable:
    """The edges that candidates would show, in scan order; `shot` is the candidate's number."""
    offset, excess, period = timing.values[2:]
    line, delay, exposure = np.array(
        [(one.line_time_us, one.delay_us, one.exposure_us) for one in candidates], np.float64
    ).T
    parts = [np.zeros((8, 0))]
    for line_us in np.unique(line):
        mine = np.flatnonzero(line == line_us)
        for track in _tracks(sight, timing, float(line_us)):
            room = np.minimum(exposure[mine], period - exposure[mine])
            for side in (-1.0, 1.0):
                due = delay[mine] + offset + side * (exposure[mine] + excess) / 2
                for fit, row, *columns in _meetings(track, due, period, room, soft):
                    rising = np.full(len(fit), float((side < 0) == bool(track.rate[0] > 0)))
                    parts.append(np.stack([mine, row, *columns, rising])[:, fit])
    shot, row, projector_row, slope, across, errors, soft_rows, rising = np.concatenate(parts, axis=1)
    owner = shot.astype(np.int32)
    return EdgeTable(
        owner,
        row,
        projector_row,
        slope,
        across,
        rising > 0,
        errors,
        soft_rows,
        line[owner],
        delay[owner],
        exposure[owner],
        np.zeros(len(row)),
    )


def _meetings(
    track: _Track, due: Doubles, period: float, room: Doubles, soft: _Softness
) -> Iterator[tuple[Bools, Doubles, Doubles, Doubles, Doubles, Doubles, Doubles]]:
    """Where a strip's light comes at the instants `due` (C,), whole periods apart, and whether an edge is found there.

    That, then row, projector row, slope, range, error and softness as in `EdgeTable`, (C,) each. `room`: from one edge
    of the gate to the other, microseconds: what lies too near to that or to an end of the strip is not found.
    """
    phase, k = (track.phase, track.k) if track.rate[0] > 0 else (track.phase[::-1], track.k[::-1])
    first = np.ceil((due - phase[-1]) / period)
    for turn in range(int(np.ceil((phase[-1] - phase[0]) / period))):
        at = due - (first + turn) * period
        row = np.interp(at, phase, k)
        rate, projector_row, slope, across = (
            np.interp(row, track.k, one) for one in (np.abs(track.rate), track.projector_row, track.slope, track.across)
        )
        least = _MARGIN_ROWS * rate + _PASSINGS * soft.passing_us
        fit = (np.minimum(at - phase[0], phase[-1] - at) >= least / 2) & (room >= least)
        width = soft.passing_us / rate
        yield fit, row, projector_row, slope, across, soft.error_rows * np.sqrt(LEAST_ROWS + _TAILS * width), width


def _information(table: EdgeTable, count: int, timing: GateTiming) -> Doubles:
    """What candidates would add to the inverse covariance of `NAMES`, (count, 5, 5)."""
    left, _, errors = equations(table, timing.values)
    fit = usable(table, timing.values)
    left, shot, weight = left[fit], table.shot[fit], errors[fit] ** -2
    own, sums = np.zeros((count, 5, 5)), np.zeros((count, 5))
    np.add.at(own, shot, weight[:, None, None] * left[:, :, None] * left[:, None, :])
    np.add.at(sums, shot, weight[:, None] * left)
    # The picture's jitter is common to all its edges (Sherman and Morrison).
    shared = max(timing.jitter_us, _LEAST_JITTER_US) ** 2
    factor = shared / (1 + shared * np.bincount(shot, weight, count))
    return np.asarray(own - factor[:, None, None] * sums[:, :, None] * sums[:, None, :], np.float64)


def _known(shots: Sequence[Shot], timing: GateTiming) -> Doubles:
    """The inverse covariance of `NAMES` after all shots, (5, 5), those that came after the fit included."""
    table = edge_table(shots).turned(timing.nominal, timing.projector, timing.camera)
    left, right, errors = equations(table, timing.values)
    missed = np.abs(right - left @ timing.values)
    shared = max(timing.jitter_us, _LEAST_JITTER_US)
    used = usable(table, timing.values) & (missed <= OUTLIER * np.hypot(errors, shared))
    weights = EdgeWeights(table.shot[used], errors[used] ** 2, shared**2)
    return np.asarray(left[used].T @ weights.times(left[used]) + np.diag(timing.nominal.beliefs()[1]), np.float64)
