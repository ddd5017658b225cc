"""The gate on the axis x = y = 0, straight ahead: which delay belongs to which distance, and how the gate tilts there.

A world point on the axis is (0, 0, 1/w). Everything is written in e_z - w c, the same point scaled by w and seen from
a centre c, which stays finite as w -> 0. An edge of the gate is the surface u(X) = r_p / v_p - line_time r_c = t; rows
are homogeneous of degree 0, so u and its gradient there follow from the scaled point, and the gradient's z component is
exactly w times a finite number: nothing cancels at infinity.

Two differences would cancel in float64: t - u(infinity), which is all that is left of large times where a plane recedes
to infinity, and B - 1 where planes become parallel. Both are formed from the rig's and the gate's numbers as
fractions and rounded once (`infinity_us`, `slope_excess`). What follows from them are products, quotients and sums of
equal sign, so for the ideal rig every figure is good to 8 roundings (1e-15 relative) for all settings, at and around
A = 0 and B = 1 too. For any other rig the plane is the tangent plane of the edge; without lens distortion w is as good
as for the ideal rig times the condition of its own linear equation (see `solve_axis`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.rig import Lens, Rig, RigProjector, Vector3

LEAST_ROWS = 1.0
"""Projector rows by which light must move between infinity and one baseline away for a gate to tell distances apart.

A row is the least that timing can tell, and nearer than a baseline the two fields of view hardly meet. One that moves
less lights what it lights at every distance that can be seen. It is no special angle: of 1000 pixels of focal length it
takes 0.06 degrees between rows and baseline, and a slab that is told from there on is thin only very near the rig.
"""
_INSTEAD = "set pixel clock (or line time), delay and exposure instead"
_ALONG_ROWS = (
    "This rig's gates are no slabs: the projector stands along its own rows, so a row of light is seen in the same "
    f"place at every distance; {_INSTEAD}"
)
_LOOKS_AWAY = f"This rig's gates are no slabs: the projector does not look where the camera looks; {_INSTEAD}"
_ALONG_AXIS = (
    "This gate is no slab that could be told by its distance: at its line time the edges run along the axis, as far as "
    f"one can see; {_INSTEAD}"
)


def rows_to_baseline(rig: Rig) -> float:
    """Projector rows by which light on the camera's axis moves from infinity to one baseline away, to first order.

    f_p b_r / b for projectors that are not turned, with b_r the part of the baseline b across the rows; 0 where the
    rows run along it. NaN where the projector does not look along the camera's axis.
    """
    axis, offset = rig.rotation[:, 2], rig.rotation @ np.array(rig.projector_offset_m)
    if axis[2] <= 0:
        return math.nan
    across = abs(float(axis[1] * offset[2] - axis[2] * offset[1])) / rig.baseline_m
    return rig.projector.lens.fy * across / float(axis[2]) ** 2


def no_slabs(rig: Rig) -> str:
    """Why no gate of this rig is a slab of space, and what to use instead, in one sentence; empty where they are.

    The one law about that (`LEAST_ROWS`). A gate of such a rig selects light by how many rows it has moved, not by
    distance: `gating.epipolar`.
    """
    if rig.is_ideal:
        return ""
    rows = rows_to_baseline(rig)
    if math.isnan(rows):
        return _LOOKS_AWAY
    return _ALONG_ROWS if rows < LEAST_ROWS else ""


def require_slabs(rig: Rig) -> None:
    """Raise InputError where this rig's gates are no slabs (`no_slabs`)."""
    if reason := no_slabs(rig):
        raise InputError(reason)


def no_slab(rig: Rig, line_time_us: float) -> str:
    """Why gates of this line time are no slab that is told by where it meets the axis; empty where they are.

    As `no_slabs`, and where projector and camera rows move along the axis in step: so they do at B = 1 where the
    projector draws its rows the other way.
    """
    if (reason := no_slabs(rig)) or rig.is_ideal:
        return reason
    rows = abs(time_rate(rig, line_time_us, 0.0, 0.0)) * rig.projector.rows_per_us / rig.baseline_m
    return _ALONG_AXIS if rows < LEAST_ROWS else ""


