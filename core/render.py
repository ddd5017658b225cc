"""Scene -> camera buffers: everything about the light that does not depend on the gate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from slopegate.core.measured import CaptureTracer
from slopegate.core.motion import Watch
from slopegate.core.rig import Rig
from slopegate.core.scene import Scene
from slopegate.core.tracing import RAYS_PER_BAND, Placed, Rays, Tracer

Singles = NDArray[np.float32]
Progress = Callable[[float], bool]


class Cancelled(Exception):  # noqa: N818 - an outcome, not a fault
    """The caller's progress function asked to stop."""


class Region(NamedTuple):
    """Pixels rows.start .. rows.stop, columns.start .. columns.stop; empty where start equals stop."""

    rows: slice
    columns: slice


@dataclass(frozen=True, eq=False)
class Buffers:
    """One ray per camera pixel.

    projector_row (H, W) float32: continuous projector row that lights the surface, -1 where none does (no surface, out
    of the projector's frame, in shadow). inverse_depth (H, W) float32: 1/z in 1/m, z along the camera's axis from its
    centre, 0 where there is no surface. direct (H, W, 3) float32: linear radiance when recorded once, 0 where unlit.
    ambient (H, W, 3) float32: radiance of the ambient light of one period.
    """

    projector_row: Singles
    inverse_depth: Singles
    direct: Singles
    ambient: Singles

    @staticmethod
    def empty(height: int, width: int) -> Buffers:
        """Buffers that show nothing."""
        return Buffers(
            np.full((height, width), -1, np.float32),
            np.zeros((height, width), np.float32),
            np.zeros((height, width, 3), np.float32),
            np.zeros((height, width, 3), np.float32),
        )

    def copy(self) -> Buffers:
        """Buffers of their own with the same content."""
        return Buffers(*(array.copy() for array in self._flat()))

    def _flat(self) -> tuple[Singles, ...]:
        return self.projector_row, self.inverse_depth, self.direct, self.ambient

    def put(self, pixels: NDArray[np.int64], rays: Rays) -> None:
        """Write rays into the pixels (flat indices) that they were cast for."""
        self.projector_row.reshape(-1)[pixels] = rays.projector_row
        self.inverse_depth.reshape(-1)[pixels] = rays.inverse_depth
        self.direct.reshape(-1, 3)[pixels] = rays.direct
        self.ambient.reshape(-1, 3)[pixels] = rays.ambient

    def darken(self, pixels: NDArray[np.int64]) -> None:
        """Take the projector's light off these pixels (flat indices)."""
        self.projector_row.reshape(-1)[pixels] = -1
        self.direct.reshape(-1, 3)[pixels] = 0

    def put_back(self, pixels: NDArray[np.int64], other: Buffers) -> None:
        """Copy these pixels (flat indices) from buffers of the same size."""
        for mine, theirs in zip(self._flat(), other._flat(), strict=True):
            depth = mine.shape[2:]
            mine.reshape(-1, *depth)[pixels] = theirs.reshape(-1, *depth)[pixels]


def render(
    rig: Rig,
    scene: Scene,
    time_s: float = 0.0,
    offset: tuple[float, float] = (0.5, 0.5),
    progress: Progress | None = None,
) -> Buffers:
    """Cast one ray per pixel, at `offset` (column part, row part, each 0..1) inside its pixel.

    `progress` is told the share done, 0..1; Cancelled is raised when it returns False.
    """
    tracer = make_tracer(rig, scene)
    lens = rig.camera.lens
    buffers = Buffers.empty(lens.height, lens.width)
    everywhere = range(lens.height * lens.width)
    _cast(tracer, tracer.still() + tracer.moving(time_s), everywhere, buffers, offset=offset, progress=progress)
    return buffers


