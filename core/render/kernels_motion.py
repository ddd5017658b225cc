"""Numba loops over the pixels that moving bodies may change. A pixel's mark says what is known of it in this frame."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray
from slopegate.core.render.kernels import Pixels
from slopegate.core.render.kernels_facets import ASK, FIRST, NOTHING, ROUND, Cells, cell_at, judge_shade

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]
Marks = NDArray[np.uint8]

CLEAR: Final = 0
MAYBE_COVERED: Final = 1
COVERED: Final = 2
SHADED: Final = 3
MAYBE_SHADED: Final = 4

Box = tuple[int, int, int, int]
"""First row, row after the last, first column, column after the last."""


@njit(cache=True, nogil=True)
def mark_seen(sight: Doubles, cells: Cells, box: Box, marks: Marks) -> None:
    """MAYBE_COVERED for pixels of a box in whose direction, sight (H, W, 2), a body may be seen."""
    raster, patch, what = cells.raster, cells.patch, cells.what
    for k in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            r, c = cell_at(raster, patch, sight[k, j, 0], sight[k, j, 1])
            if r == -2 or (r >= 0 and what[r, c] != NOTHING):
                marks[k, j] = MAYBE_COVERED


@njit(cache=True, nogil=True)
def mark_shaded(beam: Singles, row: Singles, cells: Cells, box: Box, marks: Marks) -> int:
    """SHADED or MAYBE_SHADED for pixels of a box whose surface, lit by itself, lies behind a body or may do so.

    beam (H, W, 3) as in `tracing.Rays`; row (H, W): its projector row. Returns how many pixels the body may shade.
    """
    raster, patch, what, planes = cells.raster, cells.patch, cells.what, cells.planes
    touched = 0
    for k in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            if row[k, j] < 0 or marks[k, j] == COVERED or marks[k, j] == SHADED:
                continue
            x, y = np.float64(beam[k, j, 0]), np.float64(beam[k, j, 1])
            r, c = cell_at(raster, patch, x, y)
            cell = what[r, c] if r >= 0 else (NOTHING if r == -1 else ASK | ROUND)
            if cell == NOTHING:
                continue
            touched += 1
            t = (cell & ~ROUND) - FIRST
            verdict = -1 if t == ASK - FIRST else 0
            if t >= 0:
                z = np.float64(beam[k, j, 2])
                verdict = judge_shade(raster, planes[t, 0], planes[t, 1], planes[t, 2], x, y, z)
            if verdict == 1:
                marks[k, j] = SHADED
            elif verdict == -1 or cell & ROUND:
                marks[k, j] = MAYBE_SHADED
    return touched


@njit(cache=True, nogil=True)
def collect(marks: Marks, box: Box, least: int, most: int, out: Indices) -> int:
    """Flat indices of a box's pixels with marks least..most, in order; returns how many there are."""
    width, count = marks.shape[1], 0
    for k in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            if least <= marks[k, j] <= most:
                out[count] = k * width + j
                count += 1
    return count


@njit(cache=True, nogil=True)
def take_rays(sight: Doubles, depth: Doubles, pixels: Indices, directions: Doubles, depths: Doubles) -> None:
    """directions (R, 3), z = 1, and depths (R,) of pixels (R,), from sight (P, 2) and depth (P,)."""
    for i in range(pixels.shape[0]):
        p = pixels[i]
        directions[i, 0], directions[i, 1], directions[i, 2] = sight[p, 0], sight[p, 1], 1.0
        depths[i] = depth[p]


@njit(cache=True, nogil=True)
def put_back(pixels: Indices, marks: Marks, resting: Pixels, out: Pixels) -> None:
    """Show what never moves in these pixels, but for those COVERED; without the projector's light in those SHADED.

    marks (P,), by flat index.
    """
    for i in range(pixels.shape[0]):
        p = pixels[i]
        if marks[p] == COVERED:
            continue
        dark = marks[p] == SHADED
        out.projector_row[p] = np.float32(-1) if dark else resting.projector_row[p]
        out.inverse_depth[p] = resting.inverse_depth[p]
        for c in range(3):
            out.direct[p, c] = np.float32(0) if dark else resting.direct[p, c]
            out.ambient[p, c] = resting.ambient[p, c]


@njit(cache=True, nogil=True)
def set_marks(pixels: Indices, value: int, marks: Marks) -> None:
    """Mark these pixels; marks (P,), by flat index."""
    for i in range(pixels.shape[0]):
        marks[pixels[i]] = value


@njit(cache=True, nogil=True)
def bounding(pixels: Indices, width: int) -> Box:
    """The box round pixels of an image of this width; all 0 without pixels."""
    if pixels.shape[0] == 0:
        return 0, 0, 0, 0
    first, last, left, right = pixels[0] // width, pixels[0] // width, width, -1
    for i in range(pixels.shape[0]):
        k = pixels[i] // width
        j = pixels[i] - k * width
        first, last, left, right = min(first, k), max(last, k), min(left, j), max(right, j)
    return first, last + 1, left, right + 1
