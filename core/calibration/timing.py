"""When projector and camera scan, from gated pictures of a plane: a linear law of the gate's edges.

Model section 2: projector row r shines at r row_us + m period, camera row k is exposed from line k + delay - exposure/2
until as long after it. At an edge the two meet, so that each edge that is found in a picture is one linear equation:

    row_us r + m period = stretch line k + delay + offset -+ (exposure + excess) / 2 + jitter of the picture

with the line time, delay and exposure that were set. `stretch` scales all line times (a wrong number of clocks a line),
`offset` is what the real delay is longer than the one set, `excess` what the real exposure is. Both rows may count
against the scan: then r and k count from the other end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Literal

import numpy as np

from slopegate.core.calibration.edges import Edge
from slopegate.core.rig.arrays import Bools, Doubles, Ints
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings

Direction = Literal["down", "up"]

NAMES: Final = ("row_us", "stretch", "offset_us", "excess_us", "period_us")
FRACTIONS: Final = np.arange(0.60, 1.005, 0.01)
STRETCHES: Final = np.arange(0.95, 1.055, 0.01)
"""Active fractions and line times, as shares of those set, that are tried to begin with."""
BELIEVED: Final = (0.2, 0.05, 0.01)
"""Standard deviations of what is believed beforehand: of `row_us` as a share of it, of `stretch`, and of `excess` as a
share of the period."""
LEAST_RATE: Final = 0.1
"""Edges where projector and camera run along each other are left out: below this share of the projector's row time."""
OUTLIER: Final = 5.0
"""Edges further from the law than this many of their standard errors are left out, with their picture's others."""
LEAST_EDGES: Final = 12
ROUNDS: Final = 12
LEAST_SHARE: Final = 0.6
"""Of all edges, those that have to follow one law for it to be believed."""


@dataclass(frozen=True)
class Shot:
    """The edges of one picture, and the gate that was set for it."""

    settings: GateSettings
    edges: tuple[Edge, ...]


@dataclass(frozen=True)
class Nominal:
    """What is believed of the rig beforehand: the projector's rows and period, the camera's rows."""

    projector_rows: int
    camera_rows: int
    period_us: float
    period_error_us: float
    active_fraction: float = 0.92

    def beliefs(self) -> tuple[Doubles, Doubles]:
        """What is believed of `NAMES` and one over its variance, both (5,); nothing is of the offset."""
        row_us = self.active_fraction * self.period_us / self.projector_rows
        share, stretch, excess = BELIEVED
        wide = np.array([share * row_us, stretch, np.inf, excess * self.period_us, self.period_error_us])
        return np.array([row_us, 1.0, 0.0, 0.0, self.period_us]), wide**-2


