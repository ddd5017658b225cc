"""From a wanted slab, plane or set of points to gate settings (model section 3, inverse design)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np

from slopegate.core.gating.gate import Slab, exact_upright_line_time, phase_us, slab, slope_ratio
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.axis import (
    Scanners,
    infinity_us,
    require_slabs,
    scanners,
    time_on_axis,
    time_rate,
    us_per_row,
)
from slopegate.core.rig.checks import InputError, require, require_finite
from slopegate.core.rig.rig import Rig, Vector3
from slopegate.core.rig.settings import GateSettings, LineTimes, gate, quantise

_SAME_SIDE: Final = "of a plane that camera and projector see from the same side"
_IN_FRONT: Final = "of a plane that the camera sees in front of it"
_BEFORE_RIG: Final = "of a plane of which the camera sees what is before the rig"


class PlaneError(InputError):
    """No gate lies along a plane. Whoever was given the plane in other numbers tells those, and what is `allowed`."""

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(f"{field} is {value!r}: it must be {allowed}")
        self.allowed = allowed


def gate_around(
    rig: Rig,
    camera_rows: Doubles,
    projector_rows: Doubles,
    line_time_us: float,
    keep: float = 0.98,
) -> GateSettings:
    """The thinnest gate of this line time that records the share `keep` of the points, as many lost before as after.

    camera_rows (n,): the rows that see the points, whole numbers; projector_rows (n,): continuous rows that light them.
    Raises InputError where there are no points. Delay and exposure to 4 roundings of the points' times (1e-11 us), and
    a projector row wider than the points, so no rounding loses one that should be kept.
    """
    require(camera_rows.size > 0, "camera_rows", camera_rows.size, "at least one point")
    phases = phase_us(rig, line_time_us, camera_rows + 0.5, projector_rows)
    first, last = np.quantile(phases, ((1 - keep) / 2, (1 + keep) / 2))
    row_us = 1 / rig.projector.rows_per_us
    return gate(line_time_us, float(first + last) / 2, float(last - first) + row_us)


_TILTS = 80
"""Into how many steps the tilts are divided of a camera that sets its line time freely."""


def every_line_time(rig: Rig) -> list[float]:
    """Every line time of the camera's ladder, microseconds; if it is set freely, evenly spaced tilts about B = 1."""
    line = rig.camera.shutter.line
    if not isinstance(line, LineTimes):
        return [line.line_time_us(clock) for clock in line.ladder_mhz]
    upright = exact_upright_line_time(rig.camera.lens, rig.projector)
    ratios = 1 + np.linspace(-0.85, 0.85, _TILTS + 1)
    return sorted({line.nearest(upright / ratio) for ratio in ratios})


def gate_before_wall(rig: Rig, points_m: Doubles, wall_z_m: float) -> GateSettings:
    """The gate, as the hardware has it, that records an object whole and the wall behind it as little as can be.

    points_m (N, 3), world coordinates: the corners of the object's triangles. wall_z_m: where the wall stands upright.
    Of the gates of all line times that record fewest of the wall's rows it is the thinnest. On an ideal rig the phase
    of a point of a triangle lies between those of its corners, so nothing of the object is left out. Raises InputError
    for a rig whose gates are no slabs, and for an object that is not in front of the rig.
    """
    require_slabs(rig)
    (_, seen_row, depth), (_, lit_row, _) = rig.to_camera(points_m), rig.to_projector(points_m)
    ahead = (depth > 0) & np.isfinite(seen_row) & np.isfinite(lit_row)
    require(bool(ahead.any()), "points_m", int(ahead.sum()), "at least one point in front of the rig")
    seen_row, lit_row = seen_row[ahead], lit_row[ahead]
    wall_rows, wall_lit = _upright_wall(rig, wall_z_m)
    row_us, period_us = 1 / rig.projector.rows_per_us, rig.projector.period_us
    found = []
    for line_time_us in every_line_time(rig):
        phases = phase_us(rig, line_time_us, seen_row, lit_row)
        # What a pixel sees beside its centre is up to half a row away.
        margin_us = line_time_us / 2 + row_us
        start_us, end_us = float(phases.min()) - margin_us, float(phases.max()) + margin_us
        whole = gate(line_time_us, (start_us + end_us) / 2, min(end_us - start_us, period_us))
        behind = np.mod(phase_us(rig, line_time_us, wall_rows, wall_lit) - (start_us - margin_us), period_us)
        spill = int((behind < whole.exposure_us + 2 * margin_us).sum())
        found.append((spill, whole.exposure_us, line_time_us, whole))
    return quantise(rig.camera.shutter, min(found)[3], period_us)


