"""What a gate records: the window of each camera row, and the slab of space that the windows make.

Model sections 2 and 3; equations 7-10 of the paper. A surface point lit by projector row coordinate r_p shines at
t = r_p / v_p + m T for every integer m. Camera row k is exposed during delay + (k + 1/2) line_time -+ exposure / 2. So
a point is recorded once for every m whose instant lies in that window, and the test needs nothing but r_p and the row,
whatever the rig: the geometry sits in r_p.

This is the one home of that test: `recorded_times` for single points, `weights` for images, `lit_rows` for ranges of
projector rows. The kernels of `exposure` repeat it for speed, and tests hold them to these functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopegate.core.gating.slab_errors import SlabErrors, slab_errors
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Ints, Singles
from slopegate.core.rig.axis import AxisPoint, infinity_us, no_slab, slope_terms, solve_axis, time_rate
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.rig import Lens, Rig, RigProjector, Vector3
from slopegate.core.rig.settings import CentreDelayUs, GateSettings


def slope_ratio(rig: Rig, line_time_us: float) -> float:
    """B = (v_p / v_c) (f_c / f_p): projector rows per camera row, in normalised rows. To one rounding, any rig."""
    top, bottom = slope_terms(rig.camera.lens, rig.projector, line_time_us)
    return top / bottom


def exact_upright_line_time(camera: Lens, projector: RigProjector) -> float:
    """The line time at which B = 1, microseconds, to one rounding: the ideal rig's slabs stand upright."""
    top, bottom = slope_terms(camera, projector, 1.0)
    return bottom / top


def upright_line_time(rig: Rig) -> float:
    """The line time nearest to `exact_upright_line_time` that the camera can have, microseconds."""
    return rig.camera.shutter.line.nearest(exact_upright_line_time(rig.camera.lens, rig.projector))


def phase_us(rig: Rig, line_time_us: float, camera_rows: Doubles, projector_rows: Doubles) -> Doubles:
    """Phase of points, microseconds: r_p / v_p - r_c line_time, from continuous row coordinates (broadcast).

    The phase is all that a gate of this line time knows of a point: the gate records it when its phase, give or take
    whole periods, lies in start .. end of the exposure of row coordinate 0. To 3 roundings of the times.
    """
    return projector_rows / rig.projector.rows_per_us - camera_rows * line_time_us


def rows_at_phase(rig: Rig, line_time_us: float | Doubles, camera_rows: Doubles, phases_us: float | Doubles) -> Doubles:
    """Projector row coordinates that have this phase in these camera rows: the inverse of `phase_us` (broadcast)."""
    return (phases_us + camera_rows * line_time_us) * rig.projector.rows_per_us


# Times in whole ticks. Sums of floats would round differently for two gates that share an edge; whole numbers do not,
# so a gate and its complement, or two slices that meet, record every point exactly once.

_GRID_BITS = 30
"""The ends of an exposure are whole multiples of 2^-30 us."""

_PERIOD_BITS = 54
"""The period is a whole number of ticks of this many bits: int64 holds it, and no float64 period loses a bit."""


@dataclass(frozen=True)
class Ticks:
    """The exposure of row coordinate 0 in ticks: from `start` until `start + exposure`, modulo `period`."""

    period: int
    per_us: Fraction
    start: int
    exposure: int


def in_ticks(settings: GateSettings, period_us: float) -> Ticks:
    """The exposure of row coordinate 0 in ticks, its ends rounded to the grid of 2^-30 us."""
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
    """When camera rows are exposed, within one projector period; arrays of one value per row.

    start_us and end_us in [0, period]; the exposure lasts from start_us to end_us plus `periods` (int64) whole periods,
    at least one where end_us comes before start_us; `wraps` says where it does.
    """

    start_us: Doubles
    end_us: Doubles
    periods: Indices
    wraps: Bools


def row_times(settings: GateSettings, period_us: float, rows: Indices) -> RowTimes:
    """When the camera rows `rows`, an array (n,) of whole numbers from 0 to 2^20, are exposed."""
    ticks = in_ticks(settings, period_us)
    start = _phases(ticks, settings.line_time_us, rows)
    periods, rest = divmod(ticks.exposure, ticks.period)
    end = start + rest
    wraps = end >= ticks.period
    end -= ticks.period * wraps.astype(np.int64)
    start_us, end_us = (phase.astype(np.float64) / float(ticks.per_us) for phase in (start, end))
    return RowTimes(start_us, end_us, periods + wraps.astype(np.int64), wraps)