@dataclass(frozen=True)
class AxisPoint:
    """An edge of the gate where it meets the axis: the plane A z + (B - 1) y + C x = K, in world coordinates."""

    w: float
    """Inverse distance from the origin, 1/m; 0 at infinity, negative behind the rig."""
    A: float
    slope: float
    """B - 1 of the ideal rig."""
    skew: float
    """C, 0 for the ideal rig."""
    K: float
    """b (B + 1) / 2 of the ideal rig, metres; negative where light from nearer by comes earlier."""

    @property
    def normal(self) -> Vector3:
        """Unit normal; its z component has the sign of A. (0, 0, 1) for the plane at infinity (A = B - 1 = 0)."""
        length = math.hypot(self.skew, self.slope, self.A)
        return (self.skew / length, self.slope / length, self.A / length) if length else (0.0, 0.0, 1.0)

    @property
    def offset_m(self) -> float:
        """Distance along `normal` from the origin to the plane; infinite for the plane at infinity."""
        length = math.hypot(self.skew, self.slope, self.A)
        return self.K / length if length else math.inf

    @property
    def tilt_deg(self) -> float:
        """Tilt from the vertical, positive when the top leans away; beyond 90 degrees where A < 0.

        Continuous as A passes through 0 and, in front of the rig, as B passes through 1. Behind the rig (A < 0) planes
        either side of B = 1 are tilted by nearly +180 and -180 degrees, which is the same: there `normal` is the
        continuous form.
        """
        return math.degrees(math.atan2(self.slope, self.A))


@dataclass(frozen=True)
class RowSlopes:
    """Gradient of a row (or of a time) by the scaled point, world axes, and its product with the optical centre."""

    x: float
    y: float
    z: float
    per_w: float
    """gradient . centre: how the row falls as w grows. On the axis z = w per_w, without cancellation."""


@dataclass(frozen=True)
class Scanners:
    """Both scanners' rows (the projector's as a time, us) and slopes at one point."""

    projector_us: float
    camera_row: float
    projector: RowSlopes
    camera: RowSlopes


def scanners(rig: Rig, w: float, direction: Vector3 = (0.0, 0.0, 1.0)) -> Scanners:
    """Projector time and camera row at the world point direction / w, and their slopes by `direction`.

    Slopes to 1e-14 relative, distorted lenses too (their derivatives are OpenCV's, in closed form). Raises InputError
    for a point that is not in front of both.
    """
    speed = rig.projector.rows_per_us
    row_p, slopes_p = _row(rig.projector.lens, rig.rotation, np.array(direction) - w * rig.projector_centre_m)
    row_c, slopes_c = _row(rig.camera.lens, np.eye(3), np.array(direction) - w * rig.camera_centre_m)
    return Scanners(
        row_p / speed, row_c, _slopes(slopes_p / speed, rig.projector_centre_m), _slopes(slopes_c, rig.camera_centre_m)
    )


def _slopes(gradient: Doubles, centre: Doubles) -> RowSlopes:
    x, y, z = (float(value) for value in gradient)
    return RowSlopes(x, y, z, float(gradient @ centre))


def _row(lens: Lens, rotation: Doubles, seen: Doubles) -> tuple[float, Doubles]:
    """Row and its gradient by `seen`, the scaled point relative to the optical centre in world axes."""
    point = rotation @ seen
    require(point[2] > 0, "the point", tuple(np.round(seen, 6).tolist()), "in front of the camera and the projector")
    x, y = point[0] / point[2], point[1] / point[2]
    row, along_x, along_y = _lens_row(lens, x, y)
    return float(row), rotation.T @ (np.array([along_x, along_y, -(along_x * x + along_y * y)]) / point[2])


def _lens_row(lens: Lens, x: float, y: float) -> tuple[float, float, float]:
    """The pixel row and its derivatives by normalised x and y."""
    if not lens.distorted:
        return y * lens.fy + lens.cy, 0.0, lens.fy
    import cv2  # large, and only distorted lenses need it

    zero = np.zeros(3)
    pixel, slopes = cv2.projectPoints(np.array([[[x, y, 1.0]]]), zero, zero, lens.matrix, np.array(lens.distortion))
    # Columns 3 and 4 are derivatives by the translation along x and y, which moves a point at depth 1 as x and y do.
    return float(pixel[0, 0, 1]), float(slopes[1, 3]), float(slopes[1, 4])