def _upright_wall(rig: Rig, wall_z_m: float) -> tuple[Doubles, Doubles]:
    """Camera and projector rows at which an upright wall is seen and lit, in its middle and at both of its sides."""
    lens = rig.camera.lens
    columns, rows = np.meshgrid([0.5, lens.width / 2, lens.width - 0.5], lens.row_centres)
    rays = rig.camera_rays(columns, rows)
    centre = rig.camera_centre_m
    points = centre + rays * ((wall_z_m - centre[2]) / rays[..., 2])[..., None]
    _, lit, _ = rig.to_projector(points)
    inside = (lit >= 0) & (lit < rig.projector.lens.height)
    return rows[inside], lit[inside]


def whole_period(rig: Rig, line_time_us: float) -> GateSettings:
    """The gate that records everything once, whatever its depth: an exposure of one projector period, unrounded."""
    period = rig.projector.period_us
    return gate(line_time_us, period / 2, period)


MIN_DISTANCE_M, MAX_DISTANCE_M, MIN_THICKNESS_M = 1e-9, 1e9, 1e-15
"""What can be asked for: far beyond any rig, and far from where float64 numbers end."""


@dataclass(frozen=True)
class Planned:
    """Settings for a wanted slab: `exact` before rounding, `applied` as the hardware makes them.

    Residuals are got - wanted. A residual is None where the applied slab, or what was wanted, has no finite value.
    """

    exact: GateSettings
    applied: GateSettings
    slab: Slab
    residual_tilt_deg: float
    residual_distance_m: float | None
    residual_thickness_m: float | None


def plan(
    rig: Rig, tilt_deg: float, distance_m: float, thickness_m: float, line_time_us: float | None = None
) -> GateSettings:
    """The gate whose centre plane meets the axis x = y = 0 at `distance_m` with this tilt, `thickness_m` thick there.

    Given a line time, the tilt follows from it and delay and exposure hold distance and thickness. Raises InputError
    for distances that are not from 1e-9 m to 1e9 m, thicknesses not from 1e-15 m to 1e9 m, or a plane that no line time
    makes: |tan tilt| < 2 distance / baseline for the ideal rig. For a rig whose gates are no slabs it says so
    (`axis.no_slabs`), as `plan_plane` does.

    Accuracy for the ideal rig, with q = tan(tilt) baseline / (2 distance), B = (1 + q) / (1 - q): the line time to
    1e-15 (3 + 4 |q| / (1 - q^2)) relative (q is the nearer to +-1 the steeper the plane: 1e-12 for B from 1/400 to
    400); for that line time, the delay to one rounding plus 1e-15 of its distance from the delay of a plane at
    infinity, and the exposure to 2e-15 relative. What float64 leaves of the delay, 2^-53 of it, moves the plane by
    2^-53 |delay| / (v_f b (B + 1) / 2) in inverse distance, v_f = f_p / v_p: under 1e-14 / m for the check rig. Other
    rigs alike, where turned by up to 0.3 rad; through distorted lenses the tilt to 1e-11 degrees, delay and exposure to
    1e-10 us.
    """
    require_slabs(rig)
    _require_metres("distance_m", distance_m, MIN_DISTANCE_M)
    _require_metres("thickness_m", thickness_m, MIN_THICKNESS_M)
    if line_time_us is None:
        quoted = float(f"{tilt_deg:.4g}")
        require(math.isfinite(tilt_deg) and abs(tilt_deg) < 90, "tilt_deg", quoted, "between -90 and 90")
        at, tangent = scanners(rig, 1 / distance_m), _tangent(tilt_deg)
        allowed = f"less steep for a plane {distance_m:g} m away: it would pass between the camera and the projector"
        line_time_us = _line_time(at, tangent, 1 / distance_m)
        if rig.is_opposed and line_time_us <= 0:
            raise InputError(
                "No slab stands upright or near it: the projector draws its rows the other way than the camera "
                "reads its own (see rows in the rig file)"
            )
        require(line_time_us > 0, "tilt_deg", quoted, allowed)
    delay = time_on_axis(rig, line_time_us, 1 / distance_m)
    return gate(line_time_us, delay, _exposure(rig, line_time_us, distance_m, thickness_m))


def _require_metres(field: str, value: float, least: float) -> None:
    good = math.isfinite(value) and least <= value <= MAX_DISTANCE_M
    require(good, field, value, f"from {least:g} to {MAX_DISTANCE_M:g} m")


