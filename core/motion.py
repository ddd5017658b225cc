"""Which pixels a moving body can change: those that may see it, and those whose surface it may keep the light from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from slopegate.core.kernels_render import mark_beams
from slopegate.core.rig import Rig
from slopegate.core.tracing import Placed

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Mask = NDArray[np.bool_]

MARGIN = 1e-4
"""Added to every side of a bound, in x/z: far more than float32 misplaces an outline, less than a pixel."""


class Cone(NamedTuple):
    """Directions x/z and y/z, as one viewer sees them, that hold a body."""

    left: float
    right: float
    top: float
    bottom: float


EVERYWHERE = Cone(-np.inf, np.inf, -np.inf, np.inf)


def cone(points: Doubles, centre: Doubles, rotation: Doubles) -> Cone | None:
    """The cone from `centre` (axes: rotation @ world) round world points (P, 3); None when all lie behind it."""
    local = (points - centre) @ rotation.T
    depth = local[:, 2]
    if not (depth > 0).any():
        return None
    if (depth <= 1e-6).any():
        return EVERYWHERE
    x, y = local[:, 0] / depth, local[:, 1] / depth
    return Cone(x.min() - MARGIN, x.max() + MARGIN, y.min() - MARGIN, y.max() + MARGIN)


class Watch:
    """Finds the pixels that bodies at given poses can change in buffers cast without them."""

    def __init__(self, rig: Rig, projector_row: Singles, beam: Singles) -> None:
        """projector_row (H, W) and beam (H, W, 2) as cast without the moving bodies."""
        self._rig, self._row, self._beam = rig, projector_row, beam
        lens = rig.camera.lens
        columns, rows = np.arange(lens.width) + 0.5, np.arange(lens.height)[:, None] + 0.5
        if lens.distorted:
            self._x, self._y = lens.normalise(columns, rows)
        else:
            self._x, self._y = lens.normalise(columns, 0.5)[0], lens.normalise(0.5, rows)[1]

    def pixels(self, bodies: Sequence[Placed]) -> NDArray[np.int64]:
        """Flat indices, rising, of every pixel that any of the bodies covers or may shade."""
        mask = np.zeros(self._row.shape, np.bool_)
        for placed in bodies:
            points = placed.hull_points()
            seen = cone(points, self._rig.camera_centre_m, np.eye(3))
            if seen is not None:
                across = (self._x >= seen.left) & (self._x <= seen.right)
                mask |= across & (self._y >= seen.top) & (self._y <= seen.bottom)
            shadow = cone(points, self._rig.projector_centre_m, self._rig.rotation)
            if shadow is not None:
                mark_beams(self._row, self._beam, *shadow, mask)
        return np.flatnonzero(mask)
