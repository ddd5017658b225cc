"""Light that reaches surfaces through glass: particles from the projector, each of which knows its row.

Paths from the camera cannot ask a point for what it sends through glass. Particles start evenly over the projector's
raster, where glass may be, pass glass as paths do, and leave their light on every matt surface that they meet from
there on and that the camera sees directly. What is seen of that through glass again is left out, and so is what lobes
throw of it towards the camera.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light import kernels_bake as kernels
from slopegate.core.light.cells import Picture
from slopegate.core.light.kernels_bake import Paths, Vertices
from slopegate.core.light.kernels_surfaces import GLASS
from slopegate.core.light.points import hashed, pair
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.light.walk import BATCH, Walk
from slopegate.core.render.fog import length_within, medium_of
from slopegate.core.render.render import Cancelled, Progress
from slopegate.core.render.tracing import ProjectorFrame, point
from slopegate.core.rig.arrays import Doubles, Ints, Singles
from slopegate.core.rig.rig import Rig, Vector3
from slopegate.core.scene.scene import Scene


class Splats(NamedTuple):
    """Light of N particles on what the camera sees: places (N, 3) int32, pixel, projector row and column; light (N, C)
    float32, divided by the surface's colour, times the tangent area of the camera that it is spread over."""

    places: Ints
    light: Singles


_Box = tuple[Vector3, Vector3]
_AIM: Final = 6000
"""Seed of where particles start."""


class Caustics:
    """Particles through the glass of a scene, into the cells of a picture."""

    def __init__(self, rig: Rig, scene: Scene, surfaces: Surfaces, picture: Picture) -> None:
        self._rig, self._surfaces, self._picture = rig, surfaces, picture
        self._medium = medium_of(scene.fog)
        self._frame = ProjectorFrame(rig.projector)
        self._low, self._high = self._aim()
        self._area = tangent_areas(rig, picture)

    def _aim(self) -> tuple[Doubles, Doubles]:
        """Least and greatest (x/z, y/z) in the projector's axes at which there is glass, within its field."""
        low, high = self._frame.low, self._frame.high
        near, far = self._surfaces.glass_bounds()
        corners = np.array([[(near, far)[n >> k & 1][k] for k in range(3)] for n in range(8)])
        q = (corners - self._rig.projector_centre_m) @ self._rig.rotation.T
        if (q[:, 2] <= 1e-6).any():
            return low, high
        seen = q[:, :2] / q[:, 2:]
        return np.maximum(low, seen.min(axis=0)), np.minimum(high, seen.max(axis=0))

    def light(self, walk: Walk, count: int, seed: int, max_order: int, progress: Progress | None) -> Singles:
        """What `count` particles bring to the cells, (R, B, C, W) float32: light divided by the surface's colour."""
        grid, rows = self._picture.grid, self._rig.projector.lens.height
        light = np.zeros((grid.rows, walk.bands, walk.paths.weight.shape[1], grid.columns), np.float32)
        splats = self.splats(walk, count, seed, max_order, progress)
        home = self._picture.view.home[splats.places[:, 0]]
        splats.light[:] /= np.maximum(self._area[home], 1e-30)[:, None]
        leave(home, splats.places[:, 1], rows, splats.light, light)
        return light / np.float32(max(count, 1))

    def splats(self, walk: Walk, count: int, seed: int, max_order: int, progress: Progress | None) -> Splats:
        """Where `count` particles light what the camera sees directly."""
        paths, channels = walk.paths, walk.paths.weight.shape[1]
        found = [Splats(np.zeros((0, 3), np.int32), np.zeros((0, channels), np.float32))]
        size = self._high - self._low
        if not (size > 0).all():
            return found[0]
        for first in range(0, count, BATCH):
            if progress is not None and not progress(1.0):
                raise Cancelled("The bake was stopped")
            some = min(BATCH, count - first)
            q = np.empty((some, 3))
            _start(first, some, seed, self._low, size, q)
            sent = self._frame.places(q)
            lit = np.flatnonzero(sent[0] >= 0)
            some = len(lit)
            away = q[lit] @ self._rig.rotation
            paths.direction[:some] = away / np.sqrt((away**2).sum(axis=1, keepdims=True))
            paths.origin[:some] = self._rig.projector_centre_m
            paths.weight[:some] = 1.0
            paths.number[:some], paths.inside[:some] = first + lit, 0
            # While only glass was met; `slot` keeps which particle it was.
            paths.plain[:some], paths.slot[:some] = kernels.ON_SIGHT, np.arange(some)
            places = np.column_stack([place[lit].astype(np.int32) for place in sent])
            self._follow(walk, some, seed, max_order, places, found)
        places, light = (np.concatenate(parts) for parts in zip(*found, strict=True))
        # Each carries pi times its share of the field; pi is that of a matt surface's radiance.
        return Splats(places, light * np.float32(size.prod()))

    def _follow(self, walk: Walk, count: int, seed: int, max_order: int, places: Ints, found: list[Splats]) -> None:
        """Take a batch of particles, sent from projector rows and columns (N, 2), to its end."""
        paths, at, materials = walk.paths, walk.at, self._surfaces.materials
        for order in range(1, max_order + 1):
            met = self._surfaces.meet(paths.origin[:count], paths.direction[:count])
            kernels.arrive(count, paths, met, at)
            if order == 1:
                _only_glass(count, materials, at)
            if self._medium is not None:
                self._fade(count, paths, at)
            found.append(self._splat(count, paths, at, places))
            count = kernels.turn(count, order, seed ^ 0x5A5A5A5A, 0.0, materials, paths, at)
            if not count:
                return

    def _fade(self, count: int, paths: Paths, at: Vertices) -> None:
        """Take from the particles what fog keeps of them on their last leg; what it scatters is lost."""
        medium = self._medium
        if medium is not None:
            _fade_legs(count, (medium.lo, medium.hi), medium.extinction, paths, at)

    def _splat(self, count: int, paths: Paths, at: Vertices, places: Ints) -> Splats:
        """The particles' light on the matt surfaces that the camera sees."""
        rig, grid = self._rig, self._picture.grid
        here = np.flatnonzero((at.kind[:count] >= 0) & (self._surfaces.materials[at.kind[:count], 0] != GLASS))
        points = at.point[here].astype(np.float64)
        columns, rows, depth = rig.to_camera(points)
        with np.errstate(invalid="ignore"):
            inside = (columns >= 0) & (columns < grid.width) & (rows >= 0) & (rows < grid.height)
        here, points, depth = here[inside], points[inside], depth[inside]
        pixel = rows[inside].astype(np.int64) * grid.width + columns[inside].astype(np.int64)
        ways = points - rig.camera_centre_m
        facing = -(at.normal[here] * ways).sum(axis=1)
        starts = np.broadcast_to(rig.camera_centre_m, ways.shape).astype(np.float32)
        hidden = self._surfaces.blocked(starts, ways.astype(np.float32)) | (facing <= 0)
        strength = facing / np.maximum(depth, 1e-6) ** 3
        if self._medium is not None:
            medium = self._medium
            _fade_ways(ways, (medium.lo, medium.hi), medium.extinction, point(rig.camera_centre_m), strength)
        seen = here[~hidden]
        light = paths.weight[seen] * strength[~hidden, None]
        where = np.column_stack([pixel[~hidden], places[paths.slot[seen]]])
        return Splats(where.astype(np.int32), light.astype(np.float32))


