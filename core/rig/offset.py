"""The delay that a rig has of its own, from a flat target whose distance is known."""

from __future__ import annotations

import math

from slopegate.core.rig.axis import time_on_axis
from slopegate.core.rig.rig import Rig


def delay_offset_us(rig: Rig, line_time_us: float, distance_m: float, found_us: float) -> float:
    """The `delay_offset_us` with which a gate's delay will be the model's, microseconds.

    `found_us` is the delay that lit, with the rig's present offset, what lies straight ahead at this distance. It is
    corrected by less than half a projector period, for a trigger one period later lights the same rows. As accurate as
    `core.axis.time_on_axis`. Raises ValueError for a distance that the rig cannot have.
    """
    missed_us = found_us - time_on_axis(rig, line_time_us, 1 / distance_m)
    return rig.camera.shutter.delay_offset_us + math.remainder(missed_us, rig.projector.period_us)
