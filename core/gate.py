"""From settings to what each camera row records (model sections 2 and 3; equations 7-10 of the paper).

A surface point lit by projector row coordinate r_p shines at t = r_p / v_p + m T for every integer m. Camera row k is
exposed during delay + (k + 1/2) line_time -+ exposure / 2. So a point is recorded once for every m whose instant lies
in that window, and the test needs nothing but r_p and the row, whatever the rig: the geometry sits in r_p.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from slopegate.core.axis import axis_point, solve_axis, time_on_axis
from slopegate.core.checks import require
from slopegate.core.rig import Rig, Vector3
from slopegate.core.settings import CentreDelayUs, GateSettings

Floats = NDArray[np.float64]

PARALLEL = 1e-9
"""|B - 1| below which the planes count as parallel and the hinge (1e8 m away and more) as absent."""

TICKS_PER_US = 2.0**30
"""Window edges are whole ticks of about a femtosecond, so that a gate and its complement, or two slices that meet,
share their edges to the last bit. An edge moves by at most half a tick: 5e-10 us, 2.2e-11 rows of the check rig."""


@dataclass(frozen=True, eq=False)
class RowWindows:
    """What each camera row records, by projector row coordinate; arrays of one value per camera row.

    A point at low <= r_p < high (float64) is recorded `inside` times (int32), any other lit point `outside` times.
    Wrap round the frame, blanking and exposures beyond one period are all in these four numbers.
    """

    low: Floats
    high: Floats
    inside: NDArray[np.int32]
    outside: NDArray[np.int32]


def row_windows(rig: Rig, settings: GateSettings) -> RowWindows:
    """The window of every camera row, *continuous* level of detail (model section 2), any rig.

    Edges are exact to half a tick (`TICKS_PER_US`) plus one float64 rounding, for |delay| and exposure below 1e6 us.
    """
    rows = np.arange(rig.camera.lens.height) + 0.5
    period = _ticks(rig.projector.period_us / 2) * 2
    offset = _ticks(rows * settings.line_time_us) + _ticks(settings.delay_us)
    half = _ticks(settings.exposure_us / 2)
    start, end = np.mod(offset - half, period), np.mod(offset + half, period)
    gap = end < start
    whole = (2 * half - (end - start)) // period - gap
    scale = rig.projector.rows_per_us / TICKS_PER_US
    return RowWindows(
        low=np.where(gap, end, start) * scale,
        high=np.where(gap, start, end) * scale,
        inside=np.where(gap, whole, whole + 1).astype(np.int32),
        outside=np.where(gap, whole + 1, whole).astype(np.int32),
    )


def _ticks(time_us: ArrayLike) -> NDArray[np.int64]:
    return np.rint(np.asarray(time_us, np.float64) * TICKS_PER_US).astype(np.int64)


def weights(windows: RowWindows, projector_rows: ArrayLike) -> NDArray[np.int32]:
    """How often light of these projector rows, (N_c,) or (N_c, W), is recorded by each camera row; same shape.

    Negative rows stand for points that the projector does not light and weigh nothing.
    """
    rows = np.asarray(projector_rows)
    column = (slice(None),) + (None,) * (rows.ndim - 1)
    hit = (rows >= windows.low[column]) & (rows < windows.high[column])
    counts = np.where(hit, windows.inside[column], windows.outside[column])
    return np.where(rows < 0, 0, counts).astype(np.int32)


def discrete_weights(rig: Rig, settings: GateSettings, camera_rows: ArrayLike, projector_rows: ArrayLike) -> Floats:
    """Weight of whole projector rows j, all of whose points are lit during [j, j + 1) / v_p (broadcast, float64).

    The *discrete rows* level of detail: the overlap with the window of camera row k (a whole number) in row times,
    a trapezoid in j. It differs from `weights` by at most one row at each edge.
    """
    speed, period = rig.projector.rows_per_us, rig.projector.period_us
    centre = settings.delay_us + (np.asarray(camera_rows, np.float64) + 0.5) * settings.line_time_us
    lit_from = np.asarray(projector_rows, np.float64) / speed

    def lit_until(time_us: Floats) -> Floats:
        phase = (time_us - lit_from) / period
        whole = np.floor(phase)
        return whole + np.minimum((phase - whole) * period * speed, 1.0)

    return lit_until(centre + settings.exposure_us / 2) - lit_until(centre - settings.exposure_us / 2)


def complement(settings: GateSettings, period_us: float) -> GateSettings:
    """The gate that records what this one does not: together every point counts ceil(exposure / T) times.

    Raises ValueError when the exposure is a whole number of periods (to 1e-6 us), since nothing is left to record.
    """
    period = 2 * np.rint(period_us / 2 * TICKS_PER_US) / TICKS_PER_US  # the period that `row_windows` counts in
    periods = math.ceil(round(settings.exposure_us / period, 10))
    rest = float(periods * period - settings.exposure_us)
    require(
        rest > 1e-6,
        "exposure_us",
        settings.exposure_us,
        f"other than a whole number of projector periods ({period_us:g} us) for a complement to exist",
    )
    delay = settings.delay_us + periods * period / 2
    if delay > period:
        delay -= period
    return GateSettings(settings.line_time_us, CentreDelayUs(float(delay)), rest)


@dataclass(frozen=True)
class Plane:
    """A z + (B - 1) y = b (B + 1) / 2, in world coordinates; as `normal` . X = `offset_m` with a unit normal.

    `A` passes through 0 where the plane recedes to infinity. For a rig that is not ideal it is the tangent plane of the
    gate's edge on the axis x = y = 0, scaled alike. The plane at infinity itself has normal (0, 0, 1) and an infinite
    offset.
    """

    A: float
    normal: Vector3
    offset_m: float


@dataclass(frozen=True)
class Slab:
    """The gate as a slab of space, read on the axis x = y = 0; None where a surface is not in front of the rig."""

    line_time_us: float
    B: float
    tilt_deg: float
    distance_m: float | None
    near_m: float | None
    far_m: float | None
    thickness_m: float | None
    hinge_y_m: float | None
    near: Plane
    centre: Plane
    far: Plane
    windows_us: tuple[tuple[float, float], ...]
    frame: int
    """The projector frame whose light this is: `inverse_depth_bounds` of this frame bounds the same slab."""
    warnings: tuple[str, ...]


def slab(rig: Rig, settings: GateSettings) -> Slab:
    """Read-outs of a gate. Of its copies one period apart it describes the one that covers most of the axis.

    Closed form for the ideal rig; for others the point on the axis is solved to float64 rounding (`core.axis`).
    """
    frame = _frame(rig, settings)
    centre_us, half = settings.delay_us - frame * rig.projector.period_us, settings.exposure_us / 2
    points = [solve_axis(rig, settings.line_time_us, time) for time in (centre_us - half, centre_us, centre_us + half)]
    far, centre, near = sorted(points, key=lambda point: point.w)
    far_m, distance_m, near_m = (1 / point.w if point.w > 0 else None for point in (far, centre, near))
    flat = abs(centre.slope) < PARALLEL
    return Slab(
        line_time_us=settings.line_time_us,
        B=slope_ratio(rig, settings.line_time_us),
        tilt_deg=centre.tilt_deg,
        distance_m=distance_m,
        near_m=near_m,
        far_m=far_m,
        thickness_m=None if near_m is None or far_m is None else far_m - near_m,
        hinge_y_m=None if flat else centre.K / centre.slope,
        near=Plane(near.A, near.normal, near.offset_m),
        centre=Plane(centre.A, centre.normal, centre.offset_m),
        far=Plane(far.A, far.normal, far.offset_m),
        windows_us=_windows_us(settings, rig.projector.period_us),
        frame=frame,
        warnings=tuple(_warnings(rig, settings, near_m, far_m)),
    )


def slope_ratio(rig: Rig, line_time_us: float) -> float:
    """B = (v_p / v_c) (f_c / f_p): how many projector rows pass per camera row, in normalised rows."""
    return rig.projector.rows_per_us * line_time_us * rig.camera.lens.fy / rig.projector.lens.fy


def _frame(rig: Rig, settings: GateSettings) -> int:
    """The projector frame whose light fills most of the axis in front of the rig; the nearest one where none does."""
    period, lens = rig.projector.period_us, rig.projector.lens
    nearest_w = 2 * max(lens.height - lens.cy, 1.0) / (lens.fy * rig.baseline_m)
    infinity = time_on_axis(rig, settings.line_time_us, 0.0)
    point = axis_point(rig, settings.line_time_us, 0.0)
    ends = sorted((infinity, infinity + nearest_w * point.K * lens.fy / rig.projector.rows_per_us))
    start, end = (settings.delay_us + sign * settings.exposure_us / 2 for sign in (-1, 1))
    first, last = math.floor((start - ends[1]) / period), math.ceil((end - ends[0]) / period)

    def merit(frame: int) -> tuple[float, int]:
        overlap = min(end - frame * period, ends[1]) - max(start - frame * period, ends[0])
        return overlap, -abs(frame)

    return max(range(first, last + 1), key=merit)


def _windows_us(settings: GateSettings, period_us: float) -> tuple[tuple[float, float], ...]:
    """The exposure of row coordinate 0 modulo the period: whole periods first, then what is left, split at the wrap."""
    whole, rest = divmod(settings.exposure_us, period_us)
    windows = [(0.0, period_us)] * int(whole)
    start = (settings.delay_us - settings.exposure_us / 2) % period_us
    if rest and start + rest <= period_us:
        windows.append((start, start + rest))
    elif rest:
        windows += [(0.0, start + rest - period_us), (start, period_us)]
    return tuple(windows)


def _warnings(rig: Rig, settings: GateSettings, near_m: float | None, far_m: float | None) -> list[str]:
    period, row_us = rig.projector.period_us, 1 / rig.projector.rows_per_us
    found = []
    if near_m is None:
        found.append("straight ahead the whole slab lies beyond infinity: distance, near and far have no finite value")
    elif far_m is None:
        found.append("the slab reaches to infinity: far and thickness have no finite value")
    if settings.exposure_us > period:
        times = int(settings.exposure_us // period)
        often = "once or more" if times == 1 else f"{times} times or more"
        found.append(f"the exposure is longer than the projector's period ({period:g} us): all light counts {often}")
    if settings.exposure_us < row_us:
        found.append(f"the exposure is shorter than one projector row ({row_us:.1f} us)")
    windows = row_windows(rig, settings)
    dark = (windows.low >= rig.projector.lens.height) & (windows.outside == 0)
    if 2 * dark.sum() >= dark.size:
        found.append(f"{int(dark.sum())} of {dark.size} camera rows are exposed in the projector's blanking only")
    return found
