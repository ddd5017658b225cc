"""Figures of one run: a row for every way and scene, and what they come to over all scenes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

HALF_COUNT: Final = 0.5
"""A setting is good enough when its rounding costs less than this: a camera cannot tell it from the exact one."""


@dataclass(frozen=True)
class GateError:
    """Against the exact gate of the same rays, over all gates of a scene.

    max_counts and rms_counts as measured; wrong_pixels: how many fell on the wrong side of an edge (off by more than a
    count); level_counts: the most that any other pixel is off; edge_rows: how far edges lie from the exact ones,
    maximum and root mean square, in camera rows.

    edge_counts: what that costs a pixel of full scale. An edge that lies d rows off takes the share d of a pixel's
    light; where a pixel is one ray it shows as a whole pixel on the wrong side, with probability d. Either way the
    error is d times full scale on average over where edges fall, and that is what the choice of a default rests on:
    single pixels on the wrong side rule the measured maximum and root mean square of every finite number type.
    """

    max_counts: float
    rms_counts: float
    wrong_pixels: int
    level_counts: float
    edge_rows_max: float
    edge_rows_rms: float
    edge_counts: float

    @property
    def counts(self) -> float:
        """The largest error of a pixel, on average over where edges fall."""
        return self.edge_counts + self.level_counts


@dataclass(frozen=True)
class AreaError:
    """Against the mean over each pixel's area: counts, and the same as a share of the pixel's light, in camera rows.

    A pixel is one row tall, so an edge that lies d rows off takes the share d of its light. Pixels of fewer than 100
    counts are left out of the rows.
    """

    max_counts: float
    rms_counts: float
    max_rows: float
    rms_rows: float


@dataclass(frozen=True)
class Cost:
    """Milliseconds a frame: median by the wall's clock, and of the cores' with quartiles.

    share: of a frame's work that was really run, the rest being equal to it. ratio: core time as a multiple of that of
    copying the frame; quiet_ratio likewise of the quietest runs.
    """

    wall_ms: float
    core_ms: float
    low_ms: float
    high_ms: float
    repeats: int
    share: float
    ratio: float
    quiet_ratio: float
    core_ms_per_mpixel: float


@dataclass(frozen=True)
class Row:
    """One way on one scene. cost is None in a run without clocks; memory_mb: kept arrays and the peak of a frame."""

    scene: str
    group: str
    name: str
    default: bool
    width: int
    height: int
    cost: Cost | None
    gate: GateError | None
    area: AreaError | None
    memory_mb: float


@dataclass(frozen=True)
class WaySummary:
    """One way over all scenes: geometric means of cost, worst rounding, root mean square of errors and most memory."""

    group: str
    name: str
    default: bool
    scenes: int
    core_ms_per_mpixel: float
    fastest: float
    slowest: float
    ratio: float
    gate_counts: float | None
    gate_rms_counts: float | None
    gate_max_counts: float | None
    edge_rows: float | None
    area_rms_counts: float | None
    area_max_counts: float | None
    area_rms_rows: float | None
    memory_mb: float


def summarise(rows: Sequence[Row]) -> list[WaySummary]:
    """One summary for all rows of a name, in the order of their first appearance. All must have a cost."""
    names = list(dict.fromkeys((row.group, row.name) for row in rows))
    return [_summary([row for row in rows if (row.group, row.name) == name]) for name in names]


def _summary(rows: Sequence[Row]) -> WaySummary:
    costs = [row.cost for row in rows if row.cost is not None]
    gates = [row.gate for row in rows if row.gate is not None]
    areas = [row.area for row in rows if row.area is not None]
    per_pixel = [cost.core_ms_per_mpixel for cost in costs]
    first = rows[0]
    return WaySummary(
        group=first.group,
        name=first.name,
        default=first.default,
        scenes=len(rows),
        core_ms_per_mpixel=geometric_mean(per_pixel),
        fastest=min(per_pixel),
        slowest=max(per_pixel),
        ratio=geometric_mean([cost.ratio for cost in costs]),
        gate_counts=_most(error.counts for error in gates),
        gate_rms_counts=_root_mean_square([error.rms_counts for error in gates]),
        gate_max_counts=_most(error.max_counts for error in gates),
        edge_rows=_most(error.edge_rows_max for error in gates),
        area_rms_counts=_root_mean_square([error.rms_counts for error in areas]),
        area_max_counts=_most(error.max_counts for error in areas),
        area_rms_rows=_root_mean_square([error.rms_rows for error in areas]),
        memory_mb=max(row.memory_mb for row in rows),
    )


def geometric_mean(values: Sequence[float]) -> float:
    """The geometric mean of numbers above 0."""
    return math.exp(sum(map(math.log, values)) / len(values))


def _root_mean_square(values: Sequence[float]) -> float | None:
    return math.sqrt(sum(value**2 for value in values) / len(values)) if values else None


def _most(values: Iterable[float]) -> float | None:
    return max(values, default=None)


def pareto(points: Sequence[tuple[float, float]]) -> list[bool]:
    """For each (cost, error): whether no other is at most as large in both and smaller in one."""
    return [
        not any(other[0] <= point[0] and other[1] <= point[1] and other != point for other in points)
        for point in points
    ]


@dataclass(frozen=True)
class Verdict:
    """What the run says about the default. The cheapest is the one of least cost whose rounding is below half a count,
    among those that cache what the camera sees."""

    default: str
    cheapest: str
    default_counts: float
    row_by_row_counts: float | None
    row_by_row_times: float | None
    on_gate_front: bool
    on_area_front: bool


def judge(summaries: Sequence[WaySummary]) -> Verdict:
    """The cheapest way that rounds well enough, and whether the default lies on both Pareto fronts."""
    default = next(item for item in summaries if item.default)
    rounded = [item for item in summaries if item.gate_counts is not None]
    good = [item for item in rounded if item.gate_counts is not None and item.gate_counts < HALF_COUNT]
    slow = next((item for item in summaries if item.name == "row by row"), None)
    return Verdict(
        default=default.name,
        cheapest=min(good, key=lambda item: item.core_ms_per_mpixel).name,
        default_counts=default.gate_counts or 0.0,
        row_by_row_counts=slow.gate_counts if slow else None,
        row_by_row_times=slow.core_ms_per_mpixel / default.core_ms_per_mpixel if slow else None,
        on_gate_front=_on_front(rounded, default, "gate_counts"),
        on_area_front=_on_front([item for item in summaries if item.area_rms_counts], default, "area_rms_counts"),
    )


def _on_front(among: Sequence[WaySummary], default: WaySummary, error: str) -> bool:
    points = [(item.core_ms_per_mpixel, float(getattr(item, error))) for item in among]
    return pareto(points)[list(among).index(default)]
