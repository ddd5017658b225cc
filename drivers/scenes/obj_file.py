"""Reads Wavefront OBJ files and their material libraries (MTL) as parts, one for each material.

What of a file is not a polygon with a colour or a texture is remarked by name: lines, free-form surfaces,
transparency, maps for anything but the colour.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.checks import shown
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.material_files import ObjMaterial, library_names, read_library
from slopegate.drivers.scenes.mesh_parts import MAX_POINTS, MAX_TRIANGLES, MeshFile, MeshPart
from slopegate.drivers.scenes.mesh_pictures import MeshPictures, find_named
from slopegate.drivers.scenes.mesh_surfaces import linear_colours
from slopegate.drivers.scenes.obj_text import keyword, lines_of, text_of, uncommented
from slopegate.drivers.scenes.polygons import cut, guessed

_IDLE = {
    "vn", "vp", "g", "s", "o", "mg", "lod", "bevel", "c_interp", "d_interp", "shadow_obj", "trace_obj", "cstype", "deg",
    "bmat", "step", "parm", "trim", "hole", "scrv", "sp", "end", "con", "ctech", "stech", "res", "maplib",
}  # fmt: skip
_LEFT_OUT = {
    "l": "lines", "p": "points", "curv": "free-form curves", "curv2": "free-form curves", "surf": "free-form surfaces",
    "bzp": "Bezier patches", "bsp": "B-spline patches", "cdc": "Cardinal curves", "cdp": "Cardinal patches",
    "call": "calls of other files", "csh": "calls of programs", "usemap": "texture maps (usemap)",
}  # fmt: skip


MAX_LINES = 20_000_000
_CHUNK = 50_000
"""Lines that are kept as text before they become arrays."""
_NONE = -(2**62)
"""The index of a corner that has no texture coordinate."""


class _Rows:
    """Numbers of lines of one kind. They become arrays chunk by chunk: as words they take twenty times as much."""

    def __init__(self, where: Path, what: str, needed: str, least: int) -> None:
        self.count = 0
        self._where, self._what, self._needed, self._least = where, what, needed, least
        self._lines: list[tuple[int, str]] = []
        self._chunks: list[Doubles] = []

    def add(self, number: int, rest: str) -> None:
        self._lines.append((number, rest))
        self.count += 1
        if len(self._lines) == _CHUNK:
            self._flush()
        if self.count > MAX_POINTS:
            raise SceneError(f"{self._where} has more than {MAX_POINTS} lines with a {self._what}: that is too many")

    def table(self, width: int) -> Doubles:
        """All rows (n, width), NaN where a line has fewer numbers."""
        self._flush()
        table = np.full((self.count, width), np.nan)
        start = 0
        for chunk in self._chunks:
            kept = min(width, chunk.shape[1])
            table[start : start + len(chunk), :kept] = chunk[:, :kept]
            start += len(chunk)
        return table

    def _flush(self) -> None:
        rows = [uncommented(rest).split(None, 7)[:7] for _, rest in self._lines]
        sizes = np.array([len(row) for row in rows], np.int64)
        try:
            flat = np.array([float(word) for row in rows for word in row])
        except ValueError:
            self._blame(next(k for k, row in enumerate(rows) if not all(_is_number(word) for word in row)))
        short = np.flatnonzero((sizes < self._least) | ((sizes == 5) & (self._least == 3)))
        if len(short):
            self._blame(int(short[0]))
        if rows:
            table = np.full((len(rows), int(sizes.max())), np.nan)
            table[np.arange(table.shape[1]) < sizes[:, None]] = flat
            self._chunks.append(table)
        self._lines.clear()

    def _blame(self, index: int) -> NoReturn:
        number, rest = self._lines[index]
        raise SceneError(f"{self._where}: line {number} has {self._what} {shown(rest)}: it must have {self._needed}")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


class _Corners:
    """Indices of the corners of faces, which become arrays chunk by chunk."""

    def __init__(self, where: Path) -> None:
        self._where = where
        self._lines: list[tuple[int, list[str]]] = []
        self._chunks: list[Indices] = []
        self.sizes: list[int] = []
        self.numbers: list[int] = []
        self.before: list[tuple[int, int]] = []
        """Vertices and texture coordinates before each face, from which negative indices count."""
        self.materials: list[int] = []
        self._triangles = 0

    def add(self, number: int, rest: str, before: tuple[int, int], material: int) -> None:
        corners = uncommented(rest).split()
        if len(corners) < 3:
            raise SceneError(
                f"{self._where}: line {number} has a face of {len(corners)} corners: it must have at least 3"
            )
        self._triangles += len(corners) - 2
        if self._triangles > MAX_TRIANGLES:
            raise SceneError(f"{self._where} has more than {MAX_TRIANGLES} triangles: that is too many")
        self._lines.append((number, corners))
        self.sizes.append(len(corners))
        self.numbers.append(number)
        self.before.append(before)
        self.materials.append(material)
        if len(self._lines) == _CHUNK:
            self._flush()

    def resolved(self, points: int, places: int) -> Indices:
        """Numbers (n, 2) of each corner's vertex, and of its texture coordinate or _NONE, from 0 on."""
        self._flush()
        raw = np.concatenate(self._chunks)
        sizes = np.array(self.sizes)
        before = np.repeat(np.array(self.before), sizes, axis=0)
        found = np.where(raw > 0, raw - 1, np.where(raw == _NONE, _NONE, raw + before))
        for k, count, what in ((0, points, "vertices"), (1, places, "texture coordinates")):
            wrong = (raw[:, k] != _NONE) & ((raw[:, k] == 0) | (found[:, k] < 0) | (found[:, k] >= count))
            if wrong.any():
                at = int(np.argmax(wrong))
                number = self.numbers[int(np.searchsorted(np.cumsum(sizes), at, side="right"))]
                self._blame(number, str(raw[at, k]), f"it must be within 1..{count}, the {what}")
        return found

    def _flush(self) -> None:
        words = [word for _, corners in self._lines for word in corners]
        if words:
            found = _alike(words)
            self._chunks.append(self._one_by_one() if found is None else found)
        self._lines.clear()

    def _one_by_one(self) -> Indices:
        found = []
        for number, corners in self._lines:
            for corner in corners:
                first, _, rest = corner.partition("/")
                second = rest.partition("/")[0]
                found.append((self._index(number, first), self._index(number, second) if second else _NONE))
        return np.array(found, np.int64)

    def _index(self, number: int, word: str) -> int:
        try:
            value = int(word)
        except ValueError:
            value = None
        if value is None or abs(value) > 2**40:
            self._blame(number, word, "it must be a whole number, counted from 1")
        return value

    def _blame(self, number: int, index: str, allowed: str) -> NoReturn:
        raise SceneError(f"{self._where}: line {number} has a face with index {shown(index)}: {allowed}")


