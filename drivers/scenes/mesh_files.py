"""Mesh files (OBJ, PLY, STL, GLB) through trimesh, checked and placed in front of the rig."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from slopegate.core.rig.rig import Vector3
from slopegate.core.scene.scene import Mesh
from slopegate.core.scene.shapes import Finish, Floats, NoAreaError, triangles, turn
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_files import read_plain
from slopegate.drivers.scenes.mesh_materials import file_material, tiled
from slopegate.drivers.scenes.obj_text import triangulated
from slopegate.drivers.scenes.scene_values import MAX_METRES

SUFFIXES = (".obj", ".ply", ".stl", ".glb")
MAX_TRIANGLES = 2_000_000
LARGEST = 1e12
# File axes -> world axes (y down, z away from the rig), the file's front towards the rig.
_UPRIGHT = {
    "y": np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a mesh goes.

    The file's up axis is turned to world up, the mesh is turned by `rotation` and scaled (by `scale`, or to
    `fit_height_m`, smaller where its largest side would exceed `fit_extent_m`), and put at `position_m` with its
    anchor: the centre of its bounding box, the middle of that box's lowest side, or the file's own origin.
    """

    position_m: Vector3
    rotation: Floats = field(default_factory=turn)
    up: Literal["y", "z"] = "y"
    anchor: Literal["centre", "base", "origin"] = "centre"
    scale: float = 1.0
    fit_height_m: float | None = None
    fit_extent_m: float | None = None


def read_mesh(path: Path, placement: Placement, finish: Finish | None) -> list[Mesh]:
    """The meshes of a file, one for each of its parts and materials, placed in the world.

    `finish` replaces the file's own materials. Raises SceneError for files that are missing, damaged, empty, or whose
    triangles have no area, indices out of range or vertices that are not finite.
    """
    meshes: list[Mesh] = []
    for part, transform in _parts(path):
        if len(part.faces) > MAX_TRIANGLES:
            raise SceneError(f"{path} has {len(part.faces)} triangles: at most {MAX_TRIANGLES} are allowed")
        try:
            meshes.append(_mesh(path, part, transform, finish))
        except NoAreaError:
            continue
        except (ValueError, IndexError) as error:
            raise SceneError(f"{path}: {error}") from error
    if not meshes:
        raise SceneError(f"{path} holds no triangle with an area: a mesh needs at least one")
    return _placed(path, meshes, placement)


def _parts(path: Path) -> Iterator[tuple[Any, Floats]]:
    """Every part with triangles, and the transform that the file's scene graph gives it."""
    import trimesh

    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"{path} is no mesh that can be read: it must be one of {', '.join(SUFFIXES)}")
    data = read_plain(path)
    if suffix == ".obj":
        data = triangulated(path, data)
    try:
        resolver = trimesh.resolvers.FilePathResolver(str(path))
        scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], resolver=resolver, process=False)
        placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
        found = [(scene.geometry[name], np.asarray(transform, np.float64)) for transform, name in placed]
    except Exception as error:  # loaders of damaged files raise whatever they stumble over
        raise SceneError(f"{path} cannot be read as a mesh: it is empty, damaged or cut short") from error
    for part, transform in found:
        if len(getattr(part, "faces", ())):
            yield part, transform


def _mesh(path: Path, part: Any, transform: Floats, finish: Finish | None) -> Mesh:
    name = path.stem
    raw = np.asarray(part.vertices, np.float64)
    if raw.ndim != 2 or raw.shape[1] != 3:
        raise ValueError(f"it has vertices of shape {raw.shape}: each must have three coordinates")
    # Points that no triangle uses may be anything.
    usable = np.where(np.abs(raw) <= LARGEST, raw, np.nan)
    with np.errstate(invalid="ignore"):
        vertices = usable @ transform[:3, :3].T + transform[:3, 3]
    faces = np.asarray(part.faces, np.int64)
    if finish is not None and finish.texture is None:
        return triangles(name, vertices, faces, finish)
    # Checked before the indices are used; the material only adds to it.
    bare = triangles(name, vertices, faces)
    own, uv = file_material(path, part)
    if uv is None:
        if finish is not None:
            raise ValueError("it has no texture coordinates: an object without them must have an albedo, not a texture")
        return replace(bare, albedo=own.albedo)
    uv, texture = tiled(path, uv, own.texture if finish is None else finish.texture)
    soup = np.arange(faces.size).reshape(-1, 3)
    return triangles(name, vertices[faces].reshape(-1, 3), soup, Finish(own.albedo, texture), uv.reshape(-1, 2))


def _placed(path: Path, meshes: list[Mesh], placement: Placement) -> list[Mesh]:
    turned = placement.rotation @ _UPRIGHT[placement.up]
    points = [mesh.vertices @ turned.T for mesh in meshes]
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
        replace(mesh, vertices=(group - anchor) * scale + offset) for mesh, group in zip(meshes, points, strict=True)
    ]


def _scale(path: Path, extent: Floats, placement: Placement) -> float:
    if placement.fit_height_m is None:
        return placement.scale
    limits = [] if placement.fit_extent_m is None else [placement.fit_extent_m / float(extent.max())]
    if extent[1] > 0:
        limits.append(placement.fit_height_m / float(extent[1]))
    if not limits:
        raise SceneError(f"{path} is flat and has no height: it must be sized by scale, not by fit_height_m")
    return min(limits)
