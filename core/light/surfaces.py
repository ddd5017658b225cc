"""The surfaces of a scene for rays from anywhere: what light that has left its first surface meets.

Objects stand where they are at time 0. Triangles are embree's, spheres exact; geometry is float32, which misplaces a
hit by about 3e-7 of the distance over the cosine of incidence. Conventions are those of `render.tracing`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.light import kernels_surfaces as kernels
from slopegate.core.light.kernels_surfaces import GLASS, GLOSS, MATT, Balls, Faceted, Met, Paint
from slopegate.core.render.render import Cancelled, Progress
from slopegate.core.render.tracing import embree_scene, solid_triangles
from slopegate.core.rig.arrays import Bools, Doubles, Ints, Singles
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.materials import Glass, Gloss, Material
from slopegate.core.scene.scene import Mesh, Scene, Sphere

SHADOW_SHARE = 1.0 - 1e-4
"""A shadow ray runs over this share of its way, as in `render.tracing`."""

RAYS_AT_ONCE = 1 << 16


class Guides(NamedTuple):
    """What one ray through each pixel meets: depth (H, W) float32 metres, along the camera's axis, infinite
    where nothing is met; normal (H, W, 3) float32, towards the camera; albedo (H, W, 3) float32, linear; kind (H, W)
    int32, which material of the surfaces' list, -1 where nothing is met."""

    depth: Singles
    normal: Singles
    albedo: Singles
    kind: Ints


class Surfaces:
    """All surfaces of a scene as it is at time 0."""

    def __init__(self, scene: Scene) -> None:
        """Raises UserError for a capture, which has a depth map and no surfaces, and where embreex is missing."""
        if scene.capture is not None:
            raise UserError(
                f"{scene.name} is a photo with depth: light between surfaces needs surfaces that rays can be cast at"
            )
        self._foggy = scene.fog is not None and scene.fog.scattering_per_m > 0
        self._kinds: dict[Material | None, int] = {}
        corners, faces = _gather_meshes(scene, self._kinds)
        self._faces = faces
        self._balls = _gather_spheres(scene, self._kinds)
        self._embree = embree_scene(corners) if len(corners) else None
        self.triangles: Doubles = corners
        """(T, 3, 3) float64, world."""
        self.materials: Singles = _material_table(self._kinds)
        """(M, 4) float32: MATT, GLOSS or GLASS, then share and exponent of the lobe, then the index."""

    @property
    def grey(self) -> bool:
        """Whether no surface has a colour: one channel says all."""
        sets = self._faces.albedo, self._balls.albedo, self._faces.texels
        return all(bool((a == a[:, :1]).all()) for a in sets)

    @property
    def has_plain(self) -> bool:
        """Whether the camera sees light that is not multiplied by a surface's colour: of fog, gloss or glass."""
        return self._foggy or self.has_gloss or self.has_glass

    @property
    def has_gloss(self) -> bool:
        """Whether any surface has a lobe."""
        return bool((self.materials[:, 0] == GLOSS).any())

    @property
    def has_glass(self) -> bool:
        """Whether any surface is glass."""
        return bool((self.materials[:, 0] == GLASS).any())

    def glass_bounds(self) -> tuple[Doubles, Doubles]:
        """Least and greatest corner (3,) of a box round all glass; an empty one where there is none."""
        glass = self.materials[:, 0] == GLASS
        own = glass[self._faces.paint[self._faces.mesh, 0]] if len(self.triangles) else np.zeros(0, np.bool_)
        corners = self.triangles[own].reshape(-1, 3)
        balls = glass[self._balls.kind]
        centres, radii = self._balls.centres[balls], self._balls.radii[balls, None]
        ends = np.concatenate([corners, centres - radii, centres + radii])
        return ends.min(axis=0, initial=np.inf), ends.max(axis=0, initial=-np.inf)

    def meet(self, origins: Singles, directions: Singles) -> Met:
        """What rays (N, 3) float32 with directions of length 1 meet first."""
        count = len(origins)
        met = Met(
            np.empty(count, np.float32),
            np.empty((count, 3), np.float32),
            np.empty((count, 3), np.float32),
            np.empty(count, np.int32),
        )
        if self._embree is None:
            nothing = np.full(count, -1, np.int32)
            blank = np.zeros(count, np.float32)
            kernels.settle(origins, directions, (nothing, blank, blank, blank), self._faces, self._balls, met)
            return met
        found = self._embree.run(origins, directions, query="INTERSECT", output=1)
        hit = found["primID"], found["tfar"], found["u"], found["v"]
        kernels.settle(origins, directions, hit, self._faces, self._balls, met)
        return met

    def blocked(self, origins: Singles, vectors: Singles) -> Bools:
        """Whether a surface stands on the way from origins (N, 3) to origins + vectors, its last 1e-4 left out."""
        out = np.zeros(len(origins), np.bool_)
        if self._embree is not None and len(origins):
            reach = np.full(len(origins), SHADOW_SHARE, np.float32)
            out[:] = self._embree.run(origins, vectors, dists=reach, query="OCCLUDED") >= 0
        kernels.block_by_balls(origins, vectors, SHADOW_SHARE, self._balls, out)
        return out

    def guides(self, rig: Rig, progress: Progress | None = None, offset: tuple[float, float] = (0.5, 0.5)) -> Guides:
        """What the camera sees through one place (column part, row part) of each pixel.

        Raises Cancelled when progress returns False.
        """
        lens = rig.camera.lens
        pixels = lens.height * lens.width
        depth, normal = np.empty(pixels, np.float32), np.empty((pixels, 3), np.float32)
        albedo, kind = np.empty((pixels, 3), np.float32), np.empty(pixels, np.int32)
        for start in range(0, pixels, RAYS_AT_ONCE):
            if progress is not None and not progress(start / pixels):
                raise Cancelled("The preparation of indirect light was stopped")
            part = slice(start, min(start + RAYS_AT_ONCE, pixels))
            rows, columns = np.divmod(np.arange(part.start, part.stop), lens.width)
            rays = rig.camera_rays(columns + offset[0], rows + offset[1])
            length = np.sqrt((rays**2).sum(axis=1))
            origins = np.broadcast_to(rig.camera_centre_m, rays.shape).astype(np.float32)
            met = self.meet(origins, (rays / length[:, None]).astype(np.float32))
            depth[part] = met.distance / length
            normal[part], albedo[part], kind[part] = met.normal, met.albedo, met.kind
        shape = lens.height, lens.width
        return Guides(depth.reshape(shape), normal.reshape(*shape, 3), albedo.reshape(*shape, 3), kind.reshape(shape))


