"""Which pixels a moving body can change: those that may see it, and those whose surface it may keep the light from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from slopegate.core.kernels_render import fill_triangles, look_up
from slopegate.core.tracing import RAYS_PER_BAND, Placed, Rays, Tracer

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]

MARGIN_CELLS = 0.25
"""By how much silhouettes are drawn too large: far more than float32 misplaces an outline (1e-3 of a cell)."""

NEAREST_M = 1e-3
"""A body nearer than this to the plane of a viewer may be seen anywhere."""

MAX_CELLS = 1 << 22


class Field:
    """What one viewer looks out on: a grid over x/z and y/z in its axes, on which silhouettes are drawn."""

    def __init__(self, centre: Doubles, rotation: Doubles, bounds: tuple[Doubles, Doubles], pitch: float) -> None:
        """bounds: lowest and highest (x/z, y/z) that matter; pitch: the size of a cell, enlarged if there are many."""
        self._centre, self._rotation = centre, rotation
        low, high = bounds
        extent = np.maximum(high - low, pitch)
        self.cell = max(pitch, float(np.sqrt(np.prod(extent) / MAX_CELLS)))
        self.low = low
        width, height = (np.ceil(extent / self.cell) + 1).astype(int)
        self.grid = np.zeros((height, width), np.bool_)

    def draw(self, bodies: Sequence[Placed]) -> bool:
        """Mark every cell in which any of the bodies is seen; False when none is anywhere in the field."""
        self.grid[...] = False
        for placed in bodies:
            points, faces = placed.outline()
            local = (points - self._centre) @ self._rotation.T
            depth = local[:, 2]
            if not (depth > 0).any():
                continue
            if (depth <= NEAREST_M).any():
                self.grid[...] = True
                break
            cells = (local[:, :2] / depth[:, None] - self.low) / self.cell
            fill_triangles(cells, faces, MARGIN_CELLS, self.grid)
        return bool(self.grid.any())


class Watch:
    """Finds the pixels that bodies at given poses change in buffers cast without them."""

    def __init__(self, tracer: Tracer, projector_row: Singles, depth: Doubles, beam: Singles) -> None:
        """projector_row (H, W), depth (H, W) and beam (H, W, 2) as cast through pixel centres without the bodies."""
        self._tracer, self._row, self._depth, self._beam = tracer, projector_row, depth, beam
        self.rays_cast = 0
        rig, frame = tracer.rig, tracer.frame
        lens = rig.camera.lens
        rays = rig.camera_rays(np.arange(lens.width) + 0.5, np.arange(lens.height)[:, None] + 0.5)
        self._sight = rays[..., :2].astype(np.float32)
        bounds = self._sight.min(axis=(0, 1)).astype(np.float64), self._sight.max(axis=(0, 1)).astype(np.float64)
        self._seen = Field(rig.camera_centre_m, np.eye(3), bounds, 1 / lens.fx)
        self._lit = Field(rig.projector_centre_m, rig.rotation, (frame.low, frame.high), 1 / lens.fx)

    def cover(self, moving: Sequence[Placed]) -> Iterator[tuple[Indices, Rays]]:
        """Cast rays at the bodies wherever they may be seen: pixels (flat indices) in which they are, what those see.

        Adds the number of rays to `rays_cast`.
        """
        if not self._seen.draw(moving):
            return
        for pixels in self._bands(self._look_up(self._seen, self._sight)):
            met, rays = self._tracer.trace_over(*self._positions(pixels), self._depth.reshape(-1)[pixels], moving)
            self.rays_cast += len(pixels)
            yield pixels[met], rays

    def shade(self, moving: Sequence[Placed], apart_from: Indices) -> Iterator[Indices]:
        """Pixels (flat indices) lit without the bodies from whose surface any of them keeps the light.

        Adds the number of rays to `rays_cast`.
        """
        if not self._lit.draw(moving):
            return
        candidates = self._row >= 0
        candidates.reshape(-1)[apart_from] = False
        for pixels in self._bands(self._look_up(self._lit, self._beam, candidates)):
            shaded = self._tracer.shaded(*self._positions(pixels), self._depth.reshape(-1)[pixels], moving)
            self.rays_cast += len(pixels)
            yield pixels[shaded]

    def _look_up(self, field: Field, directions: Singles, candidates: Mask | None = None) -> Indices:
        mask = np.ones(self._row.shape, np.bool_) if candidates is None else candidates
        look_up(directions, field.low[0], field.low[1], 1 / field.cell, field.grid, mask)
        return np.flatnonzero(mask)

    def _positions(self, pixels: Indices) -> tuple[Doubles, Doubles]:
        rows, columns = np.divmod(pixels, self._row.shape[1])
        return columns + 0.5, rows + 0.5

    @staticmethod
    def _bands(pixels: Indices) -> Iterator[Indices]:
        for start in range(0, len(pixels), RAYS_PER_BAND):
            yield pixels[start : start + RAYS_PER_BAND]