def _phases(ticks: Ticks, line_time_us: float, rows: Indices) -> Indices:
    """Start of each row's exposure modulo the period, 0 <= phase < period, (n,) ticks."""
    whole, part = divmod(Fraction(line_time_us) / 2 * ticks.per_us, 1)
    whole %= ticks.period
    odd = 2 * rows + 1
    offset: Indices = np.rint(odd * float(part)).astype(np.int64) + ticks.start
    # The products leave int64 and wrap round. Only their small difference is kept, which does not mind.
    turns = np.floor(odd * (whole / ticks.period) + offset / ticks.period).astype(np.int64)
    phases: Indices = (odd * np.int64(whole) + offset - turns * np.int64(ticks.period)) % ticks.period
    return phases


# Which points those times record.


@dataclass(frozen=True, eq=False)
class RowWindows:
    """What each camera row records, by projector row coordinate; arrays of one value per camera row.

    A point at low <= r_p < high (float64) is recorded `inside` times (int32), any other lit point `outside` times.
    Wrap round the frame, blanking and exposures beyond one period are all in these four numbers.
    """

    low: Doubles
    high: Doubles
    inside: Ints
    outside: Ints


def row_windows(rig: Rig, settings: GateSettings) -> RowWindows:
    """The window of every camera row, *continuous* level of detail (model section 2), any rig.

    Counts are exact. Edges are off by at most 5e-10 us, half a grid step, plus 4 roundings of a period: 2.3e-11 rows of
    the check rig, 1e-12 of the period for periods of 500 us and more, for every settings that `GateSettings` takes.
    Gates that share an edge (two slices that meet, a gate and its `complement`) share it to the last bit.
    """
    times = row_times(settings, rig.projector.period_us, np.arange(rig.camera.lens.height))
    speed, wraps = rig.projector.rows_per_us, times.wraps
    return RowWindows(
        low=np.where(wraps, times.end_us, times.start_us) * speed,
        high=np.where(wraps, times.start_us, times.end_us) * speed,
        inside=np.where(wraps, times.periods - 1, times.periods + 1).astype(np.int32),
        outside=times.periods.astype(np.int32),
    )


def recorded_times(windows: RowWindows, camera_rows: NDArray[np.integer], projector_rows: ArrayLike) -> Ints:
    """How often each point is recorded, from the camera row that sees it and the projector row that lights it.

    camera_rows: whole numbers; projector_rows: continuous coordinates; broadcast. Negative projector rows stand for
    points that the projector does not light: they are recorded 0 times. Comparisons only: exact for the windows given.
    """
    rows = np.asarray(projector_rows)
    hit = (rows >= windows.low[camera_rows]) & (rows < windows.high[camera_rows])
    counts = np.where(hit, windows.inside[camera_rows], windows.outside[camera_rows])
    return np.where(rows < 0, 0, counts).astype(np.int32)


def weights(windows: RowWindows, projector_rows: ArrayLike) -> Ints:
    """How often each pixel of an image is recorded: `recorded_times` of projector_rows (N_c,) or (N_c, W)."""
    rows = np.asarray(projector_rows)
    return recorded_times(windows, np.arange(len(rows)).reshape(-1, *(1,) * (rows.ndim - 1)), rows)


class Reach(NamedTuple):
    """Least and greatest projector row that lights anything in each camera row, (N_c,) float64; inf, -inf for none."""

    low: Doubles
    high: Doubles


def whole_reach(rig: Rig) -> Reach:
    """Every row of the projector in every row of the camera: nothing is known of the scene."""
    height = rig.camera.lens.height
    return Reach(np.zeros(height), np.full(height, float(rig.projector.lens.height)))


def seen_reach(projector_row: Singles) -> Reach:
    """The reach of what an image shows, from `Buffers.projector_row` (N_c, W), where negative is unlit."""
    lit = projector_row >= 0
    low = projector_row.min(axis=1, where=lit, initial=np.inf).astype(np.float64)
    return Reach(low, projector_row.max(axis=1, where=lit, initial=-np.inf).astype(np.float64))


