"""What bodies show a viewer, cell by cell, so that only those rays are cast whose answer is not known beforehand."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from slopegate.core.kernels_facets import Cells, Patch, Raster, Spheres
from slopegate.core.kernels_outline import NEAREST_M, draw_round, draw_triangles, extent, lay_planes

Doubles = NDArray[np.float64]

MAX_CELLS: Final = 1 << 22
_SIDES: Final = 16


class View:
    """A viewer and the directions that matter to it."""

    def __init__(self, centre: Doubles, rotation: Doubles, low: Doubles, high: Doubles, pitch: float) -> None:
        """low and high: the least and greatest (x/z, y/z); pitch: the size of a cell, enlarged if there are many."""
        self._centre, self._rotation = centre, rotation
        extents = np.maximum(high - low, pitch)
        scale = 1 / max(pitch, float(np.sqrt(np.prod(extents) / MAX_CELLS)))
        width, height = (int(count) for count in np.ceil(extents * scale) + 1)
        self.raster = Raster(float(low[0]), float(low[1]), scale, width, height)
        # What lies nearer than NEAREST_M along the axis, and in a direction that matters, is nearer than this.
        self._close_m = NEAREST_M * float(np.sqrt(1 + (np.maximum(abs(low), abs(high)) ** 2).sum()))

    def look(self, triangles: Doubles, spheres: Spheres, rotation: Doubles, position: Doubles) -> Cells:
        """The cells of a body at a pose (a point p of it is at rotation p + position); triangles (T, 3, 3)."""
        turn = self._rotation @ rotation
        shift = self._rotation @ (position - self._centre)
        corners = (triangles.reshape(-1, 3) @ turn.T + shift).reshape(triangles.shape)
        round_ = _outlines(spheres.centres @ turn.T + shift, spheres.radii)
        if round_ is None or self._touched(corners):
            return ask_everywhere()
        raster = self.raster
        box = np.array([raster.height, -1, raster.width, -1])
        extent(corners, raster, box)
        extent(round_, raster, box)
        top, left = max(int(box[0]), 0), max(int(box[2]), 0)
        height = max(min(int(box[1]), raster.height - 1) + 1 - top, 0)
        width = max(min(int(box[3]), raster.width - 1) + 1 - left, 0)
        patch = Patch(top, left, height, width)
        cells = Cells(raster, patch, np.zeros((height, width), np.int32), np.empty((len(corners), 3)))
        lay_planes(corners, raster, cells.planes)
        draw_triangles(corners, cells, np.zeros((height, width), np.float32))
        draw_round(round_, cells)
        return cells

    def _touched(self, corners: Doubles) -> bool:
        """Whether a triangle comes so near to the viewer that what is cut off of it may matter."""
        depth = corners[:, :, 2]
        cut = corners[(depth <= NEAREST_M).any(axis=1) & (depth > 0).any(axis=1)]
        normal = np.cross(cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0])
        distance = np.abs((normal * cut[:, 0]).sum(axis=1))
        return bool((distance <= self._close_m * np.sqrt((normal**2).sum(axis=1))).any())


def ask_everywhere() -> Cells:
    """Cells that know nothing: every ray is cast."""
    return Cells(Raster(0.0, 0.0, 1.0, 0, 0), Patch(0, 0, 0, 0), np.zeros((0, 0), np.int32), np.zeros((0, 3)))


def _outlines(centres: Doubles, radii: Doubles) -> Doubles | None:
    """Polygons (S, 16, 3) in the viewer's axes that hide spheres from it; None where one may be seen anywhere.

    They stand about the circle in which the cone of sight touches the sphere.
    """
    before = centres[:, 2] + radii > 0
    centres, radii = centres[before], radii[before]
    square = (centres**2).sum(axis=1)
    if (square <= radii**2 * (1 + 1e-6)).any():
        return None
    share = radii**2 / square
    along = centres / np.sqrt(square)[:, None]
    across = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    across /= np.sqrt((across**2).sum(axis=1, keepdims=True))
    up = np.cross(along, across)
    size = radii * np.sqrt(1 - share) / np.cos(np.pi / _SIDES)
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    turned = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * up[:, None]
    points = (centres * (1 - share)[:, None])[:, None] + size[:, None, None] * turned
    return None if (points[..., 2] <= NEAREST_M).any() else np.ascontiguousarray(points)
