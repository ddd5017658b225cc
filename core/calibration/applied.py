"""A calibration put into a rig, and beside the one before it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from slopegate.core.calibration.geometry import Geometry
from slopegate.core.calibration.timing import GateTiming
from slopegate.core.calibration.timing_errors import TimingErrors
from slopegate.core.rig.calibration import GEOMETRY, NUMBERS, TIMING, Calibration, as_rows, joined
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.rig.uncertainty import numbers_of, with_numbers
from slopegate.core.rig.variants import in_scan_order

Facts = tuple[tuple[str, str], ...]


def with_geometry(rig: Rig, geometry: Geometry, facts: Facts) -> Rig:
    """The rig with these lenses and this pose, whose rows count as in the pictures that were calibrated with.

    What the geometry does not tell (shutter, period, blur) stays. `facts` say where it comes from.
    """
    told = Calibration(GEOMETRY, as_rows(geometry.covariance), facts)
    return replace(
        rig,
        camera=replace(rig.camera, lens=geometry.camera),
        projector=replace(rig.projector, lens=geometry.projector),
        projector_offset_m=geometry.offset_m,
        projector_rotation=geometry.rotation,
        calibration=joined(rig.calibration, told),
    )


def with_timing(rig: Rig, timing: GateTiming, errors: TimingErrors, facts: Facts) -> Rig:
    """The rig with this timing, in scan order; its numbers and its geometry's err together as `errors` says.

    What the clock of a camera counts is taken up by clocks_per_line; where line times are set directly, nothing is.
    """
    line, values = rig.camera.shutter.line, numbers_of(rig)
    clocks = line.clocks_per_line * timing.stretch if isinstance(line, PixelClocks) else 0.0
    # A camera whose delays come out too long is to be told shorter ones.
    offset = rig.camera.shutter.delay_offset_us - timing.offset_us
    values[len(GEOMETRY) :] = timing.period_us, timing.active_fraction, clocks, offset
    kept = [place for place, name in enumerate(TIMING) if clocks or name != "clocks_per_line"]
    told = Calibration(tuple(TIMING[place] for place in kept), as_rows(errors.covariance[np.ix_(kept, kept)]), facts)
    tied = {name: errors.by_geometry[kept, place] for place, name in enumerate(GEOMETRY)}
    known = joined(rig.calibration, told, tied)
    told_rig = replace(with_numbers(rig, values), calibration=known)
    return in_scan_order(told_rig, timing.camera == "up", timing.projector == "up")


@dataclass(frozen=True)
class Difference:
    """A number of two calibrations of one rig: both values, and by how many standard errors of both they differ.

    `sigmas` is infinite where neither has an uncertainty and the values differ.
    """

    name: str
    old: float
    new: float
    standard_error: float
    sigmas: float


def differences(old: Rig, new: Rig) -> tuple[Difference, ...]:
    """All `NUMBERS` of the new calibration beside the old rig's; those that neither tells are left out."""
    errors = [one.calibration.standard_errors if one.calibration else {} for one in (old, new)]
    before, after = numbers_of(old), numbers_of(new)
    found = []
    for place, name in enumerate(NUMBERS):
        if all(name not in known for known in errors):
            continue
        error = math.hypot(*(known.get(name, 0.0) for known in errors))
        gap = abs(float(after[place] - before[place]))
        sigmas = gap / error if error > 0 else (np.inf if gap > 0 else 0.0)
        found.append(Difference(name, float(before[place]), float(after[place]), error, float(sigmas)))
    return tuple(found)
