"""The way back: from a wanted plane and thickness to settings (model section 3, inverse design)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from slopegate.core.axis import scanners, time_on_axis
from slopegate.core.checks import require, require_positive
from slopegate.core.gate import Slab, slab, slope_ratio
from slopegate.core.rig import Rig
from slopegate.core.settings import GateSettings, gate, quantise


@dataclass(frozen=True)
class Planned:
    """Settings for a wanted slab: unrounded, as the hardware does them, and what the rounding costs (got - wanted).

    A residual is None where the applied slab has no finite value.
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

    Given a line time, the tilt follows from it and delay and exposure hold distance and thickness. Exact for every rig
    up to float64 rounding (through a distorted lens the tilt to 1e-8 degrees). Raises ValueError for values that are
    not finite, not positive, or a plane that no line time makes: |tan tilt| < 2 distance / baseline for the ideal rig.
    """
    require_positive("distance_m", distance_m)
    require_positive("thickness_m", thickness_m)
    if line_time_us is None:
        line_time_us = _line_time(rig, tilt_deg, distance_m)
    delay = time_on_axis(rig, line_time_us, 1 / distance_m)
    return gate(line_time_us, delay, _exposure(rig, line_time_us, distance_m, thickness_m))


def _line_time(rig: Rig, tilt_deg: float, distance_m: float) -> float:
    require(math.isfinite(tilt_deg) and abs(tilt_deg) < 90, "tilt_deg", tilt_deg, "between -90 and 90")
    w = 1 / distance_m
    at, tangent = scanners(rig, w), math.tan(math.radians(tilt_deg))
    top = at.projector.y - tangent * w * at.projector.per_w
    bottom = at.camera.y - tangent * w * at.camera.per_w
    allowed = f"less steep for a plane {distance_m:g} m away: it would pass between the camera and the projector"
    require(top > 0 and bottom > 0, "tilt_deg", tilt_deg, allowed)
    return top / bottom


def _exposure(rig: Rig, line_time_us: float, distance_m: float, thickness_m: float) -> float:
    """Exposure whose edges lie `thickness_m` apart on the axis, as many microseconds before as after the centre."""
    if rig.is_ideal:
        K = rig.baseline_m * (slope_ratio(rig, line_time_us) + 1) / 2
        A = K / distance_m
        half = A * (thickness_m * A / (K + math.hypot(K, thickness_m * A)))
        return 2 * half * rig.projector.lens.fy / rig.projector.rows_per_us
    centre = time_on_axis(rig, line_time_us, 1 / distance_m)

    def times(near_m: float) -> tuple[float, float]:
        far_m = near_m + thickness_m
        return time_on_axis(rig, line_time_us, 1 / near_m), time_on_axis(rig, line_time_us, 1 / far_m)

    low, high = max(distance_m - thickness_m, 1e-3 * distance_m), distance_m
    for _ in range(100):
        middle = (low + high) / 2
        near, far = times(middle)
        later = (near - centre) > (centre - far)
        low, high = (middle, high) if later == (near > far) else (low, middle)
    near, far = times((low + high) / 2)
    return abs(near - far)


def plan_on_hardware(rig: Rig, tilt_deg: float, distance_m: float, thickness_m: float) -> Planned:
    """The same for what the camera accepts: line time first, then delay and exposure for *that* line time, rounded."""
    exact = plan(rig, tilt_deg, distance_m, thickness_m)
    line_time = rig.camera.shutter.line.nearest(exact.line_time_us)
    refit = plan(rig, tilt_deg, distance_m, thickness_m, line_time)
    applied = quantise(rig.camera.shutter, refit, rig.projector.period_us)
    got = slab(rig, applied)
    return Planned(
        exact=exact,
        applied=applied,
        slab=got,
        residual_tilt_deg=got.tilt_deg - tilt_deg,
        residual_distance_m=None if got.distance_m is None else got.distance_m - distance_m,
        residual_thickness_m=None if got.thickness_m is None else got.thickness_m - thickness_m,
    )
