"""The gate along the axis x = y = 0: which time belongs to which distance, and how the gate's edge lies there.

A world point on the axis is (0, 0, 1/w). Everything is written in e_z - w c, the same point scaled by w and seen from
a centre c, which stays finite as w -> 0. An edge of the gate is the surface u(X) = r_p / v_p - line_time r_c = t; rows
are homogeneous of degree 0, so u and its gradient there follow from the scaled point, and the gradient's z component is
exactly w times a finite number: nothing cancels at infinity. For the ideal rig u is affine in w and these are the
closed forms of model section 3; for any other rig the plane is the tangent plane of the edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from slopegate.core.checks import require
from slopegate.core.rig import Lens, Rig, Vector3

Floats = NDArray[np.float64]

_STEP = 1e-5
"""Half step of the central difference through a distorted lens: relative error about 1e-10."""


@dataclass(frozen=True)
class AxisPoint:
    """An edge of the gate where it meets the axis, as a plane A z + (B - 1) y + C x = K, in world coordinates."""

    w: float
    """Inverse distance from the origin, 1/m; 0 at infinity, negative behind the rig."""
    A: float
    slope: float
    """B - 1 of the ideal rig."""
    skew: float
    """C, 0 for the ideal rig."""
    K: float
    """b (B + 1) / 2 of the ideal rig, metres."""

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
        """Tilt from the vertical, positive when the top leans away; beyond 90 degrees where A < 0."""
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

    Raises ValueError for a point that is not in front of both.
    """
    speed = rig.projector.rows_per_us
    row_p, slopes_p = _row(rig.projector.lens, rig.rotation, np.array(direction) - w * rig.projector_centre_m)
    row_c, slopes_c = _row(rig.camera.lens, np.eye(3), np.array(direction) - w * rig.camera_centre_m)
    return Scanners(
        row_p / speed, row_c, _slopes(slopes_p / speed, rig.projector_centre_m), _slopes(slopes_c, rig.camera_centre_m)
    )


def _slopes(gradient: Floats, centre: Floats) -> RowSlopes:
    x, y, z = (float(value) for value in gradient)
    return RowSlopes(x, y, z, float(gradient @ centre))


def _row(lens: Lens, rotation: Floats, seen: Floats) -> tuple[float, Floats]:
    """Row and its gradient by `seen`, the scaled point relative to the optical centre in world axes."""
    point = rotation @ seen
    require(point[2] > 0, "the point", tuple(np.round(seen, 6).tolist()), "in front of the camera and the projector")
    x, y = point[0] / point[2], point[1] / point[2]
    row = float(lens.project(x, y)[1])
    along_x, along_y = _lens_slopes(lens, x, y)
    return row, rotation.T @ (np.array([along_x, along_y, -(along_x * x + along_y * y)]) / point[2])


def _lens_slopes(lens: Lens, x: float, y: float) -> tuple[float, float]:
    """Derivatives of the pixel row by normalised x and y."""
    if not lens.distorted:
        return 0.0, lens.fy
    h = _STEP
    rows = lens.project([x + h, x - h, x, x], [y, y, y + h, y - h])[1]
    return float(rows[0] - rows[1]) / (2 * h), float(rows[2] - rows[3]) / (2 * h)


def time_on_axis(rig: Rig, line_time_us: float, w: float) -> float:
    """Centre delay that puts the gate's centre through (0, 0, 1/w)."""
    at = scanners(rig, w)
    return at.projector_us - line_time_us * at.camera_row


def axis_point(rig: Rig, line_time_us: float, w: float) -> AxisPoint:
    """The surface of constant u through (0, 0, 1/w)."""
    at = scanners(rig, w)
    scale = -rig.projector.rows_per_us / rig.projector.lens.fy
    K = scale * (at.projector.per_w - line_time_us * at.camera.per_w)
    slope = scale * (at.projector.y - line_time_us * at.camera.y) + 0.0
    skew = scale * (at.projector.x - line_time_us * at.camera.x) + 0.0  # no -0.0
    return AxisPoint(w=w, A=w * K, slope=slope, skew=skew, K=K)


def solve_axis(rig: Rig, line_time_us: float, time_us: float) -> AxisPoint:
    """The surface u = time_us where it meets the axis: Newton in w, exact in one step for the ideal rig.

    Where a rotated rig has no such point in front of both scanners, the tangent at infinity tells on which side it
    lies, with w clipped to where both still see the axis.
    """
    w = 0.0
    for _ in range(30):
        point = axis_point(rig, line_time_us, w)
        missing = time_us - time_on_axis(rig, line_time_us, w)
        per_w = point.K * rig.projector.lens.fy / rig.projector.rows_per_us
        step = missing / per_w
        w = _stay_in_front(rig, w, w + step)
        if rig.is_ideal or abs(step) <= 1e-15 + 4e-16 * abs(w):
            break
    return axis_point(rig, line_time_us, w)


def _stay_in_front(rig: Rig, old: float, new: float) -> float:
    """At most nine tenths of the way to where the axis leaves either scanner's front."""
    for normal, centre in ((rig.rotation[2], rig.projector_centre_m), (np.array([0, 0, 1.0]), rig.camera_centre_m)):
        at_old, at_new = (float(normal[2] - w * (normal @ centre)) for w in (old, new))
        if at_new <= 0.1 * at_old:
            new = old + (new - old) * 0.9 * at_old / (at_old - at_new)
    return new
