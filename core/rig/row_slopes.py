"""Where a rig's two lenses show points, with the derivatives by every one of the rig's numbers, in closed form.

What an uncertainty is carried through where `uncertainty.spread` would be too slow: a read-out beside a slider, a map.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import LENS, NUMBERS
from slopegate.core.rig.rig import Lens, Rig

OFFSET: Final = slice(NUMBERS.index("offset_x_m"), NUMBERS.index("offset_z_m") + 1)
_TURN: Final = slice(NUMBERS.index("rotation_x_rad"), NUMBERS.index("rotation_z_rad") + 1)
_SLOPES: Final = 6
"""OpenCV's derivatives by rotation and shift come first, then those by focal lengths, centre and distortion."""


@dataclass(frozen=True, eq=False)
class ShownPoints:
    """Pixels (N, 2), column and row, of N points, and their derivatives by the points (N, 2, 3) and by `NUMBERS`
    (N, 2, 28)."""

    pixels: Doubles
    by_points: Doubles
    by_numbers: Doubles


def seen(rig: Rig, points: Doubles) -> ShownPoints:
    """Where the camera sees points (N, 3) in front of it, in its own axes, from its centre; of any scale."""
    found, _ = _shown(rig.camera.lens, points, np.zeros(3), NUMBERS.index("camera.fx"))
    return found


def lit(rig: Rig, points: Doubles) -> ShownPoints:
    """Where the projector lights points (N, 3) in front of it, in the camera's axes, from the projector's centre."""
    import cv2  # large, and only calibrated rigs need it

    turn = np.asarray(cv2.Rodrigues(rig.rotation)[0], np.float64).ravel()
    found, by_turn = _shown(rig.projector.lens, points, turn, NUMBERS.index("projector.fx"))
    found.by_numbers[..., _TURN] = by_turn
    return ShownPoints(found.pixels, found.by_points @ rig.rotation, found.by_numbers)


def _shown(lens: Lens, points: Doubles, turn: Doubles, first: int) -> tuple[ShownPoints, Doubles]:
    """What the lens shows of points that it sees turned, by the turned points; and the derivatives by the turn."""
    import cv2

    bent = np.array([*lens.distortion, *[0.0] * 5][: max(5, len(lens.distortion))])
    pixels, slopes = cv2.projectPoints(points.reshape(-1, 1, 3), turn, np.zeros(3), lens.matrix, bent)
    by_all = np.asarray(slopes, np.float64).reshape(len(points), 2, -1)
    by_numbers = np.zeros((len(points), 2, len(NUMBERS)))
    by_numbers[..., first : first + len(LENS)] = by_all[..., _SLOPES : _SLOPES + len(LENS)]
    return ShownPoints(np.asarray(pixels, np.float64).reshape(-1, 2), by_all[..., 3:_SLOPES], by_numbers), by_all[
        ..., :3
    ]
