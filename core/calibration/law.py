"""The law of a gate's edges: one linear equation for each edge that is found in a picture.

Model section 2: projector row r shines at r row_us + m period, camera row k is exposed from line k + delay - exposure/2
until as long after it. At an edge the two meet:

    row_us r + m period = stretch line k + delay + offset -+ (exposure + excess) / 2 + jitter of the picture

with the line time, delay and exposure that were set. `stretch` scales all line times (a wrong number of clocks a line),
`offset` is what the real delay is longer than the one set, `excess` what the real exposure is. Both rows may count
against the scan: then r and k count from the other end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, Literal

import numpy as np

from slopegate.core.calibration.edges import Edge
from slopegate.core.rig.arrays import Bools, Doubles, Ints
from slopegate.core.rig.settings import GateSettings

Direction = Literal["down", "up"]

NAMES: Final = ("row_us", "stretch", "offset_us", "excess_us", "period_us")
"""The numbers of the law."""
BELIEVED: Final = (0.2, 0.05, 0.01)
"""Standard deviations of what is believed beforehand: of `row_us` as a share of it, of `stretch`, and of `excess` as a
share of the period."""
PLACED: Final = 0.02
"""Rows by which all strips of an edge may be found off alike, and as much for each row that the edge is soft."""
LEAST_RATE: Final = 0.1
"""Edges where projector and camera run along each other are left out: below this share of the projector's row time."""


