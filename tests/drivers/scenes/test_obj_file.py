"""OBJ and MTL as programs of all kinds write them: each is read whole, or says by name what is left out."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from read_parts import area, colour_at, corners, read, read_whole
from slopegate.drivers.files.errors import SceneError

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
PLACES = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"
CENTRE = (0.5, 0.4, 0.0)


def obj(folder: Path, text: str | bytes, library: str | bytes | None = None, name: str = "thing") -> Path:
    for suffix, content in ((".obj", text), (".mtl", library)):
        if content is not None:
            (folder / f"{name}{suffix}").write_bytes(content.encode() if isinstance(content, str) else content)
    return folder / f"{name}.obj"


def flag(path: Path) -> None:
    """Red, green above blue, white, in two by two texels."""
    cv2.imwrite(str(path), np.array([[[0, 0, 255], [0, 255, 0]], [[255, 0, 0], [255, 255, 255]]], np.uint8))


@pytest.mark.parametrize("blank", [" ", "\t", "  \t "])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", " \\\n \n"])
def test_tabs_and_every_end_of_line(tmp_path: Path, blank: str, end: str) -> None:
    text = (QUAD + "f 1 2 3 4\n" + QUAD.replace(" 0\n", " 2\n") + "f -4 -3 -2 -1\n").replace(" ", blank)
    path = obj(tmp_path, f"mtllib{blank}thing.mtl{end}usemtl{blank}red{end}" + text.replace("\n", end), None)
    (tmp_path / "thing.mtl").write_bytes(f"newmtl{blank}red{end}{blank}Kd{blank}0.8 0.05 0.05{end}".encode())
    (mesh,) = read_whole(path)
    assert mesh.albedo == pytest.approx((0.8, 0.05, 0.05))
    assert sorted(set(corners(mesh)[..., 2].ravel())) == [0, 2]
    assert area(mesh) == pytest.approx(2)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32", "latin-1"])
@pytest.mark.parametrize("other", ["utf-8", "utf-16", "latin-1"])
def test_encodings_of_file_and_library_need_not_agree(tmp_path: Path, encoding: str, other: str) -> None:
    text = "# Stühle\nmtllib thing.mtl\n" + QUAD + "usemtl Rücken\nf 1 2 3 4\n"
    path = obj(tmp_path, text.encode(encoding), "# Möbel\nnewmtl Rücken\nKd 0.8 0.05 0.05\n".encode(other))
    assert read_whole(path)[0].albedo == pytest.approx((0.8, 0.05, 0.05))


@pytest.mark.parametrize(
    ("used", "defined"),
    [("Wood#1", "Wood#1"), ("a b", "a b"), ("a", "a # comment"), ("a # comment", "a"), ("a #1", "a #1")],
)
def test_names_with_number_signs_and_blanks(tmp_path: Path, used: str, defined: str) -> None:
    path = obj(tmp_path, f"mtllib thing.mtl\n{QUAD}usemtl {used}\nf 1 2 3 4 # four\n", f"newmtl {defined}\nKd 1 0 0\n")
    assert read_whole(path)[0].albedo == (1, 0, 0)


@pytest.mark.parametrize(
    "lines", ["mtllib a.mtl b c.mtl", "mtllib a.mtl\nmtllib b c.mtl", "mtllib B C.MTL\nmtllib .\\a.mtl"]
)
def test_several_libraries_and_names_with_blanks(tmp_path: Path, lines: str) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "b c.mtl").write_text("newmtl green\nKd 0 1 0\nnewmtl red\nKd 0 0 1\n")
    path = obj(tmp_path, lines + "\n" + QUAD + "usemtl red\nf 1 2 3\nusemtl green\nf 1 3 4\n")
    meshes = read_whole(path)
    assert colour_at(meshes, (0.9, 0.1, 0)) in ([1, 0, 0], [0, 0, 1])
    assert colour_at(meshes, (0.1, 0.9, 0)) == [0, 1, 0]


def test_materials_that_are_nowhere_are_remarked(tmp_path: Path) -> None:
    text = QUAD + "usemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n"
    (first, second), remarks = read(obj(tmp_path, "mtllib thing.mtl\n" + text, "newmtl green\nKd 0 1 0\n"))
    assert first.albedo == second.albedo == (0.8, 0.8, 0.8)
    assert remarks == ("its material 'red' (as 1 more) is in no library: it is light grey",)
    assert read(obj(tmp_path, text))[1] == remarks
    _, remarks = read(obj(tmp_path, "mtllib gone.mtl thing.mtl\n" + text.replace("blue", "green")))
    assert [remark for remark in remarks if "library 'gone.mtl' is missing" in remark]


@pytest.mark.parametrize(
    ("options", "place", "wanted"),
    [
        ("", (0.25, 0.75), [1, 0, 0]),
        ("-s 1 1 1", (0.25, 0.75), [1, 0, 0]),
        ("-blendu on -texres 256 -clamp off -mm 0 1", (0.25, 0.75), [1, 0, 0]),
        ("-s 2", (0.375, 0.75), [0, 1, 0]),
        ("-s 2 2 1", (0.125, 0.875), [1, 0, 0]),
        ("-s 2 2", (0.375, 0.875), [0, 1, 0]),
        ("-o 0.5", (0.25, 0.75), [0, 1, 0]),
        ("-o 0.5 0.5 0", (0.25, 0.75), [1, 1, 1]),
        ("-o 1 -clamp on", (0.25, 0.75), [0, 1, 0]),
        ("-o 1", (0.25, 0.75), [1, 0, 0]),
    ],
)
def test_options_of_maps_are_honoured(
    tmp_path: Path, options: str, place: tuple[float, float], wanted: list[float]
) -> None:
    flag(tmp_path / "my flag.png")
    library = f"newmtl m\nmap_Kd {options} my flag.png\n"
    meshes = read_whole(obj(tmp_path, "mtllib thing.mtl\n" + QUAD + PLACES + "usemtl m\n" + FACE, library))
    assert colour_at(meshes, (*place, 0.0)) == wanted


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("map_Kd -mm 0.2 0.5 flag.png", "-mm 0.2 0.5"),
        ("map_Kd -t 1 1 1 flag.png", "-t 1 1 1"),
        ("map_Bump -bm 0.2 bump.png", "has a map_bump, which is left out"),
        ("map_d flag.png", "has a map_d: what it cuts out is shown whole"),
        ("d 0.3", "lets light through"),
        ("Tr 0.7", "lets light through"),
        ("d 1\nTr 1", ""),
        ("Tr 0", ""),
        ("Ke 1 1 1", "shines by itself"),
        ("Ke 0 0 0\nKs 1 1 1\nNs 9\nillum 2\nNi 1.4", ""),
        ("Kd 1.5 0 0", "colours outside 0..1"),
        ("Kd 0.5", ""),
        ("Kd spectral red.rfl 1", "has no red, green and blue as colour"),
    ],
)
def test_what_a_material_asks_for_beyond_colour_and_texture_is_remarked(tmp_path: Path, line: str, words: str) -> None:
    flag(tmp_path / "flag.png")
    _, remarks = read(obj(tmp_path, "mtllib thing.mtl\n" + QUAD + PLACES + "usemtl m\n" + FACE, f"newmtl m\n{line}\n"))
    assert bool(remarks) == bool(words)
    assert words in "; ".join(remarks)


@pytest.mark.parametrize("name", ["maps\\Flag.PNG", "./maps/flag.png", '"maps/flag.png"', "maps/flag.png "])
def test_textures_are_found_by_names_from_other_systems(tmp_path: Path, name: str) -> None:
    (tmp_path / "maps").mkdir()
    flag(tmp_path / "maps" / "flag.png")
    text = "mtllib thing.mtl\n" + QUAD + PLACES + "usemtl m\n" + FACE
    assert colour_at(read_whole(obj(tmp_path, text, f"newmtl m\nmap_Kd {name}\n")), (0.2, 0.8, 0)) == [1, 0, 0]


def test_a_texture_of_another_computer_is_taken_from_beside_and_remarked(tmp_path: Path) -> None:
    flag(tmp_path / "flag.png")
    text = "mtllib thing.mtl\n" + QUAD + PLACES + "usemtl m\n" + FACE
    meshes, remarks = read(obj(tmp_path, text, "newmtl m\nmap_Kd C:\\work\\flag.png\n"))
    assert colour_at(meshes, (0.2, 0.8, 0)) == [1, 0, 0]
    assert len(remarks) == 1
    assert "flag.png is taken instead" in remarks[0]
    with pytest.raises(SceneError, match=r"other.png is missing: .*thing.mtl names it as a texture"):
        read(obj(tmp_path, text, "newmtl m\nmap_Kd other.png\nnewmtl n\nmap_Kd unused.png\n"))


def test_sixteen_bits_of_grey_are_a_ramp(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "ramp.png"), np.arange(0, 65536, 256, dtype=np.uint16).reshape(-1, 1))
    text = "mtllib thing.mtl\n" + QUAD + PLACES + "usemtl m\n" + FACE
    meshes = read_whole(obj(tmp_path, text, "newmtl m\nmap_Kd ramp.png\n"))
    top, middle, bottom = (colour_at(meshes, (0.5, y, 0))[0] for y in (0.999, 0.5, 0.001))
    assert (top, middle, bottom) == pytest.approx((0, 0.214, 1), abs=0.02)


RING = "".join(f"v {x} {y} 0\n" for x, y in ((0, 0), (3, 0), (3, 3), (0, 3), (1, 1), (2, 1), (2, 2), (1, 2)))


@pytest.mark.parametrize(
    ("points", "wanted"),
    [
        ("0 1 0, 0 0 0, 1 0 0, 1 .3 0, .3 .3 0, .3 1 0", 0.51),
        ("0 0 0, 1 0 0, 1 1 0, .8 1 0, .8 .2 0, .2 .2 0, .2 1 0, 0 1 0", 0.52),
        ("0 0 0, 2 0 0, .5 .5 0, 0 2 0", 1.0),
        ("2 0 0, .5 .5 0, 0 2 0, 0 0 0", 1.0),
        ("0 0 0, 0 2 0, 0 .5 .5, 0 0 2", 1.0),
        ("0 0 0, 1 0 0, 2 0 0, 2 1 0, 1 1 0, 0 1 0", 2.0),
        ("0 0 0, 0 0 0, 1 0 0, 1 1 0, 0 1 0", 1.0),
    ],
)
@pytest.mark.parametrize("start", range(4))
def test_polygons_cover_their_area_whatever_their_shape(tmp_path: Path, points: str, wanted: float, start: int) -> None:
    each = points.split(", ")
    turned = [*each[start:], *each[:start]]
    text = "".join(f"v {point}\n" for point in turned) + "f " + " ".join(str(k + 1) for k in range(len(each)))
    assert area(*read_whole(obj(tmp_path, text))) == pytest.approx(wanted)
    text = text.rsplit("f ", 1)[0] + "f " + " ".join(str(k) for k in range(len(each), 0, -1))
    assert area(*read_whole(obj(tmp_path, text))) == pytest.approx(wanted)


def test_a_ring_keeps_its_hole(tmp_path: Path) -> None:
    meshes = read_whole(obj(tmp_path, RING + "f 1 2 3 4 1 5 8 7 6 5\n"))
    assert area(*meshes) == pytest.approx(8)
    with pytest.raises(AssertionError, match="nothing is at"):
        colour_at(meshes, (1.5, 1.5, 0))


def test_polygons_that_cross_themselves_are_remarked(tmp_path: Path) -> None:
    eight = "v 0 0 0\nv 2 2 0\nv 2 1 0\nv 2 0 0\nv 0 2 0\nv 0 1.5 0\n"
    _, remarks = read(obj(tmp_path, eight + "f 1 2 3 4 5 6\n"))
    assert remarks == ("1 of its polygons cross themselves or are far from flat: what they cover is a guess",)
    assert read(obj(tmp_path, QUAD + "f 1 2 4 3\n"))[1] == remarks


def test_polygons_of_very_many_corners(tmp_path: Path) -> None:
    angle = np.linspace(0, 2 * np.pi, 30_001)[:-1]
    for radius, refused in ((np.ones_like(angle), False), (1 + 0.5 * np.cos(3 * angle), True)):
        places = np.stack([np.cos(angle) * radius, np.sin(angle) * radius], axis=1)
        text = "".join(f"v {x:.9f} {y:.9f} 0\n" for x, y in places)
        path = obj(tmp_path, text + "f " + " ".join(str(k + 1) for k in range(len(angle))))
        if refused:
            with pytest.raises(SceneError, match=r"1 polygons of 30000 corners that are not convex: .*at most 20000"):
                read(path)
        else:
            assert area(*read_whole(path)) == pytest.approx(np.pi, rel=1e-6)


def test_colours_of_vertices_are_srgb_and_vary_over_a_face(tmp_path: Path) -> None:
    points = [f"v {x} {y} 0 {c} 0 0" for x, y, c in ((0, 0, 0), (1, 0, 1), (1, 1, 1), (0, 1, 0))]
    meshes = read_whole(obj(tmp_path, "\n".join(points) + "\nf 1 2 3 4\n"))
    for x in (0.05, 0.3, 0.5, 0.95):
        assert colour_at(meshes, (x, 0.5, 0)) == pytest.approx([x, 0, 0], abs=0.04)
    grey = "v 0 0 0 .5 .5 .5\nv 1 0 0 .5 .5 .5\nv 1 1 0 .5 .5 .5\nf 1 2 3\n"
    assert read_whole(obj(tmp_path, grey))[0].albedo == pytest.approx((0.214,) * 3, abs=1e-3)
    assert read_whole(obj(tmp_path, grey.replace(".5", "255")))[0].albedo == (1, 1, 1)
    assert "outside 0..1" in read(obj(tmp_path, grey.replace(".5", "1.5")))[1][0]
    assert "1 of its 3 vertices have no colour" in read(obj(tmp_path, grey.replace(" .5 .5 .5", "", 1)))[1][0]


def test_colours_multiply_a_texture(tmp_path: Path) -> None:
    flag(tmp_path / "flag.png")
    points = "".join(f"v {x} {y} 0 {c} {c} {c}\n" for x, y, c in ((0, 0, 1), (1, 0, 1), (1, 1, 0), (0, 1, 1)))
    text = "mtllib thing.mtl\n" + points + PLACES + "usemtl m\n" + FACE
    meshes = read_whole(obj(tmp_path, text, "newmtl m\nKd 0.1 0.1 0.1\nmap_Kd flag.png\n"))
    assert colour_at(meshes, (0.02, 0.98, 0)) == pytest.approx([1, 0, 0], abs=0.1)
    assert colour_at(meshes, (0.75, 0.25, 0)) == pytest.approx([0.75] * 3, abs=0.1)
    assert colour_at(meshes, (0.97, 0.97, 0)) == pytest.approx([0, 0.03, 0], abs=0.05)


def test_faces_may_name_vertices_that_come_later_and_mix_their_forms(tmp_path: Path) -> None:
    text = "vt 0 0\nf 1 2/1 3//1\nf 1/1/1 3/1 4\n" + QUAD + "vn 0 0 1\n"
    assert area(*read_whole(obj(tmp_path, text))) == pytest.approx(1)
    with pytest.raises(SceneError, match=r"line 5 has a face with index '5': it must be within 1..4, the vertices"):
        read(obj(tmp_path, QUAD + "f 1 2 5\n"))


def test_texture_coordinates_without_a_texture_change_nothing(tmp_path: Path) -> None:
    bare = read_whole(obj(tmp_path, QUAD + "f 1 2 3 4\n"))
    (mesh,) = read_whole(obj(tmp_path, QUAD + PLACES + FACE))
    assert mesh.albedo == bare[0].albedo == (0.8, 0.8, 0.8)
    assert mesh.texture is None


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("l 1 2\nl 2 3\np 1", "2 lines are left out; 1 points are left out"),
        ("cstype bezier\ndeg 1\ncurv 0 1 1 2\nparm u 0 1\nend", "1 free-form curves are left out"),
        ("surf 0 1 0 1 1 2 3 4", "1 free-form surfaces are left out"),
        ("call other.obj", "1 calls of other files are left out"),
        ("facet 1 2 3", "line 6 begins with 'facet', which OBJ does not know"),
        ("v 0 0 0 0.5", "the weights of its vertices"),
        ("g a\no b\ns 1\nvn 0 0 1\nvp 0", ""),
    ],
)
def test_what_is_no_polygon_is_remarked_by_name(tmp_path: Path, lines: str, words: str) -> None:
    assert "; ".join(read(obj(tmp_path, QUAD + "f 1 2 3\n" + lines + "\n"))[1]).startswith(words)


def test_a_file_without_faces_says_what_it_holds(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"holds no triangle \(only lines, free-form surfaces\)"):
        read(obj(tmp_path, QUAD + "l 1 2\nsurf 0 1 0 1 1 2 3 4\n"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("v 0 0 0\nv 1 0\n", "line 2 has a vertex '1 0': it must have three coordinates"),
        ("v 0,5 0 0\n", "line 1 has a vertex '0,5 0 0'"),
        ("v 0 0 0 1 1\n", "line 1 has a vertex"),
        ("v 0 0 0\nvt\n", "line 2 has a texture coordinate ''"),
        ("v 0 0 0\nf 1 1/x 1\n", "line 2 has a face with index 'x': it must be a whole number"),
        ("v 0 0 0\nf 1 1 99999999999999999999999\n", "it must be a whole number"),
    ],
)
def test_damaged_lines_are_refused_with_their_number(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        read(obj(tmp_path, text if "f " in text else text + "f 1 1 1\n"))
    assert words in str(caught.value)
