"""Whether the gates contradict the target that they were seen on: another size, or another place, fits them better.

A chart of another size stands at another distance for the camera, turned the same way. The projector rows that would
light it are off, by the same everywhere where it faces the rig: that looks like another delay offset, and nothing tells
it. Where it is turned about the vertical, edges no longer lie as one law has them; where it is tilted, the projector
would have to be lit for another share of the period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from slopegate.core.calibration.informative import LEAST_LEAD
from slopegate.core.calibration.law import Nominal, Shot, edge_table, equations, usable
from slopegate.core.calibration.normal import scaled_inverse
from slopegate.core.calibration.target import FlatTarget, rows_on
from slopegate.core.calibration.timing import MOST, OUTLIER, GateTiming, fit_timing
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.spread import robust_deviation

OTHER_SIZE: Final = 0.05
"""From which share on a target counts as one of another size."""
MUCH_BETTER: Final = 1.5
"""Factor by which edges have to miss the law by less on a target of another size."""
MOST_MISSED_ROWS: Final = 0.6
"""By which edges may then lie off the law: where it is more, no size explains them, and the rig file is wrong."""
LARGEST: Final = 4.0
"""Times as large, or as small, as a chart may be mistaken."""
ACTIVE_APART: Final = 0.2
"""Of the rig's active fraction, by how much the one that is found may differ from it."""
SURE: Final = 5.0
"""Standard errors by which it has to be beyond that."""
_STEPS: Final = 4
_MOST_STEP: Final = 2.5
"""Times the size, from one try to the next."""
_MOVED: Final = 0.01


@dataclass(frozen=True)
class ActiveRange:
    """Active fractions that are possible for a rig whose file has `believed`."""

    believed: float

    @property
    def least(self) -> float:
        """The smallest."""
        return (1 - ACTIVE_APART) * self.believed

    @property
    def most(self) -> float:
        """The largest: no projector is lit for longer than its period."""
        return min(1.0, (1 + ACTIVE_APART) * self.believed)

    def beyond(self, found: float, error: float) -> bool:
        """Whether what was found is surely none of them."""
        return max(self.least - found, found - self.most) > SURE * error


def better_size(shots: Sequence[Shot], rig: Rig, target: FlatTarget, timing: GateTiming) -> float | None:
    """How many times as large, and as far away, the target would have to be for the edges to follow one law.

    timing: what was fitted to these shots of it. None where the size that is believed does as well.
    """
    size, best, found = 1.0, timing, 1.0
    for _ in range(_STEPS):
        try:
            size *= _growth(_on(shots, rig, target, size), rig, _of_size(target, size), best)
            fit = fit_timing(_on(shots, rig, target, size), timing.nominal)
        except InputError:  # no law holds for a target of that size
            break
        if fit.lead < LEAST_LEAD or fit.edge_error_us >= best.edge_error_us:
            break
        best, found = fit, size
    other = abs(np.log(found)) > OTHER_SIZE and MUCH_BETTER * best.edge_error_us < timing.edge_error_us
    if not other or abs(np.log(found)) > np.log(LARGEST):
        return None
    table = edge_table(_on(shots, rig, target, found)).turned(timing.nominal, best.projector, best.camera)
    rate_us = float(np.median(np.abs(table.rate_us(best.values[0], best.stretch))))
    return found if best.edge_error_us < MOST_MISSED_ROWS * rate_us else None


def _of_size(target: FlatTarget, size: float) -> FlatTarget:
    x, y, one = (np.array(target.slopes) / size).tolist()
    return FlatTarget((x, y, one))


def _on(shots: Sequence[Shot], rig: Rig, target: FlatTarget, size: float) -> list[Shot]:
    """The shots, with the projector rows that light a target so many times as large."""
    if size == 1.0:
        return list(shots)
    other = _of_size(target, size)
    columns, rows = np.array([(edge.column, edge.row) for shot in shots for edge in shot.edges]).T
    here, above, below = (rows_on(rig, other, columns, rows + away)[0] for away in (0.0, -0.5, 0.5))
    lit = iter(zip(here.tolist(), (below - above).tolist(), strict=True))
    moved = []
    for shot in shots:
        edges = []
        for edge in shot.edges:
            row, slope = next(lit)
            edges.append(replace(edge, projector_row=row, slope=slope))
        moved.append(replace(shot, edges=tuple(edges)))
    return moved


def _growth(shots: Sequence[Shot], rig: Rig, target: FlatTarget, timing: GateTiming) -> float:
    """By what factor the target should grow, from the law's equations with its size as one more number."""
    table = edge_table(shots).turned(timing.nominal, timing.projector, timing.camera)
    columns, rows = np.array([(edge.column, edge.row) for shot in shots for edge in shot.edges]).T
    near, far = (rows_on(rig, _of_size(target, 1 + by), columns, rows)[0] for by in (-_MOVED, _MOVED))
    per_size = (far - near) / (2 * _MOVED) * (-1.0 if timing.projector == "up" else 1.0)
    left, right, errors = equations(table, timing.values)
    missed = right - left @ timing.values
    fit = usable(table, timing.values)
    spread = max(robust_deviation(missed[fit], about=0.0), float(np.quantile(np.abs(missed[fit]), MOST)))
    used = fit & (np.abs(missed) <= OUTLIER * spread)
    rise, scatter = timing.values[0] * per_size[used], np.hypot(errors[used], spread)
    more = _change(left[used], rise, missed[used], scatter, timing.nominal)
    return float(np.clip(1 + more, 1 / _MOST_STEP, _MOST_STEP))


def _change(left: Doubles, per_size: Doubles, missed: Doubles, errors: Doubles, nominal: Nominal) -> float:
    """What the size has to rise by, with nothing believed of it beforehand."""
    both = np.column_stack([left, per_size]) / errors[:, None]
    known = np.append(nominal.beliefs()[1], 0.0)
    return float((scaled_inverse(both.T @ both + np.diag(known)) @ both.T @ (missed / errors))[-1])
