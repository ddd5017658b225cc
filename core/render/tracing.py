"""Light along single camera rays: where the surface is, which projector row lights it, and how brightly.

A Lambertian two-sided surface lit by a projector whose pixels carry equal flux (value 1 each) shows
L = albedo cos_i / (z_p^2 cos theta), with z_p its depth from the projector and theta its angle off the projector's
axis. With n . (P - C_p) the distance of the projector from the tangent plane this is albedo |n . (P - C_p)| / z_p^3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from slopegate.core.render import kernels
from slopegate.core.render.casting import Body, Pose
from slopegate.core.render.facets import View, ask_everywhere
from slopegate.core.render.kernels import Hits, Pixels
from slopegate.core.render.kernels_facets import Cells
from slopegate.core.rig.rig import Lens, Projector, Rig
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

RAYS_PER_BAND = 1 << 16
"""Rays to cast at a time: bounds the memory beside the buffers to about 20 MB."""


@dataclass(frozen=True, eq=False)
class Rays:
    """What R camera rays see: the fields of `render.Buffers` with one leading axis, the exact depth (R,) float64
    (infinite where there is no surface), and where the points lie as seen from the projector: beam (R, 3) float32,
    x/z, y/z and z in its axes (NaN, NaN and -1 where no surface is in front of it)."""

    projector_row: Singles
    inverse_depth: Singles
    direct: Singles
    ambient: Singles
    depth: Doubles
    beam: Singles


class Placed(NamedTuple):
    """A body at a pose, and what it shows the camera and the projector there."""

    body: Body
    pose: Pose
    seen: Cells
    lit: Cells


class Tracer:
    """The surfaces of a scene, made ready for ray casting by one rig."""

    def __init__(self, rig: Rig, scene: Scene, skip: bool = True) -> None:
        """skip False: cast every ray at every body, also where it is known beforehand what it meets."""
        self.rig = rig
        self.frame = ProjectorFrame(rig.projector)
        self._ambient = np.float32(scene.ambient)
        pitch = 1 / rig.camera.lens.fx
        self._views = (
            View(rig.camera_centre_m, np.eye(3), *field_of(rig.camera.lens), pitch),
            View(rig.projector_centre_m, rig.rotation, self.frame.low, self.frame.high, pitch),
        )
        self._skip = skip
        self._moving = [(Body(items), motion) for items, motion in _moving_together(scene)]
        still = Body([item for item in scene.objects if item.motion is None])
        self._still = self._place(still, Pose(np.eye(3), np.zeros(3)))

    def still(self) -> tuple[Placed, ...]:
        """What never moves."""
        return (self._still,)

    def poses(self, time_s: float) -> tuple[Pose, ...]:
        """Where the moving bodies are at this time."""
        return tuple(Pose(*motion.pose(time_s)) for _, motion in self._moving)

    def moving(self, time_s: float) -> tuple[Placed, ...]:
        """What moves, where it is at this time."""
        poses = self.poses(time_s)
        return tuple(self._place(body, pose) for (body, _), pose in zip(self._moving, poses, strict=True))

    def _place(self, body: Body, pose: Pose) -> Placed:
        if not self._skip:
            return Placed(body, pose, ask_everywhere(), ask_everywhere())
        seen, lit = (view.look(body.triangles, body.spheres, *pose) for view in self._views)
        return Placed(body, pose, seen, lit)

    def trace(self, columns: Doubles, rows: Doubles, bodies: Sequence[Placed]) -> Rays:
        """Cast one ray through each camera position (columns, rows), (R,) float64 continuous pixel coordinates."""
        directions = self.rig.camera_rays(columns, rows)
        hits = Hits(np.full(len(directions), np.inf), np.zeros(len(directions)), np.zeros(directions.shape, np.float32))
        self._cast(directions, bodies, hits)
        count = len(directions)
        colour = np.empty((2, count, 3), np.float32)
        out = Pixels(np.empty(count, np.float32), np.empty(count, np.float32), colour[0], colour[1])
        q = self._light(directions, hits, bodies, np.arange(count), out)
        return Rays(*out, hits.depth, q.astype(np.float32))

    def trace_over(
        self, directions: Doubles, depth: Doubles, moving: Sequence[Placed], places: Indices, out: Pixels
    ) -> Indices:
        """Write what those of the rays (R, 3) from the camera see that meet a moving body before the `depth` (R,) of
        what never moves into their `places` (R,) in `out`; returns these. The directions are of no use afterwards."""
        hits = Hits(depth.copy(), np.empty(len(depth)), np.empty(directions.shape, np.float32))
        self._cast(directions, moving, hits)
        kept = np.empty(len(depth), np.int64)
        count = kernels.keep_nearer(depth, directions, hits, kept)
        part = Hits(hits.depth[:count], hits.facing[:count], hits.colour[:count])
        covered = places[kept[:count]]
        self._light(directions[:count], part, (*self.still(), *moving), covered, out)
        return covered

    def _cast(self, directions: Doubles, bodies: Sequence[Placed], hits: Hits) -> None:
        for body, pose, seen, _ in bodies:
            body.cast(self.rig.camera_centre_m, directions, self.rig.projector_centre_m, pose, seen, hits)

    def _light(
        self, directions: Doubles, hits: Hits, bodies: Sequence[Placed], places: Indices, out: Pixels
    ) -> Doubles:
        """Write the projector's light on the points hit; returns those (R, 3) as x/z, y/z, z in its axes."""
        vectors, q = self._from_projector(directions, hits.depth)
        row = self.frame.rows(q)
        self._shade(vectors, q, bodies, row)
        kernels.shine(row, q, hits, self._ambient, places, out)
        return q

    def shaded(self, directions: Doubles, depth: Doubles, bodies: Sequence[Placed]) -> NDArray[np.bool_]:
        """Whether a body keeps the projector's light from the point at `depth` (R,) on each of these camera rays."""
        vectors, q = self._from_projector(directions, depth)
        row = np.zeros(len(depth), np.float32)
        self._shade(vectors, q, bodies, row)
        return row < 0

    def _shade(self, vectors: Doubles, q: Doubles, bodies: Sequence[Placed], row: Singles) -> None:
        for body, pose, _, lit in bodies:
            body.shade(self.rig.projector_centre_m, vectors, q, pose, lit, row)

    def _from_projector(self, directions: Doubles, depth: Doubles) -> tuple[Doubles, Doubles]:
        rig = self.rig
        vectors, q = np.empty_like(directions), np.empty_like(directions)
        centre, light = rig.camera_centre_m, rig.projector_centre_m
        kernels.to_projector_axes(centre, directions, depth, light, rig.rotation, vectors, q)
        return vectors, q