def tangent_areas(rig: Rig, picture: Picture) -> Doubles:
    """Tangent area (N,) of every cell's pixels: a picture's pixels are all as large as that on the axis."""
    lens, cells = rig.camera.lens, picture.grid.rows * picture.grid.columns
    return np.asarray(np.bincount(picture.view.home, minlength=cells) / (lens.fx * lens.fy))


@njit(cache=True, nogil=True)
def _start(first: int, count: int, seed: int, low: Doubles, size: Doubles, q: Doubles) -> None:
    """Places (N, 3) evenly spread over the field: x/z, y/z and 1, in the projector's axes."""
    own = hashed(seed, _AIM)
    for n in range(count):
        u, v = pair(np.uint32(first + n), own)
        q[n, 0], q[n, 1], q[n, 2] = low[0] + u * size[0], low[1] + v * size[1], 1.0


@njit(cache=True, nogil=True)
def _only_glass(count: int, materials: Singles, at: Vertices) -> None:
    """Forget the particles that did not meet glass first: theirs is light that paths from the camera find."""
    for i in range(count):
        if at.kind[i] >= 0 and materials[at.kind[i], 0] != GLASS:
            at.kind[i] = kernels.NOTHING


@njit(cache=True, nogil=True, error_model="numpy")
def _fade_legs(
    count: int,
    box: _Box,
    extinction: float,
    paths: Paths,
    at: Vertices,
) -> None:
    for i in range(count):
        if at.kind[i] < 0:
            continue
        start = (float(paths.origin[i, 0]), float(paths.origin[i, 1]), float(paths.origin[i, 2]))
        way = (at.point[i, 0] - start[0], at.point[i, 1] - start[1], at.point[i, 2] - start[2])
        kept = np.float32(np.exp(-extinction * length_within(box[0], box[1], start, way, 1.0)))
        for k in range(paths.weight.shape[1]):
            paths.weight[i, k] *= kept


@njit(cache=True, nogil=True, error_model="numpy")
def _fade_ways(
    ways: Doubles,
    box: _Box,
    extinction: float,
    start: Vector3,
    strength: Doubles,
) -> None:
    for i in range(ways.shape[0]):
        way = (ways[i, 0], ways[i, 1], ways[i, 2])
        strength[i] *= np.exp(-extinction * length_within(box[0], box[1], start, way, 1.0))


@njit(cache=True, nogil=True)
def leave(home: Ints, row: Ints, rows: int, light: Singles, out: Singles) -> None:
    """Add light (N, C) to cells home (N,) of out (R, B, C, W), in the bands of the projector's rows (N,), 0 to rows."""
    columns = out.shape[3]
    for n in range(home.shape[0]):
        band = kernels.part_of_line(row[n], rows, out.shape[1])
        r, c = home[n] // columns, home[n] % columns
        for k in range(out.shape[2]):
            out[r, band, k, c] += light[n, k]