def _row_at_infinity(lens: Lens, axis: Doubles) -> Fraction:
    """The row of the direction `axis` (3,), in the lens's axes: exact, but for a distorted lens float64."""
    x, y, z = (Fraction(float(part)) for part in axis)
    require(z > 0, "projector_rotation", tuple(axis.tolist()), "such that the projector looks along the camera's axis")
    if lens.distorted:
        return Fraction(_lens_row(lens, float(x / z), float(y / z))[0])
    return y / z * Fraction(lens.fy) + Fraction(lens.cy)


def us_per_row(projector: RigProjector) -> Fraction:
    """Time from one projector row to the next, 1 / v_p in microseconds, exactly."""
    return Fraction(projector.active_fraction) * Fraction(projector.period_us) / projector.lens.height


def infinity_us(rig: Rig, line_time_us: float) -> Fraction:
    """The delay of the gate whose centre meets the axis at infinity, microseconds; exact for undistorted lenses."""
    row_p = _row_at_infinity(rig.projector.lens, rig.rotation[:, 2])
    lens = rig.camera.lens
    row_c = _row_at_infinity(lens, np.array([0.0, 0.0, 1.0])) if lens.distorted else Fraction(lens.cy)
    return row_p * us_per_row(rig.projector) - Fraction(line_time_us) * row_c


def slope_excess(rig: Rig, line_time_us: float) -> float:
    """B - 1, to one rounding: 0 only where B is exactly 1."""
    top, bottom = slope_terms(rig.camera.lens, rig.projector, line_time_us)
    return (top - bottom) / bottom


def slope_terms(camera: Lens, projector: RigProjector, line_time_us: float) -> tuple[int, int]:
    """Two whole numbers whose ratio is exactly B = (v_p / v_c) (f_c / f_p) (model section 3).

    Whole numbers, not a Fraction: its greatest common divisor would take most of the time of a read-out.
    """
    focal_c, focal_p = camera.fy, projector.lens.fy
    values = (line_time_us, focal_c, projector.active_fraction, projector.period_us, focal_p)
    (line, line2), (f_c, f_c2), (active, active2), (period, period2), (f_p, f_p2) = (
        float(value).as_integer_ratio() for value in values
    )
    return projector.lens.height * line * f_c * active2 * period2 * f_p2, active * period * f_p * line2 * f_c2


def time_rate(rig: Rig, line_time_us: float, w: float, other_w: float) -> float:
    """How much later light from nearer by comes: (u(w) - u(other_w)) / (w - other_w), us m; the derivative where equal.

    Undistorted: a row is (y - w d_y) / (z - w d_z), whose difference has the factor w - other_w: 1e-15 relative to
    the larger of its two terms, which have the same sign when the origin lies between camera and projector.
    """
    if rig.camera.lens.distorted or rig.projector.lens.distorted:
        if w == other_w:
            return axis_point(rig, line_time_us, w).K * rig.projector.lens.fy / rig.projector.rows_per_us
        near, far = scanners(rig, w), scanners(rig, other_w)
        rows = near.camera_row - far.camera_row
        return (near.projector_us - far.projector_us - line_time_us * rows) / (w - other_w)
    lens_p, lens_c = rig.projector.lens, rig.camera.lens
    row_p = lens_p.fy * _row_rate(rig.rotation[:, 2], rig.rotation @ rig.projector_centre_m, w, other_w)
    row_c = lens_c.fy * _row_rate(np.array([0.0, 0.0, 1.0]), rig.camera_centre_m, w, other_w)
    return row_p / rig.projector.rows_per_us - line_time_us * row_c


def _row_rate(axis: Doubles, centre: Doubles, w: float, other_w: float) -> float:
    """Difference of y/z of the point axis - w centre between two w, over their difference; no cancellation."""
    depth, other_depth = float(axis[2] - w * centre[2]), float(axis[2] - other_w * centre[2])
    in_front = min(depth, other_depth) > 0
    require(in_front, "the inverse distance", (w, other_w), "of points in front of the camera and the projector")
    return float(axis[1] * centre[2] - axis[2] * centre[1]) / (depth * other_depth)


