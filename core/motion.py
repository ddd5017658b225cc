"""Which pixels a moving body can change: those that may see it, and those whose surface it may keep the light from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from slopegate.core.silhouettes import Field
from slopegate.core.tracing import RAYS_PER_BAND, Placed, Rays, Tracer

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]


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

        Adds the number of rays to `rays_cast`. To be exhausted before `shade` is asked about the same poses.
        """
        outlines = [(placed.bit, *placed.outline()) for placed in moving]
        self._lit.draw(outlines)
        if not self._seen.draw(outlines):
            return
        bits = self._seen.bodies(self._sight).reshape(-1)
        for pixels in _bands(np.flatnonzero(bits)):
            columns, rows = self._positions(pixels)
            before = self._depth.reshape(-1)[pixels]
            met, rays = self._tracer.trace_over(columns, rows, before, moving, bits[pixels], self._lit)
            self.rays_cast += len(pixels)
            yield pixels[met], rays

    def shade(self, moving: Sequence[Placed], apart_from: Indices) -> Iterator[Indices]:
        """Pixels (flat indices) lit without the bodies from whose surface any of them keeps the light.

        Adds the number of rays to `rays_cast`.
        """
        bits = self._lit.bodies(self._beam)
        bits[self._row < 0] = 0
        bits = bits.reshape(-1)
        bits[apart_from] = 0
        for pixels in _bands(np.flatnonzero(bits)):
            columns, rows = self._positions(pixels)
            shaded = self._tracer.shaded(columns, rows, self._depth.reshape(-1)[pixels], moving, bits[pixels])
            self.rays_cast += len(pixels)
            yield pixels[shaded]

    def _positions(self, pixels: Indices) -> tuple[Doubles, Doubles]:
        rows, columns = np.divmod(pixels, self._row.shape[1])
        return columns + 0.5, rows + 0.5


def _bands(pixels: Indices) -> Iterator[Indices]:
    for start in range(0, len(pixels), RAYS_PER_BAND):
        yield pixels[start : start + RAYS_PER_BAND]
