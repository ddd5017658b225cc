"""When projector and camera scan, from gated pictures of a plane: the numbers of `law` by least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from slopegate.core.calibration.law import (
    Direction,
    EdgeTable,
    EdgeWeights,
    Nominal,
    Shot,
    edge_table,
    equations,
    usable,
)
from slopegate.core.calibration.normal import scaled_inverse
from slopegate.core.rig.arrays import Doubles, Ints
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.spread import robust_deviation

FRACTIONS: Final = np.arange(0.60, 1.005, 0.01)
STRETCHES: Final = np.arange(0.95, 1.055, 0.02)
"""Active fractions and line times, as shares of those set, that are tried to begin with."""
OUTLIER: Final = 5.0
"""Edges further from the law than this many of their standard errors are left out, with their picture's others."""
LEAST_EDGES: Final = 12
STARTING: Final = 200
"""Edges, out of all, that are enough to begin with."""
ROUNDS: Final = 6
MOST_DEVIATIONS: Final = 4.0
"""By how many standard deviations of what is believed beforehand a number may differ from it."""
LEAST_SPREAD_US: Final = 1.0
"""By which edges may miss the law before it counts against it."""
MOST: Final = 0.8
"""Of all edges, those by which directions are judged."""
NEARER: Final = 1.5
"""Times what farther rows change in fog, by how much the values may be off."""
MOST_SURPRISE: Final = 11.0
"""What noise alone makes of a sum of squares of five, at most, in 19 of 20 runs."""
FITTED: Final = 4
"""Numbers that shots have to tell: one of the five is known well beforehand."""
HALVINGS: Final = 30
"""Of the range in which jitter is sought."""
LEAST_SHARE: Final = 0.6
"""Of all edges, those that have to follow one law for it to be believed."""

_DIRECTIONS: Final[tuple[Direction, Direction]] = ("down", "up")


@dataclass(frozen=True, eq=False)
class GateTiming:
    """The fitted law. `values` and `covariance` are of `NAMES`.

    A standard error is infinite where the pictures do not tell a number; `period_us` is then the nominal one.
    `left_out`: numbers of the shots that do not follow the law (triggers that were missed). `lead`: by what factor the
    edges miss the law by less than with any other directions. `pulls` (5, N): by how much each of the
    values rises for every microsecond by which the light at an edge comes later, for all edges of all shots in turn.
    """

    values: Doubles
    covariance: Doubles
    projector: Direction
    camera: Direction
    jitter_us: float
    edge_error_us: float
    edges: int
    left_out: tuple[int, ...]
    nominal: Nominal
    lead: float
    pulls: Doubles

    @property
    def offset_us(self) -> float:
        """How much longer the real delay is than the one that was set."""
        return float(self.values[2])

    @property
    def stretch(self) -> float:
        """By what factor real line times are longer than those that were set."""
        return float(self.values[1])

    @property
    def period_us(self) -> float:
        """The projector's frame period."""
        return float(self.values[4])

    @property
    def active_fraction(self) -> float:
        """Share of the period in which rows are lit."""
        return float(self.nominal.projector_rows * self.values[0] / self.values[4])

    @property
    def standard_errors(self) -> Doubles:
        """Of `values`, (5,) float64."""
        return np.sqrt(np.diag(self.covariance))


def fit_timing(shots: Sequence[Shot], nominal: Nominal) -> GateTiming:
    """Fit the law to the edges of gated pictures of a plane.

    Raises InputError where there are too few edges or no law of this kind holds for most of them.
    """
    table = edge_table(shots)
    if len(table.row) < LEAST_EDGES:
        raise InputError(
            f"number of edges that the gates show on the plane is {len(table.row)}: it must be at least {LEAST_EDGES}; "
            "take gates whose light begins or ends on the plane"
        )
    few, ways = table.thinned(STARTING), [(p, c) for p in _DIRECTIONS for c in _DIRECTIONS]
    tried = []
    for projector, camera in ways:
        turned = few.turned(nominal, projector, camera)
        tried.append(_settle(turned, _start(turned, nominal), nominal))
    order = sorted(range(len(tried)), key=lambda number: tried[number][1])
    best, second = (tried[number] for number in order[:2])
    if not np.isfinite(best[1]):
        raise InputError(
            f"no timing fits the {len(table.row)} edges that the gates show: the plane moves, or its place in the rig "
            "file is wrong"
        )
    directions = ways[order[0]]
    return _refine(table.turned(nominal, *directions), best[0], nominal, directions, second[1] / best[1])


