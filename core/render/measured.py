"""Light along camera rays into a measured scene: a photo with depth, under the projector's light and its shadows.

The photo already holds albedo times shading, so a pixel shows L = photo / z_p^2, z_p its depth from the projector,
without a cosine; where depth is missing there is no light at all but fog's, which has no end there. Shadows come from
the measured surface itself: its pixels are joined to a net, broken where depth jumps, and drawn into a map of inverse
depth as the projector sees it. Inverse depth is affine over a plane's picture, so planes are drawn exactly. What the
camera did not see casts nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.render import fog, kernels
from slopegate.core.render.kernels import Pixels
from slopegate.core.render.tracing import RAYS_PER_BAND, Placed, ProjectorFrame, Rays, bounded, point
from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.scene.scene import MeasuredScene, Scene

CLEARANCE = (0.02, 0.008)
"""What shades a point must be nearer to the projector by both this share of its inverse depth and this many 1/m (2 cm
at 1 m, 3 cm at 2 m). Sensors of measured scenes step by about 0.003 1/m, so noise and steps cast no shadow specks."""

JUMP = (0.05, 0.01)
"""Neighbouring pixels whose inverse depths differ by more than this share and this many 1/m belong to two surfaces."""

MAX_MAP_SIDE = 8192
"""Most cells of the shadow map along either side: 256 MB of float32 at worst."""


@njit(cache=True, nogil=True)
def _joined(a: float, b: float, share: float, step: float) -> bool:
    """Whether two inverse depths, 0 where unknown, belong to one surface."""
    return a > 0 and b > 0 and abs(a - b) <= max(share * max(a, b), step)


@njit(cache=True, nogil=True)
def _draw_triangle(net: Singles, i: int, j: int, k: int, m: int, n: int, o: int, out: Singles) -> None:
    """Draw net[i, j], net[k, m], net[n, o] into the cells of `out` whose centres it covers, nearest surface kept."""
    x0, y0, w0 = np.float64(net[i, j, 0]) - 0.5, np.float64(net[i, j, 1]) - 0.5, np.float64(net[i, j, 2])
    ax, ay, aw = net[k, m, 0] - 0.5 - x0, net[k, m, 1] - 0.5 - y0, net[k, m, 2] - w0
    bx, by, bw = net[n, o, 0] - 0.5 - x0, net[n, o, 1] - 0.5 - y0, net[n, o, 2] - w0
    area = ax * by - ay * bx
    if abs(area) < 1e-9:
        return
    left = max(int(np.ceil(x0 + min(0.0, ax, bx) - 1e-3)), 0)
    right = min(int(np.floor(x0 + max(0.0, ax, bx) + 1e-3)), out.shape[1] - 1)
    top = max(int(np.ceil(y0 + min(0.0, ay, by) - 1e-3)), 0)
    bottom = min(int(np.floor(y0 + max(0.0, ay, by) + 1e-3)), out.shape[0] - 1)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            px, py = column - x0, row - y0
            s, t = (px * by - py * bx) / area, (ax * py - ay * px) / area
            # Float32 places a corner to 1e-4 of a cell: neighbours overlap by a little more than that.
            if s >= -1e-3 and t >= -1e-3 and s + t <= 1.001:
                w = w0 + s * aw + t * bw
                out[row, column] = max(out[row, column], w)


@njit(cache=True, nogil=True)
def draw_net(net: Singles, share: float, step: float, out: Singles) -> None:
    """Draw a surface net (H, W, 3) of cell column, cell row, inverse depth (0 = none) into `out`, nearest kept.

    Neighbours are joined unless they differ by more than `share` of the larger and more than `step`. Every pixel
    covers at least the cell that it falls into.
    """
    height, width = net.shape[0], net.shape[1]
    for i in range(height):
        for j in range(width):
            w = net[i, j, 2]
            if not w > 0:
                continue
            if 0 <= net[i, j, 0] < out.shape[1] and 0 <= net[i, j, 1] < out.shape[0]:
                row, column = int(net[i, j, 1]), int(net[i, j, 0])
                out[row, column] = max(out[row, column], w)
            if i + 1 == height or j + 1 == width:
                continue
            right, down, across = net[i, j + 1, 2], net[i + 1, j, 2], net[i + 1, j + 1, 2]
            # The square of four pixels as two triangles, so that one missing corner leaves the other half standing.
            if _joined(right, down, share, step):
                if _joined(w, right, share, step) and _joined(w, down, share, step):
                    _draw_triangle(net, i, j, i, j + 1, i + 1, j, out)
                if _joined(across, right, share, step) and _joined(across, down, share, step):
                    _draw_triangle(net, i + 1, j + 1, i, j + 1, i + 1, j, out)


class CaptureTracer:
    """Light along camera rays into a capture; the counterpart of `tracing.Tracer`."""

    def __init__(self, rig: Rig, scene: Scene, capture: MeasuredScene) -> None:
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
        self._medium = fog.medium_of(scene.fog)
        self._frame = ProjectorFrame(rig.projector)
        self.shadows = self._draw_shadows()

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
        directions = self.rig.camera_rays(columns, rows)
        vectors, q = self._from_projector(directions, depth)
        row, column = self._frame.places(q)
        lit = np.flatnonzero(row >= 0)
        shaded = self.shadows.shaded(q[lit])
        row[lit[shaded]] = column[lit[shaded]] = -1
        lit = lit[~shaded]
        known = depth < np.inf
        photo = np.where(known[:, None], self._photo[pixel], np.float32(0))
        direct = np.zeros_like(photo)
        direct[lit] = photo[lit] * bounded(q[lit, 2] ** -2.0)[:, None]
        out = Pixels(row, column, bounded(1 / depth), direct, photo * self._ambient)
        if self._medium is not None:
            eye, light = point(self.rig.camera_centre_m), point(self.rig.projector_centre_m)
            places = np.arange(len(depth))
            fog.dim(self._medium, eye, light, directions, depth, vectors, float(self._ambient), places, out)
        return Rays(*out, depth, q.astype(np.float32))

    def _from_projector(self, directions: Doubles, depth: Doubles) -> tuple[Doubles, Doubles]:
        vectors, q = np.empty_like(directions), np.empty_like(directions)
        centre, light = self.rig.camera_centre_m, self.rig.projector_centre_m
        kernels.to_projector_axes(centre, directions, depth, light, self.rig.rotation, vectors, q)
        return vectors, q

    def _draw_shadows(self) -> ShadowMap:
        """The shadow map of the measured surface, drawn band by band to bound the memory."""
        height, width = self._depth.shape
        net = np.empty((height, width, 3), np.float32)
        band = max(1, RAYS_PER_BAND // width)
        for top in range(0, height, band):
            part = self._depth[top : top + band]
            rows, columns = np.indices(part.shape).reshape(2, -1) + 0.5
            directions = self.rig.camera_rays(columns, rows + top)
            net[top : top + band] = self._from_projector(directions, part.ravel())[1].reshape(*part.shape, 3)
        return ShadowMap(net, self.rig.camera.lens, self._frame)


class ShadowMap:
    """The inverse depth of the nearest surface along directions from the projector, at the camera's pixel pitch.

    nearest (h, w) in 1/m, 0 where nothing is known: cell (r, c) covers (x/z - low[0]) scale[0] in [c, c + 1) and
    (y/z - low[1]) scale[1] in [r, r + 1).
    """

    def __init__(self, net: Singles, lens: Lens, frame: ProjectorFrame) -> None:
        """Draw a net (H, W, 3) of x/z, y/z, z in projector axes (NaN, NaN, -1 where nothing is known)."""
        extent = frame.high - frame.low
        self.scale = np.minimum([lens.fx, lens.fy], MAX_MAP_SIDE / extent)
        # Cells in step with the camera's pixels: of the ideal rig a column of pixels fills one column of cells.
        step = np.array([lens.cx / lens.fx, lens.cy / lens.fy])
        self.low = np.floor((frame.low + step) * self.scale) / self.scale - step
        size = np.ceil(extent * self.scale).astype(int) + 2
        self.nearest = np.zeros((size[1], size[0]), np.float32)
        net[..., :2] = (net[..., :2] - self.low) * self.scale
        net[..., 2] = np.where(net[..., 2] > 0, 1 / net[..., 2], 0)
        draw_net(net, JUMP[0], JUMP[1], self.nearest)

    def shaded(self, q: Doubles) -> Bools:
        """Whether something stands before the points q (R, 3), given as x/z, y/z, z inside the projector's frame."""
        column, row = ((q[:, :2] - self.low) * self.scale).astype(np.int64).T
        nearest = self.nearest[row, column]
        w = 1 / q[:, 2]
        return np.asarray((nearest > w * (1 + CLEARANCE[0])) & (nearest > w + CLEARANCE[1]))
