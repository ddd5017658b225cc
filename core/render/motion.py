"""Which pixels moving bodies change: those that see one, and those whose surface one keeps the light from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from slopegate.core.render import kernels_motion as kernels
from slopegate.core.render.kernels import Pixels
from slopegate.core.render.kernels_facets import Cells
from slopegate.core.render.kernels_motion import COVERED, MAYBE_COVERED, MAYBE_SHADED, SHADED, Box
from slopegate.core.render.tracing import RAYS_PER_BAND, Placed, Tracer

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]


class Watch:
    """Moves bodies about in buffers that were cast without them."""

    def __init__(self, tracer: Tracer, resting: Pixels, depth: Doubles, beam: Singles) -> None:
        """resting (P,), depth (P,) and beam (P, 3) as cast through pixel centres without the bodies."""
        lens = tracer.rig.camera.lens
        self._tracer, self._resting, self._depth = tracer, resting, depth
        shape = lens.height, lens.width
        rows, columns = np.arange(lens.height)[:, None] + 0.5, np.arange(lens.width) + 0.5
        self._sight = np.stack(np.broadcast_arrays(*lens.normalise(columns, rows)), axis=-1)
        self._row, self._beam = resting.projector_row.reshape(shape), beam.reshape(*shape, 3)
        lit = (self._row >= 0)[..., None]
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
            kernels.mark_seen(self._sight, placed.seen, box, self._marks)
        marks = self._marks.reshape(-1)
        candidates = self._collect(_union(boxes), MAYBE_COVERED, MAYBE_COVERED).copy()
        kernels.set_marks(candidates, kernels.CLEAR, marks)
        self.pixels_judged = len(candidates)
        for pixels in _bands(candidates):
            directions, depth = self._rays(pixels)
            covered = self._tracer.trace_over(directions, depth, moving, pixels, out)
            kernels.set_marks(covered, COVERED, marks)
        within = _union([*boxes, self._shade(moving)])
        changed = self._collect(within, COVERED, SHADED).copy()
        kernels.put_back(self._changed, marks, self._resting, out)
        kernels.put_back(changed, marks, self._resting, out)
        kernels.set_marks(changed, kernels.CLEAR, marks)
        width = self._row.shape[1]
        box = kernels.bounding(changed, width)
        touched = _union([self._changed_box, box])
        self._changed, self._changed_box = changed, box
        return touched

    def _shade(self, moving: Sequence[Placed]) -> Box:
        """Mark the surfaces that never move and that the bodies shade; the box that they lie in."""
        boxes = [self._lit_reach.box(placed.lit) for placed in moving]
        for placed, box in zip(moving, boxes, strict=True):
            self.pixels_judged += kernels.mark_shaded(self._beam, self._row, placed.lit, box, self._marks)
        marks = self._marks.reshape(-1)
        within = _union(boxes)
        asked = self._collect(within, MAYBE_SHADED, MAYBE_SHADED).copy()
        kernels.set_marks(asked, kernels.CLEAR, marks)
        for pixels in _bands(asked):
            shaded = self._tracer.shaded(*self._rays(pixels), moving)
            kernels.set_marks(pixels[shaded], SHADED, marks)
        return within

    def _rays(self, pixels: Indices) -> tuple[Doubles, Doubles]:
        directions, depth = np.empty((len(pixels), 3)), np.empty(len(pixels))
        kernels.take_rays(self._sight.reshape(-1, 2), self._depth, pixels, directions, depth)
        return directions, depth

    def _collect(self, box: Box, least: int, most: int) -> Indices:
        return self._found[: kernels.collect(self._marks, box, least, most, self._found)]


class _Reach:
    """Which directions x/z, y/z each row and each column of the image holds."""

    def __init__(self, directions: NDArray[np.floating], among: NDArray[np.bool_]) -> None:
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
    for start in range(0, len(pixels), RAYS_PER_BAND):
        yield pixels[start : start + RAYS_PER_BAND]