def _start(table: EdgeTable, nominal: Nominal) -> Doubles:
    """The numbers of the law at which the offsets that single edges tell agree best."""
    best, found = -1.0, np.zeros(5)
    for fraction, stretch in product(FRACTIONS.tolist(), STRETCHES.tolist()):
        row_us = fraction * nominal.period_us / nominal.projector_rows
        late = row_us * table.projector_row - stretch * table.line_us * table.row - table.delay_us
        late = late - table.side(row_us, stretch) * table.exposure_us / 2
        mean = np.exp(2j * np.pi * late / nominal.period_us).mean()
        if abs(mean) > best:
            offset = float(np.angle(mean)) / (2 * np.pi) * nominal.period_us
            best, found = float(abs(mean)), np.array([row_us, stretch, offset, 0.0, nominal.period_us])
    return found


def _settle(table: EdgeTable, values: Doubles, nominal: Nominal) -> tuple[Doubles, float]:
    """Solve the equations again and again, each time with the turns and outliers that the last one tells.

    Every edge counts alone, against the scatter of the better half, so that single pictures that follow another law
    (missed triggers) do not matter. The values, and by how much most edges miss them at most, microseconds.
    """
    for _ in range(ROUNDS):
        left, right, errors = equations(table, values)
        missed = np.abs(right - left @ values)
        fit = usable(table, values)
        if not fit.any():
            return values, np.inf
        spread = max(robust_deviation(missed[fit], about=0.0), LEAST_SPREAD_US)
        used = fit & (missed <= OUTLIER * spread)
        weights = EdgeWeights(table.shot[used], errors[used] ** 2 + spread**2, 0.0)
        values = _solve(left[used], right[used], weights, nominal)[0]
        if not _believable(values, nominal):
            return values, np.inf
    left, right, _ = equations(table, values)
    missed = np.abs(right - left @ values)[usable(table, values)]
    return values, max(float(np.quantile(missed, MOST)), LEAST_SPREAD_US) if len(missed) else np.inf


def _believable(values: Doubles, nominal: Nominal) -> bool:
    """Whether row and line time are near what is believed beforehand: far off lie laws of other directions."""
    believed, known = nominal.beliefs()
    return bool((np.abs(values - believed) * np.sqrt(known) <= MOST_DEVIATIONS)[:2].all())


def _refine(
    table: EdgeTable, values: Doubles, nominal: Nominal, directions: tuple[Direction, Direction], lead: float
) -> GateTiming:
    """The same with all edges: pictures share their jitter, and edges weigh by their errors."""
    jitter, scale, spread = 0.0, 1.0, np.inf
    for number in range(ROUNDS):
        left, right, errors = equations(table, values)
        missed = np.abs(right - left @ values)
        fit = usable(table, values)
        if number == 0 and fit.any():
            spread = max(robust_deviation(missed[fit], about=0.0), LEAST_SPREAD_US)
        used = fit & (missed <= OUTLIER * np.maximum(spread if number < 2 else 0.0, np.hypot(scale * errors, jitter)))
        if not used.any():
            break
        weights = EdgeWeights(table.shot[used], (scale * errors[used]) ** 2, jitter**2)
        values, covariance, gain = _solve(left[used], right[used], weights, nominal)
        jitter, scale = shot_noise((right - left @ values)[used], table.shot[used], errors[used])
    share = float(used.sum() / max(1, fit.sum()))
    if used.sum() < LEAST_EDGES or share < LEAST_SHARE:
        raise InputError(
            f"only {int(used.sum())} of {len(used)} edges follow one timing: the plane moves, or its place in the rig "
            "file is wrong"
        )
    if not _believable(values, nominal):
        raise InputError(
            f"with it, rows would be lit for {nominal.projector_rows * values[0] / values[4]:.3g} of the period, where "
            f"the rig file has {nominal.active_fraction:.3g}, and line times would be {values[1]:.3g} times those set: "
            "the plane moves, or its place in the rig file is wrong"
        )
    left_out = tuple(sorted({int(shot) for shot in table.shot[~used]} - {int(shot) for shot in table.shot[used]}))
    period = nominal.period_us
    values[2] = (values[2] + period / 2) % period - period / 2
    pulls = np.zeros((len(values), len(used)))
    pulls[:, used] = -gain
    late = table.rate_us(values[0], values[1]) * table.bent_rows
    covariance += _bent(pulls * np.where(used, late, 0.0), table.shot)
    return GateTiming(
        values, covariance, *directions, jitter, scale * float(np.median(errors[used])), int(used.sum()),
        left_out, nominal, lead, pulls,
    )  # fmt: skip


