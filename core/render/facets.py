"""What bodies show a viewer, cell by cell, so that only those rays are cast whose answer is not known beforehand."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from slopegate.core.render.kernels_facets import Cells, Patch, Raster, Spheres
from slopegate.core.render.kernels_outline import NEAREST_M, draw_round, draw_triangles

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
        patch = self._patch(np.concatenate([corners.reshape(-1, 3), round_.reshape(-1, 3)]))
        shape = patch.height, patch.width
        cells = Cells(self.raster, patch, np.zeros(shape, np.int32), _planes(corners, self.raster))
        draw_triangles(corners, cells, np.zeros(shape, np.float32))
        draw_round(round_, cells)
        return cells

    def _patch(self, points: Doubles) -> Patch:
        """The cells that what lies between points (P, 3), in the viewer's axes, may touch."""
        raster, ahead = self.raster, points[:, 2] > NEAREST_M
        if not ahead.any():
            return Patch(0, 0, 0, 0)
        if not ahead.all():
            return Patch(0, 0, raster.height, raster.width)
        cells = (points[:, :2] / points[:, 2:] - (raster.left, raster.top)) * raster.scale
        size = np.array([raster.width, raster.height])
        left, top = (int(place) for place in np.clip(cells.min(axis=0) - 1, 0, size))
        right, bottom = (int(place) for place in np.clip(cells.max(axis=0) + 2, 0, size))
        return Patch(top, left, bottom - top, right - left)

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


def _planes(corners: Doubles, raster: Raster) -> Doubles:
    """`Cells.planes` of triangles (T, 3, 3) in viewer's axes; not finite where a plane holds the viewer."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    away = (normal * corners[:, 0]).sum(axis=1)
    at_corner = normal[:, 0] * raster.left + normal[:, 1] * raster.top + normal[:, 2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        planes = np.stack([normal[:, 0] / raster.scale, normal[:, 1] / raster.scale, at_corner]) / away
    return np.ascontiguousarray(planes.T)


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
