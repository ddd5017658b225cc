"""How far the projector's light comes: a depth map as the projector sees it, for shadows in the fog.

Shadows on surfaces are traced ray by ray (`render`); in the fog a map of the projector's own pixels is enough. Glass
casts no shadow here. In a capture only what its camera saw casts one, as on its surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from typing import Final

import numpy as np

from slopegate.core.light.airlight_exact import make_optics
from slopegate.core.light.airlight_table import Box, ShadeMap
from slopegate.core.render.kernels import Hits
from slopegate.core.render.measured import CaptureTracer
from slopegate.core.render.tracing import RAYS_PER_BAND, Body, Placed, Pose, Tracer
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.materials import Glass
from slopegate.core.scene.scene import Scene

_NOWHERE: Final[Box] = (0, 0, 0, 0)
_BEFORE_M: Final = 1e-3
"""A body that comes nearer than this to the projector's plane may shade anything."""


class LitDepth:
    """The map, and what is in it of what moves."""

    def __init__(self, rig: Rig, scene: Scene, time_s: float) -> None:
        self._rig = rig
        opaque = tuple(item for item in scene.objects if not isinstance(item.material, Glass))
        self._tracer = Tracer(rig, replace(scene, objects=opaque), skip=False) if opaque else None
        self.map = _empty_map(rig)
        if scene.capture is not None:
            shadows = CaptureTracer(rig, scene, scene.capture).shadows
            left, top, scale_x, scale_y = map(float, (*shadows.low, *shadows.scale))
            self.map = ShadeMap(left, top, scale_x, scale_y, shadows.nearest)
        if self._tracer is not None:
            height, width = self.map.nearest.shape
            self._cast(self._tracer.still(), (0, height, 0, width), self.map.nearest)
        if self._tracer is None and scene.capture is None:
            self.map = self.map._replace(nearest=np.zeros((0, 0), np.float32))
        self._still = self.map.nearest.copy() if scene.moving else self.map.nearest
        self._poses: list[bytes] = []
        self._box = _NOWHERE
        self.move(time_s)

    def move(self, time_s: float) -> Box:
        """Show what moves where it is at this time; the box of cells that may have changed, (0, 0, 0, 0) for none."""
        moving = self._tracer.moving(time_s) if self._tracer is not None else ()
        poses = [pose.rotation.tobytes() + pose.position.tobytes() for _, pose, _, _ in moving]
        if poses == self._poses:
            return _NOWHERE
        boxes = [self._box, *(self._reach(body, pose) for body, pose, _, _ in moving)]
        before, now = self._box, _union(boxes[1:])
        nearest = self.map.nearest
        rows, columns = slice(before[0], before[1]), slice(before[2], before[3])
        nearest[rows, columns] = self._still[rows, columns]
        for placed, box in zip(moving, boxes[1:], strict=True):
            self._cast([placed], box, nearest)
        self._poses, self._box = poses, now
        return _union([before, now])

    def _cast(self, bodies: Sequence[Placed], box: Box, nearest: Singles) -> None:
        """Enter bodies into the cells of a box."""
        top, bottom, left, right = box
        light, rotation = self._rig.projector_centre_m, self._rig.rotation
        if top >= bottom or left >= right:
            return
        band = max(1, RAYS_PER_BAND // (right - left))
        x = self.map.left + (np.arange(left, right) + 0.5) / self.map.scale_x
        for first in range(top, bottom, band):
            last = min(first + band, bottom)
            y = self.map.top + (np.arange(first, last) + 0.5) / self.map.scale_y
            slopes = np.stack(np.broadcast_arrays(x, y[:, None], 1.0), axis=-1).reshape(-1, 3)
            # Of length 1 along the projector's axis, so that hits are at depths along it.
            directions = np.ascontiguousarray(slopes @ rotation)
            count = len(directions)
            hits = Hits(np.full(count, np.inf), np.empty(count), np.empty((count, 3), np.float32))
            for body, pose, _, cells in bodies:
                body.cast(light, directions, light, pose, cells, hits)
            part = nearest[first:last, left:right]
            np.maximum(part, (1 / hits.depth).astype(np.float32).reshape(part.shape), out=part)

    def _reach(self, body: Body, pose: Pose) -> Box:
        """The cells in which a body may be seen."""
        radii = np.repeat(body.spheres.radii, 8)[:, None]
        corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        cubes = np.repeat(body.spheres.centres, 8, axis=0) + radii * np.tile(corners, (len(body.spheres.radii), 1))
        points = np.concatenate([body.triangles.reshape(-1, 3), cubes]) @ pose.rotation.T + pose.position
        seen = (points - self._rig.projector_centre_m) @ self._rig.rotation.T
        height, width = self.map.nearest.shape
        if (seen[:, 2] < _BEFORE_M).all():
            return _NOWHERE
        if (seen[:, 2] < _BEFORE_M).any():
            return 0, height, 0, width
        low, high = (f(seen[:, :2] / seen[:, 2:], axis=0) for f in (np.min, np.max))
        left, right = _cells(low[0], high[0], self.map.left, self.map.scale_x, width)
        top, bottom = _cells(low[1], high[1], self.map.top, self.map.scale_y, height)
        return top, bottom, left, right


def _empty_map(rig: Rig) -> ShadeMap:
    """A map with nothing in it: cells are the projector's pixels, but for what its lens distorts."""
    lens, optics = rig.projector.lens, make_optics(rig)
    width, height = (
        ceil(round((high - low) * focal, 6))
        for low, high, focal in zip(optics.low, optics.high, (lens.fx, lens.fy), strict=True)
    )
    return ShadeMap(*optics.low, lens.fx, lens.fy, np.zeros((height, width), np.float32))


def _cells(low: float, high: float, start: float, scale: float, count: int) -> tuple[int, int]:
    """First cell that low..high touches, and one past the last, with one more at either side."""
    first, last = np.clip([(low - start) * scale - 1, (high - start) * scale + 2], 0, count)
    return int(first), int(last)


def _union(boxes: Sequence[Box]) -> Box:
    """The box round all that are not empty."""
    full = [box for box in boxes if box[0] < box[1] and box[2] < box[3]]
    if not full:
        return _NOWHERE
    tops, bottoms, lefts, rights = zip(*full, strict=True)
    return min(tops), max(bottoms), min(lefts), max(rights)