def _bent(changes: Doubles, shot: Ints) -> Doubles:
    """The share in the covariance (5, 5) of light that bends beside edges, as fog's does, from what every edge changes
    the values by (5, N) when rows farther away have a say.

    That grows with the rows' distance and is alike in all shots: no number of gates makes it smaller. What the shots'
    noise alone would change is none of it.
    """
    of_shots: Doubles = np.stack([np.bincount(shot, one) for one in changes], axis=1)
    whole, noise = of_shots.sum(axis=0), of_shots.T @ of_shots
    if not np.diag(noise).all():
        return np.zeros_like(noise)
    surprise = float(whole @ scaled_inverse(noise) @ whole)
    share = max(0.0, 1 - MOST_SURPRISE / surprise)
    return np.asarray(share * NEARER**2 * np.outer(whole, whole), np.float64)


def _solve(left: Doubles, right: Doubles, weights: EdgeWeights, nominal: Nominal) -> tuple[Doubles, Doubles, Doubles]:
    """Generalised least squares, with what is believed of all numbers but the offset beforehand.

    The values (5,), their covariance (5, 5), and by how much each rises with each of `right` (5, N).
    """
    weighted = weights.times(left)
    normal, wanted = left.T @ weighted, weighted.T @ right
    believed, known = nominal.beliefs()
    normal += np.diag(known)
    wanted += known * believed
    scale = np.sqrt(np.diag(normal))
    inverse = np.linalg.inv(normal / np.outer(scale, scale))
    covariance = inverse / np.outer(scale, scale)
    return inverse @ (wanted / scale) / scale, covariance, covariance @ weighted.T


def shot_noise(missed: Doubles, shot: Ints, errors: Doubles) -> tuple[float, float]:
    """Standard deviation of the shots' own shift, and the factor on the edges' errors, from what the fit misses.

    Edges of a shot scatter about their weighted mean by their own errors, the means by jitter beside. It is sought by
    the likelihood's slope (restricted, with the fitted numbers spread over the shots by their weights), in which shots
    that tell little count little: by plain moments a few of them would hide the jitter of all others. Errors that were
    stated too large stay: where they come from rows, edges of a shot do not show them.
    """
    weights = 1 / errors**2
    size = int(shot.max()) + 1
    whole = np.bincount(shot, weights, size)
    seen = whole > 0
    means = np.divide(np.bincount(shot, weights * missed, size), whole, out=np.zeros(size), where=seen)
    freedom = len(missed) - int(seen.sum())
    inner = float((weights * (missed - means[shot]) ** 2).sum()) / freedom if freedom > 0 else 1.0
    scale = max(1.0, float(np.sqrt(inner)))
    squares, own = means[seen] ** 2, scale**2 / whole[seen]
    low, high = 0.0, float(squares.sum())
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        weight = 1 / (middle + own)
        typical = float((weight**2).sum() / weight.sum())
        expected = max(float(weight.sum()) - FITTED * typical, typical)
        low, high = (middle, high) if float((weight**2 * squares).sum()) > expected else (low, middle)
    return float(np.sqrt(low)), scale
