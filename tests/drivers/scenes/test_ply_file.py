"""PLY as programs of all kinds write it: each is read whole, or says by name what is left out."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from read_parts import area, colour_at, corners, read, read_whole
from slopegate.drivers.files.errors import SceneError

XYZ = "property float x\nproperty float y\nproperty float z\n"
LIST = "property list uchar int vertex_indices\n"
SQUARE = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]
FORMS = ("ascii", "binary_little_endian", "binary_big_endian")
_LETTERS = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
}


def ply(folder: Path, form: str, *tables: tuple[str, str, list[str]], comment: str = "made", end: str = "\n") -> Path:
    """A file of elements, each with its name, its properties and its rows as text."""
    head = f"ply\nformat {form} 1.0\ncomment {comment}\n"
    body = b""
    for name, properties, rows in tables:
        head += f"element {name} {len(rows)}\n{properties}"
        kinds = [line.split()[1:-1] for line in properties.splitlines()]
        for row in rows:
            body += f"{row}{end}".encode() if form == "ascii" else packed(form, kinds, row.split())
    path = folder / "thing.ply"
    path.write_bytes((head + "end_header\n").replace("\n", end).encode() + body)
    return path


def packed(form: str, kinds: list[list[str]], words: list[str]) -> bytes:
    order, data = "<" if "little" in form else ">", b""
    for kind in kinds:
        count = 1
        if kind[0] == "list":
            count = int(words[0])
            data += struct.pack(order + _LETTERS[kind[1]], count)
            words = words[1:]
        values: list[Any] = [float(word) if kind[-1] in {"float", "double"} else int(word) for word in words[:count]]
        data += struct.pack(f"{order}{count}{_LETTERS[kind[-1]]}", *values)
        words = words[count:]
    return data


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_triangles_quads_and_concave_polygons_in_one_file(tmp_path: Path, form: str, end: str) -> None:
    points = [*SQUARE, "2 0 0", "2 1 0", "3 0 0", "4 0 0", "4 .3 0", "3.3 .3 0", "3.3 1 0", "3 1 0"]
    for faces in (["4 0 1 2 3", "3 1 4 2", "6 6 7 8 9 10 11"], ["6 6 7 8 9 10 11", "3 1 4 2", "4 0 1 2 3"]):
        path = ply(tmp_path, form, ("vertex", XYZ, points), ("face", LIST, faces), end=end)
        assert area(*read_whole(path)) == pytest.approx(2.01)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("count", "index"), [("uchar", "uint"), ("int", "short"), ("ushort", "float"), ("char", "char")]
)
def test_lists_of_every_type(tmp_path: Path, form: str, count: str, index: str) -> None:
    listed = f"property list {count} {index} vertex_index\n"
    path = ply(tmp_path, form, ("vertex", XYZ, SQUARE), ("face", listed, ["4 0 1 2 3", "3 0 1 2"]))
    assert area(*read_whole(path)) == pytest.approx(1.5)


@pytest.mark.parametrize("form", FORMS)
def test_strips_of_triangles_with_restarts(tmp_path: Path, form: str) -> None:
    points = [*SQUARE, "2 0 0", "2 1 0", "5 0 0", "6 0 0", "5 1 0"]
    strips = ["10 0 3 1 2 4 5 -1 6 7 8", "3 6 7 8"]
    path = ply(tmp_path, form, ("vertex", XYZ, points), ("tristrips", LIST, strips))
    assert area(*read_whole(path)) == pytest.approx(3)
    path = ply(tmp_path, form, ("vertex", XYZ, points), ("face", LIST, []), ("tristrips", LIST, strips[:1]))
    assert area(*read_whole(path)) == pytest.approx(2.5)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("kind", "names", "code", "wanted"),
    [
        ("uchar", "red green blue", "255 0 0", (1, 0, 0)),
        ("uchar", "diffuse_red diffuse_green diffuse_blue", "255 0 0", (1, 0, 0)),
        ("uchar", "r g b", "255 0 0", (1, 0, 0)),
        ("uchar", "Red Green Blue", "255 0 128", (1, 0, 0.2159)),
        ("ushort", "red green blue", "65535 0 32896", (1, 0, 0.2159)),
        ("int", "red green blue", "255 0 128", (1, 0, 0.2159)),
        ("float", "red green blue", "1 0 0.501961", (1, 0, 0.2159)),
        ("float", "red green blue", "255 0 128", (1, 0, 0.2159)),
        ("double", "r g b", "0.5 0.5 0.5", (0.214, 0.214, 0.214)),
    ],
)
def test_colours_of_every_name_and_type(
    tmp_path: Path, form: str, kind: str, names: str, code: str, wanted: tuple[float, ...]
) -> None:
    coloured = "".join(f"property {kind} {name}\n" for name in names.split())
    for vertex, face in ((True, False), (False, True)):
        rows = [f"{place} {code}" if vertex else place for place in SQUARE]
        faces = [f"4 0 1 2 3 {code}" if face else "4 0 1 2 3"]
        path = ply(
            tmp_path,
            form,
            ("vertex", XYZ + coloured * vertex, rows),
            ("face", LIST + coloured * face, faces),
        )
        assert read_whole(path)[0].albedo == pytest.approx(wanted, abs=1e-3)


@pytest.mark.parametrize("form", FORMS)
def test_colours_of_mixed_faces(tmp_path: Path, form: str) -> None:
    coloured = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    points = [*SQUARE, "2 0 0"]
    faces = ["3 1 4 2 255 0 0", "4 0 1 2 3 0 0 255"]
    meshes = read_whole(ply(tmp_path, form, ("vertex", XYZ, points), ("face", LIST + coloured, faces)))
    assert colour_at(meshes, (1.3, 0.2, 0)) == [1, 0, 0]
    assert colour_at(meshes, (0.3, 0.6, 0)) == colour_at(meshes, (0.6, 0.3, 0)) == [0, 0, 1]
    both = [f"{point} 255 0 0" for point in points]
    meshes, remarks = read(ply(tmp_path, form, ("vertex", XYZ + coloured, both), ("face", LIST + coloured, faces)))
    assert meshes[0].albedo == (1, 0, 0)
    assert remarks == ("it has colours of vertices and of faces: those of its faces are left out",)


def test_a_quad_that_crosses_itself_is_seen(tmp_path: Path) -> None:
    coloured = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    faces = ["3 0 1 2 255 0 0", "4 0 2 3 1 0 0 255"]
    meshes, remarks = read(ply(tmp_path, "ascii", ("vertex", XYZ, SQUARE), ("face", LIST + coloured, faces)))
    assert colour_at(meshes, (0.7, 0.4, 0)) == [1, 0, 0]
    assert colour_at(meshes, (0.2, 0.7, 0)) == colour_at(meshes, (0.4, 0.9, 0)) == [0, 0, 1]
    assert "cross themselves" in remarks[0]


def test_colours_above_their_range_and_alpha_are_remarked(tmp_path: Path) -> None:
    coloured = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
    rows = [f"{place} 300 0 0 255" for place in SQUARE]
    meshes, remarks = read(ply(tmp_path, "ascii", ("vertex", XYZ + coloured, rows), ("face", LIST, ["4 0 1 2 3"])))
    assert meshes[0].albedo == (1, 0, 0)
    assert "colours outside 0..1" in remarks[0]
    rows = [f"{place} 255 0 0 {k * 80}" for k, place in enumerate(SQUARE)]
    _, remarks = read(ply(tmp_path, "ascii", ("vertex", XYZ + coloured, rows), ("face", LIST, ["4 0 1 2 3"])))
    assert "alpha" in remarks[0]


def flag(path: Path) -> None:
    cv2.imwrite(str(path), np.array([[[0, 0, 255], [0, 255, 0]], [[255, 0, 0], [255, 255, 255]]], np.uint8))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("names", ["s t", "u v", "texture_u texture_v", "S T"])
@pytest.mark.parametrize("comment", ["TextureFile my flag.png", "texturefile .\\My flag.png"])
def test_textures_by_vertex(tmp_path: Path, form: str, names: str, comment: str) -> None:
    flag(tmp_path / "my flag.png")
    placed = "".join(f"property float {name}\n" for name in names.split())
    rows = [f"{place} {place[:3]}" for place in SQUARE]
    tables = ("vertex", XYZ + placed, rows), ("face", LIST, ["4 0 1 2 3"])
    meshes = read_whole(ply(tmp_path, form, *tables, comment=comment))
    assert colour_at(meshes, (0.2, 0.8, 0)) == [1, 0, 0]
    assert colour_at(meshes, (0.8, 0.8, 0)) == [0, 1, 0]
    (bare,) = read_whole(ply(tmp_path, form, *tables))
    assert (bare.albedo, bare.texture) == ((0.8, 0.8, 0.8), None)


@pytest.mark.parametrize("form", FORMS)
def test_textures_by_wedge_and_number(tmp_path: Path, form: str) -> None:
    flag(tmp_path / "a.png")
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((1, 1, 3), np.uint8))
    wedges = LIST + "property list uchar float texcoord\nproperty int texnumber\n"
    faces = ["4 0 1 2 3 8 0 0 1 0 1 1 0 1 0", "3 4 5 6 6 0 0 1 0 0 1 1", "3 7 8 9 0 0"]
    points = [*SQUARE, "2 0 0", "3 0 0", "2 1 0", "4 0 0", "5 0 0", "4 1 0"]
    path = ply(tmp_path, form, ("vertex", XYZ, points), ("face", wedges, faces), comment="TextureFile a.png")
    path.write_bytes(path.read_bytes().replace(b"a.png\n", b"a.png\ncomment TextureFile b.png\n"))
    meshes, remarks = read(path)
    assert colour_at(meshes, (0.2, 0.8, 0)) == [1, 0, 0]
    assert colour_at(meshes, (2.2, 0.2, 0)) == [0, 0, 0]
    assert colour_at(meshes, (4.2, 0.2, 0)) == [0.8, 0.8, 0.8]
    assert remarks == ("1 of its triangles have no place in its texture: they show none",)


@pytest.mark.parametrize("form", FORMS)
def test_a_missing_texture_is_one_sentence(tmp_path: Path, form: str, capfd: pytest.CaptureFixture[str]) -> None:
    wedges = LIST + "property list uchar float texcoord\n"
    faces = ["4 0 1 2 3 8 0 0 1 0 1 1 0 1"]
    path = ply(tmp_path, form, ("vertex", XYZ, SQUARE), ("face", wedges, faces), comment="TextureFile gone.png")
    with pytest.raises(SceneError, match=r"gone.png is missing: .*thing.ply names it as a texture"):
        read(path)
    assert capfd.readouterr() == ("", "")


def test_colours_multiply_a_texture(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "white.png"), np.full((8, 8, 3), 255, np.uint8))
    more = "property float s\nproperty float t\nproperty float red\nproperty float green\nproperty float blue\n"
    rows = [f"{place} {place[:3]} {place[0]} 0 1" for place in SQUARE]
    path = ply(
        tmp_path, "ascii", ("vertex", XYZ + more, rows), ("face", LIST, ["4 0 1 2 3"]), comment="TextureFile white.png"
    )
    assert colour_at(read_whole(path), (0.5, 0.5, 0)) == pytest.approx([0.5, 0, 1], abs=0.04)


@pytest.mark.parametrize("form", FORMS)
def test_what_is_no_polygon_is_remarked_by_name(tmp_path: Path, form: str) -> None:
    edges = "property int vertex1\nproperty list uchar uchar more\n"
    vertices, faces = ("vertex", XYZ, SQUARE), ("face", LIST, ["4 0 1 2 3", "2 0 1", "0", "1 3"])
    meshes, remarks = read(ply(tmp_path, form, vertices, ("edge", edges, ["0 1 7", "1 0"]), faces))
    assert area(*meshes) == pytest.approx(1)
    assert remarks == (
        "its element 'edge' (2 rows) is left out",
        "3 of its 4 faces have fewer than 3 corners: they are left out",
    )
    path = ply(tmp_path, form, vertices, ("face", LIST, ["4 0 1 2 3"]))
    path.write_bytes(path.read_bytes() + b"9 9 9\n")
    assert read(path)[1] == ("what follows its last element is left out",)


@pytest.mark.parametrize("form", FORMS)
def test_points_alone_are_refused_in_words(tmp_path: Path, form: str) -> None:
    for tables in ([("vertex", XYZ, SQUARE)], [("vertex", XYZ, SQUARE), ("face", LIST, [])]):
        with pytest.raises(SceneError, match="holds 4 points and no faces: a mesh needs triangles or polygons"):
            read(ply(tmp_path, form, *tables))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("element", ["vertex", "face"])
@pytest.mark.parametrize("count", [5, 70_000, 9_000_000, 4_000_000_000, 10**17])
def test_a_header_that_promises_more_than_is_there(tmp_path: Path, form: str, element: str, count: int) -> None:
    path = ply(tmp_path, form, ("vertex", XYZ, SQUARE), ("face", LIST, ["4 0 1 2 3"] * 4))
    path.write_bytes(path.read_bytes().replace(f"element {element} 4".encode(), f"element {element} {count}".encode()))
    with pytest.raises(
        SceneError, match=rf"thing.ply .*{count} rows of '{element}'|has .* as row 5|a face with vertex 67108864"
    ):
        read(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("ply", "plx", "is no PLY file"),
        ("end_header", "", "is no PLY file"),
        ("format ascii 1.0", "format ascii_art 1.0", "a header with 'format ascii_art 1.0'"),
        ("format ascii 1.0\n", "", "a header without a format"),
        ("property float y", "property quad y", "a header with 'property quad y'"),
        ("property float y", "property float x", "names 'x' twice"),
        ("property float z", "property float depth", "has no vertices with x, y and z"),
        ("list uchar", "list float", "a header with 'property list float int"),
        ("element face 1", "element face -1", "a header with 'element face -1'"),
        ("vertex_indices", "corners", "has faces without a list vertex_indices"),
        ("1 1 0", "1 1", "has '1 1' as row 3 of 'vertex': its header promises x, y, z"),
        ("1 1 0", "1 one 0", "holds more than numbers"),
        ("1 1 0", "1 nan 0", "not finite"),
        ("4 0 1 2 3", "4 0 1 2 4", "a face with vertex 4: it must be in 0..3"),
        ("4 0 1 2 3", "4 0 1 2 -1", "a face with vertex -1"),
        ("4 0 1 2 3", "4 0 1 2 0.5", "a face with vertex 0.5"),
        ("4 0 1 2 3", "4 0 1 2 nan", "a face with vertex nan"),
        ("4 0 1 2 3", "-4 0 1 2 3", "as row 1 of 'face'"),
    ],
)
def test_damage_is_one_sentence(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = ply(tmp_path, "ascii", ("vertex", XYZ, SQUARE), ("face", LIST, ["4 0 1 2 3"]))
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(SceneError) as caught:
        read(path)
    assert words in str(caught.value)


def test_lines_that_are_no_header_and_numbers_that_no_header_promises(tmp_path: Path) -> None:
    coloured = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    path = ply(tmp_path, "ascii", ("vertex", XYZ, SQUARE), ("face", LIST + coloured, ["4 0 1 2 3 9 1 1 1 1 1 1"]))
    path.write_text(path.read_text().replace("comment made", "Made by hand"))
    (mesh,), remarks = read(path)
    assert mesh.albedo == (0.8, 0.8, 0.8)
    assert remarks == (
        "its rows of 'face' hold more than its header says: that is left out",
        "its header has a line 'Made by hand', which PLY does not know: it is left out",
    )


def test_a_return_after_the_header_of_a_binary_file(tmp_path: Path) -> None:
    path = ply(tmp_path, FORMS[1], ("vertex", XYZ, SQUARE), ("face", LIST, ["4 0 1 2 3"]))
    path.write_bytes(path.read_bytes().replace(b"end_header\n", b"end_header\r\n"))
    (mesh,) = read_whole(path)
    np.testing.assert_allclose(np.ptp(corners(mesh), axis=(0, 1)), (1, 1, 0))
