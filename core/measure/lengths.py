"""Lengths in space of what is seen in the image: by depth, or by the surface in the middle of the gate's slab."""

from __future__ import annotations

import math

import numpy as np

from slopegate.core.gating.gate import rows_at_phase, slab_if_any
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.triangulate import inverse_depth

Spot = tuple[float, float]
"""Continuous column and row."""


def at_depth(rig: Rig, spot: Spot, inverse_depth_per_m: float) -> Doubles | None:
    """Where a ray of the camera is at this 1/z, (3,) metres; None where that is nowhere before the camera."""
    if not inverse_depth_per_m > 0:
        return None
    return np.asarray(rig.camera_centre_m + rig.camera_rays(*spot) / inverse_depth_per_m, np.float64)


def in_slab(rig: Rig, settings: GateSettings, spot: Spot) -> Doubles | None:
    """Where a ray of the camera meets the middle of the gate's slab, (3,) metres; None where it does not."""
    found = slab_if_any(rig, settings).slab
    if found is None or found.distance_m is None or found.thickness_m is None:
        return None
    phase = settings.delay_us - found.frame * rig.projector.period_us
    row = rows_at_phase(rig, settings.line_time_us, np.array([spot[1]]), float(phase))
    inverse, met = inverse_depth(rig, rig.camera_rays(spot[0], spot[1])[None], row)
    return at_depth(rig, spot, float(inverse[0])) if met[0] else None


def metres_per_pixel(rig: Rig, distance_m: float) -> float | None:
    """How long a pixel in the middle of a row is at this distance on the axis; None where that is behind the camera."""
    depth = distance_m - float(rig.camera_centre_m[2])
    if not (depth > 0 and math.isfinite(depth)):
        return None
    lens = rig.camera.lens
    ends = rig.camera_rays([lens.width / 2 - 0.5, lens.width / 2 + 0.5], [lens.height / 2] * 2)
    return depth * float(np.linalg.norm(ends[1] - ends[0]))


def round_length(longest_m: float) -> float:
    """The greatest of 1, 2 or 5 times a power of ten that is no longer than this, metres."""
    power = 10.0 ** math.floor(math.log10(longest_m))
    return max(step * power for step in (1, 2, 5) if step * power <= longest_m * (1 + 1e-12))


def length_text(metres: float) -> str:
    """A length in the unit that suits it."""
    for least, scale, unit in ((1000.0, 1e-3, "km"), (1.0, 1.0, "m"), (0.01, 100.0, "cm")):
        if metres >= least:
            return f"{metres * scale:.4g} {unit}"
    return f"{metres * 1000:.3g} mm"
