"""A calibration beside the one before it: which numbers moved, and where a gate stood really that was set with the old.

Both rigs are in scan order, so where one of them takes rows to go the other way, the old one is turned first: else all
numbers would differ for one reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.calibration.applied import Difference, differences
from slopegate.core.gating.gate import Slab, slab_if_any
from slopegate.core.gating.plan import plan
from slopegate.core.rig.calibration import unit_of
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.plus_minus import plus_minus
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.uncertainty import really_made
from slopegate.core.rig.variants import in_scan_order

FAR_APART: Final = 3.0
"""Standard errors of both calibrations from which on a number is said to have moved."""
TYPICAL_M: Final = 1.0
"""Distance of the upright gate that both rigs are compared by."""
_THICKNESS_M: Final = 0.1
_MOST_TOLD: Final = 6


@dataclass(frozen=True, eq=False)
class Compared:
    """What a new calibration says of an old rig.

    differences: of all numbers that either tells. turned: which rows go the other way than the old rig has them.
    settings: of an upright gate at `distance_m`, planned with the old rig, None where it has no such gates; really: the
    slab that they make on the new rig, with its errors, None where there is none.
    """

    differences: tuple[Difference, ...]
    turned: tuple[str, ...]
    distance_m: float
    settings: GateSettings | None
    really: Slab | None

    @property
    def moved(self) -> tuple[Difference, ...]:
        """The numbers that differ by more than `FAR_APART` standard errors of both, the farthest first."""
        far = [one for one in self.differences if one.sigmas > FAR_APART]
        return tuple(sorted(far, key=lambda one: -one.sigmas))

    @property
    def sentences(self) -> tuple[str, ...]:
        """The same for people: rows, numbers, and the gate."""
        return tuple(self._sentences())

    def _sentences(self) -> Iterator[str]:
        for which in self.turned:
            yield f"the {which}'s rows are scanned the other way than the old rig has them"
        moved, count = self.moved, len(self.differences)
        if not moved:
            yield f"none of {count} numbers moved by more than {FAR_APART:g} standard errors"
        else:
            told = "; ".join(map(_told, moved[:_MOST_TOLD]))
            more = f"; and {len(moved) - _MOST_TOLD} more" if len(moved) > _MOST_TOLD else ""
            yield f"{len(moved)} of {count} numbers moved by more than {FAR_APART:g} standard errors: {told}{more}"
        if self.settings is None:
            return
        gate = f"a gate that the old rig has upright at {self.distance_m:g} m"
        if self.really is None or self.really.distance_m is None:
            yield f"{gate} stands nowhere in front of the new one"
            return
        errors = self.really.errors
        distance = (
            plus_minus(self.really.distance_m, errors.distance_m or 0.0) if errors else f"{self.really.distance_m:.4g}"
        )
        tilt = plus_minus(self.really.tilt_deg, errors.tilt_deg) if errors else f"{self.really.tilt_deg:.2f}"
        yield f"{gate} really stands at {distance} m, tilted by {tilt} degrees"


def compared(old: Rig, new: Rig, distance_m: float = TYPICAL_M) -> Compared:
    """The old rig, calibrated or not, beside the new one, which was calibrated."""
    ups = _ups(old, new)
    turned = tuple(which for which, up in zip(("camera", "projector"), ups, strict=True) if up)
    settings = _gate(old, distance_m)
    really = None
    if settings is not None:
        late_us = old.camera.shutter.delay_offset_us - new.camera.shutter.delay_offset_us
        really = slab_if_any(new, really_made(old, settings, new, late_us)).slab
    return Compared(differences(in_scan_order(old, *ups), new), turned, distance_m, settings, really)


def _told(one: Difference) -> str:
    unit = unit_of(one.name)
    by = f"{one.sigmas:.1f}" if np.isfinite(one.sigmas) else "it had none"
    # enough figures to show the difference
    decimals = max(0, 2 - int(np.floor(np.log10(abs(one.new - one.old)))))
    return f"{one.name} from {one.old:.{decimals}f} to {one.new:.{decimals}f}{unit} ({by})"


def _gate(rig: Rig, distance_m: float) -> GateSettings | None:
    try:
        return plan(rig, 0.0, distance_m, _THICKNESS_M)
    except InputError:  # a rig whose gates are no slabs, or none that stands upright there
        return None


def _ups(old: Rig, new: Rig) -> tuple[bool, bool]:
    """Whether camera and projector rows have to be counted from the other end for the old rig to look like the new."""

    def apart(ups: tuple[bool, bool]) -> float:
        other = in_scan_order(old, *ups)
        offsets = [np.array(rig.projector_offset_m) / rig.baseline_m for rig in (other, new)]
        return float(np.linalg.norm(other.rotation - new.rotation) + np.linalg.norm(offsets[0] - offsets[1]))

    ways = ((False, False), (False, True), (True, False), (True, True))
    return min(ways, key=apart)
