"""Light along single camera rays: where the surface is, which projector row lights it, and how brightly.

A Lambertian two-sided surface lit by a projector whose pixels carry equal flux (value 1 each) shows
L = albedo cos_i / (z_p^2 cos theta), with z_p its depth from the projector and theta its angle off the projector's
axis. With n . (P - C_p) the distance of the projector from the tangent plane this is albedo |n . (P - C_p)| / z_p^3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from slopegate.core import kernels_render as kernels
from slopegate.core.casting import Body, Hits
from slopegate.core.rig import Projector, Rig
from slopegate.core.scene import KeyFrames, Mesh, Scene, Sphere
from slopegate.core.silhouettes import Field

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bits = NDArray[np.uint32]

LAST_BIT = 31
"""Bodies beyond the 32nd share its bit: their silhouettes are taken together."""

RAYS_PER_BAND = 1 << 16
"""Rays to cast at a time: bounds the memory beside the buffers to about 20 MB."""


@dataclass(frozen=True, eq=False)
class Rays:
    """What R camera rays see: the fields of `render.Buffers` with one leading axis, the exact depth (R,) float64
    (infinite where there is no surface), and where the points lie as seen from the projector: beam (R, 2) float32, x/z
    and y/z in its axes (NaN where no surface is in front of it)."""

    projector_row: Singles
    inverse_depth: Singles
    direct: Singles
    ambient: Singles
    depth: Doubles
    beam: Singles


@dataclass(frozen=True, eq=False)
class Placed:
    """A body at a pose: a point p of the body is at rotation p + position.

    bit: what stands for it in `silhouettes.Field`, 0 for a body without silhouette, at which all rays are cast.
    """

    body: Body
    rotation: Doubles
    position: Doubles
    bit: int

    def outline(self) -> tuple[Doubles, Ints]:
        """World points (P, 3) and triangles (T, 3) between them that cover the body from wherever it is seen."""
        points, faces = self.body.outline()
        return points @ self.rotation.T + self.position, faces


class Tracer:
    """The surfaces of a scene, made ready for ray casting by one rig."""

    def __init__(self, rig: Rig, scene: Scene) -> None:
        self.rig = rig
        self._ambient = np.float32(scene.ambient)
        self._still = Body([item for item in scene.objects if item.motion is None])
        self._moving = [(Body(items), motion) for items, motion in _moving_together(scene)]
        self.frame = ProjectorFrame(rig.projector)

    def still(self) -> tuple[Placed, ...]:
        """What never moves."""
        return (Placed(self._still, np.eye(3), np.zeros(3), 0),)

    def moving(self, time_s: float) -> tuple[Placed, ...]:
        """What moves, where it is at this time."""
        return tuple(
            Placed(body, *motion.pose(time_s), 1 << min(index, LAST_BIT))
            for index, (body, motion) in enumerate(self._moving)
        )

    def trace(self, columns: Doubles, rows: Doubles, bodies: Sequence[Placed]) -> Rays:
        """Cast one ray through each camera position (columns, rows), (R,) float64 continuous pixel coordinates."""
        directions = self.rig.camera_rays(columns, rows)
        hits = Hits.none(len(directions))
        for placed in bodies:
            self._cast(directions, placed, hits)
        return self._light(directions, hits, bodies, None)

    def trace_over(
        self,
        columns: Doubles,
        rows: Doubles,
        depth: Doubles,
        moving: Sequence[Placed],
        seen: Bits,
        lit: Field,
    ) -> tuple[NDArray[np.int64], Rays]:
        """Which of these rays meet a moving body before the `depth` (R,) of what never moves, and what those see.

        seen: the bits (R,) of the bodies that each ray may meet; lit: their silhouettes as the projector sees them.
        """
        directions = self.rig.camera_rays(columns, rows)
        hits = Hits.none(len(directions), depth)
        for placed in moving:
            among = np.flatnonzero(seen & np.uint32(placed.bit))
            part = hits.part(among)
            self._cast(directions[among], placed, part)
            hits.put(among, part)
        met = np.flatnonzero(hits.depth < depth)
        return met, self._light(directions[met], hits.part(met), (*self.still(), *moving), lit)

    def _cast(self, directions: Doubles, placed: Placed, hits: Hits) -> None:
        points = self.rig.camera_centre_m, self.rig.projector_centre_m
        (origin, light), turned = _own_frame(placed, points, directions)
        placed.body.cast(origin, turned, light, hits)

    def _light(self, directions: Doubles, hits: Hits, bodies: Sequence[Placed], silhouettes: Field | None) -> Rays:
        """The projector's light on the points hit."""
        origin, light = self.rig.camera_centre_m, self.rig.projector_centre_m
        vectors, q = np.zeros_like(directions), np.empty_like(directions)
        kernels.to_projector_axes(origin, directions, hits.depth, light, self.rig.rotation, vectors, q)
        row = self.frame.rows(q)
        lit = np.flatnonzero(row >= 0)
        beam = q[:, :2].astype(np.float32)
        bits = None if silhouettes is None else silhouettes.bodies(beam[lit])
        shaded = _shaded(light, vectors[lit], bodies, bits)
        row[lit[shaded]] = -1
        direct = np.empty_like(hits.colour)
        kernels.shine(row, q, hits.facing, hits.colour, direct)
        return Rays(row, bounded(1 / hits.depth), direct, hits.colour * self._ambient, hits.depth, beam)

    def shaded(
        self, columns: Doubles, rows: Doubles, depth: Doubles, bodies: Sequence[Placed], bits: Bits
    ) -> NDArray[np.bool_]:
        """Whether a body keeps the projector's light from the point at `depth` (R,) on each of these camera rays.

        bits (R,): which bodies may.
        """
        light = self.rig.projector_centre_m
        directions = self.rig.camera_rays(columns, rows)
        vectors, q = np.zeros_like(directions), np.empty_like(directions)
        kernels.to_projector_axes(self.rig.camera_centre_m, directions, depth, light, self.rig.rotation, vectors, q)
        return _shaded(light, vectors, bodies, bits)


