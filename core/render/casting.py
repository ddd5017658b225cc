"""Rigid bodies that rays are cast at: embree finds the triangle, float64 its exact point.

Embree computes in float32. It decides only *which* triangle a ray meets (so silhouettes and edges are exact to about
1e-7 of the distance); the point itself is where the float64 ray meets the float64 plane of that triangle. Spheres are
solved in float64 outright (about 1e-15 of the distance, less near their outline).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from slopegate.core.render import kernels
from slopegate.core.render.kernels import Hits
from slopegate.core.render.kernels_facets import Cells, Spheres, first_met, shade
from slopegate.core.scene.scene import Mesh, Sphere

Doubles = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Indices = NDArray[np.int64]

SHADOW_REACH = 1.0 - 1e-4
"""A shadow ray runs from the projector over this share of the way to the lit point: what stands within 1e-4 of the
distance before the point (0.1 mm at 1 m) casts no shadow on it. Float32 misplaces a surface by about 3e-7 of the
distance over the cosine of incidence, so no surface shades itself unless light grazes it at a cosine below 3e-3."""


class Pose(NamedTuple):
    """Where a body is: a point p of it is at rotation p + position; (3, 3) and (3,) float64."""

    rotation: Doubles
    position: Doubles

    def from_world(self, point: Doubles) -> Doubles:
        """A world point (3,) in the body's frame."""
        return np.asarray(self.rotation.T @ (point - self.position))

    def turned(self, vectors: Doubles, which: Indices) -> Singles:
        """Some of the world vectors (R, 3) in the body's axes, (N, 3)."""
        out = np.empty((len(which), 3), np.float32)
        kernels.turn_some(vectors, which, self.rotation, out)
        return out


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
        self.spheres = Spheres(
            np.array([s.centre_m for s in spheres], np.float64).reshape(-1, 3),
            np.array([s.radius_m for s in spheres], np.float64),
            np.array([s.albedo for s in spheres], np.float32).reshape(-1, 3),
        )
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
        self.triangles = np.concatenate(corners)
        """(T, 3, 3) float64: corners in the body's frame."""
        self._faces = _faces(self.triangles, np.concatenate(albedo))
        self._embree = _embree_scene(self.triangles) if len(self.triangles) else None

    def cast(self, eye: Doubles, directions: Doubles, light: Doubles, pose: Pose, cells: Cells, hits: Hits) -> None:
        """Cast world rays (R, 3) with z = 1 from the eye; update `hits` where this body, posed so, is nearer.

        light: the projector's centre, in world axes; cells: what the body shows the eye.
        """
        origin, own_light = pose.from_world(eye), pose.from_world(light)
        prim, spheres = np.empty(len(directions), np.int32), np.empty(len(directions), np.bool_)
        if first_met(directions, cells, prim, spheres):
            self._ask(origin, directions, pose, prim)
        if self._embree is not None:
            bary = np.empty((len(prim), 2), np.float32)
            kernels.refine_triangles(prim, origin, directions, pose.rotation, own_light, self._faces, hits, bary)
            for texture in self._textures:
                kernels.sample_texture(prim, bary, texture.first, texture.uv, texture.texels, hits.colour)
        if len(self.spheres.radii):
            kernels.hit_spheres(origin, directions, pose.rotation, own_light, self.spheres, spheres, hits)

    def _ask(self, origin: Doubles, directions: Doubles, pose: Pose, prim: Ints) -> None:
        """Replace -2 in `prim` (R,) by the triangle that the ray meets, or -1."""
        asked = np.flatnonzero(prim == -2)
        if self._embree is None:
            prim[asked] = -1
            return
        turned = pose.turned(directions, asked)
        starts = np.full(turned.shape, origin, np.float32)
        prim[asked] = self._embree.run(starts, turned, query="INTERSECT")

    def shade(self, light: Doubles, vectors: Doubles, q: Doubles, pose: Pose, cells: Cells, row: Singles) -> None:
        """Set row (R,) to -1 for the points that this body, posed so, keeps the light from; those below 0 stay.

        The points are light + vectors (R, 3) in world axes, and q (R, 3), x/z, y/z, z, in the light's own; cells: what
        the body shows the light.
        """
        own_light = pose.from_world(light)
        asked = np.empty(len(row), np.int64)
        count = shade(cells, self.spheres, own_light, pose.rotation, vectors, q, SHADOW_REACH, row, asked)
        if count and self._embree is not None:
            turned = pose.turned(vectors, asked[:count])
            reach = np.full(count, SHADOW_REACH, np.float32)
            starts = np.full(turned.shape, own_light, np.float32)
            met = self._embree.run(starts, turned, dists=reach, query="OCCLUDED")
            row[asked[:count][met >= 0]] = -1


def _solid_triangles(mesh: Mesh) -> tuple[Doubles, Ints]:
    """Triangles (T, 3, 3) and faces (T, 3) of a mesh without those that have no area."""
    triangles = np.asarray(mesh.vertices, np.float64)[mesh.faces].reshape(-1, 3, 3)
    normal = _cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    solid = (normal**2).sum(axis=1) > 0
    return triangles[solid], np.asarray(mesh.faces, np.int32).reshape(-1, 3)[solid]


def _faces(triangles: Doubles, albedo: Singles) -> kernels.Faces:
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = _cross(edge1, edge2)
    normal /= np.sqrt((normal**2).sum(axis=1, keepdims=True))
    return kernels.Faces(np.ascontiguousarray(triangles[:, 0]), edge1, edge2, normal, albedo)


def _cross(a: Doubles, b: Doubles) -> Doubles:
    return np.asarray(np.cross(a, b), np.float64)


def _embree_scene(triangles: Doubles) -> Any:  # embreex has no types
    try:
        from embreex import rtcore_scene  # not on every platform, and only needed here
        from embreex.mesh_construction import TriangleMesh
    except ImportError as error:
        raise ImportError(
            "rays are cast by the package embreex, which is not installed (it has no build for Linux on 64-bit ARM); "
            "captures with photo and depth open without it"
        ) from error
    scene = rtcore_scene.EmbreeScene(robust=True)
    TriangleMesh(scene, triangles.astype(np.float32))
    return scene