class Renderer:
    """Renders one scene again and again; casts anew only what its moving objects can have changed."""

    def __init__(self, rig: Rig, scene: Scene) -> None:
        self._rig, self._tracer = rig, make_tracer(rig, scene)
        self._buffers: Buffers | None = None
        self._resting: Buffers | None = None
        self._watch: Watch | None = None
        self._poses: list[bytes] = []
        self._changed = np.zeros(0, np.int64)
        self.recast_pixels = 0
        """How many rays the last call of `at` cast: one per pixel that a moving object may cover or shade."""

    def at(self, time_s: float, progress: Progress | None = None) -> tuple[Buffers, Region]:
        """The buffers at this time, equal to `render`'s to the last bit, and where they differ from the last call's.

        The buffers stay the renderer's own: the next call changes them in place. `progress` as for `render`; a
        cancelled call leaves the renderer as if it had not been made.
        """
        lens = self._rig.camera.lens
        moving = self._tracer.moving(time_s)
        first = self._buffers is None
        if self._buffers is None:
            buffers = self._cast_resting(bool(moving), progress)
        else:
            buffers = self._buffers
            self.recast_pixels = 0
        if self._watch is None or self._resting is None:
            return buffers, _whole(lens.height, lens.width) if first else NOWHERE
        poses = [placed.rotation.tobytes() + placed.position.tobytes() for placed in moving]
        if poses == self._poses:
            return buffers, NOWHERE
        changed = self._move(buffers, self._watch, self._resting, moving)
        touched = np.concatenate([self._changed, changed])
        self._changed, self._poses = changed, poses
        return buffers, _whole(lens.height, lens.width) if first else _region(touched, lens.width)

    def _move(self, buffers: Buffers, watch: Watch, resting: Buffers, moving: Sequence[Placed]) -> NDArray[np.int64]:
        """Show the moving bodies where they are now; the pixels (flat indices) that they change."""
        none = np.zeros(0, np.int64)
        watch.rays_cast = 0
        met = [none]
        for pixels, rays in watch.cover(moving):
            buffers.put(pixels, rays)
            met.append(pixels)
        covered = np.concatenate(met)
        shaded = np.concatenate([none, *watch.shade(moving, covered)])
        buffers.put_back(_without(self._changed, covered, buffers.projector_row.size), resting)
        buffers.darken(shaded)
        self.recast_pixels += watch.rays_cast
        return np.concatenate([covered, shaded])

    def _cast_resting(self, moving: bool, progress: Progress | None) -> Buffers:
        lens = self._rig.camera.lens
        buffers = Buffers.empty(lens.height, lens.width)
        pixels = range(lens.height * lens.width)
        points = Points(np.zeros(len(pixels)), np.zeros((len(pixels), 2), np.float32)) if moving else None
        _cast(self._tracer, self._tracer.still(), pixels, buffers, points=points, progress=progress)
        if points is not None and isinstance(self._tracer, Tracer):
            self._resting = buffers.copy()
            shape = (lens.height, lens.width)
            depth, beam = points.depth.reshape(shape), points.beam.reshape(*shape, 2)
            self._watch = Watch(self._tracer, self._resting.projector_row, depth, beam)
        self._buffers, self.recast_pixels = buffers, len(pixels)
        return buffers


class Points(NamedTuple):
    """Where the surfaces lie, per pixel (flat): depth (P,) float64 and beam (P, 2) float32 as in `Rays`."""

    depth: NDArray[np.float64]
    beam: Singles


NOWHERE = Region(slice(0, 0), slice(0, 0))


def _whole(height: int, width: int) -> Region:
    return Region(slice(0, height), slice(0, width))


def _without(pixels: NDArray[np.int64], others: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Those of `pixels` that are not among `others`, all flat indices below `size`."""
    mask = np.zeros(size, np.bool_)
    mask[others] = True
    return pixels[~mask[pixels]]


def _region(pixels: NDArray[np.int64], width: int) -> Region:
    """The rectangle round pixels given by flat index."""
    if len(pixels) == 0:
        return NOWHERE
    rows, columns = np.divmod(pixels, width)
    return Region(slice(int(rows.min()), int(rows.max()) + 1), slice(int(columns.min()), int(columns.max()) + 1))


def make_tracer(rig: Rig, scene: Scene) -> Tracer | CaptureTracer:
    """The scene made ready for casting rays. Raises ValueError when a capture does not belong to the rig's camera."""
    return Tracer(rig, scene) if scene.capture is None else CaptureTracer(rig, scene, scene.capture)


def _cast(
    tracer: Tracer | CaptureTracer,
    bodies: Sequence[Placed],
    pixels: NDArray[np.int64] | range,
    buffers: Buffers,
    *,
    offset: tuple[float, float] = (0.5, 0.5),
    points: Points | None = None,
    progress: Progress | None = None,
) -> None:
    """Cast rays for these pixels (flat indices) into the buffers, in bands."""
    width = buffers.projector_row.shape[1]
    for start in range(0, len(pixels), RAYS_PER_BAND):
        if progress is not None and not progress(start / len(pixels)):
            raise Cancelled("Rendering was stopped")
        part = pixels[start : start + RAYS_PER_BAND]
        band = np.arange(part.start, part.stop) if isinstance(part, range) else part
        rows, columns = np.divmod(band, width)
        rays = tracer.trace(columns + offset[0], rows + offset[1], bodies)
        buffers.put(band, rays)
        if points is not None:
            points.depth[band], points.beam[band] = rays.depth, rays.beam
