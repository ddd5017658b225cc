"""Where camera and projector see a skin: points, tangent planes, and what falls in about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopegate.core.light.kernels_subsurface import Light, SkinColumns, Tangents, bend, gather
from slopegate.core.render.facets import ask_everywhere
from slopegate.core.render.kernels import Hits
from slopegate.core.render.tracing import Body, Placed, Pose, solid_triangles
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Ints, Singles
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.scene.materials import Skin
from slopegate.core.scene.scene import Mesh, Sphere

_SAME = 1 + 1e-9
"""Two distances along a ray that are the same surface, computed twice."""
_NODES, _SHARES = np.polynomial.laguerre.laggauss(4)
"""Radii^2 / (2 sigma^2) and their weights: the mean over a Gaussian's area is exact for polynomials up to r^14."""
_DIRECTIONS = 8
"""Directions in which light is looked up about a point."""
_BEND_SIGMAS = 1.5
"""Where the skin's curvature is measured, in the widest lobe's deviations: most of what a gate beside the row shows."""
_SLOPE_STEP = 1e-4
"""Step, in x/z and y/z, of the slope of a distorted projector lens."""


class SkinPatch(NamedTuple):
    """Pixels (P,) of a raster that see a surface first: their numbers; the points (P, 3) in world axes, unit normals
    (P, 3) and texture coordinates (P, 2) there, 0 where a mesh has none."""

    pixels: Indices
    points: Doubles
    normals: Doubles
    uv: Doubles


@dataclass(frozen=True, eq=False)
class View:
    """A raster seen from a centre: its lens, and the rotation from world axes into its own."""

    centre: Doubles
    lens: Lens
    rotation: Doubles

    def rays(self, pixels: Indices) -> Doubles:
        """Directions (R, 3) in world axes, of depth 1 along the view's own axis, through the middles of pixels."""
        rows, columns = np.divmod(pixels, self.lens.width)
        x, y = self.lens.normalise(columns + 0.5, rows + 0.5)
        return np.stack([x, y, np.ones_like(x)], axis=-1) @ self.rotation

    def around(self, low: Doubles, high: Doubles) -> Indices:
        """Pixels that may see what lies in a box of the world; all where a part of it is not well in front."""
        lens = self.lens
        corners = np.stack([np.where([i & 1, i & 2, i & 4], high, low) for i in range(8)])
        local = (corners - self.centre) @ self.rotation.T
        if lens.distorted or local[:, 2].min() < 1e-3:
            return np.arange(lens.width * lens.height)
        column, row = lens.project(local[:, 0] / local[:, 2], local[:, 1] / local[:, 2])
        left, right = np.clip([np.floor(column.min()), np.ceil(column.max())], 0, lens.width).astype(int)
        top, bottom = np.clip([np.floor(row.min()), np.ceil(row.max())], 0, lens.height).astype(int)
        return (np.arange(top, bottom)[:, None] * lens.width + np.arange(left, right)).ravel()


def views(rig: Rig) -> tuple[View, View]:
    """The camera and the projector."""
    camera = View(rig.camera_centre_m, rig.camera.lens, np.eye(3))
    return camera, View(rig.projector_centre_m, rig.projector.lens, rig.rotation)


