"""The renderer: a scene to the camera's buffers, all about the light that does not depend on the gate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopegate.core.render.kernels import Pixels
from slopegate.core.render.measured import CaptureTracer
from slopegate.core.render.motion import MovingBodies
from slopegate.core.render.tracing import RAYS_PER_BAND, Placed, Tracer
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.materials import Glass
from slopegate.core.scene.scene import Scene

Progress = Callable[[float], bool]


def part_of(progress: Progress | None, start: float, length: float) -> Progress | None:
    """A progress function for the piece of the work that begins at the share `start` and is `length` of it long."""
    if progress is None:
        return None
    return lambda share: progress(min(start + length * share, 1.0))


class Cancelled(Exception):  # noqa: N818 - an outcome, not a fault
    """The caller's progress function asked to stop."""


class Region(NamedTuple):
    """A rectangle of pixels, rows.start .. rows.stop by columns.start .. columns.stop; empty where these are equal."""

    rows: slice
    columns: slice


NOWHERE = Region(slice(0, 0), slice(0, 0))


class Points(NamedTuple):
    """Where the surfaces lie, per pixel (flat): depth (P,) float64 and beam (P, 3) float32 as in `Rays`."""

    depth: Doubles
    beam: Singles


@dataclass(frozen=True, eq=False)
class Buffers:
    """What the camera sees, one ray per pixel.

    projector_row (H, W) float32: continuous projector row that lights the surface, -1 where none does (no surface, out
    of the projector's frame, in shadow). projector_column (H, W) float32: the column that lights it, -1 where none does
    or where only rows are known. inverse_depth (H, W) float32: 1/z in 1/m, z along the camera's axis from its
    centre, 0 where there is no surface. direct (H, W, 3) float32: linear radiance when recorded once, 0 where unlit.
    ambient (H, W, 3) float32: radiance of the ambient light of one period.
    """

    projector_row: Singles
    projector_column: Singles
    inverse_depth: Singles
    direct: Singles
    ambient: Singles

    @staticmethod
    def empty(height: int, width: int) -> Buffers:
        """Buffers that show nothing."""
        return Buffers(
            np.full((height, width), -1, np.float32),
            np.full((height, width), -1, np.float32),
            np.zeros((height, width), np.float32),
            np.zeros((height, width, 3), np.float32),
            np.zeros((height, width, 3), np.float32),
        )

    def copy(self) -> Buffers:
        """Buffers of their own with the same content."""
        return Buffers(*(array.copy() for array in self._flat()))

    def _flat(self) -> tuple[Singles, ...]:
        return self.projector_row, self.projector_column, self.inverse_depth, self.direct, self.ambient

    def pixels(self) -> Pixels:
        """The same arrays with one leading axis."""
        return Pixels(*(array.reshape(-1, *array.shape[2:]) for array in self._flat()))


def render(
    rig: Rig,
    scene: Scene,
    time_s: float = 0.0,
    offset: tuple[float, float] = (0.5, 0.5),
    progress: Progress | None = None,
    skip: bool = True,
) -> Buffers:
    """Cast one ray per pixel, at `offset` (column part, row part, each 0..1) inside its pixel.

    `progress` is told the share done, 0..1; Cancelled is raised when it returns False. `skip` as for `make_tracer`.
    """
    tracer = make_tracer(rig, scene, skip)
    lens = rig.camera.lens
    buffers = Buffers.empty(lens.height, lens.width)
    _cast(tracer, tracer.still() + tracer.moving(time_s), buffers, offset=offset, progress=progress)
    return buffers


