"""How well a fitted timing tells a rig's numbers: the pictures' errors, the geometry's, and what ties both together.

The law is fitted to projector rows that a calibrated geometry says light the target. Where that is wrong, the timing
follows: a microsecond is a twentieth of a projector row, which cannot be told from the projector's principal point. So
the timing's numbers err along with the geometry's, and a gate's distance, which needs both, errs less than either alone
would make it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.calibration.law import NAMES, Shot
from slopegate.core.calibration.target import FlatTarget, TargetOf, rows_on
from slopegate.core.calibration.timing import GateTiming
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import GEOMETRY, NUMBERS
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.rig.uncertainty import beside, numbers_of, with_numbers

_STEP: Final = 1e-5
"""1/m: by which a target's slopes are moved."""


@dataclass(frozen=True, eq=False)
class TimingErrors:
    """covariance (4, 4): of `TIMING`. by_geometry (4, 24): by how much each of them rises with each of `GEOMETRY`;
    the covariance holds the geometry's share already."""

    covariance: Doubles
    by_geometry: Doubles


def timing_covariance(
    timing: GateTiming, rig: Rig, shots: Sequence[Shot], targets: Sequence[TargetOf] = ()
) -> TimingErrors:
    """What `timing`, fitted to these shots of this rig (as it was before), tells of `TIMING`, and how well.

    targets: where each target stands, by the number that shots carry. None where the projector rows on it were decoded
    from patterns: they do not depend on the geometry then.
    """
    change = _to_numbers(timing, rig)
    by_geometry = np.zeros((len(NAMES), len(GEOMETRY)))
    covariance = timing.covariance.copy()
    if targets:
        by_geometry = _by_geometry(timing, rig, shots, targets)
        covariance += by_geometry @ geometry_covariance(rig) @ by_geometry.T
        for number, target in enumerate(targets):
            slopes = _by_slopes(timing, rig, shots, number, target(rig))
            covariance += slopes @ np.array(target(rig).covariance) @ slopes.T
    return TimingErrors(change @ covariance @ change.T, change @ by_geometry)


def geometry_covariance(rig: Rig) -> Doubles:
    """The covariance of `GEOMETRY` (24, 24), 0 for what the rig's calibration does not tell."""
    every = np.zeros((len(GEOMETRY), len(GEOMETRY)))
    known = rig.calibration
    if known is not None:
        mine = [place for place, name in enumerate(known.names) if name in GEOMETRY]
        to = [GEOMETRY.index(known.names[place]) for place in mine]
        every[np.ix_(to, to)] = known.array[np.ix_(mine, mine)]
    return every


def _to_numbers(timing: GateTiming, rig: Rig) -> Doubles:
    """Derivatives (4, 5) of `TIMING` by `NAMES`."""
    line, change = rig.camera.shutter.line, np.zeros((4, 5))
    change[0, 4] = 1.0
    change[1, 0] = timing.nominal.projector_rows / timing.period_us
    change[1, 4] = -timing.active_fraction / timing.period_us
    change[2, 1] = line.clocks_per_line if isinstance(line, PixelClocks) else 0.0
    change[3, 2] = -1.0
    return change


@dataclass(frozen=True, eq=False)
class _Places:
    """Where the edges of one target lie, (N,) each: columns and rows of the picture, and `pulls` (5, N)."""

    columns: Doubles
    rows: Doubles
    pulls: Doubles


def _places(timing: GateTiming, shots: Sequence[Shot], number: int) -> _Places:
    edges = [(shot.target, edge.column, edge.row) for shot in shots for edge in shot.edges]
    target, columns, rows = np.array(edges, np.float64).reshape(-1, 3).T
    mine = target == number
    # Light that comes from a later row comes later, unless rows count against the scan.
    per_row = timing.values[0] * (-1.0 if timing.projector == "up" else 1.0)
    return _Places(columns[mine], rows[mine], per_row * timing.pulls[:, mine])


def _by_geometry(timing: GateTiming, rig: Rig, shots: Sequence[Shot], targets: Sequence[TargetOf]) -> Doubles:
    """Derivatives (5, 24) of `NAMES`."""
    values, errors = numbers_of(rig), np.sqrt(np.diag(geometry_covariance(rig)))
    found = np.zeros((len(NAMES), len(GEOMETRY)))
    for number, target in enumerate(targets):
        at = _places(timing, shots, number)
        for column, name in enumerate(GEOMETRY):
            if errors[column] > 0:
                place = NUMBERS.index(name)
                ends, sides = beside(values, place, float(errors[column])), []
                for value in ends:
                    moved = values.copy()
                    moved[place] = value
                    other = with_numbers(rig, moved)
                    sides.append(rows_on(other, target(other), at.columns, at.rows)[0])
                found[:, column] += at.pulls @ ((sides[1] - sides[0]) / (ends[1] - ends[0]))
    return found


def _by_slopes(timing: GateTiming, rig: Rig, shots: Sequence[Shot], number: int, target: FlatTarget) -> Doubles:
    """Derivatives (5, 3) of `NAMES` by the slopes of one target."""
    at, sides = _places(timing, shots, number), []
    for step in _STEP * np.eye(3):
        ends = [
            rows_on(rig, FlatTarget(_vector(np.array(target.slopes) + sign * step)), at.columns, at.rows)[0]
            for sign in (1, -1)
        ]
        sides.append((ends[0] - ends[1]) / (2 * _STEP))
    return at.pulls @ np.stack(sides, axis=1)


def _vector(values: Doubles) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


@dataclass(frozen=True)
class PulseWidth:
    """How long the trigger's pulse lasts, microseconds, with its standard error; and the edge that the second timing's
    camera triggers on: "falling" where it is later by the pulse, "rising" where it is earlier."""

    width_us: float
    error_us: float
    second: str


def pulse_width(first: GateTiming, second: GateTiming) -> PulseWidth:
    """What two timings of one rig tell of its trigger's pulse: the same but for the edge that the camera triggers on.

    A pulse is shorter than half a period: the edge that comes later by less than that ends it. Geometry does not
    matter, for it shifts both offsets alike. Raises InputError where rows of the two do not scan alike.
    """
    if (first.projector, first.camera) != (second.projector, second.camera):
        raise InputError("the two timings are not of one rig: their rows are drawn or read in other directions")
    later = math.remainder(second.offset_us - first.offset_us, first.period_us)
    error = math.hypot(*(one.standard_errors[2] for one in (first, second)))
    return PulseWidth(abs(later), error, "falling" if later > 0 else "rising")
