"""Where camera and projector see a skin: points, tangent planes, and what falls in about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slopegate.core.light.kernels_subsurface import Light, Tangents, gather
from slopegate.core.render.facets import ask_everywhere
from slopegate.core.render.kernels import Hits
from slopegate.core.render.tracing import Body, Placed, Pose, solid_triangles
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Singles
from slopegate.core.rig.rig import Lens, Rig
from slopegate.core.scene.materials import Skin
from slopegate.core.scene.scene import Mesh, Sphere

_SAME = 1 + 1e-9
"""Two distances along a ray that are the same surface, computed twice."""
_NODES, _SHARES = np.polynomial.laguerre.laggauss(4)
"""Radii^2 / (2 sigma^2) and their weights: the mean over a Gaussian's area is exact for polynomials up to r^14."""
_SLOPE_STEP = 1e-4
"""Step, in x/z and y/z, of the slope of a distorted projector lens."""


class SkinPatch(NamedTuple):
    """Pixels (P,) of a raster that see a surface first: their numbers; the points (P, 3) in world axes, unit normals
    (P, 3) and texture coordinates (P, 2) there, 0 where the surface has none."""

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
        depth, normals, uv = self._meet(view.centre, rays)
        met = np.flatnonzero(np.isfinite(depth))
        hits = Hits(np.full(len(met), np.inf), np.empty(len(met)), np.empty((len(met), 3), np.float32))
        for body, pose, *_ in bodies:
            body.cast(view.centre, rays[met], light, pose, ask_everywhere(), hits)
        first = met[depth[met] <= hits.depth * _SAME]
        points = view.centre + depth[first, None] * rays[first]
        return SkinPatch(pixels[first], points, normals[first], uv[first])

    def _to_world(self, points: Doubles) -> Doubles:
        return np.asarray(points @ self._pose.rotation.T + self._pose.position, np.float64)

    def _meet(self, eye: Doubles, rays: Doubles) -> tuple[Doubles, Doubles, Doubles]:
        """Depth (R,), infinite where it is missed, unit normal (R, 3) and uv (R, 2) where rays meet it."""
        uv = np.zeros((len(rays), 2))
        if isinstance(self.item, Sphere):
            away = self._to_world(np.array([self.item.centre_m]))[0] - eye
            depth = _meet_sphere(away, self.item.radius_m, rays)
            out = np.where(np.isfinite(depth), depth, 0.0)[:, None] * rays - away
            return depth, out / self.item.radius_m, uv
        assert self._body is not None
        depth, prim, bary = self._body.met(eye, rays, self._pose)
        triangles, faces = solid_triangles(self.item)
        corners = triangles[prim]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ self._pose.rotation.T
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if self.item.uv is not None:
            share = np.column_stack([1 - bary.sum(axis=1), bary]).astype(np.float64)
            uv = (share[:, :, None] * self.item.uv[faces[prim]]).sum(axis=1)
        return depth, normals, uv


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
    away = (patch.points - rig.projector_centre_m) @ rig.rotation.T
    x, y = away[:, 0] / depth, away[:, 1] / depth
    column, row = lens.project(x, y)
    across = np.cross(patch.normals, np.eye(3)[np.abs(patch.normals).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.empty((len(depth), 2, 3))
    slopes = _lens_slopes(lens, x, y)
    for k, direction in enumerate((across, np.cross(patch.normals, across))):
        local = direction @ rig.rotation.T
        dx, dy = (local[:, 0] - x * local[:, 2]) / depth, (local[:, 1] - y * local[:, 2]) / depth
        along[:, k, 0] = slopes[0] * dx + slopes[1] * dy
        along[:, k, 1] = slopes[2] * dx + slopes[3] * dy
        along[:, k, 2] = local[:, 2]
    return Tangents(np.column_stack([column, row, depth]), along, own.astype(np.float32))


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
    depth = np.zeros(lens.height * lens.width, np.float32)
    bright[patch.pixels], depth[patch.pixels] = strength(rig, patch)
    shape = lens.height, lens.width
    return Light(bright.reshape(shape), depth.reshape(shape))


def gathered(points: Tangents, light: Light, sigmas_mm: Sequence[float]) -> Singles:
    """Irradiance about each point as lobes of these deviations average it, (P, L)."""
    radii = 1e-3 * np.outer(sigmas_mm, np.sqrt(2 * _NODES))
    out = np.empty((len(points.own), len(sigmas_mm)), np.float32)
    gather(points, light, radii, np.tile(_SHARES, (len(sigmas_mm), 1)), out)
    return out


def in_front(rig: Rig, patch: SkinPatch) -> SkinPatch:
    """The pixels whose points are in front of the projector."""
    ahead: Bools = (patch.points - rig.projector_centre_m) @ rig.rotation[2] > 0
    return SkinPatch(patch.pixels[ahead], patch.points[ahead], patch.normals[ahead], patch.uv[ahead])
