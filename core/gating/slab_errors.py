"""How well a gate's slab is known where the rig was calibrated: the standard errors of what `gate.slab` reads.

Where an edge of the gate meets the axis follows from u(w) = t, with u = row_p / v_p - line_time row_c and t the edge's
time. So dw = (dt - du) / u_w for every number of the rig, and distances, thickness and tilt follow from w. All
derivatives are in closed form, but those of its angles by differences along the gate's edge: a read-out takes less time
than the slab itself. `uncertainty.spread` finds the same by drawing the rig anew (tests hold one to the other).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import NUMBERS
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.row_slopes import OFFSET, ShownPoints, lit, seen
from slopegate.core.rig.settings import GateSettings, PixelClocks

_ASIDE: Final = 1e-4
"""How far beside the axis the edge's slope is looked at, as a share of the distance."""
_PERIOD, _ACTIVE, _CLOCKS, _LATE = (
    NUMBERS.index(name) for name in ("period_us", "active_fraction", "clocks_per_line", "delay_offset_us")
)


@dataclass(frozen=True)
class SlabErrors:
    """One standard error of each read-out of a `gate.Slab`, by the calibration of its rig; None where that has no
    value."""

    tilt_deg: float
    turn_deg: float
    distance_m: float | None
    near_m: float | None
    far_m: float | None
    thickness_m: float | None


Three = tuple[float, float, float]
"""Of the far surface, the centre plane and the near surface."""


def slab_errors(
    rig: Rig, settings: GateSettings, frame: int, inverse_per_m: Three, metres: tuple[float | None, ...]
) -> SlabErrors | None:
    """Of the slab that these settings make of the light of this projector frame; None where the rig was not calibrated.

    inverse_per_m and metres: where its surfaces meet the axis, the far one, the centre and the near one.
    """
    known = rig.calibration
    if known is None:
        return None
    w = np.array([*inverse_per_m, *[inverse_per_m[1]] * 6])
    points = np.tile([0.0, 0.0, 1.0], (9, 1))
    for axis in range(3):
        points[3 + 2 * axis : 5 + 2 * axis, axis] += (_ASIDE, -_ASIDE)
    edge = _Edge(rig, settings, points, w)
    late = np.zeros(len(NUMBERS))
    late[[_PERIOD, _LATE]] = -frame, -1.0
    moved = (late - edge.by_numbers[:3]) / edge.by_w[:3, None]
    places = [NUMBERS.index(name) for name in known.names]

    def error(slopes: Doubles) -> float:
        return math.sqrt(max(0.0, float(slopes[places] @ known.array @ slopes[places])))

    far, distance, near = (None if at is None else -moved[place] * at**2 for place, at in enumerate(metres))
    tilt, turn = edge.angles(moved[1])
    return SlabErrors(
        tilt_deg=error(tilt),
        turn_deg=error(turn),
        distance_m=None if distance is None else error(distance),
        near_m=None if near is None else error(near),
        far_m=None if far is None else error(far),
        thickness_m=None if near is None or far is None else error(far - near),
    )


class _Edge:
    """The time u at which the projector's light would have to come to points / w (N, 3), (N,), and its slopes."""

    def __init__(self, rig: Rig, settings: GateSettings, points: Doubles, w: Doubles) -> None:
        half = np.array(rig.projector_offset_m) / 2
        camera, projector = seen(rig, points + w[:, None] * half), lit(rig, points - w[:, None] * half)
        self._row_us, self._line_us = 1 / rig.projector.rows_per_us, settings.line_time_us
        self.by_w = self._time(projector.by_points @ -half, camera.by_points @ half)
        self._by_points = self._time(projector.by_points, camera.by_points)
        self.by_numbers = self._time(projector.by_numbers, camera.by_numbers)
        apart = w[:, None, None] / 2
        self.by_numbers[:, OFFSET] += self._time(-apart * projector.by_points, apart * camera.by_points)
        self._add_times(rig, projector, camera)

    def _time(self, projector: Doubles, camera: Doubles) -> Doubles:
        """What the two rows (N, 2, ...), with their columns, make of the time."""
        return projector[:, 1] * self._row_us - camera[:, 1] * self._line_us

    def _add_times(self, rig: Rig, projector: ShownPoints, camera: ShownPoints) -> None:
        lit_us = projector.pixels[:, 1] * self._row_us
        self.by_numbers[:, _PERIOD] = lit_us / rig.projector.period_us
        self.by_numbers[:, _ACTIVE] = lit_us / rig.projector.active_fraction
        line = rig.camera.shutter.line
        if isinstance(line, PixelClocks):  # the camera keeps its clock
            self.by_numbers[:, _CLOCKS] = -camera.pixels[:, 1] * self._line_us / line.clocks_per_line

    def angles(self, moved: Doubles) -> tuple[Doubles, Doubles]:
        """Derivatives (28,) of tilt and turn in degrees where the centre's w moves by `moved` (28,).

        They are those of the gradient across the edge at point 1, as it changes between points 3 and 4 (x), 5 and 6
        (y), 7 and 8 (z).
        """
        ahead = self._by_points[1, 2]
        beside = self.by_numbers + self.by_w[:, None] * moved
        by_x, by_y, by_z = ((beside[first] - beside[first + 1]) / (2 * _ASIDE) for first in (3, 5, 7))

        def angle(aside: float, by_aside: Doubles) -> Doubles:
            return np.asarray(np.degrees((ahead * by_aside - aside * by_z) / (aside**2 + ahead**2)), np.float64)

        return angle(self._by_points[1, 1], by_y), angle(self._by_points[1, 0], by_x)