def _gather_meshes(scene: Scene, kinds: dict[Material | None, int]) -> tuple[Doubles, Faceted]:
    corners: list[Doubles] = [np.zeros((0, 3, 3))]
    paints: list[Paint] = []
    texels: list[Singles] = [np.zeros((0, 3), np.float32)]
    uv: list[Doubles] = [np.zeros((0, 3, 2))]
    which: list[Ints] = [np.zeros(0, np.int32)]
    offset = 0
    for mesh in (item for item in scene.objects if isinstance(item, Mesh)):
        triangles, faces = solid_triangles(mesh)
        if mesh.motion is not None:
            rotation, position = mesh.motion.pose(0.0)
            triangles = triangles @ rotation.T + position
        corners.append(triangles)
        textured = mesh.texture is not None and mesh.uv is not None
        uv.append(mesh.uv[faces] if textured else np.zeros((len(faces), 3, 2)))  # type: ignore[index]
        which.append(np.full(len(faces), len(paints), np.int32))
        kind = kinds.setdefault(_for_bake(mesh.material), len(kinds))
        height, width = mesh.texture.shape[:2] if textured else (0, 0)  # type: ignore[union-attr]
        paints.append(Paint(kind, offset, height, width, mesh.albedo))
        if textured:
            texels.append(np.asarray(mesh.texture, np.float32).reshape(-1, 3))
            offset += height * width
    joined = np.concatenate(corners)
    edges = joined[:, 1] - joined[:, 0], joined[:, 2] - joined[:, 0]
    normal = np.asarray(np.cross(*edges), np.float64)
    normal /= np.sqrt((normal**2).sum(axis=1, keepdims=True))
    table = np.array([[p.kind, p.offset, p.height, p.width] for p in paints], np.int64).reshape(-1, 4)
    colours = np.array([p.albedo for p in paints], np.float32).reshape(-1, 3)
    return joined, Faceted(
        normal.astype(np.float32),
        np.concatenate(uv).astype(np.float32),
        np.concatenate(which),
        table,
        colours,
        np.concatenate(texels),
    )


def _gather_spheres(scene: Scene, kinds: dict[Material | None, int]) -> Balls:
    spheres = [item for item in scene.objects if isinstance(item, Sphere)]
    centres = np.zeros((len(spheres), 3))
    for n, item in enumerate(spheres):
        centres[n] = item.centre_m
        if item.motion is not None:
            rotation, position = item.motion.pose(0.0)
            centres[n] = rotation @ centres[n] + position
    return Balls(
        centres,
        np.array([s.radius_m for s in spheres], np.float64),
        np.array([s.albedo for s in spheres], np.float32).reshape(-1, 3),
        np.array([kinds.setdefault(_for_bake(s.material), len(kinds)) for s in spheres], np.int32),
    )


def _for_bake(material: Material | None) -> Material | None:
    """Skin counts as matt: how light spreads inside it does not matter a hand's breadth away."""
    return material if isinstance(material, Gloss | Glass) else None


def _material_table(kinds: dict[Material | None, int]) -> Singles:
    table = np.zeros((max(len(kinds), 1), 4), np.float32)
    for material, row in kinds.items():
        if isinstance(material, Gloss):
            table[row] = GLOSS, material.share, material.exponent, 1.0
        elif isinstance(material, Glass):
            table[row] = GLASS, 0.0, 0.0, material.index
        else:
            table[row] = MATT, 0.0, 0.0, 1.0
    return table
