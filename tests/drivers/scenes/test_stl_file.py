"""STL, text and binary, as programs of all kinds write it."""

import struct
from pathlib import Path

import pytest

from read_parts import area, corners, read, read_whole
from slopegate.drivers.files.errors import SceneError

TRIANGLES = [((0, 0, 0), (1, 0, 0), (1, 1, 0)), ((0, 0, 0), (1, 1, 0), (0, 1, 0))]


def text(name: str = "", triangles: list[tuple[tuple[int, int, int], ...]] = TRIANGLES) -> str:
    facets = "".join(
        " facet normal 0 0 1\n  outer loop\n"
        + "".join(f"   vertex {x} {y}.0e0 {z}\n" for x, y, z in corners)
        + "  endloop\n endfacet\n"
        for corners in triangles
    )
    return f"solid {name}\n{facets}endsolid {name}\n"


def binary(head: bytes = b"", count: int = 2, attribute: int = 0) -> bytes:
    rows = b"".join(struct.pack("<12fH", 0, 0, 1, *sum(corners, ()), attribute) for corners in TRIANGLES)
    return head.ljust(80, b" ") + struct.pack("<I", count) + rows


def stl(folder: Path, content: str | bytes) -> Path:
    path = folder / "thing.stl"
    path.write_bytes(content.encode("latin-1") if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    "content",
    [
        text(),
        text("Stück"),
        text().replace("\n", "\r\n"),
        text().replace("\n", "\r").upper(),
        "  \n" + text(),
        text("one", TRIANGLES[:1]) + text("empty", []) + text("two", TRIANGLES[1:]),
        text("", [((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))]),
        binary(),
        binary(b"solid by some program, facet by facet"),
    ],
)
def test_the_same_square_however_it_is_written(tmp_path: Path, content: str | bytes) -> None:
    (mesh,) = read_whole(stl(tmp_path, content))
    assert area(mesh) == pytest.approx(1)
    assert corners(mesh).max() == 1
    assert len(mesh.vertices) == 4


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (binary(attribute=0x83E0), "colours in its header or attribute bytes are left out"),
        (binary(b"COLOR=\x01\x02\x03\x04"), "colours in its header or attribute bytes are left out"),
        (binary(count=1), "its header says 1 triangles: the 50 bytes that follow them are left out"),
        (binary() + b"abc", "the 3 bytes that follow them are left out"),
    ],
)
def test_what_is_left_out_is_remarked(tmp_path: Path, content: bytes, words: str) -> None:
    _, remarks = read(stl(tmp_path, content))
    assert len(remarks) == 1
    assert words in remarks[0]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (binary(count=3), "is cut short: its header says 3 triangles, and 2 are there"),
        (binary(count=4_000_000_000), "is cut short: its header says 4000000000 triangles"),
        (binary()[:100], "is cut short: its header says 2 triangles, and 0 are there"),
        (binary()[:50], "is no STL file"),
        (binary(count=0)[:84], "holds no triangle"),
        ("solid\nendsolid\n", "holds no triangle"),
        (text()[:-60], "is cut short or damaged: 2 facets begin, and 1 are whole"),
        (text().replace("vertex 1 0.0e0 0", "vertex 1 0.0e0"), "it must have three vertices"),
        (text().replace("vertex 1 0.0e0 0", "corner 1 0.0e0 0"), "it must have three vertices"),
        (text().replace("   vertex 1 0.0e0 0\n", ""), "it must have three vertices"),
        (text().replace("vertex 1 0.0e0 0", "vertex 1 0,5 0"), "holds more than numbers"),
        (text().replace("vertex 1 0.0e0 0", "vertex 1 nan 0"), "not finite"),
    ],
)
def test_damage_is_one_sentence(tmp_path: Path, content: str | bytes, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        read(stl(tmp_path, content))
    assert words in str(caught.value)
