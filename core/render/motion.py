"""Moving bodies in a picture of what rests: only the pixels that they can cover or shade are cast anew.

A pixel carries a mark while one picture is made. What a body's cells leave open is marked MAYBE and decided by a ray;
what changed is remembered, so that the next picture begins by putting it back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.compiled.kept import njit
from slopegate.core.render.kernels import Pixels
from slopegate.core.render.kernels_facets import ASK, FIRST, NOTHING, ROUND, Cells, cell_at, judge_shade
from slopegate.core.render.tracing import RAYS_PER_BAND, Placed, Tracer
from slopegate.core.rig.arrays import Bools, Bytes, Doubles, Indices, Singles

CLEAR: Final = 0
MAYBE_COVERED: Final = 1
COVERED: Final = 2
SHADED: Final = 3
MAYBE_SHADED: Final = 4

Box = tuple[int, int, int, int]
"""First row, row after the last, first column, column after the last."""


@njit(cache=True, nogil=True)
def mark_seen(sight: Doubles, cells: Cells, box: Box, marks: Bytes) -> None:
    """Mark as MAYBE_COVERED the pixels of a box in whose direction, sight (H, W, 2), a body may be seen."""
    raster, patch, what = cells.raster, cells.patch, cells.what
    for k in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            r, c = cell_at(raster, patch, sight[k, j, 0], sight[k, j, 1])
            if r == -2 or (r >= 0 and what[r, c] != NOTHING):
                marks[k, j] = MAYBE_COVERED


@njit(cache=True, nogil=True)
def mark_shaded(beam: Singles, row: Singles, cells: Cells, box: Box, marks: Bytes) -> int:
    """Mark as SHADED or MAYBE_SHADED the pixels of a box whose surface, else lit, lies or may lie behind a body.

    beam (H, W, 3) as in `tracing.Rays`; row (H, W): its projector row. Returns how many pixels the body may shade.
    """
    raster, patch, what, planes = cells.raster, cells.patch, cells.what, cells.planes
    touched = 0
    for k in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            # Dark by itself, hidden by a body, or shaded by another one already: one more shadow changes nothing.
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
def collect(marks: Bytes, box: Box, least: int, most: int, out: Indices) -> int:
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
def put_back(pixels: Indices, marks: Bytes, resting: Pixels, out: Pixels) -> None:
    """Show what never moves in these pixels, but for those COVERED; without the projector's light in those SHADED.

    marks (P,), by flat index.
    """
    for i in range(pixels.shape[0]):
        p = pixels[i]
        if marks[p] == COVERED:
            continue
        dark = marks[p] == SHADED
        out.projector_row[p] = np.float32(-1) if dark else resting.projector_row[p]
        out.projector_column[p] = np.float32(-1) if dark else resting.projector_column[p]
        out.inverse_depth[p] = resting.inverse_depth[p]
        for c in range(3):
            out.direct[p, c] = np.float32(0) if dark else resting.direct[p, c]
            out.ambient[p, c] = resting.ambient[p, c]


@njit(cache=True, nogil=True)
def set_marks(pixels: Indices, value: int, marks: Bytes) -> None:
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


class MovingBodies:
    """Moves bodies about in buffers that were cast without them."""

    def __init__(self, tracer: Tracer, resting: Pixels, depth: Doubles, beam: Singles) -> None:
        """resting (P,), depth (P,) and beam (P, 3) as cast through pixel centres without the bodies."""
        lens = tracer.rig.camera.lens
        self._tracer, self._resting, self._depth = tracer, resting, depth
        shape = lens.height, lens.width
        sight = lens.normalise(lens.column_centres, lens.row_centres[:, None])
        self._sight = np.stack(np.broadcast_arrays(*sight), axis=-1)
        self._row, self._beam = resting.projector_row.reshape(shape), beam.reshape(*shape, 3)
        lit = (self._row >= 0)[..., None]
        # The loops of a picture run over the boxes that these give, not over the whole image.
        self._seen_reach = _Reach(self._sight, np.ones_like(lit))
        self._lit_reach = _Reach(self._beam[..., :2], lit)
        self._marks = np.zeros(shape, np.uint8)
        self._found = np.empty(self._row.size, np.int64)
        self._changed = np.zeros(0, np.int64)
        self._changed_box: Box = (0, 0, 0, 0)
        self.pixels_judged = 0
        """How many pixels the last call of `move` had to look at."""

    def move(self, moving: Sequence[Placed], out: Pixels) -> Box:
        """Show the bodies where they are now, and what never moves where they were; the box of all that may differ."""
        boxes = [self._seen_reach.box(placed.seen) for placed in moving]
        for placed, box in zip(moving, boxes, strict=True):
            mark_seen(self._sight, placed.seen, box, self._marks)
        marks = self._marks.reshape(-1)
        candidates = self._collect(_union(boxes), MAYBE_COVERED, MAYBE_COVERED).copy()
        set_marks(candidates, CLEAR, marks)  # a ray decides below which of them are covered
        self.pixels_judged = len(candidates)
        for pixels in _bands(candidates):
            directions, depth = self._rays(pixels)
            covered = self._tracer.trace_over(directions, depth, moving, pixels, out)
            set_marks(covered, COVERED, marks)
        within = _union([*boxes, self._shade(moving)])
        changed = self._collect(within, COVERED, SHADED).copy()
        # First what the last picture changed, then this one's: a pixel may be in both.
        put_back(self._changed, marks, self._resting, out)
        put_back(changed, marks, self._resting, out)
        set_marks(changed, CLEAR, marks)
        width = self._row.shape[1]
        box = bounding(changed, width)
        touched = _union([self._changed_box, box])
        self._changed, self._changed_box = changed, box
        return touched

    def _shade(self, moving: Sequence[Placed]) -> Box:
        """Mark the surfaces that never move and that the bodies shade; the box that they lie in."""
        boxes = [self._lit_reach.box(placed.lit) for placed in moving]
        for placed, box in zip(moving, boxes, strict=True):
            self.pixels_judged += mark_shaded(self._beam, self._row, placed.lit, box, self._marks)
        marks = self._marks.reshape(-1)
        within = _union(boxes)
        asked = self._collect(within, MAYBE_SHADED, MAYBE_SHADED).copy()
        set_marks(asked, CLEAR, marks)
        for pixels in _bands(asked):
            shaded = self._tracer.shaded(*self._rays(pixels), moving)
            set_marks(pixels[shaded], SHADED, marks)
        return within

    def _rays(self, pixels: Indices) -> tuple[Doubles, Doubles]:
        directions, depth = np.empty((len(pixels), 3)), np.empty(len(pixels))
        take_rays(self._sight.reshape(-1, 2), self._depth, pixels, directions, depth)
        return directions, depth

    def _collect(self, box: Box, least: int, most: int) -> Indices:
        return self._found[: collect(self._marks, box, least, most, self._found)]


class _Reach:
    """Which directions x/z, y/z each row and each column of the image holds."""

    def __init__(self, directions: NDArray[np.floating], among: Bools) -> None:
        """directions (H, W, 2), of which those `among` (H, W, 1) count."""
        low, high = np.where(among, directions, np.inf), np.where(among, directions, -np.inf)
        self._rows = low[..., 1].min(axis=1), high[..., 1].max(axis=1)
        self._columns = low[..., 0].min(axis=0), high[..., 0].max(axis=0)

    def box(self, cells: Cells) -> Box:
        """The box of pixels outside which the body shows nothing."""
        raster = cells.raster
        if raster.width == 0:
            return 0, len(self._rows[0]), 0, len(self._columns[0])
        top, left, height, width = cells.patch
        rows = _between(*self._rows, raster.top, raster.scale, top, height, raster.height)
        columns = _between(*self._columns, raster.left, raster.scale, left, width, raster.width)
        return *rows, *columns


def _between(
    low: Doubles, high: Doubles, start: float, scale: float, first: int, count: int, whole: int
) -> tuple[int, int]:
    """First and one past the last place that reaches cells first..first + count, or lies outside the whole raster."""
    least, greatest = (low - start) * scale, (high - start) * scale
    touching = (greatest >= first) & (least <= first + count) & (count > 0)
    found = np.flatnonzero(touching | (least < 0) & (greatest > -np.inf) | (greatest >= whole))
    return (int(found[0]), int(found[-1]) + 1) if len(found) else (0, 0)


def _union(boxes: Sequence[Box]) -> Box:
    """The box round all that are not empty."""
    full = np.array([box for box in boxes if box[0] < box[1] and box[2] < box[3]], np.int64).reshape(-1, 4)
    if len(full) == 0:
        return 0, 0, 0, 0
    return int(full[:, 0].min()), int(full[:, 1].max()), int(full[:, 2].min()), int(full[:, 3].max())


def _bands(pixels: Indices) -> Iterator[Indices]:
    """The pixels, as many at a time as rays are cast."""
    for start in range(0, len(pixels), RAYS_PER_BAND):
        yield pixels[start : start + RAYS_PER_BAND]