class SkinBody:
    """One object of skin where it is at one time."""

    def __init__(self, item: Mesh | Sphere, skin: Skin, time_s: float) -> None:
        self.item, self.skin = item, skin
        self._pose = Pose(np.eye(3), np.zeros(3)) if item.motion is None else Pose(*item.motion.pose(time_s))
        self._body = Body([item]) if isinstance(item, Mesh) else None

    def reach(self) -> tuple[Doubles, Doubles]:
        """Corners (3,) of a box of the world that holds it."""
        if isinstance(self.item, Sphere):
            centre = self._to_world(np.array([self.item.centre_m]))[0]
            return centre - self.item.radius_m, centre + self.item.radius_m
        points = self._to_world(np.asarray(self.item.vertices, np.float64))
        return points.min(axis=0), points.max(axis=0)

    def seen(self, view: View, bodies: Sequence[Placed], light: Doubles) -> SkinPatch:
        """What a view sees of it before all `bodies`; light: the projector's centre."""
        pixels = view.around(*self.reach())
        rays = view.rays(pixels)
        depth, prim, bary = self._meet(view.centre, rays)
        met = np.flatnonzero(np.isfinite(depth))
        hits = Hits(np.full(len(met), np.inf), np.empty(len(met)), np.empty((len(met), 3), np.float32))
        for body, pose, *_ in bodies:
            body.cast(view.centre, rays[met], light, pose, ask_everywhere(), hits)
        first = met[depth[met] <= hits.depth * _SAME]
        points = view.centre + depth[first, None] * rays[first]
        return SkinPatch(pixels[first], points, *self._surface(points, prim[first], bary[first]))

    def _to_world(self, points: Doubles) -> Doubles:
        return np.asarray(points @ self._pose.rotation.T + self._pose.position, np.float64)

    def _meet(self, eye: Doubles, rays: Doubles) -> tuple[Doubles, Ints, Singles]:
        """Depth (R,) where rays meet it, infinite where they miss, and the triangle and place in it as `Body.met`."""
        if self._body is not None:
            return self._body.met(eye, rays, self._pose)
        assert isinstance(self.item, Sphere)
        away = self._to_world(np.array([self.item.centre_m]))[0] - eye
        nowhere = np.zeros(len(rays), np.int32), np.zeros((len(rays), 2), np.float32)
        return _meet_sphere(away, self.item.radius_m, rays), *nowhere

    def _surface(self, points: Doubles, prim: Ints, bary: Singles) -> tuple[Doubles, Doubles]:
        """Unit normals (P, 3) and uv (P, 2) at points of it."""
        if isinstance(self.item, Sphere):
            normals = (points - self._to_world(np.array([self.item.centre_m]))) / self.item.radius_m
            return normals, _round_uv(normals @ self._pose.rotation)
        uv = np.zeros((len(points), 2))
        triangles, faces = solid_triangles(self.item)
        edges = triangles[:, 1:] - triangles[:, :1]
        normals = np.cross(edges[:, 0], edges[:, 1]) @ self._pose.rotation.T
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if self.item.uv is not None:
            corners = self.item.uv[faces[prim]]
            uv = corners[:, 0] + bary[:, :1] * (corners[:, 1] - corners[:, 0])
            uv += bary[:, 1:] * (corners[:, 2] - corners[:, 0])
        return normals[prim], uv


def _round_uv(out: Doubles) -> Doubles:
    """Longitude and latitude as texture coordinates (P, 2) of directions (P, 3) out of a sphere's middle: once round
    it, from top to bottom, with the middle towards the rig (-z)."""
    longitude = np.arctan2(out[:, 0], -out[:, 2])
    latitude = np.arcsin(np.clip(out[:, 1], -1, 1))
    return np.stack([0.5 + longitude / (2 * np.pi), 0.5 + latitude / np.pi], axis=-1)


def _meet_sphere(away: Doubles, radius: float, rays: Doubles) -> Doubles:
    square = (rays**2).sum(axis=1)
    middle = rays @ away / square
    rest = radius**2 - ((middle[:, None] * rays - away) ** 2).sum(axis=1)
    half = np.sqrt(np.maximum(rest, 0.0) / square)
    depth = np.where(middle > half, middle - half, middle + half)
    return np.where((rest > 0) & (depth > 0), depth, np.inf)


def strength(rig: Rig, patch: SkinPatch) -> tuple[Doubles, Doubles]:
    """Irradiance (P,) that the projector would give the points (1: a frontal surface at 1 m), and their depth from it.

    Whether they are lit is another question; 0 where a point is not in front of it.
    """
    away = patch.points - rig.projector_centre_m
    depth = away @ rig.rotation[2]
    ahead = np.where(depth > 0, depth, np.inf)
    facing = np.abs((away * patch.normals).sum(axis=1))
    return np.minimum(facing / ahead**3, 1e30), depth


def tangents(rig: Rig, patch: SkinPatch) -> Tangents:
    """The tangent planes at points in front of the projector, as it sees them."""
    own, depth = strength(rig, patch)
    lens = rig.projector.lens
    points = (patch.points - rig.projector_centre_m) @ rig.rotation.T
    normals = patch.normals @ rig.rotation.T
    x, y = points[:, 0] / depth, points[:, 1] / depth
    column, row = lens.project(x, y)
    slopes = _lens_slopes(lens, x, y)
    # Where rows rise, in space: on the plane it is this without its part along the normal.
    rising = np.column_stack([slopes[2], slopes[3], -x * slopes[2] - y * slopes[3]])
    steep = rising - (rising * normals).sum(axis=1)[:, None] * normals
    size = np.linalg.norm(steep, axis=1)
    # Where no direction is steeper than another, any will do.
    steep[size == 0] = np.cross(normals[size == 0], [0.6, 0.0, 0.8])
    steep /= np.linalg.norm(steep, axis=1, keepdims=True)
    along = np.empty((len(depth), 2, 3))
    for k, local in enumerate((steep, np.cross(normals, steep))):
        dx, dy = (local[:, 0] - x * local[:, 2]) / depth, (local[:, 1] - y * local[:, 2]) / depth
        along[:, k, 0] = slopes[0] * dx + slopes[1] * dy
        along[:, k, 1] = slopes[2] * dx + slopes[3] * dy
        along[:, k, 2] = local[:, 2]
    return Tangents(np.column_stack([column, row, depth]), points, along, own.astype(np.float32))


