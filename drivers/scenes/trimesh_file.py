"""Reads mesh files with trimesh."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.scene.shapes import Finish
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_checks import check_pixels
from slopegate.drivers.files.picture_decoding import linear_rgb
from slopegate.drivers.files.reading import decoding
from slopegate.drivers.scenes.mesh_parts import MeshFile, MeshPart


def read_trimesh(path: Path, data: bytes) -> MeshFile:
    """The parts of a file that have triangles. Raises SceneError."""
    import trimesh

    suffix = path.suffix.lower()
    with decoding(SceneError(f"{path} cannot be read as a mesh: it is empty, damaged or cut short")):
        resolver = trimesh.resolvers.FilePathResolver(str(path))
        scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], resolver=resolver, process=False)
        placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
        found = [(scene.geometry[name], np.asarray(transform, np.float64)) for transform, name in placed]
    return MeshFile(tuple(_part(path, part, where) for part, where in found if len(getattr(part, "faces", ()))))


def _part(path: Path, part: Any, transform: Doubles) -> MeshPart:
    vertices, faces = np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int64)
    bare = MeshPart(vertices, faces, transform=transform)
    if faces.min() < 0 or faces.max() >= len(vertices):
        return bare
    factor, texture, uv, colours = _surface(path, part)
    return MeshPart(vertices, faces, uv, colours, factor, texture, transform=transform)


def _surface(
    path: Path, part: Any
) -> tuple[tuple[float, float, float] | None, Singles | None, Doubles | None, Singles | None]:
    """Factor, texture, texture coordinates (F, 3, 2) per corner of a face, v down, and colours, if any.

    Colour factors of materials (Kd, baseColorFactor) are linear; pictures and the vertex colours of PLY are sRGB.
    """
    visual = part.visual
    faces = np.asarray(part.faces)
    if visual.kind == "texture":
        uv = getattr(visual, "uv", None)
        places = None
        if uv is not None and len(uv) == len(part.vertices):
            places = np.asarray(uv, np.float64)[faces] * (1.0, -1.0) + (0.0, 1.0)
        image = _image(visual.material)
        red, green, blue = (float(value) for value in _factor(visual.material))
        if image is None or places is None:
            return (red, green, blue), None, places, None
        check_pixels(path, *image.size)
        with decoding(SceneError(f"{path} has a texture that cannot be decoded: it is damaged or cut short")):
            pixels = np.asarray(image.convert("RGB"))
        return (red, green, blue), linear_rgb(path, pixels), places, None
    if visual.kind in {"vertex", "face"}:
        return None, None, None, _colours(path, visual, faces)
    return None, None, None, None


def _image(material: Any) -> Any:
    found = getattr(material, "image", None)
    return found if found is not None else getattr(material, "baseColorTexture", None)


def _factor(material: Any) -> Singles:
    """The material's linear colour: of the whole surface, or what its picture is multiplied by."""
    colour = getattr(material, "baseColorFactor", None)
    if colour is None:
        colour = getattr(material, "diffuse", None)
        if colour is not None and _image(material) is not None:
            colour = None  # a picture replaces Kd, as most programs that write OBJ expect
    if colour is None:
        return np.ones(3, np.float32) if _image(material) is not None else np.array(Finish.albedo, np.float32)
    values = np.asarray(colour)
    return (values[:3] / (255 if values.dtype.kind in "ui" else 1)).astype(np.float32).clip(0, 1)


def _colours(path: Path, visual: Any, faces: Indices) -> Singles:
    """The linear colour of each corner of a face (F, 3, 3)."""
    if visual.kind == "vertex":
        codes = np.asarray(visual.vertex_colors)[:, :3][faces]
    else:
        codes = np.repeat(np.asarray(visual.face_colors)[:, None, :3], 3, axis=1)
    linear = codes / np.float32(255) if path.suffix.lower() == ".glb" else linear_rgb(path, codes.astype(np.uint8))
    return np.asarray(linear, np.float32)
