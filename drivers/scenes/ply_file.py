"""Reads PLY files as parts: polygons and strips of triangles, with colours of vertices or faces, and textures."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import shown
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.mesh_parts import MeshFile, MeshPart, check_triangles
from slopegate.drivers.scenes.mesh_pictures import MeshPictures
from slopegate.drivers.scenes.mesh_surfaces import linear_colours
from slopegate.drivers.scenes.ply_data import PlyTable, read_header, read_tables
from slopegate.drivers.scenes.polygons import cut, guessed

_COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_PLACES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"), ("s0", "t0"), ("u0", "v0"))
_CORNERS = ("vertex_indices", "vertex_index")
_FULL = {"u1": 255.0, "u2": 65535.0, "i1": 255.0}
_TEXTURE = re.compile(r"comment\s+texturefile\s+(.+)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class _PlyTriangles:
    """The triangles of a file; those of strips come last, and have neither place nor face: -1."""

    corners: Indices
    """(T, 3), of vertices."""
    places: Indices
    """(T, 3), where each corner stands among those of all faces."""
    faces: Indices
    """(T,)"""


def read_ply(path: Path, data: bytes) -> MeshFile:
    """The parts of a PLY file, one for each texture. Raises SceneError."""
    header = read_header(path, data)
    tables, remarks = read_tables(path, data, header, {"vertex", "face", "tristrips"})
    remarks += [
        f"its element {shown(element.name)} ({element.count} rows) is left out"
        for element in header.elements
        if element.name not in tables and element.count
    ]
    if header.unknown:
        remarks.append(f"its header has a line {shown(header.unknown[0])}, which PLY does not know: it is left out")
    vertex, face = tables.get("vertex"), tables.get("face")
    if vertex is None and not any(element.count for element in header.elements):
        raise SceneError(f"{path} holds nothing: a mesh needs vertices and faces")
    if vertex is None or not {"x", "y", "z"} <= vertex.columns.keys():
        raise SceneError(f"{path} has no vertices with x, y and z: a mesh needs them")
    points = np.stack([vertex.columns[name] for name in "xyz"], axis=1)
    found = _triangles(path, points, face, tables.get("tristrips"), remarks)
    if not len(found.corners):
        raise SceneError(f"{path} holds {len(points)} points and no faces: a mesh needs triangles or polygons")
    colours = _colours(vertex, face, found, remarks)
    names = [match[1].strip() for line in header.comments if (match := _TEXTURE.fullmatch(line))]
    uv = _places(vertex, face, found)
    pictures = MeshPictures(path)
    parts = []
    for number, chosen in _by_texture(face, found, uv, names, remarks):
        used, own = np.unique(found.corners[chosen], return_inverse=True)
        parts.append(
            MeshPart(
                vertices=points[used],
                faces=own.reshape(-1, 3),
                uv=None if uv is None or not np.isfinite(uv[chosen]).all() else uv[chosen],
                colours=None if colours is None else colours[chosen],
                texture=None if number < 0 else pictures.read(path.parent, names[number], path),
            )
        )
    return MeshFile(tuple(parts), (*remarks, *pictures.remarks))


def _triangles(
    path: Path, points: Doubles, face: PlyTable | None, strips: PlyTable | None, remarks: list[str]
) -> _PlyTriangles:
    corners, places, faces = [np.zeros((0, 3), np.int64)], [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    listed = _corners(path, face, len(points))
    if listed is not None:
        flat, sizes = listed
        short = int((sizes < 3).sum())
        if short:
            remarks.append(f"{short} of its {len(sizes)} faces have fewer than 3 corners: they are left out")
        check_triangles(path, int(np.maximum(sizes - 2, 0).sum()))
        whole = np.flatnonzero(sizes >= 3)
        kept = np.flatnonzero(np.repeat(sizes >= 3, sizes))
        if len(whole):
            cuts, owners, crossing = cut(str(path), points, flat[kept], sizes[whole])
            remarks += guessed(crossing)
            corners.append(flat[kept][cuts])
            places.append(kept[cuts])
            faces.append(whole[owners])
    listed = _corners(path, strips, len(points), restarts=True)
    if listed is not None:
        flat, sizes = listed
        ends = np.cumsum(sizes)
        windows = np.stack([flat[:-2], flat[1:-1], flat[2:]], axis=1) if len(flat) > 2 else np.zeros((0, 3), np.int64)
        first = np.searchsorted(ends, np.arange(len(windows)), side="right")
        last = np.searchsorted(ends, np.arange(len(windows)) + 2, side="right")
        windows = windows[(windows >= 0).all(axis=1) & (first == last)]
        corners.append(windows)
        places.append(np.full(windows.shape, -1))
        faces.append(np.full(len(windows), -1))
    found = _PlyTriangles(np.concatenate(corners), np.concatenate(places), np.concatenate(faces))
    check_triangles(path, len(found.corners))
    return found


def _corner_list(table: PlyTable) -> str | None:
    """The name of the list of corners, whichever of the usual ones it has."""
    return next((name for name in _CORNERS if name in table.lists), None)


def _corners(path: Path, table: PlyTable | None, points: int, restarts: bool = False) -> tuple[Indices, Indices] | None:
    """The vertices of all faces in a row, and how many each face has; -1 ends a strip where it `restarts`."""
    if table is None:
        return None
    name = _corner_list(table)
    if name is None:
        raise SceneError(f"{path} has faces without a list {' or '.join(_CORNERS)}")
    flat, sizes = table.lists[name]
    wrong = ~((flat >= (-1 if restarts else 0)) & (flat < points) & (flat == np.floor(flat)))
    if wrong.any():
        raise SceneError(f"{path} has a face with vertex {flat[np.argmax(wrong)]:.12g}: it must be in 0..{points - 1}")
    return flat.astype(np.int64), sizes


def _colours(vertex: PlyTable, face: PlyTable | None, found: _PlyTriangles, remarks: list[str]) -> Singles | None:
    """The linear colour of each corner (T, 3, 3), if the file has any: those of vertices before those of faces."""
    of_vertices = _linear(vertex, remarks)
    of_faces = None if face is None else _linear(face, remarks)
    if of_vertices is not None:
        if of_faces is not None:
            remarks.append("it has colours of vertices and of faces: those of its faces are left out")
        return of_vertices[found.corners]
    if of_faces is None:
        return None
    colours = np.full((*found.corners.shape, 3), np.float32(0.8))
    listed = found.faces >= 0
    colours[listed] = of_faces[found.faces[listed], None]
    return colours


def _linear(table: PlyTable, remarks: list[str]) -> Singles | None:
    names = next((names for names in _COLOURS if set(names) <= table.columns.keys()), None)
    if names is None:
        return None
    alpha = table.columns.get(names[0].replace("red", "alpha") if "red" in names[0] else "a")
    if alpha is not None and len(alpha) and (alpha < alpha.max()).any():
        remarks.append("parts of it let light through (alpha): they are shown opaque")
    codes = np.stack([table.columns[name] for name in names], axis=1)
    return linear_colours(codes, _FULL.get(table.types[names[0]]), remarks)


def _places(vertex: PlyTable, face: PlyTable | None, found: _PlyTriangles) -> Doubles | None:
    """Texture coordinates (T, 3, 2) with v down, NaN where a face has none; those of faces before those of vertices."""
    uv = None
    names = next((names for names in _PLACES if set(names) <= vertex.columns.keys()), None)
    if names is not None:
        uv = np.stack([vertex.columns[name] for name in names], axis=1)[found.corners]
    listed = None if face is None else _corner_list(face)
    wedges = None if face is None else face.lists.get("texcoord")
    if face is not None and listed is not None and wedges is not None:
        corners = face.lists[listed]
        uv = np.full((*found.corners.shape, 2), np.nan) if uv is None else uv
        flat, lengths = wedges
        sizes = corners[1]
        # Where a face's own coordinates begin, of those faces that have a pair for each corner.
        starts, own = np.cumsum(lengths) - lengths, np.cumsum(sizes) - sizes
        fitting = (found.faces >= 0) & (lengths == 2 * sizes)[found.faces]
        numbers = found.faces[fitting]
        first = starts[numbers, None] + 2 * (found.places[fitting] - own[numbers, None])
        uv[fitting] = np.stack([flat[first], flat[first + 1]], axis=-1)
    return None if uv is None else uv * (1.0, -1.0) + (0.0, 1.0)


def _by_texture(
    face: PlyTable | None, found: _PlyTriangles, uv: Doubles | None, names: list[str], remarks: list[str]
) -> list[tuple[int, Indices]]:
    """Which triangles have which of the textures `names`, -1 for none."""
    everything = np.arange(len(found.corners))
    if not names:
        return [(-1, everything)]
    numbers = np.zeros(len(found.corners), np.int64)
    own = None if face is None else face.columns.get("texnumber")
    if own is not None and len(own):
        numbers = np.where(found.faces >= 0, np.clip(np.nan_to_num(own, nan=-1.0), -1, 1e6)[found.faces], 0).astype(
            np.int64
        )
    elif len(names) > 1:
        remarks.append(f"it names {len(names)} textures, but not where they belong: {shown(names[0])} is all over it")
    placed = np.zeros(len(numbers), np.bool_) if uv is None else np.isfinite(uv).all(axis=(1, 2))
    numbers[~placed | (numbers < 0) | (numbers >= len(names))] = -1
    if (numbers < 0).any():
        remarks.append(f"{int((numbers < 0).sum())} of its triangles have no place in its texture: they show none")
    return [(int(number), everything[numbers == number]) for number in np.unique(numbers)]
