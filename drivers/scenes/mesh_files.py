"""Reads mesh files (OBJ, PLY, STL, GLB) with trimesh, checks them, and places them in front of the rig.

Three parts: the file and its place in the world, the surfaces that it describes, and a clean-up of OBJ text, of which
trimesh accepts too little and refuses too little.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from os.path import isfile
from pathlib import Path
from typing import Any, Literal

import numpy as np

from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Vector3
from slopegate.core.scene.scene import Mesh
from slopegate.core.scene.shapes import GREY, Finish, NoAreaError, triangles, turn
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_files import MAX_PIXELS, check_pixels, linear_rgb
from slopegate.drivers.files.reading import decoding, read_plain
from slopegate.drivers.scenes.scene_values import MAX_METRES

SUFFIXES = (".obj", ".ply", ".stl", ".glb")
MAX_TRIANGLES = 2_000_000
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


def read_mesh(path: Path, placement: Placement, finish: Finish = GREY, *, own_colour: bool = True) -> list[Mesh]:
    """The meshes of a file in the world, one for each part and material.

    `finish` says what they are made of, and their colour unless they keep their `own_colour`. Raises SceneError for a
    file that is missing, damaged or empty, and for triangles without area, indices out of range and vertices that are
    not finite.
    """
    meshes: list[Mesh] = []
    for part, transform in _parts(path):
        if len(part.faces) > MAX_TRIANGLES:
            raise SceneError(f"{path} has {len(part.faces)} triangles: at most {MAX_TRIANGLES} are allowed")
        try:
            meshes.append(_mesh(path, part, transform, finish, own_colour))
        except NoAreaError:
            continue
        except InputError as error:
            raise SceneError(f"{path}: {error}") from error
    if not meshes:
        raise SceneError(f"{path} holds no triangle with an area: a mesh needs at least one")
    return _placed(path, meshes, placement)


def _parts(path: Path) -> Iterator[tuple[Any, Doubles]]:
    """Every part that has triangles, with the (4, 4) transform that the file's scene graph gives it."""
    import trimesh

    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"{path} is no mesh that can be read: it must be one of {', '.join(SUFFIXES)}")
    data = read_plain(path)
    if suffix == ".obj":
        data = _clean_obj(path, data)
    with decoding(SceneError(f"{path} cannot be read as a mesh: it is empty, damaged or cut short")):
        resolver = trimesh.resolvers.FilePathResolver(str(path))
        scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], resolver=resolver, process=False)
        placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
        found = [(scene.geometry[name], np.asarray(transform, np.float64)) for transform, name in placed]
    for part, transform in found:
        if len(getattr(part, "faces", ())):
            yield part, transform


def _mesh(path: Path, part: Any, transform: Doubles, finish: Finish, own_colour: bool) -> Mesh:
    name = path.stem
    raw = np.asarray(part.vertices, np.float64)
    if raw.ndim != 2 or raw.shape[1] != 3:
        raise InputError(f"it has vertices of shape {raw.shape}: each must have three coordinates")
    # Vertices that no triangle uses may be anything; the others are checked by `triangles`.
    usable = np.where(np.abs(raw) <= LARGEST, raw, np.nan)
    with np.errstate(invalid="ignore"):
        vertices = usable @ transform[:3, :3].T + transform[:3, 3]
    faces = np.asarray(part.faces, np.int64)
    if not own_colour and not finish.patterned:
        return triangles(name, vertices, faces, finish)
    # Checked here, before the indices are used to look up colours and texture coordinates.
    bare = triangles(name, vertices, faces, finish)
    own, uv = _surface(path, part)
    shown = Finish(own.albedo, own.texture, finish.material) if own_colour else finish
    if uv is None:
        if shown.patterned:
            raise InputError(
                "it has no texture coordinates: an object without them must have an albedo, no texture and no veins"
            )
        return replace(bare, albedo=shown.albedo)
    uv, texture = _tiled(path, uv, shown.texture)
    soup = np.arange(faces.size).reshape(-1, 3)
    return triangles(name, vertices[faces].reshape(-1, 3), soup, replace(shown, texture=texture), uv.reshape(-1, 2))


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


def _scale(path: Path, extent: Doubles, placement: Placement) -> float:
    if placement.fit_height_m is None:
        return placement.scale
    limits = [] if placement.fit_extent_m is None else [placement.fit_extent_m / float(extent.max())]
    if extent[1] > 0:
        limits.append(placement.fit_height_m / float(extent[1]))
    if not limits:
        raise SceneError(f"{path} is flat and has no height: it must be sized by scale, not by fit_height_m")
    return min(limits)


def _surface(path: Path, part: Any) -> tuple[Finish, Doubles | None]:
    """The surface of a trimesh part, and its texture coordinates (F, 3, 2) per corner of a face, v down, if any.

    Colour factors of materials (Kd, baseColorFactor) are linear; pictures and the vertex colours of PLY are sRGB. A
    face whose vertices have colours gets their mean.
    """
    visual = part.visual
    faces = np.asarray(part.faces)
    if visual.kind == "texture":
        uv = getattr(visual, "uv", None)
        places = None
        if uv is not None and len(uv) == len(part.vertices):
            places = np.asarray(uv, np.float64)[faces] * (1.0, -1.0) + (0.0, 1.0)
        image = _image(visual.material)
        factor = _factor(visual.material)
        if image is None or places is None:
            return Finish((float(factor[0]), float(factor[1]), float(factor[2]))), places
        check_pixels(path, *image.size)
        with decoding(SceneError(f"{path} has a texture that cannot be decoded: it is damaged or cut short")):
            pixels = np.asarray(image.convert("RGB"))
        return Finish(Finish.albedo, linear_rgb(path, pixels) * factor), places
    if visual.kind in {"vertex", "face"}:
        return _coloured(path, visual, faces)
    return Finish(), None