class Renderer:
    """Renders one scene again and again; casts anew only what its moving objects can have changed."""

    def __init__(self, rig: Rig, scene: Scene, skip: bool = True) -> None:
        """skip False: cast every ray anew at every call, as `render` does."""
        self._rig, self._scene, self._skip = rig, scene, skip
        self._tracer = make_tracer(rig, scene, skip)
        # Through glass anything may show what moves: then every picture is cast anew.
        self._bent = scene.moving and any(isinstance(item.material, Glass) for item in scene.objects)
        self._buffers: Buffers | None = None
        self._watch: MovingBodies | None = None
        self._poses: list[bytes] = []
        self.recast_pixels = 0
        """Pixels that the last call of `at` computed anew: those that a moving object may cover or shade."""

    def at(self, time_s: float, progress: Progress | None = None) -> tuple[Buffers, Region]:
        """The buffers at this time, equal to `render`'s to the last bit, and where they differ from the last call's.

        The buffers stay the renderer's own: the next call changes them in place. `progress` as for `render`; a
        cancelled call leaves the renderer as if it had not been made.
        """
        lens = self._rig.camera.lens
        whole = Region(slice(0, lens.height), slice(0, lens.width))
        if not self._skip or self._bent:
            self._buffers = render(self._rig, self._scene, time_s, progress=progress, skip=self._skip)
            self.recast_pixels = lens.height * lens.width
            return self._buffers, whole
        first = self._buffers is None
        buffers = self._buffers or self._cast_resting(progress)
        self.recast_pixels = lens.height * lens.width if first else 0
        if self._watch is None or not isinstance(self._tracer, Tracer):
            return buffers, whole if first else NOWHERE
        poses = [pose.rotation.tobytes() + pose.position.tobytes() for pose in self._tracer.poses(time_s)]
        if poses == self._poses:
            return buffers, NOWHERE
        top, bottom, left, right = self._watch.move(self._tracer.moving(time_s), buffers.pixels())
        self._poses = poses
        self.recast_pixels += self._watch.pixels_judged
        return buffers, whole if first else Region(slice(top, bottom), slice(left, right))

    def _cast_resting(self, progress: Progress | None) -> Buffers:
        lens = self._rig.camera.lens
        buffers = Buffers.empty(lens.height, lens.width)
        pixels = lens.height * lens.width
        points = Points(np.empty(pixels), np.empty((pixels, 3), np.float32)) if self._scene.moving else None
        _cast(self._tracer, self._tracer.still(), buffers, points=points, progress=progress)
        if points is not None and isinstance(self._tracer, Tracer):
            self._watch = MovingBodies(self._tracer, buffers.copy().pixels(), points.depth, points.beam)
        self._buffers = buffers
        return buffers


def make_tracer(rig: Rig, scene: Scene, skip: bool = True) -> Tracer | CaptureTracer:
    """The scene made ready for casting rays. Raises InputError when a capture does not belong to the rig's camera.

    skip False: cast every ray at every body, also where it is known beforehand what it meets.
    """
    return Tracer(rig, scene, skip) if scene.capture is None else CaptureTracer(rig, scene, scene.capture)


def _cast(
    tracer: Tracer | CaptureTracer,
    bodies: Sequence[Placed],
    buffers: Buffers,
    *,
    offset: tuple[float, float] = (0.5, 0.5),
    points: Points | None = None,
    progress: Progress | None = None,
) -> None:
    """Cast a ray for every pixel into the buffers, in bands."""
    height, width = buffers.projector_row.shape
    out, size = buffers.pixels(), height * width
    for start in range(0, size, RAYS_PER_BAND):
        if progress is not None and not progress(start / size):
            raise Cancelled("Rendering was stopped")
        band = slice(start, min(start + RAYS_PER_BAND, size))
        rows, columns = np.divmod(np.arange(band.start, band.stop), width)
        rays = tracer.trace(columns + offset[0], rows + offset[1], bodies)
        out.projector_row[band], out.projector_column[band] = rays.projector_row, rays.projector_column
        out.inverse_depth[band] = rays.inverse_depth
        out.direct[band], out.ambient[band] = rays.direct, rays.ambient
        if points is not None:
            points.depth[band], points.beam[band] = rays.depth, rays.beam