def time_on_axis(rig: Rig, line_time_us: float, w: float) -> float:
    """The delay of the gate whose centre passes through (0, 0, 1/w), microseconds.

    For lenses without distortion its error is one rounding of the result plus 1e-15 of its distance from `infinity_us`.
    """
    return float(infinity_us(rig, line_time_us) + Fraction(w * time_rate(rig, line_time_us, w, 0.0)))


def axis_point(rig: Rig, line_time_us: float, w: float) -> AxisPoint:
    """The gate's edge through (0, 0, 1/w), as its tangent plane there."""
    if rig.is_ideal:
        slope = slope_excess(rig, line_time_us)
        K = rig.baseline_m * (slope + 2) / 2
        return AxisPoint(w=w, A=w * K, slope=slope, skew=0.0, K=K)
    at = scanners(rig, w)
    scale = -rig.projector.rows_per_us / rig.projector.lens.fy
    K = scale * (at.projector.per_w - line_time_us * at.camera.per_w)
    slope = scale * (at.projector.y - line_time_us * at.camera.y) + 0.0
    skew = scale * (at.projector.x - line_time_us * at.camera.x) + 0.0  # no -0.0
    return AxisPoint(w=w, A=w * K, slope=slope, skew=skew, K=K)


def solve_axis(rig: Rig, line_time_us: float, late_us: float) -> AxisPoint:
    """Where the gate's edge of the delay infinity_us + late_us meets the axis: Newton in w, one step for the ideal rig.

    w is accurate relative to itself, at infinity too, to 1e-15 times |time_rate's larger term / time_rate|. Through
    distorted lenses the time itself is known to 1e-15 of the rows' times: w to about 1e-14 / m.

    Where a rotated rig has no such point in front of both scanners, the tangent at infinity tells on which side it
    lies, with w clipped to where both still see the axis. Raises InputError where the axis has no slab (`no_slab`).
    """
    # Through distorted lenses the time itself is rounded, so steps below this would go on for ever.
    noise = 4e-15 if rig.camera.lens.distorted or rig.projector.lens.distorted else 0.0
    w = 0.0
    for _ in range(30):
        per_w = time_rate(rig, line_time_us, w, w)
        if per_w == 0:
            raise InputError(_ALONG_AXIS)
        step = (late_us - w * time_rate(rig, line_time_us, w, 0.0)) / per_w if w else late_us / per_w
        w = _stay_in_front(rig, w, w + step)
        if rig.is_ideal or abs(step) <= 4e-16 * abs(w) + noise:
            break
    return _facing(axis_point(rig, line_time_us, w))


def _facing(at: AxisPoint) -> AxisPoint:
    """The same plane with K >= 0: whether later light is nearer or farther depends on where the projector stands."""
    return at if at.K >= 0 else AxisPoint(at.w, -at.A, -at.slope, -at.skew, -at.K)


def _stay_in_front(rig: Rig, old: float, new: float) -> float:
    """At most nine tenths of the way to where the axis leaves either scanner's front."""
    for normal, centre in ((rig.rotation[2], rig.projector_centre_m), (np.array([0, 0, 1.0]), rig.camera_centre_m)):
        at_old, at_new = (float(normal[2] - w * (normal @ centre)) for w in (old, new))
        if at_new <= 0.1 * at_old:
            new = old + (new - old) * 0.9 * at_old / (at_old - at_new)
    return new


def delay_offset_us(rig: Rig, line_time_us: float, distance_m: float, found_us: float) -> float:
    """Delay offset of a rig, microseconds, from the delay that lit a board straight ahead at a known distance.

    `found_us` is that delay, set with the rig's present offset. The offset changes by less than half a projector
    period, for a trigger one period later lights the same rows. As accurate as `time_on_axis`. Raises InputError for a
    distance that the rig cannot have.
    """
    missed_us = found_us - time_on_axis(rig, line_time_us, 1 / distance_m)
    return rig.camera.shutter.delay_offset_us + math.remainder(missed_us, rig.projector.period_us)