def lit_rows(windows: RowWindows, reach: Reach) -> tuple[int, int]:
    """First camera row that the gate can light, and one past the last; (0, 0) where it can light none.

    `recorded_times` for a range of projector rows in place of one: the range counts as soon as any of it may.
    """
    some = reach.low <= reach.high
    meets = some & (reach.high >= windows.low) & (reach.low < windows.high)
    leaves = some & ((reach.low < windows.low) | (reach.high >= windows.high))
    rows = np.flatnonzero(meets & (windows.inside > 0) | leaves & (windows.outside > 0))
    return (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 0)


def discrete_weights(rig: Rig, settings: GateSettings, camera_rows: ArrayLike, projector_rows: ArrayLike) -> Doubles:
    """How much of whole projector rows' light camera rows record, float64 (broadcast).

    The *discrete rows* level of detail (model section 2): all points of projector row j are lit during [j, j + 1) /
    v_p, so its weight is the overlap with the window of camera row k (a whole number) in row times, a trapezoid in j.
    It differs from `weights` by at most one row at each edge. Off by at most what the window's two edges are (see
    `row_windows`), in rows; exactly whole where no edge touches the row.
    """
    rows = np.asarray(camera_rows, np.int64)
    times = row_times(settings, rig.projector.period_us, rows.ravel())
    first, speed = np.asarray(projector_rows, np.float64), rig.projector.rows_per_us

    def lit_until(time_us: Doubles) -> Doubles:
        """Share of row j's light that has come at this phase of the period."""
        return np.minimum(np.maximum((time_us * speed).reshape(rows.shape) - first, 0.0), 1.0)

    return times.periods.reshape(rows.shape) + (lit_until(times.end_us) - lit_until(times.start_us))


