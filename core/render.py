"""Scene -> camera buffers: everything about the light that does not depend on the gate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig import Rig
from slopegate.core.scene import Scene
from slopegate.core.tracing import Rays, Tracer

Singles = NDArray[np.float32]
Progress = Callable[[float], bool]

RAYS_PER_BAND = 1 << 17


class Cancelled(Exception):  # noqa: N818 - an outcome, not a fault
    """The caller's progress function asked to stop."""


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
    tracer = Tracer(rig, scene)
    lens = rig.camera.lens
    buffers = Buffers.empty(lens.height, lens.width)
    bodies = tracer.still() + tracer.moving(time_s)
    band = max(1, RAYS_PER_BAND // lens.width)
    for top in range(0, lens.height, band):
        if progress is not None and not progress(top / lens.height):
            raise Cancelled("Rendering was stopped")
        bottom = min(top + band, lens.height)
        rows, columns = np.mgrid[top:bottom, 0 : lens.width].reshape(2, -1)
        rays = tracer.trace(columns + offset[0], rows + offset[1], bodies)
        store(buffers, np.arange(top * lens.width, bottom * lens.width), rays)
    return buffers


def store(buffers: Buffers, pixels: NDArray[np.int64], rays: Rays) -> None:
    """Write rays into the pixels (flat indices) that they were cast for."""
    buffers.projector_row.reshape(-1)[pixels] = rays.projector_row
    buffers.inverse_depth.reshape(-1)[pixels] = rays.inverse_depth
    buffers.direct.reshape(-1, 3)[pixels] = rays.direct
    buffers.ambient.reshape(-1, 3)[pixels] = rays.ambient