class ProjectorFrame:
    """The projector's raster as a test: which row lights a point, if any does."""

    def __init__(self, projector: Projector) -> None:
        self._lens = projector.lens
        # A distorted lens folds points far outside its field back into the raster; nothing beyond the undistorted
        # outline of the raster, taken a little large, is ever lit.
        width, height = self._lens.width, self._lens.height
        along = np.linspace(0.0, 1.0, 65)
        ends = np.zeros_like(along), np.ones_like(along)
        x, y = self._lens.normalise(
            np.concatenate([along, along, *ends]) * width, np.concatenate([*ends, along, along]) * height
        )
        margin = 0.01 * max(np.ptp(x), np.ptp(y))
        self.low = np.array([x.min() - margin, y.min() - margin])
        self.high = np.array([x.max() + margin, y.max() + margin])
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


def _shaded(light: Doubles, vectors: Doubles, bodies: Sequence[Placed], bits: Bits | None) -> NDArray[np.bool_]:
    """Whether any body, or any whose bit is set, stands between the light and light + vectors (R, 3), world axes."""
    shaded = np.zeros(len(vectors), np.bool_)
    for placed in bodies:
        if bits is None or placed.bit == 0:
            (centre,), turned = _own_frame(placed, (light,), vectors)
            placed.body.shade(centre, turned, shaded)
            continue
        among = np.flatnonzero((bits & np.uint32(placed.bit) != 0) & ~shaded)
        part = np.zeros(len(among), np.bool_)
        (centre,), turned = _own_frame(placed, (light,), vectors[among])
        placed.body.shade(centre, turned, part)
        shaded[among] = part
    return shaded


def _own_frame(placed: Placed, points: Sequence[Doubles], vectors: Doubles) -> tuple[list[Doubles], Doubles]:
    """World points and vectors (R, 3) in the frame of a body."""
    if not placed.position.any() and np.array_equal(placed.rotation, np.eye(3)):
        return list(points), vectors
    turned = np.empty_like(vectors)
    kernels.into_frame(vectors, placed.rotation, turned)
    return [placed.rotation.T @ (point - placed.position) for point in points], turned
