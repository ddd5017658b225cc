"""Light along camera rays into objects: where the surface is, which projector row lights it, and how brightly.

Model section 4, direct light.

A Lambertian two-sided surface lit by a projector whose pixels carry equal flux (value 1 each) shows
L = albedo cos_i / (z_p^2 cos theta), with z_p its depth from the projector and theta its angle off the projector's
axis. With n . (P - C_p) the distance of the projector from the tangent plane this is albedo |n . (P - C_p)| / z_p^3.
Gloss adds to it (`coats`), glass bends the line of sight (`glass`) and shades like anything else, fog dims it (`fog`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from slopegate.core.render import fog, kernels
from slopegate.core.render.coats import Coats, Looks, add_lobes, coats, note_spheres, note_triangles, nothing_met, plain
from slopegate.core.render.copies import find_copies
from slopegate.core.render.facets import Viewer, ask_everywhere
from slopegate.core.render.glass import Meet, look_through
from slopegate.core.render.kernels import Hits, Pixels
from slopegate.core.render.kernels_facets import Cells, Spheres, first_met, shade
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Ints, Singles
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.rig import Lens, Rig, RigProjector, Vector3
from slopegate.core.scene.materials import Glass, Material
from slopegate.core.scene.scene import KeyFrames, Mesh, Scene, Sphere

SHADOW_REACH = 1.0 - 1e-4
"""A shadow ray runs from the projector over this share of the way to the lit point: what stands within 1e-4 of the
distance before the point (0.1 mm at 1 m) casts no shadow on it. Float32 misplaces a surface by about 3e-7 of the
distance over the cosine of incidence, so no surface shades itself unless light grazes it at a cosine below 3e-3."""


# Bodies and how rays meet them.


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
    """The texture of the triangles from number `first` on."""

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
        self.plain = all(plain(item.material) for item in items)
        """Whether all of it is matt and nothing else."""
        self.glass = any(isinstance(item.material, Glass) for item in items)
        self._sphere_coats = coats([sphere.material for sphere in spheres])
        self._textures: list[_Texture] = []
        made_of: list[Material | None] = []
        corners = [np.zeros((0, 3, 3))]
        albedo = [np.zeros((0, 3), np.float32)]
        first = 0
        for mesh in meshes:
            triangles, faces = solid_triangles(mesh)
            corners.append(triangles)
            albedo.append(np.tile(np.array(mesh.albedo, np.float32), (len(faces), 1)))
            if mesh.texture is not None and mesh.uv is not None:
                self._textures.append(_Texture(first, mesh.uv[faces], mesh.texture))
            made_of += [mesh.material] * len(faces)
            first += len(faces)
        self.triangles = np.concatenate(corners)
        """(T, 3, 3) float64: corners in the body's frame."""
        self._faces = _faces(self.triangles, np.concatenate(albedo))
        self._face_coats: Coats = coats(made_of)
        self._embree = embree_scene(self.triangles) if len(self.triangles) else None

    def cast(
        self,
        eye: Doubles,
        directions: Doubles,
        light: Doubles,
        pose: Pose,
        cells: Cells,
        hits: Hits,
        looks: Looks | None = None,
    ) -> None:
        """Cast world rays (R, 3) with z = 1 from the eye; update `hits` where this body, posed so, is nearer.

        light: the projector's centre, in world axes; cells: what the body shows the eye; looks: updated as the hits
        are, None where nobody wants to know.
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
            if looks is not None:
                note_triangles(prim, pose.rotation, self._faces.normal, self._face_coats, looks)
        if len(self.spheres.radii):
            which = np.full(0 if looks is None else len(prim), -1, np.int32)
            kernels.hit_spheres(origin, directions, pose.rotation, own_light, self.spheres, spheres, hits, which)
            if looks is not None:
                self._note_spheres(which, (eye - pose.position)[None], directions, pose, hits, looks)

    def meet(self, origins: Doubles, directions: Doubles, light: Doubles, pose: Pose, hits: Hits, looks: Looks) -> None:
        """Cast world rays from anywhere, origins and directions (R, 3); update `hits` and `looks` where this body,
        posed so, is nearer, with depths in lengths of the direction."""
        starts, along = np.empty(origins.shape), np.empty(origins.shape)
        kernels.into_body(origins, directions, pose.rotation, pose.position, starts, along)
        own_light = pose.from_world(light)
        if self._embree is not None:
            prim = self._embree.run(starts.astype(np.float32), along.astype(np.float32), query="INTERSECT")
            bary = np.empty((len(prim), 2), np.float32)
            kernels.meet_triangles(prim, starts, along, own_light, self._faces, hits, bary)
            for texture in self._textures:
                kernels.sample_texture(prim, bary, texture.first, texture.uv, texture.texels, hits.colour)
            note_triangles(prim, pose.rotation, self._faces.normal, self._face_coats, looks)
        if len(self.spheres.radii):
            which = np.full(len(starts), -1, np.int32)
            kernels.meet_spheres(starts, along, own_light, self.spheres, hits, which)
            self._note_spheres(which, origins - pose.position, directions, pose, hits, looks)

    def _note_spheres(
        self, which: Ints, origins: Doubles, directions: Doubles, pose: Pose, hits: Hits, looks: Looks
    ) -> None:
        coat = self._sphere_coats
        note_spheres(which, origins, directions, hits.depth, pose.rotation, self.spheres, coat, looks)

    def met(self, eye: Doubles, directions: Doubles, pose: Pose) -> tuple[Doubles, Ints, Singles]:
        """What world rays (R, 3) from the eye meet first of this body's triangles, posed so: depth (R,) in lengths of
        the direction, infinite for none; which triangle, -1 for none; and its barycentric coordinates (R, 2) there."""
        count, origin = len(directions), pose.from_world(eye)
        hits = Hits(np.full(count, np.inf), np.empty(count), np.empty((count, 3), np.float32))
        prim, bary = np.full(count, -2, np.int32), np.zeros((count, 2), np.float32)
        self._ask(origin, directions, pose, prim)
        kernels.refine_triangles(prim, origin, directions, pose.rotation, origin, self._faces, hits, bary)
        return hits.depth, prim, bary

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


def solid_triangles(mesh: Mesh) -> tuple[Doubles, Ints]:
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


def embree_scene(triangles: Doubles) -> Any:  # embreex has no types
    """The triangles (T, 3, 3) as embree's search tree."""
    try:
        from embreex import rtcore_scene  # not on every platform, and only needed here
        from embreex.mesh_construction import TriangleMesh
    except ImportError as error:
        raise UserError(
            "rays are cast by the package embreex, which is not installed (it has no build for Linux on 64-bit ARM); "
            "captures with photo and depth open without it"
        ) from error
    scene = rtcore_scene.EmbreeScene(robust=True)
    TriangleMesh(scene, triangles.astype(np.float32))
    return scene


