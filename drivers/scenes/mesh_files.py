"""Reads mesh files (OBJ, PLY, STL, glTF), checks them, and places them in front of the rig.

Each format has a reader of its own in a file beside this one, which hands over parts; here they become meshes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Vector3
from slopegate.core.scene.scene import Mesh
from slopegate.core.scene.shapes import GREY, Finish, NoAreaError, triangles, turn
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.reading import read_plain
from slopegate.drivers.scenes.mesh_parts import MAX_TRIANGLES, MeshFile, MeshPart, check_triangles
from slopegate.drivers.scenes.mesh_surfaces import PartSurfaces, tiled
from slopegate.drivers.scenes.scene_values import MAX_METRES

SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf")
LARGEST = 1e12
"""Coordinates beyond this count as missing, so that products of them do not overflow."""
# Rotations from the file's axes to the world's (y down, z away from the rig) that turn the file's front to the rig.
_UPRIGHT = {
    "y": np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a mesh goes and how large it gets."""

    position_m: Vector3
    """Where its anchor goes."""
    rotation: Doubles = field(default_factory=turn)
    """Applied after `up` has been turned to the world's up."""
    up: Literal["y", "z"] = "y"
    """The file's axis that points up."""
    anchor: Literal["centre", "base", "origin"] = "centre"
    """The centre of the bounding box, the middle of that box's lowest side, or the file's own origin."""
    scale: float = 1.0
    fit_height_m: float | None = None
    """Instead of `scale`: the height it gets ..."""
    fit_extent_m: float | None = None
    """... or less, so that its largest side is no longer than this."""


class MeshReader:
    """Reads the mesh files of one scene: each file once, and copies of a mesh share its faces and texture."""

    def __init__(self) -> None:
        self._files: dict[Path, tuple[MeshFile, PartSurfaces]] = {}
        self._meshes: dict[tuple[object, ...], Mesh | None] = {}
        self._textures: list[Singles | None] = []
        self._triangles = 0

    def read(
        self, path: Path, placement: Placement, finish: Finish = GREY, *, own_colour: bool = True
    ) -> tuple[list[Mesh], tuple[str, ...]]:
        """The meshes of a file in the world, one for each part and material, and a remark for each thing left out.

        `finish` says what they are made of, and their colour unless they keep their `own_colour`. Raises SceneError for
        a file that is missing, damaged or empty, for triangles without area, indices out of range and vertices that are
        not finite, and for more triangles than a scene may have.
        """
        file, surfaces = self._file(path)
        self._count(path, file)
        self._textures.append(finish.texture)  # kept, so that its id stays its own
        look = own_colour, finish.albedo, id(finish.texture), finish.material
        meshes: list[tuple[Mesh, Doubles | None]] = []
        for index, part in enumerate(file.parts):
            whole, place = _apart(part)
            # Copies within the file go by the key that they share; any part may be shown by several objects.
            key = (path, *look, index if place is None or part.shared is None else ("shared", part.shared))
            if key not in self._meshes:
                self._meshes[key] = _mesh(path, whole, finish, surfaces if own_colour else None)
            mesh = self._meshes[key]
            if mesh is not None:
                meshes.append((mesh, place))
        if not meshes:
            raise SceneError(f"{path} holds no triangle with an area: a mesh needs at least one")
        remarks = (*file.remarks, *surfaces.remarks) if own_colour else file.remarks
        return _placed(path, meshes, placement), tuple(f"{path}: {remark}" for remark in dict.fromkeys(remarks))

    def _file(self, path: Path) -> tuple[MeshFile, PartSurfaces]:
        if path not in self._files:
            suffix = path.suffix.lower()
            if suffix not in SUFFIXES:
                raise SceneError(f"{path} is no mesh that can be read: it must be one of {', '.join(SUFFIXES)}")
            self._files[path] = _reader(suffix)(path, read_plain(path)), PartSurfaces(path)
        return self._files[path]

    def _count(self, path: Path, file: MeshFile) -> None:
        own = sum(len(part.faces) for part in file.parts)
        self._triangles += own
        check_triangles(path, own)
        if self._triangles > MAX_TRIANGLES:
            raise SceneError(
                f"{path}, with {own} triangles, brings the meshes of the scene to {self._triangles}: "
                f"at most {MAX_TRIANGLES} are allowed, copies among them"
            )


def read_mesh(
    path: Path, placement: Placement, finish: Finish = GREY, *, own_colour: bool = True
) -> tuple[list[Mesh], tuple[str, ...]]:
    """The meshes of one file, as a `MeshReader` reads them."""
    return MeshReader().read(path, placement, finish, own_colour=own_colour)