def _tiled(path: Path, uv: Doubles, texture: Singles | None) -> tuple[Doubles, Singles | None]:
    """The texture repeated as often as one face needs, and uv (F, 3, 2) that stay within it: 0..1."""
    if texture is None or (uv.min() >= -1e-6 and uv.max() <= 1 + 1e-6):
        return uv, texture
    if not np.isfinite(uv).all():
        raise SceneError(f"{path} has a texture coordinate that is not finite: every one must be a finite number")
    shifted = uv - np.floor(uv.min(axis=1, keepdims=True))
    across, down = (max(math.ceil(float(shifted[..., k].max()) - 1e-6), 1) for k in (0, 1))
    height, width = texture.shape[:2]
    if across * down * height * width > MAX_PIXELS:
        raise SceneError(f"{path} repeats its texture {across} x {down} times on one face: that is too large a picture")
    return shifted / (across, down), np.tile(texture, (down, across, 1))


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


def _coloured(path: Path, visual: Any, faces: Indices) -> tuple[Finish, Doubles | None]:
    """Colours of vertices or faces as a texture with one texel per face: the renderer knows no other varying colour."""
    if visual.kind == "vertex":
        codes = np.asarray(visual.vertex_colors)[:, :3][faces]
    else:
        codes = np.asarray(visual.face_colors)[:, None, :3]
    linear = codes / np.float32(255) if path.suffix.lower() == ".glb" else linear_rgb(path, codes.astype(np.uint8))
    colours = linear.mean(axis=1, dtype=np.float32)
    if (colours == colours[0]).all():
        red, green, blue = (float(value) for value in colours[0])
        return Finish((red, green, blue)), None
    width = math.ceil(math.sqrt(len(faces)))
    height = math.ceil(len(faces) / width)
    texture = np.zeros((height * width, 3), np.float32)
    texture[: len(faces)] = colours
    index = np.arange(len(faces))
    places = np.stack([(index % width + 0.5) / width, (index // width + 0.5) / height], axis=-1)
    return Finish(Finish.albedo, texture.reshape(height, width, 3)), np.repeat(places[:, None], 3, axis=1)


_KEPT = {"v", "vt", "usemtl", "mtllib", "o", "g"}


def _clean_obj(path: Path, data: bytes) -> bytes:
    """An OBJ file's text with faces as triangles `f v/vt v/vt v/vt` and without normals; the rest as it was.

    Polygons become fans around their first corner. Raises SceneError with the line of a face that has fewer than 3
    corners or an index that is no whole number or out of range, and for a texture that is missing.
    """
    lines: list[str] = []
    points, places = 0, 0
    text = data.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        word, _, rest = line.partition("#")[0].strip().partition(" ")
        if word == "f":
            lines.extend(_fan(f"{path}: line {number}", rest.split(), points, places))
            continue
        if word in _KEPT:
            lines.append(f"{word} {rest.strip()}")
        points += word == "v"
        places += word == "vt"
        if word == "mtllib":
            _check_textures(path.parent / rest.strip())
    return "\n".join(lines).encode()


def _fan(where: str, corners: list[str], points: int, places: int) -> list[str]:
    if len(corners) < 3:
        raise SceneError(f"{where} has a face of {len(corners)} corners: it must have at least 3")
    plain = [_corner(where, corner, points, places) for corner in corners]
    if not all("/" in corner for corner in plain):
        plain = [corner.partition("/")[0] for corner in plain]
    return [f"f {plain[0]} {plain[k]} {plain[k + 1]}" for k in range(1, len(plain) - 1)]


def _corner(where: str, corner: str, points: int, places: int) -> str:
    first, _, rest = corner.partition("/")
    second = rest.partition("/")[0]
    index = _absolute(where, first, points, "vertices")
    return f"{index}/{_absolute(where, second, places, 'texture coordinates')}" if second else str(index)


def _absolute(where: str, index: str, count: int, what: str) -> int:
    try:
        value = int(index)
    except ValueError:
        value = 0
    if value < 0:
        value += count + 1
    # Faces may name vertices that come later in the file, but none of the writers in use does that.
    if not 1 <= value <= count:
        raise SceneError(f"{where} has a face with index {index!r}: it must be within 1..{count}, the {what} so far")
    return value


def _check_textures(library: Path) -> None:
    """Refuse a material library whose textures are missing; a missing library only leaves the mesh grey."""
    if not isfile(library):
        return
    try:
        text = library.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise SceneError(f"{library} cannot be read: {error.strerror}") from error
    for line in text.splitlines():
        words = line.split()
        if len(words) > 1 and words[0].lower() == "map_kd":
            texture = library.parent / line.strip()[len("map_kd") :].strip()
            if not isfile(texture):
                raise SceneError(f"{texture} is missing: {library} names it as a texture")