@dataclass(frozen=True, eq=False)
class GateTiming:
    """The fitted law. `values` and `covariance` are of `NAMES`.

    A standard error is infinite where the pictures do not tell a number; `period_us` is then the nominal one.
    `left_out`: numbers of the shots that do not follow the law (triggers that were missed).
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


@dataclass(frozen=True, eq=False)
class _Table:
    """All edges as columns of numbers, (N,) each."""

    shot: Ints
    row: Doubles
    projector_row: Doubles
    slope: Doubles
    rising: Bools
    error_rows: Doubles
    line_us: Doubles
    delay_us: Doubles
    exposure_us: Doubles

    def turned(self, nominal: Nominal, projector: Direction, camera: Direction) -> _Table:
        """The same with rows that count along the scan."""
        one = self
        if projector == "up":
            one = replace(one, projector_row=nominal.projector_rows - one.projector_row, slope=-one.slope)
        if camera == "up":
            one = replace(one, row=nominal.camera_rows - one.row, slope=-one.slope, rising=~one.rising)
        return one

    def rate_us(self, row_us: float, stretch: float) -> Doubles:
        """How fast the phase row_us r - line k rises from one camera row to the next."""
        return row_us * self.slope - stretch * self.line_us

    def side(self, row_us: float, stretch: float) -> Doubles:
        """-1 for edges where the exposure begins, 1 where it ends."""
        return np.where(self.rising == (self.rate_us(row_us, stretch) > 0), -1.0, 1.0)


def fit_timing(shots: Sequence[Shot], nominal: Nominal) -> GateTiming:
    """Fit the law to the edges of gated pictures of a plane.

    Raises InputError where there are too few edges or no law of this kind holds for most of them.
    """
    table = _table(shots)
    if len(table.row) < LEAST_EDGES:
        raise InputError(
            f"number of edges that the gates show on the plane is {len(table.row)}: it must be at least {LEAST_EDGES}; "
            "take gates whose light begins or ends on the plane"
        )
    directions: tuple[Direction, Direction] = ("down", "up")
    tried = [_start(table.turned(nominal, p, c), nominal, p, c) for p in directions for c in directions]
    _, start, projector, camera = max(tried, key=lambda one: one[0])
    return _refine(table.turned(nominal, projector, camera), start, nominal, projector, camera)


def _table(shots: Sequence[Shot]) -> _Table:
    rows = [(number, shot.settings, edge) for number, shot in enumerate(shots) for edge in shot.edges]

    def column(values: list[float]) -> Doubles:
        return np.array(values, np.float64)

    return _Table(
        np.array([number for number, _, _ in rows], np.int32),
        column([edge.row for _, _, edge in rows]),
        column([edge.projector_row for _, _, edge in rows]),
        column([edge.slope for _, _, edge in rows]),
        np.array([edge.rising for _, _, edge in rows], np.bool_),
        column([edge.error_rows for _, _, edge in rows]),
        column([one.line_time_us for _, one, _ in rows]),
        column([one.delay_us for _, one, _ in rows]),
        column([one.exposure_us for _, one, _ in rows]),
    )


def _start(
    table: _Table, nominal: Nominal, projector: Direction, camera: Direction
) -> tuple[float, Doubles, Direction, Direction]:
    """The active fraction at which the offsets that single edges tell agree best, and how well: 1 is all of them."""
    best, found = -1.0, np.zeros(5)
    for fraction, stretch in product(FRACTIONS.tolist(), STRETCHES.tolist()):
        row_us = fraction * nominal.period_us / nominal.projector_rows
        late = row_us * table.projector_row - stretch * table.line_us * table.row - table.delay_us
        late = late - table.side(row_us, stretch) * table.exposure_us / 2
        mean = np.exp(2j * np.pi * late / nominal.period_us).mean()
        if abs(mean) > best:
            offset = float(np.angle(mean)) / (2 * np.pi) * nominal.period_us
            best, found = float(abs(mean)), np.array([row_us, stretch, offset, 0.0, nominal.period_us])
    return best, found, projector, camera


def _equations(table: _Table, values: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Linear equations left (N, 5) @ `NAMES` = right (N,), and the standard error of each, microseconds."""
    row_us, stretch, offset, excess, period = values
    side = table.side(row_us, stretch)
    known = table.delay_us + side * table.exposure_us / 2
    late = row_us * table.projector_row - stretch * table.line_us * table.row - known - offset - side * excess / 2
    turns = -np.round(late / period)
    left = np.stack([table.projector_row, -table.line_us * table.row, -np.ones_like(side), -side / 2, turns], axis=1)
    own = np.abs(table.rate_us(row_us, stretch)) * table.error_rows
    return left, known, np.hypot(own, _stairs_us(table, values, turns))


def _stairs_us(table: _Table, values: Doubles, turns: Doubles) -> Doubles:
    """What edges err because a camera row is exposed as one, (N,) microseconds.

    From row to row the gate moves by `rate`, within a row the light by row_us slope; overlap is the latter over the
    former. A step that is sampled in a grid after a box of that width is found off by the sum of
    sin(2 pi n u) sinc(n overlap) / (pi n) rows, at a place u between two rows: over all places a variance of 1/12
    without overlap, and of nothing where it is a whole number. The strips of one edge of the gate may all lie at the
    same place: the error counts as if they did, so that their mean has as much of it.
    """
    rate = np.abs(table.rate_us(values[0], values[1]))
    number = np.arange(1, 20)[:, None]
    waves = np.sinc(number * values[0] * np.abs(table.slope) / rate) / (np.pi * number)
    kinds = np.stack([table.shot, table.side(values[0], values[1]), turns])
    _, which, many = np.unique(kinds, axis=1, return_inverse=True, return_counts=True)
    return np.asarray(rate * np.sqrt((waves**2).sum(axis=0) / 2 * many[which.ravel()]), np.float64)


