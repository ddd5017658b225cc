"""Which gate to take next for the timing, and when it is known well enough.

Each gate that the rig accepts would show edges at places that follow from the timing so far. What they would add to
what is known (their Fisher information) says which gate brings down the standard errors most. Candidates are drawn
anew every time: edges then fall on other places between the camera's rows, and what a row hides evens out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.calibration.edges import LEAST_ROWS, profiles
from slopegate.core.calibration.law import EdgeTable, EdgeWeights, Nominal, Shot, edge_table, equations, usable
from slopegate.core.calibration.timing import OUTLIER, GateTiming
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate, quantise

FIRST: Final = 12
"""Gates that are taken before anything is fitted."""
LEAST_LEAD: Final = 0.1
"""Of the agreement with these directions over any other's."""
_LINES: Final = 10
_GATES: Final = 24
"""Candidates: line times, and gates of each."""
_SPANS: Final = (0.1, 1.5)
"""Time that the camera takes for all its rows, as a share of the projector's period."""
_LEAST_JITTER_US: Final = 0.5
"""Jitter that is reckoned with, however steady the pictures so far look."""
_GOLDEN: Final = 0.6180339887498949
_ERROR_ROWS: Final = 0.1
_MARGIN_ROWS: Final = 3 * LEAST_ROWS
"""Between an edge and the next, or the end of the target: as much as it takes to find it."""


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
    errors = _errors(timing.covariance[None], timing)[0]
    wanted = _wanted(goal)
    lacking = [
        f"{name} is known to {error * scale:.2g}{unit} and should be to {most * scale:.2g}{unit}"
        for (name, scale, unit), error, most in zip(_TOLD, errors, wanted, strict=True)
        if error > most
    ]
    if lacking:
        return TimingVerdict(False, "; ".join(lacking))
    told = ", ".join(
        f"{name} to {error * scale:.2g}{unit}" for (name, scale, unit), error in zip(_TOLD, errors, strict=True)
    )
    return TimingVerdict(True, f"known well enough: {told}")


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
    """The gate to take next, of those that the rig accepts.

    shots: those that there are. timing: what was fitted to them, or to the first of them; None: gates are spread over
    all that they could show.
    """
    random = np.random.default_rng(len(shots))
    if timing is None or timing.lead < LEAST_LEAD:
        return _spread(rig, sight, len(shots))
    candidates = _candidates(rig, sight, timing, random)
    table = _predicted(sight, timing, candidates, _error_rows(shots))
    if not len(table.shot):
        return _spread(rig, sight, len(shots))
    normal = _known(shots, timing)
    gained = _information(table, len(candidates), timing)
    scale = np.sqrt(np.diag(normal))
    covariances = np.linalg.inv((normal + gained) / np.outer(scale, scale)) / np.outer(scale, scale)
    lacking = ((_errors(covariances, timing) / _wanted(goal)) ** 2).sum(axis=1)
    return candidates[int(lacking.argmin())]


def _spread(rig: Rig, sight: TargetSight, number: int) -> GateSettings:
    """A gate where nothing is known yet: line times, delays and exposures in turn, none like one before."""
    lines = sorted(_every_line(rig))
    period, height = rig.projector.period_us, rig.camera.lens.height
    line = lines[int(number * _GOLDEN % 1 * len(lines))]
    rows = sight.projector_row
    span = float(np.nanmax(rows) - np.nanmin(rows)) / rig.projector.rows_per_us if np.isfinite(rows).any() else period
    # Half of what passes over the picture: an edge then lies on it for as many delays as can be.
    exposure = min(0.5, max(0.1, abs(span - line * height) / period / 2)) * period
    delay = (number * _GOLDEN * _GOLDEN % 1 - 0.5) * period
    return quantise(rig.camera.shutter, gate(line, delay, exposure), period)


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
    sight: TargetSight, timing: GateTiming, candidates: Sequence[GateSettings], error_rows: float
) -> EdgeTable:
    """The edges that candidates would show, in scan order; `shot` is the candidate's number."""
    offset, excess, period = timing.values[2:]
    line, delay, exposure = np.array(
        [(one.line_time_us, one.delay_us, one.exposure_us) for one in candidates], np.float64
    ).T
    parts = [np.zeros((6, 0))]
    for line_us in np.unique(line):
        mine = np.flatnonzero(line == line_us)
        for track in _tracks(sight, timing, float(line_us)):
            room = np.minimum(exposure[mine], period - exposure[mine])
            for side in (-1.0, 1.0):
                due = delay[mine] + offset + side * (exposure[mine] + excess) / 2
                parts.extend(_meetings(track, due, period, room, side, mine))
    shot, row, projector_row, slope, across, rising = np.concatenate(parts, axis=1)
    owner = shot.astype(np.int32)
    errors = np.full(len(owner), error_rows)
    return EdgeTable(
        owner, row, projector_row, slope, across, rising > 0, errors, line[owner], delay[owner], exposure[owner]
    )


def _meetings(
    track: _Track, due: Doubles, period: float, room: Doubles, side: float, mine: Indices
) -> Iterator[Doubles]:
    """Where a strip's light comes at the instants `due` (C,), whole periods apart: columns of an `EdgeTable`, (6, n).

    `room`: to the gate's other edge, microseconds. What lies too near to it or to an end of the strip is not found.
    """
    up = bool(track.rate[0] > 0)
    phase, k = (track.phase, track.k) if up else (track.phase[::-1], track.k[::-1])
    first = np.ceil((due - phase[-1]) / period)
    for turn in range(int(np.ceil((phase[-1] - phase[0]) / period))):
        at = due - (first + turn) * period
        row = np.interp(at, phase, k)
        rate, projector_row, slope, across = (
            np.interp(row, track.k, one) for one in (track.rate, track.projector_row, track.slope, track.across)
        )
        ends = np.minimum(row - track.k[0], track.k[-1] - row)
        fit = (at >= phase[0]) & (ends >= _MARGIN_ROWS) & (room >= _MARGIN_ROWS * np.abs(rate))
        rising = np.full(len(mine), float((side < 0) == up))
        yield np.stack([mine, row, projector_row, slope, across, rising])[:, fit]


def _error_rows(shots: Sequence[Shot]) -> float:
    """The standard error of an edge's row, as of those that were found."""
    return float(np.median([edge.error_rows for shot in shots for edge in shot.edges] or [_ERROR_ROWS]))


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
