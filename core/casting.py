"""Rigid bodies that rays are cast at: embree finds the triangle, float64 its exact point.

Embree computes in float32. It decides only *which* triangle a ray meets (so silhouettes and edges are exact to about
1e-7 of the distance); the point itself is where the float64 ray meets the float64 plane of that triangle. Spheres are
solved in float64 outright (about 1e-15 of the distance, less near their outline).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from slopegate.core import kernels_render as kernels
from slopegate.core.scene import Mesh, Sphere

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]

SHADOW_REACH = 1.0 - 1e-4
"""A shadow ray runs from the projector over this share of the way to the lit point: what stands within 1e-4 of the
distance before the point (0.1 mm at 1 m) casts no shadow on it. Float32 misplaces a surface by about 3e-7 of the
distance over the cosine of incidence, so no surface shades itself unless light grazes it at a cosine below 3e-3."""


@dataclass(frozen=True, eq=False)
class Hits:
    """Nearest hits of R rays: depth (R,) in lengths of the direction, infinite where nothing was hit; facing (R,), the
    distance of the light from the tangent plane there; colour (R, 3) linear albedo."""

    depth: Doubles
    facing: Doubles
    colour: Singles

    @staticmethod
    def none(count: int, before: Doubles | None = None) -> Hits:
        """Rays that have hit nothing yet; hits at or beyond the depths `before` (R,) will not count."""
        depth = np.full(count, np.inf) if before is None else before.copy()
        return Hits(depth, np.zeros(count), np.zeros((count, 3), np.float32))

    def part(self, rays: NDArray[np.int64]) -> Hits:
        """Those of some rays alone."""
        return Hits(self.depth[rays], self.facing[rays], self.colour[rays])

    def put(self, rays: NDArray[np.int64], part: Hits) -> None:
        """Write back those of some rays."""
        self.depth[rays], self.facing[rays], self.colour[rays] = part.depth, part.facing, part.colour


@dataclass(frozen=True, eq=False)
class _Texture:
    first: int
    uv: Doubles
    texels: Singles


class Body:
    """Meshes and spheres that keep their places to each other, in the frame that they were given in."""

    def __init__(self, items: Sequence[Mesh | Sphere]) -> None:
        meshes = [item for item in items if isinstance(item, Mesh)]
        spheres = [item for item in items if isinstance(item, Sphere)]
        self.centres = np.array([s.centre_m for s in spheres], np.float64).reshape(-1, 3)
        self.radii = np.array([s.radius_m for s in spheres], np.float64)
        self._sphere_albedo = np.array([s.albedo for s in spheres], np.float32).reshape(-1, 3)
        self._textures: list[_Texture] = []
        corners = [np.zeros((0, 3, 3))]
        albedo = [np.zeros((0, 3), np.float32)]
        first = 0
        for mesh in meshes:
            triangles, faces = _solid_triangles(mesh)
            corners.append(triangles)
            albedo.append(np.tile(np.array(mesh.albedo, np.float32), (len(faces), 1)))
            if mesh.texture is not None and mesh.uv is not None:
                self._textures.append(_Texture(first, mesh.uv[faces], mesh.texture))
            first += len(faces)
        stacked = np.concatenate(corners)
        self._albedo = np.concatenate(albedo)
        self._corner = np.ascontiguousarray(stacked[:, 0])
        self._edge1 = stacked[:, 1] - stacked[:, 0]
        self._edge2 = stacked[:, 2] - stacked[:, 0]
        self._normal = _cross(self._edge1, self._edge2)
        self._normal /= np.sqrt((self._normal**2).sum(axis=1, keepdims=True))
        self._embree = _embree_scene(stacked) if len(stacked) else None
        self._meshes = meshes

    def outline(self) -> tuple[Doubles, Ints]:
        """Points (P, 3) and triangles (T, 3) between them that cover the body from wherever it is seen."""
        points = [mesh.vertices for mesh in self._meshes]
        faces = [mesh.faces for mesh in self._meshes]
        for centre, radius in zip(self.centres, self.radii, strict=True):
            points.append(centre + radius * _CUBE)
            faces.append(_CUBE_FACES)
        starts = np.cumsum([0, *(len(part) for part in points)])
        shifted = [part + start for part, start in zip(faces, starts, strict=False)]
        return np.concatenate(points), np.concatenate(shifted).astype(np.int32)

    def cast(self, origin: Doubles, directions: Doubles, light: Doubles, hits: Hits) -> None:
        """Cast rays (R, 3) from one origin; update `hits` where this body is nearer. All in the body's frame."""
        if self._embree is not None:
            starts = np.full(directions.shape, origin, np.float32)
            prim: Ints = self._embree.run(starts, directions.astype(np.float32), query="INTERSECT")
            bary = np.zeros((len(prim), 2), np.float32)
            kernels.refine_triangles(
                prim,
                origin,
                directions,
                light,
                self._corner,
                self._edge1,
                self._edge2,
                self._normal,
                self._albedo,
                hits.depth,
                hits.facing,
                hits.colour,
                bary,
            )
            for texture in self._textures:
                kernels.sample_texture(prim, bary, texture.first, texture.uv, texture.texels, hits.colour)
        if len(self.radii):
            kernels.hit_spheres(
                origin,
                directions,
                light,
                self.centres,
                self.radii,
                self._sphere_albedo,
                hits.depth,
                hits.facing,
                hits.colour,
            )

    def shade(self, light: Doubles, vectors: Doubles, shaded: NDArray[np.bool_]) -> None:
        """Mark the points light + vectors (R, 3) that this body keeps the light from. All in the body's frame."""
        if self._embree is not None:
            reach = np.full(len(vectors), SHADOW_REACH, np.float32)
            starts = np.full(vectors.shape, light, np.float32)
            met = self._embree.run(starts, vectors.astype(np.float32), dists=reach, query="OCCLUDED")
            shaded |= met >= 0
        if len(self.radii):
            kernels.shade_spheres(light, vectors, self.centres, self.radii, SHADOW_REACH, shaded)


_CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_CUBE_FACES = np.array(
    [
        corners
        for a, b, c, d in ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
        for corners in ((a, b, c), (a, c, d))
    ],
    np.int32,
)


def _solid_triangles(mesh: Mesh) -> tuple[Doubles, Ints]:
    """Triangles (T, 3, 3) and faces (T, 3) of a mesh without those that have no area."""
    triangles = np.asarray(mesh.vertices, np.float64)[mesh.faces].reshape(-1, 3, 3)
    normal = _cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    solid = (normal**2).sum(axis=1) > 0
    return triangles[solid], np.asarray(mesh.faces, np.int32).reshape(-1, 3)[solid]


def _cross(a: Doubles, b: Doubles) -> Doubles:
    return np.asarray(np.cross(a, b), np.float64)


def _embree_scene(triangles: Doubles) -> Any:  # embreex has no types
    try:
        from embreex import rtcore_scene  # not on every platform, and only needed here
        from embreex.mesh_construction import TriangleMesh
    except ImportError as error:
        raise RuntimeError(
            "Rendering meshes needs the package embreex, which is not installed (it has no build for Linux on aarch64)"
        ) from error
    scene = rtcore_scene.EmbreeScene(robust=True)
    TriangleMesh(scene, triangles.astype(np.float32))
    return scene
