"""A capture (photo and depth) under the projector's light.

The photo already holds albedo times shading, so a pixel shows L = photo / z_p^2, z_p its depth from the projector,
without a cosine; where depth is missing there is no light at all. Shadows come from the measured surface itself: its
pixels are joined to a net, broken where depth jumps, and drawn into a map of inverse depth as the projector sees it.
Inverse depth is affine over a plane's picture, so planes are drawn exactly. What the camera did not see casts nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from slopegate.core.render import kernels
from slopegate.core.render.kernels_draw import draw_net
from slopegate.core.render.tracing import RAYS_PER_BAND, Placed, ProjectorFrame, Rays, bounded
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.scene.scene import Capture, Scene

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]

CLEARANCE = (0.02, 0.008)
"""What shades a point must be nearer to the projector by both this share of its inverse depth and this many 1/m (2 cm
at 1 m, 3 cm at 2 m). Sensors of measured scenes step by about 0.003 1/m, so noise and steps cast no shadow specks."""

JUMP = (0.05, 0.01)
"""Neighbouring pixels whose inverse depths differ by more than this share and this many 1/m belong to two surfaces."""

MAX_MAP_SIDE = 8192


class CaptureTracer:
    """Light along camera rays into a capture; the counterpart of `tracing.Tracer`."""

    def __init__(self, rig: Rig, scene: Scene, capture: Capture) -> None:
        self.rig = rig
        lens = rig.camera.lens
        require(not scene.objects, "objects", len(scene.objects), "none in a scene that is a capture")
        require(lens == capture.lens, "camera.lens", lens, "the lens that the capture was taken with")
        shape = (lens.height, lens.width)
        require(
            capture.inverse_depth.shape == shape,
            "inverse_depth",
            capture.inverse_depth.shape,
            f"of the lens' size {shape}",
        )
        require(capture.photo.shape == (*shape, 3), "photo", capture.photo.shape, f"of the lens' size {(*shape, 3)}")
        self._photo = capture.photo
        w = np.asarray(capture.inverse_depth, np.float64)
        known = np.isfinite(w) & (w > 0) & np.isfinite(capture.photo).all(axis=2)
        self._depth = np.full(shape, np.inf)
        np.divide(1.0, w, out=self._depth, where=known)
        self._ambient = np.float32(scene.ambient)
        self._frame = ProjectorFrame(rig.projector)
        self._shadows = self._draw_shadows()

    def still(self) -> tuple[Placed, ...]:
        """Nothing stands in front of a capture."""
        return ()

    def moving(self, time_s: float) -> tuple[Placed, ...]:
        """Nothing moves in a capture."""
        return ()

    def trace(self, columns: Doubles, rows: Doubles, bodies: Sequence[Placed]) -> Rays:
        """What camera rays (R,) see: depth and photo of the pixel that they lie in, projector row of their own."""
        pixel = rows.astype(np.int64), columns.astype(np.int64)
        depth = self._depth[pixel]
        q = self._from_projector(columns, rows, depth)
        row = self._frame.rows(q)
        lit = np.flatnonzero(row >= 0)
        shaded = self._shadows.shaded(q[lit])
        row[lit[shaded]] = -1
        lit = lit[~shaded]
        known = depth < np.inf
        photo = np.where(known[:, None], self._photo[pixel], np.float32(0))
        direct = np.zeros_like(photo)
        direct[lit] = photo[lit] * bounded(q[lit, 2] ** -2.0)[:, None]
        return Rays(row, bounded(1 / depth), direct, photo * self._ambient, depth, q.astype(np.float32))

    def _from_projector(self, columns: Doubles, rows: Doubles, depth: Doubles) -> Doubles:
        directions = self.rig.camera_rays(columns, rows)
        vectors, q = np.empty_like(directions), np.empty_like(directions)
        centre, light = self.rig.camera_centre_m, self.rig.projector_centre_m
        kernels.to_projector_axes(centre, directions, depth, light, self.rig.rotation, vectors, q)
        return q

    def _draw_shadows(self) -> ShadowMap:
        height, width = self._depth.shape
        net = np.empty((height, width, 3), np.float32)
        band = max(1, RAYS_PER_BAND // width)
        for top in range(0, height, band):
            part = self._depth[top : top + band]
            rows, columns = np.indices(part.shape).reshape(2, -1) + 0.5
            net[top : top + band] = self._from_projector(columns, rows + top, part.ravel()).reshape(*part.shape, 3)
        return ShadowMap(net, self.rig.camera.lens, self._frame)


class ShadowMap:
    """The inverse depth of the nearest surface along directions from the projector, at the camera's pixel pitch."""

    def __init__(self, net: Singles, lens: Lens, frame: ProjectorFrame) -> None:
        """Draw a net (H, W, 3) of x/z, y/z, z in projector axes (NaN, NaN, -1 where nothing is known)."""
        extent = frame.high - frame.low
        self._scale = np.minimum([lens.fx, lens.fy], MAX_MAP_SIDE / extent)
        # Cells in step with the camera's pixels: of the ideal rig a column of pixels fills one column of cells.
        step = np.array([lens.cx / lens.fx, lens.cy / lens.fy])
        self._low = np.floor((frame.low + step) * self._scale) / self._scale - step
        size = np.ceil(extent * self._scale).astype(int) + 2
        self._map = np.zeros((size[1], size[0]), np.float32)
        net[..., :2] = (net[..., :2] - self._low) * self._scale
        net[..., 2] = np.where(net[..., 2] > 0, 1 / net[..., 2], 0)
        draw_net(net, JUMP[0], JUMP[1], self._map)

    def shaded(self, q: Doubles) -> NDArray[np.bool_]:
        """Whether something stands before the points q (R, 3), given as x/z, y/z, z inside the projector's frame."""
        column, row = ((q[:, :2] - self._low) * self._scale).astype(np.int64).T
        nearest = self._map[row, column]
        w = 1 / q[:, 2]
        return np.asarray((nearest > w * (1 + CLEARANCE[0])) & (nearest > w + CLEARANCE[1]))
