"""Which pixels a moving body can change: those that may see it, and those whose surface it may keep the light from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from slopegate.core.kernels_render import mark_beams
from slopegate.core.tracing import RAYS_PER_BAND, Placed, Tracer

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Test: TypeAlias = Callable[[Doubles, Doubles, Doubles, Placed], Mask]

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
    """Finds the pixels that bodies at given poses change in buffers cast without them.

    Bounds pick the candidates; one test ray each at the body alone decides, far cheaper than casting them anew.
    """

    def __init__(self, tracer: Tracer, projector_row: Singles, depth: Doubles, beam: Singles) -> None:
        """projector_row (H, W), depth (H, W) and beam (H, W, 2) as cast through pixel centres without the bodies."""
        self._tracer, self._row, self._depth, self._beam = tracer, projector_row, depth, beam
        lens = tracer.rig.camera.lens
        columns, rows = np.arange(lens.width) + 0.5, np.arange(lens.height)[:, None] + 0.5
        if lens.distorted:
            self._x, self._y = lens.normalise(columns, rows)
        else:
            self._x, self._y = lens.normalise(columns, 0.5)[0], lens.normalise(0.5, rows)[1]

    def pixels(self, bodies: Sequence[Placed]) -> Indices:
        """Flat indices, rising, of every pixel in which any of the bodies is seen or shades what is seen."""
        mask = np.zeros(self._row.shape, np.bool_)
        for placed in bodies:
            points = placed.hull_points()
            for candidates, test in (
                (self._may_cover(points), self._tracer.covered),
                (self._may_shade(points), self._tracer.shaded),
            ):
                self._confirm(candidates, test, placed, mask.reshape(-1))
        return np.flatnonzero(mask)

    def _may_cover(self, points: Doubles) -> Mask:
        rig = self._tracer.rig
        seen = cone(points, rig.camera_centre_m, np.eye(3))
        if seen is None:
            return np.zeros(self._row.shape, np.bool_)
        across = (self._x >= seen.left) & (self._x <= seen.right)
        return np.asarray(across & (self._y >= seen.top) & (self._y <= seen.bottom))

    def _may_shade(self, points: Doubles) -> Mask:
        rig = self._tracer.rig
        mask = np.zeros(self._row.shape, np.bool_)
        shadow = cone(points, rig.projector_centre_m, rig.rotation)
        if shadow is not None:
            mark_beams(self._row, self._beam, *shadow, mask)
        return mask

    def _confirm(self, candidates: Mask, test: Test, placed: Placed, mask: Mask) -> None:
        pixels = np.flatnonzero(candidates)
        for start in range(0, len(pixels), RAYS_PER_BAND):
            band = pixels[start : start + RAYS_PER_BAND]
            rows, columns = np.divmod(band, self._row.shape[1])
            mask[band] |= test(columns + 0.5, rows + 0.5, self._depth.reshape(-1)[band], placed)