def _tangent(angle_deg: float) -> float:
    """Tangent of an angle in degrees, to four roundings up to 90 degrees."""
    # Near 90 degrees the angle's complement is exact; its conversion to radians is not.
    if abs(angle_deg) <= 45:
        return math.tan(math.radians(angle_deg))
    return math.copysign(1 / math.tan(math.radians(90 - abs(angle_deg))), angle_deg)


def _line_time(at: Scanners, tangent: float, w: float) -> float:
    """The line time at which the gate's edge has this tilt at a point on the axis; -1 where none does, microseconds."""
    top = at.projector.y - tangent * w * at.projector.per_w
    bottom = at.camera.y - tangent * w * at.camera.per_w
    return top / bottom if top > 0 and bottom > 0 else -1.0


def plan_plane(
    rig: Rig, normal: Vector3, offset_m: float, thickness_m: float, line_time_us: float | None = None
) -> GateSettings:
    """The gate along the plane normal . X = offset_m (world coordinates), `thickness_m` thick across it.

    The plane may lie anywhere, also where it never meets the axis, as a floor does. Its lean to the left or right is
    beyond a gate and is ignored. For the ideal rig the centre plane is exact everywhere: B is the projector's distance
    from the plane over the camera's. For others it is the tangent plane at the point at x = 0 in the middle of the
    camera rows that see the plane. There, too, the thickness is measured (to first order in thickness / distance), and
    about it the plane pivots when a line time is given. Raises InputError for a plane that no gate can follow, and for
    one within 1e-15 m of the camera.

    Ideal rig without a line time: B and with it the line time to two roundings however close the plane passes to the
    camera or the projector, the delay as for `plan`, the exposure to 1e-14 relative. Otherwise the delay is good to
    4 roundings of the times of the point's rows (1e-11 us) and B to 1e-15 of (|y| + |z|) / the distance of the camera
    or the projector, whichever is nearer, from the plane.
    """
    require_slabs(rig)
    _require_metres("thickness_m", thickness_m, MIN_THICKNESS_M)
    y, z = _middle_of_view(rig, normal, offset_m)
    if rig.is_ideal and line_time_us is None:
        return _along(rig, normal, offset_m, thickness_m / z)
    at = scanners(rig, 1 / z, (0.0, y / z, 1.0))
    if line_time_us is None:
        top = at.projector.y * normal[2] - at.projector.z * normal[1]
        bottom = at.camera.y * normal[2] - at.camera.z * normal[1]
        seen = top * bottom > 0
        _require_plane(seen, "normal", normal, _SAME_SIDE)
        line_time_us = top / bottom
    u_y = at.projector.y - line_time_us * at.camera.y
    u_z = at.projector.z - line_time_us * at.camera.z
    delay = at.projector_us - line_time_us * at.camera_row
    return gate(line_time_us, delay, thickness_m / z * math.hypot(u_y, u_z))


def _along(rig: Rig, normal: Vector3, offset_m: float, thickness: float) -> GateSettings:
    """The ideal rig's gate along a plane; `thickness` is the thickness over the depth at which it is measured."""
    across = Fraction(float(normal[1])) * Fraction(rig.baseline_m) / 2
    from_camera, from_projector = Fraction(offset_m) - across, Fraction(offset_m) + across
    seen = from_camera * from_projector > 0
    _require_plane(seen, "normal", normal, _SAME_SIDE)
    lens, row_us = rig.projector.lens, us_per_row(rig.projector)
    B = from_projector / from_camera
    line_time_us = float(B * Fraction(exact_upright_line_time(rig.camera.lens, rig.projector)))
    scale = rig.baseline_m / float(from_camera)  # A = scale n_z, B - 1 = scale n_y
    row_at_axis = Fraction(scale * normal[2] * lens.fy)
    delay = float(infinity_us(rig, line_time_us) + row_at_axis * row_us)
    exposure = thickness * abs(scale) * math.hypot(normal[1], normal[2]) * lens.fy * float(row_us)
    return gate(line_time_us, delay, exposure)


def _require_plane(ok: bool, field: str, value: object, allowed: str) -> None:
    if not ok:
        raise PlaneError(field, value, allowed)