def _apart(part: MeshPart) -> tuple[MeshPart, Doubles | None]:
    """The part in its own axes and its place (4, 4), or, where that flattens it or is not finite, as it is placed."""
    place = part.transform
    if place is None:
        return part, None
    size = float(np.abs(place[:3, :3]).max())
    if math.isfinite(size) and abs(float(np.linalg.det(place[:3, :3] / (size or 1.0)))) > 1e-9:
        return part, place
    with np.errstate(invalid="ignore", over="ignore"):
        vertices = part.vertices @ place[:3, :3].T + place[:3, 3]
    return replace(part, vertices=vertices, transform=None), None


def _mesh(path: Path, part: MeshPart, finish: Finish, surfaces: PartSurfaces | None) -> Mesh | None:
    """The part in its own axes; None where no triangle has an area."""
    try:
        return _surfaced(path, part, finish, surfaces)
    except NoAreaError:
        return None
    except InputError as error:
        raise SceneError(f"{path}: {error}") from error


def _surfaced(path: Path, part: MeshPart, finish: Finish, surfaces: PartSurfaces | None) -> Mesh:
    name = path.stem
    raw = np.asarray(part.vertices, np.float64)
    # Vertices that no triangle uses may be anything; the others are checked by `triangles`.
    vertices = np.where(np.abs(raw) <= LARGEST, raw, np.nan)
    faces = np.asarray(part.faces, np.int64)
    # Checked here, before the indices are used to look up colours and texture coordinates.
    bare = triangles(name, vertices, faces, Finish(finish.albedo, None, None))
    shown, uv = (finish, part.uv) if surfaces is None else surfaces.surface(part, finish.material)
    if not shown.patterned:
        return replace(bare, albedo=shown.albedo, material=shown.material)
    if uv is None:
        raise InputError(
            "it has no texture coordinates: an object without them must have an albedo, no texture and no veins"
        )
    if surfaces is None and shown.texture is not None:
        uv, texture = tiled(path, uv, shown.texture)
        shown = replace(shown, texture=texture)
    soup = np.arange(faces.size).reshape(-1, 3)
    return triangles(name, vertices[faces].reshape(-1, 3), soup, shown, uv.reshape(-1, 2))


def _placed(path: Path, meshes: list[tuple[Mesh, Doubles | None]], placement: Placement) -> list[Mesh]:
    turned = placement.rotation @ _UPRIGHT[placement.up]
    points = []
    for mesh, place in meshes:
        moved = mesh.vertices if place is None else mesh.vertices @ place[:3, :3].T + place[:3, 3]
        points.append(moved @ turned.T)
    low = np.min([group.min(axis=0) for group in points], axis=0)
    high = np.max([group.max(axis=0) for group in points], axis=0)
    scale = _scale(path, high - low, placement)
    centre = (low + high) / 2
    anchors = {"centre": centre, "base": np.array([centre[0], high[1], centre[2]]), "origin": np.zeros(3)}
    anchor = anchors[placement.anchor]
    offset = np.array(placement.position_m)
    reach = float(np.abs([low - anchor, high - anchor]).max() * scale)
    if reach > MAX_METRES:
        raise SceneError(
            f"{path} would reach {reach:g} m from its place: it must be scaled to at most {MAX_METRES:g} m"
        )
    return [
        replace(mesh, vertices=(group - anchor) * scale + offset)
        for (mesh, _), group in zip(meshes, points, strict=True)
    ]


def _scale(path: Path, extent: Doubles, placement: Placement) -> float:
    if placement.fit_height_m is None:
        return placement.scale
    limits = [] if placement.fit_extent_m is None else [placement.fit_extent_m / float(extent.max())]
    if extent[1] > 0:
        limits.append(placement.fit_height_m / float(extent[1]))
    if not limits:
        raise SceneError(f"{path} is flat and has no height: it must be sized by scale, not by fit_height_m")
    return min(limits)


def _reader(suffix: str) -> Callable[[Path, bytes], MeshFile]:
    """What reads files of this suffix, from their path and bytes. It raises SceneError alone."""
    # late: most scenes have no mesh, and readers take their time to import
    if suffix == ".obj":
        from slopegate.drivers.scenes.obj_file import read_obj as read
    elif suffix == ".ply":
        from slopegate.drivers.scenes.ply_file import read_ply as read
    elif suffix == ".stl":
        from slopegate.drivers.scenes.stl_file import read_stl as read
    else:
        from slopegate.drivers.scenes.gltf_file import read_gltf as read
    return read