def complement(settings: GateSettings, period_us: float) -> GateSettings:
    """The gate that records what this one does not: together every point counts the same, exactly.

    They count each point ceil(exposure / T) times. Exact for all settings, since both share the ticks of their edges
    (`Ticks`). Raises InputError when the exposure is a whole number of periods (to 1e-6 us), since nothing is left
    to record.
    """
    ticks = in_ticks(settings, period_us)
    periods = max(-(-ticks.exposure // ticks.period), 1)
    rest = periods * ticks.period - ticks.exposure
    beyond_whole = min(rest, ticks.period - rest if periods > 1 else rest) / ticks.per_us
    require(
        beyond_whole > Fraction(1, 10**6),
        "exposure_us",
        settings.exposure_us,
        f"other than a whole number of projector periods ({period_us:g} us) for a complement to exist",
    )
    start = (ticks.start + ticks.exposure) % ticks.period
    delay = float((start + Fraction(rest, 2)) / ticks.per_us)
    if delay > period_us:
        delay -= period_us
    return GateSettings(settings.line_time_us, CentreDelayUs(delay), float(rest / ticks.per_us))


# The slab of space that the windows make.

PARALLEL = 1e-9
"""|B - 1| below which the planes count as parallel and the hinge (1e8 m away and more) as absent."""
_FAR_PER_M = 1e-9
"""Inverse distance below which a plane counts as lying at infinity."""
_BEYOND = 1e-300
"""Inverse distance, 1/m, below which a surface counts as infinitely far: its reciprocal would overflow."""


@dataclass(frozen=True)
class Plane:
    """A plane of the gate, A z + (B - 1) y = b (B + 1) / 2 in world coordinates (model section 3).

    Also as `normal` . X = `offset_m` with a unit normal.

    `A` passes through 0 where the plane recedes to infinity, and so does the normal's z. For a rig that is not ideal it
    is the tangent plane of the gate's edge on the axis x = y = 0, scaled alike. The plane at infinity itself has normal
    (0, 0, 1) and an infinite offset. Accuracy: see `slab`.
    """

    A: float
    normal: Vector3
    offset_m: float


@dataclass(frozen=True)
class Slab:
    """Where a gate lies: its slab of space, read on the axis x = y = 0; None where a surface is not before the rig.

    What may be None has a finite form beside it that is defined for every gate and passes through 0 where the other is
    infinite: inverse distances (negative for surfaces "beyond infinity", whose planes lie behind the rig) and the
    hinge's curvature.
    """

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
    """The projector frame whose light this is, counted from the trigger."""
    warnings: tuple[str, ...]
    inverse_near_per_m: float
    inverse_distance_per_m: float
    inverse_far_per_m: float
    hinge_curvature_per_m: float
    """1 / hinge_y = 2 (B - 1) / (b (B + 1)): how fast planes of other distances turn; 0 where they are parallel."""
    errors: SlabErrors | None = None
    """One standard error of tilt, turn, distances and thickness, where the rig was calibrated."""

    @property
    def turn_deg(self) -> float:
        """How far the centre plane is turned about the vertical, positive where its right side is nearer.

        0 for an ideal rig; not for a projector that is turned or not straight above the camera.
        """
        across, _, ahead = self.centre.normal
        return math.degrees(math.atan(across / ahead)) if ahead else 0.0

    def error(self, name: str) -> float | None:
        """One standard error of one of them; None where it is not known, or the figure has no value."""
        return None if self.errors is None else cast(float | None, getattr(self.errors, name))


def slab(rig: Rig, settings: GateSettings) -> Slab:
    """Tilt, distance, thickness, planes and hinge of a gate; of its copies one period apart, the one that covers most.

    Most of the axis x = y = 0, that is. For the ideal rig every number is the closed form's to 1e-14 relative (at most
    20 roundings; `rig.axis`), for all settings, planes at and beyond infinity and B = 1 included. Any other rig without
    lens distortion: inverse distances, near, far and thickness to 1e-12 relative, `normal`, B and the curvature to
    1e-12 of their scales (1, 1 and 2 / b), where the projector is turned by up to 0.3 rad and the slab is at least a
    baseline away. With distorted lenses inverse distances to 1e-13 / m, the others alike.

    Raises InputError where the gate is no slab (`axis.no_slab`); `slab_if_any` does not.
    """
    if reason := no_slab(rig, settings.line_time_us):
        raise InputError(reason)
    infinity = infinity_us(rig, settings.line_time_us)
    frame = _frame(rig, settings, float(infinity))
    late = Fraction(settings.delay_us) - frame * Fraction(rig.projector.period_us) - infinity
    half = Fraction(settings.exposure_us) / 2
    points = [solve_axis(rig, settings.line_time_us, float(us)) for us in (late - half, late, late + half)]
    far, centre, near = sorted(points, key=lambda point: point.w)
    far_m, distance_m, near_m = (1 / point.w if point.w > _BEYOND else None for point in (far, centre, near))
    return Slab(
        line_time_us=settings.line_time_us,
        B=slope_ratio(rig, settings.line_time_us),
        tilt_deg=centre.tilt_deg,
        distance_m=distance_m,
        near_m=near_m,
        far_m=far_m,
        thickness_m=None if near_m is None or far_m is None else _thickness_m(rig, settings, near, far),
        hinge_y_m=None if abs(centre.slope) < PARALLEL else centre.K / centre.slope,
        near=Plane(near.A, near.normal, near.offset_m),
        centre=Plane(centre.A, centre.normal, centre.offset_m),
        far=Plane(far.A, far.normal, far.offset_m),
        windows_us=_windows_us(settings, rig.projector.period_us),
        frame=frame,
        warnings=tuple(_warnings(rig, settings, (near_m, far_m), centre)),
        inverse_near_per_m=near.w,
        inverse_distance_per_m=centre.w,
        inverse_far_per_m=far.w,
        hinge_curvature_per_m=centre.slope / centre.K,
        errors=slab_errors(rig, settings, frame, (far.w, centre.w, near.w), (far_m, distance_m, near_m)),
    )


@dataclass(frozen=True)
class SlabOrWhy:
    """A gate's slab, or None and one sentence that says why it has none; and what the user should know of the gate."""

    slab: Slab | None
    why: str
    warnings: tuple[str, ...]


def slab_if_any(rig: Rig, settings: GateSettings) -> SlabOrWhy:
    """`slab` for any rig: not every gate is one, and what needs none goes on without."""
    try:
        found = slab(rig, settings)
    except InputError as error:
        return SlabOrWhy(None, str(error), tuple(timing_warnings(rig, settings)))
    return SlabOrWhy(found, "", found.warnings)


def _thickness_m(rig: Rig, settings: GateSettings, near: AxisPoint, far: AxisPoint) -> float:
    """Thickness of the slab on the axis: far - near = (w_near - w_far) / (w_near w_far), metres."""
    # The difference of two inverse distances cancels for thin slabs; the exposure over the rate of time does not.
    if rig.camera.lens.distorted or rig.projector.lens.distorted:
        return 1 / far.w - 1 / near.w
    between = abs(settings.exposure_us / time_rate(rig, settings.line_time_us, near.w, far.w))
    if abs(between - (near.w - far.w)) > 1e-6 * near.w:  # clipped: see `solve_axis`
        return 1 / far.w - 1 / near.w
    return between / near.w / far.w


def _frame(rig: Rig, settings: GateSettings, infinity: float) -> int:
    """The projector frame whose light fills most of the axis in front of the rig; the nearest one where none does."""
    period, lens = rig.projector.period_us, rig.projector.lens
    nearest_w = 2 * max(lens.height - lens.cy, 1.0) / (lens.fy * rig.baseline_m)
    ends = sorted((infinity, infinity + nearest_w * time_rate(rig, settings.line_time_us, 0.0, 0.0)))
    start, end = settings.start_us, settings.end_us
    # Moving the window past the axis, their overlap is a trapezoid: greatest between where their two ends meet.
    first, last = sorted(((start - ends[0]) / period, (end - ends[1]) / period))
    low, high = math.ceil(first), math.floor(last)

    def merit(frame: int) -> tuple[float, int]:
        overlap = min(end - frame * period, ends[1]) - max(start - frame * period, ends[0])
        return overlap, -abs(frame)

    return min(max(0, low), high) if low <= high else max((high, low), key=merit)


def _windows_us(settings: GateSettings, period_us: float) -> tuple[tuple[float, float], ...]:
    """The exposure of row coordinate 0 modulo the period: whole periods first, then what is left, split at the wrap."""
    whole, rest = divmod(settings.exposure_us, period_us)
    windows = [(0.0, period_us)] * int(whole)
    start = float((Fraction(settings.delay_us) - Fraction(settings.exposure_us) / 2) % Fraction(period_us))
    if rest and start + rest <= period_us:
        windows.append((start, start + rest))
    elif rest:
        windows += [(0.0, start + rest - period_us), (start, period_us)]
    return tuple(windows)


def _warnings(
    rig: Rig, settings: GateSettings, ends_m: tuple[float | None, float | None], centre: AxisPoint
) -> list[str]:
    """What the user should know of a gate and its slab, a clause each; `ends_m`: near and far."""
    near_m, far_m = ends_m
    found = []
    if rig.is_opposed:
        found.append("the projector draws its rows the other way than the camera reads its own: no slab stands upright")
    if near_m is None:
        found.append("straight ahead the whole slab lies beyond infinity: distance, near and far have no finite value")
    elif far_m is None:
        found.append("the slab reaches to infinity: far and thickness have no finite value")
    if abs(centre.w) < _FAR_PER_M and abs(centre.slope) < PARALLEL:
        found.append("the centre plane lies at infinity but for rounding: its tilt means nothing there")
    elif centre.w < 0:
        found.append("the centre plane lies beyond infinity, behind the rig: its tilt means nothing in front of it")
    return found + timing_warnings(rig, settings)


def timing_warnings(rig: Rig, settings: GateSettings) -> list[str]:
    """What the user should know of a gate's exposure, a clause each, whether or not it is a slab."""
    period, row_us = rig.projector.period_us, 1 / rig.projector.rows_per_us
    found = []
    nearly = rig.camera.shutter.exposure_us.step / 2  # the exposure nearest to a whole period is none too long
    if settings.exposure_us > period + nearly:
        times = int(settings.exposure_us // period)
        often = "once or more" if times == 1 else f"{times} times or more"
        found.append(f"the exposure is longer than the projector's period ({period:g} us): all light counts {often}")
    if settings.exposure_us < row_us:
        found.append(f"the exposure is shorter than one projector row ({row_us:.1f} us)")
    # A row whose window lies behind the last lit row, and nowhere else, can see none of the projector's light.
    windows = row_windows(rig, settings)
    dark = (windows.low >= rig.projector.lens.height) & (windows.outside == 0)
    if 2 * dark.sum() >= dark.size:
        found.append(f"{int(dark.sum())} of {dark.size} camera rows are exposed in the projector's blanking only")
    return found