# Whole scenes, from here on.

RAYS_PER_BAND = 1 << 16
"""Rays to cast at a time: bounds the memory beside the buffers to about 20 MB."""


@dataclass(frozen=True, eq=False)
class Rays:
    """What R camera rays see: the fields of `render.Buffers` with one leading axis, the exact depth (R,) float64
    (infinite where there is no surface), and where the points lie as seen from the projector: beam (R, 3) float32,
    x/z, y/z and z in its axes (NaN, NaN and -1 where no surface is in front of it)."""

    projector_row: Singles
    projector_column: Singles
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


class SightLines(NamedTuple):
    """Lines of sight to R points: straight from the camera, directions (R, 3) with z = 1; as they arrive there, views
    (R, 3), which glass has turned; and what they meet, None where everything is plain."""

    directions: Doubles
    views: Doubles
    looks: Looks | None


class Tracer:
    """The surfaces of a scene, made ready for ray casting by one rig."""

    def __init__(self, rig: Rig, scene: Scene, skip: bool = True) -> None:
        """skip False: cast every ray at every body, also where it is known beforehand what it meets."""
        self.rig = rig
        self.frame = ProjectorFrame(rig.projector)
        self._ambient = np.float32(scene.ambient)
        self._medium = fog.medium_of(scene.fog)
        pitch = 1 / rig.camera.lens.fx
        self._views = (
            Viewer(rig.camera_centre_m, np.eye(3), *field_of(rig.camera.lens), pitch),
            Viewer(rig.projector_centre_m, rig.rotation, self.frame.low, self.frame.high, pitch),
        )
        self._skip = skip
        self._moving = [(Body(items), motion) for items, motion in _moving_together(scene)]
        rest, copied = find_copies(scene)
        self._still = [self._place(Body(rest), Pose(np.eye(3), np.zeros(3)))]
        for copies in copied:
            body = Body([copies.mesh])
            self._still += [self._place(body, Pose(*pose)) for pose in copies.poses]
        bodies = [*(placed.body for placed in self._still), *(body for body, _ in self._moving)]
        self._plain = all(body.plain for body in bodies)
        self._has_glass = any(body.glass for body in bodies)

    def still(self) -> tuple[Placed, ...]:
        """What never moves."""
        return tuple(self._still)

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
        looks = self._blank_looks(len(directions))
        self._cast(directions, bodies, hits, looks)
        views = directions
        if looks is not None and self._has_glass and (looks.glass > 0).any():
            views = look_through(self.rig.camera_centre_m, directions, hits, looks, self._meeting(bodies))
        count = len(directions)
        plain, colour = np.empty((3, count), np.float32), np.empty((2, count, 3), np.float32)
        out = Pixels(*plain, *colour)
        q = self._light(SightLines(directions, views, looks), hits, bodies, np.arange(count), out)
        return Rays(*out, hits.depth, q.astype(np.float32))

    def trace_over(
        self, directions: Doubles, depth: Doubles, moving: Sequence[Placed], places: Indices, out: Pixels
    ) -> Indices:
        """Write what those of the rays (R, 3) from the camera see that meet a moving body before the `depth` (R,) of
        what never moves into their `places` (R,) in `out`; returns these. The directions are of no use afterwards.

        For scenes without glass: through glass, what never moves may show what does.
        """
        hits = Hits(depth.copy(), np.empty(len(depth)), np.empty(directions.shape, np.float32))
        looks = self._blank_looks(len(depth))
        self._cast(directions, moving, hits, looks)
        kept = np.empty(len(depth), np.int64)
        count = kernels.keep_nearer(depth, directions, hits, kept)
        part = Hits(hits.depth[:count], hits.facing[:count], hits.colour[:count])
        covered, rays = places[kept[:count]], directions[:count]
        sight = SightLines(rays, rays, looks and looks.some(kept[:count]))
        self._light(sight, part, (*self.still(), *moving), covered, out)
        return covered

    def _blank_looks(self, count: int) -> Looks | None:
        return None if self._plain else nothing_met(count)

    def _cast(self, directions: Doubles, bodies: Sequence[Placed], hits: Hits, looks: Looks | None) -> None:
        for body, pose, seen, _ in bodies:
            body.cast(self.rig.camera_centre_m, directions, self.rig.projector_centre_m, pose, seen, hits, looks)

    def _meeting(self, bodies: Sequence[Placed]) -> Meet:
        def meet(origins: Doubles, directions: Doubles, hits: Hits, looks: Looks) -> None:
            for body, pose, _, _ in bodies:
                body.meet(origins, directions, self.rig.projector_centre_m, pose, hits, looks)

        return meet

    def _light(self, sight: SightLines, hits: Hits, bodies: Sequence[Placed], places: Indices, out: Pixels) -> Doubles:
        """Write the projector's light on the points hit; returns those (R, 3) as x/z, y/z, z in its axes."""
        directions = sight.directions
        vectors, q = self._from_projector(directions, hits.depth)
        row, column = self.frame.places(q)
        self._shade(vectors, q, bodies, row)
        kernels.shine(row, column, q, hits, self._ambient, places, out)
        if sight.looks is not None:
            add_lobes(row, q, vectors, sight.views, hits, sight.looks, places, out)
        if self._medium is not None:
            eye, light = point(self.rig.camera_centre_m), point(self.rig.projector_centre_m)
            fog.dim(self._medium, eye, light, directions, hits.depth, vectors, float(self._ambient), places, out)
        return q

    def shaded(self, directions: Doubles, depth: Doubles, bodies: Sequence[Placed]) -> Bools:
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
    """The test of a point against the projector's raster: which row and column light it, if any do."""

    def __init__(self, projector: RigProjector) -> None:
        self._lens = projector.lens
        # A distorted lens folds points far outside its field back into the raster; nothing beyond the undistorted
        # outline of the raster, taken a little large, is ever lit.
        self.low, self.high = field_of(projector.lens)
        size = projector.lens.height, projector.lens.width
        self._last = tuple(np.nextafter(np.float32(length), np.float32(0)) for length in size)

    def rows(self, q: Doubles) -> Singles:
        """The rows of `places` alone."""
        return self.places(q)[0]

    def places(self, q: Doubles) -> tuple[Singles, Singles]:
        """Projector row and column (R,) float32 of points q (R, 3), x/z, y/z, z in projector axes; -1 outside."""
        rows, columns = np.full((2, len(q)), -1, np.float32)
        lens = self._lens
        if not lens.distorted:
            kernels.pinhole_places(q, lens.matrix, (lens.width, lens.height), rows, columns)
            return rows, columns
        inside = np.flatnonzero(((q[:, :2] >= self.low) & (q[:, :2] <= self.high)).all(axis=1))
        column, row = lens.project(q[inside, 0], q[inside, 1])
        lit = (column >= 0) & (column < lens.width) & (row >= 0) & (row < lens.height)
        rows[inside[lit]] = np.minimum(row[lit].astype(np.float32), self._last[0])
        columns[inside[lit]] = np.minimum(column[lit].astype(np.float32), self._last[1])
        return rows, columns


def point(values: Doubles) -> Vector3:
    """A point (3,) as compiled loops take single ones."""
    return float(values[0]), float(values[1]), float(values[2])


def bounded(values: Doubles) -> Singles:
    """Values as float32, cut at 1e30: those of a surface that touches a centre of projection would be infinite."""
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
