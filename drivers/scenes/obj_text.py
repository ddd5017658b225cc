"""Wavefront OBJ text made plain before a general loader sees it.

Loaders disagree on relative indices, on polygons and on mistakes: trimesh 5.2 drops walls of a file that mixes absolute
and relative quads, without a word. Here every face becomes triangles with absolute, checked indices.
"""

from __future__ import annotations

from pathlib import Path

from slopegate.drivers.files.errors import SceneError

_KEPT = {"v", "vt", "usemtl", "mtllib", "o", "g"}


def triangulated(path: Path, data: bytes) -> bytes:
    """The same vertices, texture coordinates and materials, with faces as triangles `f v/vt v/vt v/vt`, no normals.

    Polygons are cut as fans from their first corner. Raises SceneError naming the line of an index that is no whole
    number, is 0 or lies outside what has been read, of a face of fewer than 3 corners, and a texture that is missing.
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
    if not library.is_file():
        return
    for line in library.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split()
        if len(words) > 1 and words[0].lower() == "map_kd":
            texture = library.parent / line.strip()[len("map_kd") :].strip()
            if not texture.is_file():
                raise SceneError(f"{texture} is missing: {library} names it as a texture")