@dataclass(frozen=True)
class Shot:
    """The edges of one picture, the gate that was set for it, and the number of the target that it was taken of."""

    settings: GateSettings
    edges: tuple[Edge, ...]
    target: int = 0


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
class EdgeTable:
    """All edges as columns of numbers, (N,) each."""

    shot: Ints
    row: Doubles
    projector_row: Doubles
    slope: Doubles
    across: Doubles
    rising: Bools
    error_rows: Doubles
    soft_rows: Doubles
    line_us: Doubles
    delay_us: Doubles
    exposure_us: Doubles
    bent_rows: Doubles

    def turned(self, nominal: Nominal, projector: Direction, camera: Direction) -> EdgeTable:
        """The same with rows that count along the scan."""
        one = self
        if projector == "up":
            one = replace(one, projector_row=nominal.projector_rows - one.projector_row, slope=-one.slope)
        if camera == "up":
            one = replace(
                one, row=nominal.camera_rows - one.row, slope=-one.slope, rising=~one.rising, bent_rows=-one.bent_rows
            )
        return one

    def thinned(self, most: int) -> EdgeTable:
        """Every so many of the edges, so that at most `most` are left."""
        some = slice(None, None, -(-len(self.row) // most))
        return EdgeTable(*(getattr(self, field.name)[some] for field in fields(self)))

    def rate_us(self, row_us: float, stretch: float) -> Doubles:
        """How fast the phase row_us r - line k rises from one camera row to the next."""
        return row_us * self.slope - stretch * self.line_us

    def side(self, row_us: float, stretch: float) -> Doubles:
        """-1 for edges where the exposure begins, 1 where it ends."""
        return np.where(self.rising == (self.rate_us(row_us, stretch) > 0), -1.0, 1.0)


def edge_table(shots: Sequence[Shot]) -> EdgeTable:
    """All edges of all shots in turn."""
    rows = [(number, shot.settings, edge) for number, shot in enumerate(shots) for edge in shot.edges]

    def column(values: list[float]) -> Doubles:
        return np.array(values, np.float64)

    return EdgeTable(
        np.array([number for number, _, _ in rows], np.int32),
        column([edge.row for _, _, edge in rows]),
        column([edge.projector_row for _, _, edge in rows]),
        column([edge.slope for _, _, edge in rows]),
        column([edge.across for _, _, edge in rows]),
        np.array([edge.rising for _, _, edge in rows], np.bool_),
        column([edge.error_rows for _, _, edge in rows]),
        column([edge.soft_rows for _, _, edge in rows]),
        column([one.line_time_us for _, one, _ in rows]),
        column([one.delay_us for _, one, _ in rows]),
        column([one.exposure_us for _, one, _ in rows]),
        column([edge.bent_rows for _, _, edge in rows]),
    )


def equations(table: EdgeTable, values: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Linear equations left (N, 5) @ `NAMES` = right (N,), and the standard error of each, microseconds."""
    row_us, stretch, offset, excess, period = values
    side = table.side(row_us, stretch)
    known = table.delay_us + side * table.exposure_us / 2
    late = row_us * table.projector_row - stretch * table.line_us * table.row - known - offset - side * excess / 2
    turns = -np.round(late / period)
    left = np.stack([table.projector_row, -table.line_us * table.row, -np.ones_like(side), -side / 2, turns], axis=1)
    own = np.abs(table.rate_us(row_us, stretch)) * table.error_rows
    return left, known, np.hypot(own, _stairs_us(table, values, turns))


def usable(table: EdgeTable, values: Doubles) -> Bools:
    """Which edges (N,) are those of a gate that moves over the rows, not along with them."""
    moved: Bools = np.abs(table.rate_us(values[0], values[1])) >= LEAST_RATE * values[0] * np.abs(table.slope)
    return moved


def _stairs_us(table: EdgeTable, values: Doubles, turns: Doubles) -> Doubles:
    """What edges err because a camera row is exposed as one, (N,) microseconds.

    From row to row the gate moves by `rate`. A step that is sampled in a grid is found off by the sum of
    sin(2 pi n u) / (pi n) rows, at a place u between two rows: over all places a variance of 1/12, and less where the
    step is soft. Columns that see other projector rows have other places: over a range of m steps a wave keeps at most
    1 / (pi n m) of itself. What the strips of one edge of the gate do not even out between them they share: it counts
    as often as there are strips.
    """
    rate = np.abs(table.rate_us(values[0], values[1]))
    side, turn = table.side(values[0], values[1]) > 0, (turns - turns.min(initial=0)).astype(np.int64)
    kinds = (table.shot * (turn.max(initial=0) + 1) + turn) * 2 + side
    _, which, counts = np.unique(kinds, return_inverse=True, return_counts=True)
    many = counts[which]
    steps = values[0] * table.across / rate
    # Light is smeared by the same time on all edges: one alone shows it by chance only.
    soft = float(np.median(table.soft_rows * rate)) / rate
    alone, together = _wave_variance(steps, soft), _wave_variance(steps * many, soft)
    together += (PLACED * (1 + soft)) ** 2
    return np.asarray(rate * np.sqrt(np.maximum(alone, many * together)), np.float64)


def _wave_variance(steps: Doubles, soft: Doubles) -> Doubles:
    """Variance of a sampled step's place, rows squared, where its columns range over so many rows (N,) and a Gaussian
    of so many makes it soft (N,)."""
    number = np.arange(1, 20)[:, None]
    kept = np.minimum(1.0, 1 / np.maximum(np.pi * number * steps, 1e-9)) * np.exp(-2 * (np.pi * number * soft) ** 2)
    return np.asarray(((kept / (np.pi * number)) ** 2).sum(axis=0) / 2, np.float64)


@dataclass(frozen=True, eq=False)
class EdgeWeights:
    """The inverse of the edges' covariance: independent variances, and one more that all edges of a shot share."""

    shot: Ints
    variances: Doubles
    shared: float

    def times(self, columns: Doubles) -> Doubles:
        """The inverse covariance times columns (N, n), after Sherman and Morrison shot by shot."""
        scaled = columns / self.variances[:, None]
        size = int(self.shot.max(initial=-1)) + 1
        sums = np.zeros((size, columns.shape[1]))
        np.add.at(sums, self.shot, scaled)
        whole = np.bincount(self.shot, 1 / self.variances, size)
        factor = self.shared / (1 + self.shared * whole)
        return scaled - (factor[:, None] * sums)[self.shot] / self.variances[:, None]