def _alike(words: list[str]) -> Indices | None:
    """The indices (n, 2) of corners that are all written in one way, as most files do; None where they are not."""
    slashes = {word.count("/") for word in words}
    if len(slashes) != 1:
        return None
    width = slashes.pop() + 1
    joined = " ".join(words)
    doubled = joined.count("//")
    if width > 3 or doubled not in {0, len(words)}:
        return None
    width -= doubled > 0
    try:
        found = np.array([int(word) for word in joined.replace("//", " ").replace("/", " ").split()], np.int64)
    except (ValueError, OverflowError):
        return None
    if found.size != width * len(words) or np.abs(found).max() > 2**40:
        return None
    found = found.reshape(-1, width)
    without = np.full(len(words), _NONE)
    return np.stack([found[:, 0], without if width == 1 or doubled else found[:, 1]], axis=1)


@dataclass
class _Statements:
    """What the lines of a file say, in their order."""

    points: _Rows
    places: _Rows
    faces: _Corners
    names: dict[str, int] = field(default_factory=lambda: {"": 0})
    """The materials in use, numbered."""
    libraries: list[str] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    unknown: dict[str, int] = field(default_factory=dict)
    """The line in which each word that OBJ does not know comes first."""


@dataclass(frozen=True, eq=False)
class _Faces:
    """The triangles of a file."""

    points: Doubles
    colours: Singles | None
    places: Doubles
    corners: Indices
    """(T, 3, 2), of vertex and texture coordinate."""
    materials: Indices