def _lens_slopes(lens: Lens, x: Doubles, y: Doubles) -> tuple[Doubles, ...]:
    """Change of column with x and y, and of row with x and y, in normalised coordinates, each (P,)."""
    if not lens.distorted:
        zero = np.zeros_like(x)
        return zero + lens.fx, zero, zero, zero + lens.fy
    h = _SLOPE_STEP
    right, left, down, up = (lens.project(x + a, y + b) for a, b in ((h, 0), (-h, 0), (0, h), (0, -h)))
    pairs = ((right, left, 0), (down, up, 0), (right, left, 1), (down, up, 1))
    return tuple((ahead[k] - behind[k]) / (2 * h) for ahead, behind, k in pairs)


def projected(rig: Rig, patch: SkinPatch) -> Light:
    """What the projector throws on a skin, from what of it the projector sees."""
    lens = rig.projector.lens
    bright = np.zeros(lens.height * lens.width, np.float32)
    points = np.zeros((lens.height * lens.width, 3), np.float32)
    bright[patch.pixels] = strength(rig, patch)[0]
    points[patch.pixels] = (patch.points - rig.projector_centre_m) @ rig.rotation.T
    shape = lens.height, lens.width
    return Light(bright.reshape(shape), points.reshape(*shape, 3))


def gathered(points: Tangents, light: Light, sigmas_mm: Sequence[float]) -> tuple[Singles, Singles]:
    """Irradiance about each point as lobes of these deviations average it, and where it is on average, in metres
    towards higher rows, both (P, L)."""
    rings = np.sqrt(2 * _NODES)
    # Rings are turned against each other, so that an edge does not cross all of them at once.
    turns = np.arange(_DIRECTIONS) + 0.25 + 0.5 * (np.arange(len(rings)) % 2)[:, None]
    angles = 2 * np.pi * turns / _DIRECTIONS
    u, v = rings[:, None] * np.cos(angles), rings[:, None] * np.sin(angles)
    weights = np.broadcast_to(_SHARES[:, None] / _DIRECTIONS, u.shape)
    one = np.stack([u, v, weights], axis=-1).reshape(-1, 3)
    offsets = np.stack([one * (1e-3 * sigma, 1e-3 * sigma, 1.0) for sigma in sigmas_mm])
    out, drift = np.empty((2, len(points.own), len(sigmas_mm)), np.float32)
    gather(points, light, offsets, out, drift)
    return out, drift


def rows_on_skin(points: Tangents, light: Light, widest_mm: float) -> tuple[Doubles, Doubles]:
    """Rows per metre at each point, and the curvature, as `bend` has them, (P,)."""
    # A surface that the projector sees edge-on along its rows: all of its light has the point's own row.
    steepness, curvature = np.maximum(points.along[:, 0, 1], 1e-3), np.zeros(len(points.own))
    bend(points, light, 1e-3 * _BEND_SIGMAS * widest_mm, steepness, curvature)
    return steepness, curvature


def columns_on_skin(points: Tangents, steepness: Doubles) -> SkinColumns:
    """Where columns lie about each point; steepness (P,): rows per metre, as from `rows_on_skin`."""
    slant = points.along[:, 0, 0] / steepness
    per_mm = 1e-3 * np.abs(points.along[:, 1, 0])
    return SkinColumns(*(np.minimum(each, 1e6).astype(np.float32) for each in (points.place[:, 0], slant, per_mm)))


def in_front(rig: Rig, patch: SkinPatch) -> SkinPatch:
    """The pixels whose points are in front of the projector."""
    ahead: Bools = (patch.points - rig.projector_centre_m) @ rig.rotation[2] > 0
    return SkinPatch(patch.pixels[ahead], patch.points[ahead], patch.normals[ahead], patch.uv[ahead])
