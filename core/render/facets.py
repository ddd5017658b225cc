"""What a body shows a viewer, drawn into a raster of cells: rays are cast only where that leaves the answer open.

The viewer is the camera, for which triangle a ray meets, or the projector, for what lies in shadow. `kernels_facets`
holds the cells and reads them.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.render.kernels_facets import ASK, FIRST, ROUND, CellRaster, Cells, Patch, Spheres
from slopegate.core.rig.arrays import Doubles, Singles

MARGIN: Final = 0.25
"""How far round a cell is looked, in cells: float32 misplaces an outline by 1e-3 of a cell."""

NEAREST_M: Final = 1e-3
"""Triangles are cut off nearer than this to the plane through the viewer."""

ALMOST: Final = 1 - 1e-5
"""What is behind by less than this share may be before: float32 misplaces it by 1e-6."""

SHEER: Final = 0.02
"""Triangles whose inverse depth changes by more than this share within a cell are seen too edge-on to be sure of."""


MAX_CELLS: Final = 1 << 22
"""Most cells of a viewer's raster; larger ones in place of more."""

_SIDES: Final = 16
"""Corners of the polygon that stands for a sphere's outline."""


@njit(cache=True, nogil=True, error_model="numpy")
def _outline(corners: Doubles, raster: CellRaster, polygon: Doubles) -> int:
    """The part of a convex polygon (n, 3) in viewer's axes beyond NEAREST_M as cells (m, 2); returns m, 0 for none."""
    count, found = corners.shape[0], 0
    for i in range(count):
        j = (i + 1) % count
        az, bz = corners[i, 2], corners[j, 2]
        # Sutherland and Hodgman's clipping at the near plane: an edge that crosses it adds the crossing.
        ends = 2 if (az > NEAREST_M) != (bz > NEAREST_M) else 1
        for end in range(ends):
            x, y, z = corners[i, 0], corners[i, 1], az
            if end == 1:
                share = (NEAREST_M - az) / (bz - az)
                x, y, z = x + share * (corners[j, 0] - x), y + share * (corners[j, 1] - y), NEAREST_M
            elif az <= NEAREST_M:
                continue
            polygon[found, 0] = (x / z - raster.left) * raster.scale
            polygon[found, 1] = (y / z - raster.top) * raster.scale
            found += 1
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _band(polygon: Doubles, count: int, low: float, high: float) -> tuple[float, float]:
    """Least and greatest column of a convex polygon between rows low and high; inf, -inf where it has none there."""
    left, right = np.inf, -np.inf
    for i in range(count):
        ax, ay = polygon[i, 0], polygon[i, 1]
        bx, by = polygon[(i + 1) % count, 0], polygon[(i + 1) % count, 1]
        if max(ay, by) < low or min(ay, by) > high:
            continue
        slope = (bx - ax) / (by - ay) if ay != by else 0.0
        for y, x in ((ay, ax), (by, bx)):
            cut = min(max(y, low), high)
            at = x + (cut - y) * slope
            left, right = min(left, at), max(right, at)
    return left, right