def _refine(table: _Table, values: Doubles, nominal: Nominal, projector: Direction, camera: Direction) -> GateTiming:
    """Solve the equations again and again, each time with the turns, weights and outliers that the last one tells.

    At first every edge counts alone, against the scatter of the better half, so that single pictures that follow
    another law (missed triggers) do not matter. Then pictures share their jitter, and edges weigh by their errors.
    """
    jitter, scale = 0.0, 1.0
    for number in range(ROUNDS):
        left, right, errors = _equations(table, values)
        missed = np.abs(right - left @ values)
        usable = np.abs(table.rate_us(values[0], values[1])) >= LEAST_RATE * values[0] * np.abs(table.slope)
        if not usable.any():
            break
        spread = 1.4826 * float(np.median(missed[usable]))
        early = number < ROUNDS // 2
        total = spread if early else np.maximum(spread, np.hypot(scale * errors, jitter))
        used = usable & (missed <= OUTLIER * total)
        own = np.hypot(errors, spread) if early else scale * errors
        weights = _Weights(table.shot[used], own[used] ** 2, 0.0 if early else jitter**2)
        values, covariance = _solve(left[used], right[used], weights, nominal)
        if number >= ROUNDS // 2 - 1:
            jitter, scale = _noise((right - left @ values)[used], table.shot[used], errors[used])
    share = float(used.sum() / max(1, usable.sum()))
    if used.sum() < LEAST_EDGES or share < LEAST_SHARE:
        raise InputError(
            f"only {int(used.sum())} of {len(used)} edges follow one timing: the plane moves, or its place in the rig "
            "file is wrong"
        )
    left_out = tuple(sorted({int(shot) for shot in table.shot[~used]} - {int(shot) for shot in table.shot[used]}))
    period = nominal.period_us
    values[2] = (values[2] + period / 2) % period - period / 2
    return GateTiming(
        values, covariance, projector, camera, jitter, scale * float(np.median(errors[used])), int(used.sum()),
        left_out, nominal,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Weights:
    """The inverse of the edges' covariance: independent variances, and one more that all edges of a shot share."""

    shot: Ints
    variances: Doubles
    shared: float

    def times(self, columns: Doubles) -> Doubles:
        """The inverse covariance times columns (N, n), after Sherman and Morrison shot by shot."""
        scaled = columns / self.variances[:, None]
        size = int(self.shot.max()) + 1
        sums = np.zeros((size, columns.shape[1]))
        np.add.at(sums, self.shot, scaled)
        whole = np.bincount(self.shot, 1 / self.variances, size)
        factor = self.shared / (1 + self.shared * whole)
        return scaled - (factor[:, None] * sums)[self.shot] / self.variances[:, None]


def _solve(left: Doubles, right: Doubles, weights: _Weights, nominal: Nominal) -> tuple[Doubles, Doubles]:
    """Generalised least squares, with what is believed of all numbers but the offset beforehand."""
    weighted = weights.times(left)
    normal, wanted = left.T @ weighted, weighted.T @ right
    believed, known = nominal.beliefs()
    normal += np.diag(known)
    wanted += known * believed
    scale = np.sqrt(np.diag(normal))
    inverse = np.linalg.inv(normal / np.outer(scale, scale))
    return inverse @ (wanted / scale) / scale, inverse / np.outer(scale, scale)


def _noise(missed: Doubles, shot: Ints, errors: Doubles) -> tuple[float, float]:
    """Standard deviation of the shots' own shift, and the factor on the edges' errors, from what the fit misses.

    Moments: edges of a shot scatter about their weighted mean by their own errors, the means by jitter beside. Errors
    that were stated too large stay: where they come from rows, edges of a shot do not show them.
    """
    weights = 1 / errors**2
    size = int(shot.max()) + 1
    whole = np.bincount(shot, weights, size)
    seen = whole > 0
    means = np.divide(np.bincount(shot, weights * missed, size), whole, out=np.zeros(size), where=seen)
    freedom = len(missed) - int(seen.sum())
    inner = float((weights * (missed - means[shot]) ** 2).sum()) / freedom if freedom > 0 else 1.0
    scale = max(1.0, float(np.sqrt(inner)))
    between = float((means[seen] ** 2).sum()) / max(1, int(seen.sum()) - 4)
    shared = between - float((scale**2 / whole[seen]).mean())
    return float(np.sqrt(max(shared, 0.0))), scale