def field_of(lens: Lens) -> tuple[Doubles, Doubles]:
    """Least and greatest (x/z, y/z) that a lens sees, taken a little large."""
    # The outline of the raster holds the extremes: lenses whose distortion folds the picture are of no use.
    along = np.linspace(0.0, 1.0, 65)
    ends = np.zeros_like(along), np.ones_like(along)
    x, y = lens.normalise(
        np.concatenate([along, along, *ends]) * lens.width, np.concatenate([*ends, along, along]) * lens.height
    )
    margin = 0.01 * max(np.ptp(x), np.ptp(y))
    return np.array([x.min() - margin, y.min() - margin]), np.array([x.max() + margin, y.max() + margin])


class ProjectorFrame:
    """The projector's raster as a test: which row lights a point, if any does."""

    def __init__(self, projector: Projector) -> None:
        self._lens = projector.lens
        # A distorted lens folds points far outside its field back into the raster; nothing beyond the undistorted
        # outline of the raster, taken a little large, is ever lit.
        self.low, self.high = field_of(projector.lens)
        height = projector.lens.height
        self._last_row = np.nextafter(np.float32(height), np.float32(0))

    def rows(self, q: Doubles) -> Singles:
        """Projector row coordinate (R,) float32 of points q (R, 3), x/z, y/z, z in projector axes; -1 outside."""
        out = np.full(len(q), -1, np.float32)
        if not self._lens.distorted:
            kernels.pinhole_rows(q, self._lens.matrix, self._lens.width, self._lens.height, self._last_row, out)
            return out
        inside = np.flatnonzero(((q[:, :2] >= self.low) & (q[:, :2] <= self.high)).all(axis=1))
        column, row = self._lens.project(q[inside, 0], q[inside, 1])
        lit = (column >= 0) & (column < self._lens.width) & (row >= 0) & (row < self._lens.height)
        out[inside[lit]] = np.minimum(row[lit].astype(np.float32), self._last_row)
        return out


def bounded(values: Doubles) -> Singles:
    """As float32, kept finite: surfaces that touch a centre of projection have values beyond its range."""
    return np.minimum(values, 1e30).astype(np.float32)


def _moving_together(scene: Scene) -> list[tuple[list[Mesh | Sphere], KeyFrames]]:
    """The moving objects in groups of equal motion: each group is one body, and every body costs every ray."""
    groups: dict[tuple[object, ...], tuple[list[Mesh | Sphere], KeyFrames]] = {}
    for item in scene.objects:
        if item.motion is not None:
            m = item.motion
            turns = bool((m.rotations != np.eye(3)).any())
            key = (m.times_s.tobytes(), m.positions_m.tobytes(), m.rotations.tobytes(), m.loop, turns and m.pivot_m)
            groups.setdefault(key, ([], m))[0].append(item)
    return list(groups.values())
