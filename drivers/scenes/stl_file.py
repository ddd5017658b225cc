"""Reads STL files, binary and text, as one part; a format without colours and without units."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from slopegate.core.rig.arrays import Doubles, Indices
from slopegate.core.rig.checks import shown
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.mesh_parts import MeshFile, MeshPart, check_triangles
from slopegate.drivers.scenes.polygons import cut, guessed

_HEAD, _FACET = 84, 50
_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_LOOP = re.compile(rb"\bouter\s+loop\b(.*?)\bendloop\b", re.DOTALL | re.IGNORECASE)
_FACET_START = re.compile(rb"\bfacet\s+normal\b", re.IGNORECASE)
_CHUNK = 50_000


def read_stl(path: Path, data: bytes) -> MeshFile:
    """The triangles of an STL file. Raises SceneError.

    Whether it is binary is told by its length, since headers of binary files may begin with "solid" too.
    """
    promised = int.from_bytes(data[80:_HEAD], "little") if len(data) >= _HEAD else 0
    text = data.lstrip()[:5].lower() == b"solid" and (len(data) < _HEAD or b"facet" in data[:100_000].lower())
    if text and len(data) != _HEAD + promised * _FACET:
        return _text(path, data)
    if len(data) < _HEAD:
        raise SceneError(f"{path} is no STL file: it is neither text that begins with 'solid' nor a binary header")
    return _binary(path, data, promised)


def _binary(path: Path, data: bytes, promised: int) -> MeshFile:
    there = (len(data) - _HEAD) // _FACET
    if promised > there:
        raise SceneError(f"{path} is cut short: its header says {promised} triangles, and {there} are there")
    check_triangles(path, promised)
    remarks = []
    if len(data) > _HEAD + promised * _FACET:
        beyond = len(data) - _HEAD - promised * _FACET
        remarks.append(f"its header says {promised} triangles: the {beyond} bytes that follow them are left out")
    rows = np.frombuffer(data, _ROW, promised, _HEAD)
    if promised == 0:
        raise SceneError(f"{path} holds no triangle: a mesh needs at least one")
    if rows["attribute"].any() or b"COLOR=" in data[:80]:
        remarks.append("colours in its header or attribute bytes are left out, since programs differ in their meaning")
    with np.errstate(invalid="ignore"):  # numpy warns of some that are no numbers
        points = rows["corners"].reshape(-1, 3).astype(np.float64)
    return _file(points, np.arange(3 * promised).reshape(-1, 3), remarks)


def _text(path: Path, data: bytes) -> MeshFile:
    facets = len(_FACET_START.findall(data))
    check_triangles(path, facets)
    chunks: list[Doubles] = []
    sizes: list[int] = []
    words: list[bytes] = []
    for loop in _LOOP.finditer(data):
        found = loop[1].split()
        if len(found) % 4 or any(word.lower() != b"vertex" for word in found[::4]) or len(found) < 12:
            raise SceneError(
                f"{path} has a facet {len(sizes) + 1} with {shown(loop[1][:200].decode('latin-1').strip())}: it must "
                "have three vertices"
            )
        sizes.append(len(found) // 4)
        words += found
        if len(sizes) % _CHUNK == 0:
            chunks.append(_numbers(path, words))
            words.clear()
    chunks.append(_numbers(path, words))
    if len(sizes) != facets:
        raise SceneError(f"{path} is cut short or damaged: {facets} facets begin, and {len(sizes)} are whole")
    if not sizes:
        raise SceneError(f"{path} holds no triangle: a mesh needs at least one")
    points = np.concatenate(chunks)
    triangles, _, crossing = cut(str(path), points, np.arange(len(points)), np.array(sizes))
    check_triangles(path, len(triangles))
    return _file(points, triangles, guessed(crossing))


def _numbers(path: Path, words: list[bytes]) -> Doubles:
    try:
        return np.array([float(word) for k, word in enumerate(words) if k % 4], np.float64).reshape(-1, 3)
    except ValueError as error:
        raise SceneError(f"{path} has a vertex that holds more than numbers") from error


def _file(points: Doubles, triangles: Indices, remarks: list[str]) -> MeshFile:
    return MeshFile((MeshPart(points, triangles),), tuple(remarks))
