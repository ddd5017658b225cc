"""Numba loops that draw bodies into a viewer's cells, with a margin: what each triangle surely fills and may touch."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray
from slopegate.core.render.kernels_facets import ASK, FIRST, ROUND, Cells, Raster

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]

MARGIN: Final = 0.25
"""How far round a cell is looked, in cells: float32 misplaces an outline by 1e-3 of a cell."""

NEAREST_M: Final = 1e-3
"""Triangles are cut off nearer than this to the plane through the viewer."""

ALMOST: Final = 1 - 1e-5
"""What is behind by less than this share may be before: float32 misplaces it by 1e-6."""

SHEER: Final = 0.02
"""Triangles whose inverse depth changes by more than this share within a cell are seen too edge-on to be sure of."""


@njit(cache=True, nogil=True, error_model="numpy")
def _outline(corners: Doubles, raster: Raster, polygon: Doubles) -> int:
    """The part of a convex polygon (n, 3) in viewer's axes beyond NEAREST_M as cells (m, 2); returns m, 0 for none."""
    count, found = corners.shape[0], 0
    for i in range(count):
        j = (i + 1) % count
        az, bz = corners[i, 2], corners[j, 2]
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