def read_obj(path: Path, data: bytes) -> MeshFile:
    """The parts of an OBJ file. Raises SceneError, with the line where one is to blame."""
    text = text_of(data)
    if max(text.count("\n"), text.count("\r")) > MAX_LINES:
        raise SceneError(f"{path} has more than {MAX_LINES} lines: that is too many")
    said = _read(path, text)
    remarks = [f"{count} {what} are left out" for what, count in said.left_out.items()]
    if not said.faces.sizes:
        only = f" (only {', '.join(said.left_out)})" if said.left_out else ""
        raise SceneError(f"{path} holds no triangle{only}: a mesh needs faces, lines that begin with f")
    if said.unknown:
        word, number = next(iter(said.unknown.items()))
        remarks.append(f"line {number} begins with {shown(word)}, which OBJ does not know: such lines are left out")
    points, colours = _points(said.points.table(7), remarks)
    corners = said.faces.resolved(len(points), said.places.count)
    triangles, polygons, crossing = cut(str(path), points, corners[:, 0], np.array(said.faces.sizes))
    remarks += guessed(crossing)
    faces = _Faces(points, colours, _places(said.places), corners[triangles], np.array(said.faces.materials)[polygons])
    pictures = MeshPictures(path)
    parts = _parts(path, said, faces, pictures, remarks)
    return MeshFile(tuple(parts), (*remarks, *pictures.remarks))


def _read(path: Path, text: str) -> _Statements:
    said = _Statements(
        _Rows(path, "a vertex", "three coordinates, or six numbers with a colour", 3),
        _Rows(path, "a texture coordinate", "one to three numbers", 1),
        _Corners(path),
    )
    material = 0
    for number, line in lines_of(text):
        word, rest = keyword(line)
        word = word.lower()
        if word == "v":
            said.points.add(number, rest)
        elif word == "vt":
            said.places.add(number, rest)
        elif word in {"f", "fo"}:
            said.faces.add(number, rest, (said.points.count, said.places.count), material)
        elif word == "usemtl":
            material = said.names.setdefault(rest, len(said.names))
        elif word == "mtllib":
            said.libraries.append(rest)
        elif word in _LEFT_OUT:
            said.left_out[_LEFT_OUT[word]] += 1
        elif word not in _IDLE:
            said.unknown.setdefault(word, number)
    return said


def _points(table: Doubles, remarks: list[str]) -> tuple[Doubles, Singles | None]:
    """Vertices (V, 3), and their linear colours (V, 3), white where a vertex has none, if any has one."""
    coloured = np.isfinite(table[:, 3:6]).all(axis=1) & ~np.isnan(table[:, 5])
    weights = table[~coloured, 3]
    if ((weights != 1) & ~np.isnan(weights)).any():
        remarks.append("the weights of its vertices (a fourth number) are left out")
    if not coloured.any():
        return table[:, :3], None
    if not coloured.all():
        remarks.append(f"{int((~coloured).sum())} of its {len(table)} vertices have no colour: they are white")
    return table[:, :3], linear_colours(np.where(coloured[:, None], table[:, 3:6], np.nan), None, remarks)


def _places(rows: _Rows) -> Doubles:
    """Texture coordinates (n, 2) with v down; v is 0 in a file that gives u alone."""
    table = rows.table(2)
    lone = np.isnan(table[:, 1])
    return np.stack([table[:, 0], 1 - np.where(lone, 0.0, table[:, 1])], axis=1)