@njit(cache=True, nogil=True, error_model="numpy")
def _span(polygon: Doubles, count: int, row: int, first: int, width: int, filled: bool) -> tuple[int, int]:
    """First and last of `width` cells from column `first` on in this row that a convex polygon may touch.

    filled: that it surely fills, margin included, instead.
    """
    low, high = row - MARGIN, row + 1.0 + MARGIN
    left, right = _band(polygon, count, low, low if filled else high)
    # A convex polygon fills between two rows what it fills at both of them; it touches what it touches at any height.
    if filled:
        other_left, other_right = _band(polygon, count, high, high)
        left, right = np.ceil(max(left, other_left) + MARGIN), np.floor(min(right, other_right) - MARGIN) - 1
    else:
        left, right = np.floor(left - MARGIN), np.floor(right + MARGIN)
    return int(min(max(left - first, 0.0), width)), int(max(min(right - first, width - 1.0), -1.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _rows(polygon: Doubles, count: int, first: int, height: int) -> tuple[int, int]:
    """First and last of `height` rows from row `first` on that a polygon may touch."""
    top, bottom = polygon[0, 1], polygon[0, 1]
    for i in range(1, count):
        top, bottom = min(top, polygon[i, 1]), max(bottom, polygon[i, 1])
    start = int(min(max(np.floor(top - MARGIN) - first, 0.0), height))
    return start, int(max(min(np.floor(bottom + MARGIN) - first, height - 1.0), -1.0))


@njit(cache=True, nogil=True, error_model="numpy")
def draw_triangles(corners: Doubles, cells: Cells, nearest: Singles) -> None:
    """Fill cells.what from triangles (T, 3, 3) in viewer's axes. nearest (h, w): zeros, for the kernel's own use.

    First the nearest triangle that fills each cell; then all that touch a cell and may be nearer make it uncertain.
    """
    raster, patch, what, planes = cells.raster, cells.patch, cells.what, cells.planes
    top, left, height, width = patch.first_row, patch.first_column, patch.height, patch.width
    polygon = np.empty((6, 2))
    # Two rounds over the triangles in one loop: all must have filled before any is judged to lie behind.
    for turn in range(2 * corners.shape[0]):
        filling, t = turn < corners.shape[0], turn % corners.shape[0]
        count = _outline(corners[t], raster, polygon)
        if count == 0:
            continue
        a, b, c = planes[t, 0], planes[t, 1], planes[t, 2]
        mark, spread = np.int32(t + FIRST), (abs(a) + abs(b)) * (0.5 + MARGIN)
        least_z = min(corners[t, 0, 2], corners[t, 1, 2], corners[t, 2, 2])
        most = 1.0 / least_z if least_z > NEAREST_M else np.inf
        first, last = _rows(polygon, count, top, height)
        for r in range(first, last + 1):
            start, end = _span(polygon, count, r + top, left, width, filling)
            at_left = a * (left + 0.5) + b * (r + top + 0.5) + c
            i, until = np.uint64(r), np.uint64(end + 1)
            # Inverse depth is affine over the picture of a plane, so within a cell it is the middle's -+ spread.
            if filling:
                for k in range(np.uint64(start), until):
                    middle, held = at_left + a * np.float64(np.int64(k)), nearest[i, k]
                    low = np.float32(middle - spread)
                    better = (low > held) & (spread <= SHEER * middle)
                    nearest[i, k] = low if better else held
                    what[i, k] = mark if better else what[i, k]
            else:
                for k in range(np.uint64(start), until):
                    own, enough = what[i, k], nearest[i, k] * ALMOST
                    # Not a number where the plane holds the viewer: then it is not behind.
                    behind = (at_left + a * np.float64(np.int64(k)) + spread < enough) | (most < enough)
                    what[i, k] = own if (own == mark) | (behind & (own >= FIRST)) else np.int32(ASK)


@njit(cache=True, nogil=True, error_model="numpy")
def draw_round(outlines: Doubles, cells: Cells) -> None:
    """Add ROUND to the cells that convex polygons (S, n, 3) in viewer's axes may touch."""
    raster, patch, what = cells.raster, cells.patch, cells.what
    polygon = np.empty((2 * outlines.shape[1], 2))
    for s in range(outlines.shape[0]):
        count = _outline(outlines[s], raster, polygon)
        if count == 0:
            continue
        first, last = _rows(polygon, count, patch.first_row, patch.height)
        for r in range(first, last + 1):
            start, end = _span(polygon, count, r + patch.first_row, patch.first_column, patch.width, False)
            for k in range(start, end + 1):
                what[r, k] |= ROUND


class Viewer:
    """The camera or the projector as a viewer: where it stands, and the raster of directions that matter to it."""

    def __init__(self, centre: Doubles, rotation: Doubles, low: Doubles, high: Doubles, pitch: float) -> None:
        """low and high: the least and greatest (x/z, y/z); pitch: the size of a cell, enlarged if there are many."""
        self._centre, self._rotation = centre, rotation
        extents = np.maximum(high - low, pitch)
        scale = 1 / max(pitch, float(np.sqrt(np.prod(extents) / MAX_CELLS)))
        width, height = (int(count) for count in np.ceil(extents * scale) + 1)
        self.raster = CellRaster(float(low[0]), float(low[1]), scale, width, height)
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
    return Cells(CellRaster(0.0, 0.0, 1.0, 0, 0), Patch(0, 0, 0, 0), np.zeros((0, 0), np.int32), np.zeros((0, 3)))


def _planes(corners: Doubles, raster: CellRaster) -> Doubles:
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