def _middle_of_view(rig: Rig, normal: Vector3, offset_m: float) -> tuple[float, float]:
    """World y and z of the plane's point at x = 0 in the middle of the camera rows that see the plane."""
    require(all(map(math.isfinite, normal)) and any(normal[1:]), "normal", normal, "three finite numbers, not along x")
    require_finite("offset_m", offset_m)
    centre = rig.camera_centre_m
    from_camera = offset_m - float(np.dot(normal, centre))
    lens = rig.camera.lens
    slopes = lens.normalise(lens.cx, np.linspace(0, lens.height, 201))[1]
    # Nearer than this the camera lies in the plane.
    apart = abs(from_camera) > MIN_THICKNESS_M
    inverse_depth = (normal[1] * slopes + normal[2]) / from_camera if apart else np.zeros_like(slopes)
    visible = slopes[inverse_depth > 1e-9]
    _require_plane(visible.size > 0, "offset_m", offset_m, _IN_FRONT)
    slope = float(visible[visible.size // 2])
    depth = from_camera / (normal[1] * slope + normal[2])
    z = depth + float(centre[2])
    _require_plane(z > MIN_THICKNESS_M, "offset_m", offset_m, _BEFORE_RIG)
    return slope * depth + float(centre[1]), z


def _exposure(rig: Rig, line_time_us: float, distance_m: float, thickness_m: float) -> float:
    """Exposure whose edges lie `thickness_m` apart on the axis, as many microseconds before as after the centre."""
    # The ideal rig's edges at w +- h with A +- (v_p / f_p) h: a quadratic in closed form, written so that a thin slab's
    # half exposure is not a difference of two near numbers.
    if rig.is_ideal:
        K = rig.baseline_m * (slope_ratio(rig, line_time_us) + 1) / 2
        A = K / distance_m
        half = A * (thickness_m * A / (K + math.hypot(K, thickness_m * A)))
        return 2 * half * rig.projector.lens.fy / rig.projector.rows_per_us

    def times(nearer_m: float) -> tuple[float, float]:
        """Between near surface and centre, and between centre and far surface; products, so that thin slabs count."""
        near_m, far_m = distance_m - nearer_m, distance_m + (thickness_m - nearer_m)
        near_w = nearer_m / distance_m / near_m
        far_w = (thickness_m - nearer_m) / distance_m / far_m
        near = near_w * time_rate(rig, line_time_us, 1 / near_m, 1 / distance_m)
        return abs(near), abs(far_w * time_rate(rig, line_time_us, 1 / distance_m, 1 / far_m))

    # Any other rig: halve the share of the thickness that lies in front of the centre until both times are equal.
    low, high = 0.0, min(thickness_m, 0.999 * distance_m)
    for _ in range(60):
        middle = (low + high) / 2
        near, far = times(middle)
        low, high = (middle, high) if near < far else (low, middle)
    return sum(times((low + high) / 2))


def plan_on_hardware(rig: Rig, tilt_deg: float, distance_m: float, thickness_m: float) -> Planned:
    """`plan` for what the camera accepts: its nearest line time, then delay and exposure for that one, rounded.

    Rounding the three numbers one by one would move the plane: delay and exposure belong to a line time. Residuals are
    differences of what `slab` reads and what was asked, one rounding.
    """
    exact = plan(rig, tilt_deg, distance_m, thickness_m)
    line_time = rig.camera.shutter.line.nearest(exact.line_time_us)
    refit = plan(rig, tilt_deg, distance_m, thickness_m, line_time)
    return _applied(rig, exact, refit, (tilt_deg, distance_m, thickness_m))


def plan_plane_on_hardware(rig: Rig, normal: Vector3, offset_m: float, thickness_m: float) -> Planned:
    """`plan_plane` for what the camera accepts; what is asked of tilt, distance and thickness is the exact gate's."""
    exact = plan_plane(rig, normal, offset_m, thickness_m)
    line_time = rig.camera.shutter.line.nearest(exact.line_time_us)
    wanted = slab(rig, exact)
    refit = plan_plane(rig, normal, offset_m, thickness_m, line_time)
    return _applied(rig, exact, refit, (wanted.tilt_deg, wanted.distance_m, wanted.thickness_m))


def _applied(
    rig: Rig, exact: GateSettings, refit: GateSettings, wanted: tuple[float, float | None, float | None]
) -> Planned:
    """The settings rounded to the hardware, with what that changes; `wanted`: tilt, distance and thickness."""
    applied = quantise(rig.camera.shutter, refit, rig.projector.period_us)
    got = slab(rig, applied)
    return Planned(
        exact=exact,
        applied=applied,
        slab=got,
        residual_tilt_deg=got.tilt_deg - wanted[0],
        residual_distance_m=_difference(got.distance_m, wanted[1]),
        residual_thickness_m=_difference(got.thickness_m, wanted[2]),
    )


def _difference(got: float | None, wanted: float | None) -> float | None:
    return None if got is None or wanted is None else got - wanted