def _parts(path: Path, said: _Statements, faces: _Faces, pictures: MeshPictures, remarks: list[str]) -> list[MeshPart]:
    library = _libraries(path, said.libraries, remarks)
    parts: list[MeshPart] = []
    notes: dict[str, list[str]] = {}
    order = np.argsort(faces.materials, kind="stable")
    bounds = np.searchsorted(faces.materials[order], np.arange(len(said.names) + 1))
    for name, number in said.names.items():
        chosen = order[bounds[number] : bounds[number + 1]]
        material = library.get(name) or library.get(uncommented(name).rstrip())
        if not len(chosen):
            continue
        if material is None:
            if name and (library or not said.libraries):
                notes.setdefault("is in no library: it is light grey", []).append(name)
            parts.append(_part(faces, chosen))
            continue
        for note in dict.fromkeys(material.notes):
            notes.setdefault(note, []).append(name)
        parts.extend(_painted(faces, chosen, name, material, pictures, notes))
    for note, names in notes.items():
        more = f" (as {len(names) - 1} more)" if len(names) > 1 else ""
        remarks.append(f"its material {shown(names[0])}{more} {note}")
    return parts


def _painted(
    faces: _Faces,
    chosen: Indices,
    name: str,
    material: ObjMaterial,
    pictures: MeshPictures,
    notes: dict[str, list[str]],
) -> list[MeshPart]:
    """The parts of one material: with its texture where there are texture coordinates, elsewhere with its colour."""
    if material.texture is None:
        return [_part(faces, chosen, material)]
    texture = pictures.read(material.library.parent, material.texture, material.library)
    bare = (faces.corners[chosen, :, 1] == _NONE).any(axis=1)
    parts = []
    if bare.any():
        notes.setdefault("has a texture, but triangles without texture coordinates: they show none", []).append(name)
        parts.append(_part(faces, chosen[bare], material))
    if not bare.all():
        parts.append(_part(faces, chosen[~bare], material, texture))
    return parts


def _part(
    faces: _Faces, chosen: Indices, material: ObjMaterial | None = None, texture: Singles | None = None
) -> MeshPart:
    """The triangles `chosen`. A texture replaces the colour of its material, as most programs that write OBJ expect."""
    corners = faces.corners[chosen]
    used, own = np.unique(corners[..., 0], return_inverse=True)
    uv = None
    if not (corners[..., 1] == _NONE).any():
        uv = faces.places[corners[..., 1]]
        if material is not None and texture is not None:
            # MTL counts v upwards.
            uv = (uv * (1, -1) + (0, 1)) * material.scale + material.offset
            uv = uv * (1, -1) + (0, 1)
    clamp = material is not None and material.clamp
    return MeshPart(
        vertices=faces.points[used],
        faces=own.reshape(-1, 3),
        uv=uv,
        colours=None if faces.colours is None else faces.colours[corners[..., 0]],
        factor=None if material is None or texture is not None else material.colour,
        texture=texture,
        wrap=("clamp", "clamp") if clamp else ("repeat", "repeat"),
    )


def _libraries(path: Path, named: list[str], remarks: list[str]) -> dict[str, ObjMaterial]:
    """The materials of all libraries that are there; of two with the same name the first counts."""
    materials: dict[str, ObjMaterial] = {}
    for rest in dict.fromkeys(named):
        choices = [names for names in library_names(rest) if names]
        found = [[(name, find_named(path.parent, name)) for name in names] for names in choices]
        best = next((pairs for pairs in found if all(place for _, place in pairs)), found[-1] if found else [])
        for name, place in best:
            if place is None:
                remarks.append(f"its material library {shown(name)} is missing: what has its materials is light grey")
                continue
            for material, content in read_library(place).items():
                materials.setdefault(material, content)
                materials.setdefault(uncommented(material).rstrip(), content)
    return materials
