import json
import shutil
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from rigs import check_rig
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.render.render import render
from slopegate.core.scene.scene import Mesh, Scene
from slopegate.core.scene.shapes import turn
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes import mesh_files
from slopegate.drivers.scenes.mesh_files import Placement
from slopegate.drivers.scenes.scene_files import SceneError, open_scene
from small_glb import UPRIGHT, SmallGlb

RIG = load_rig(None)
DATA = Path(__file__).parents[4] / "shared" / "data" / "meshes"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the shared meshes are not here")
AS_FILED = Placement((0.0, 0.0, 0.0), up="z", anchor="origin")
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def read_mesh(path: Path, placement: Placement) -> list[Mesh]:
    """The meshes of a file of which nothing is left out."""
    meshes, remarks = mesh_files.read_mesh(path, placement)
    assert remarks == ()
    return meshes


def meshes_of(scene: Scene) -> list[Mesh]:
    return [item for item in scene.objects if isinstance(item, Mesh) and item.name != "backdrop"]


def triangle_soup(meshes: list[Mesh]) -> list[tuple[Any, ...]]:
    """Every triangle by its corners in any order, with its colour."""
    soup = []
    for mesh in meshes:
        for corners in mesh.vertices[mesh.faces].round(6) + 0.0:
            soup.append((*sorted(map(tuple, corners.tolist())), mesh.albedo))
    return sorted(soup)


def obj(folder: Path, text: str) -> Path:
    path = folder / "thing.obj"
    path.write_text(text)
    return path


@needs_data
def test_relative_indices_give_the_same_box_as_absolute_ones() -> None:
    relative = read_mesh(DATA / "cornell_box_relative_indices.obj", AS_FILED)
    absolute = read_mesh(DATA / "cornell_box.obj", AS_FILED)
    corners = np.concatenate([mesh.vertices for mesh in relative])
    np.testing.assert_allclose(corners.max(axis=0) - corners.min(axis=0), (556, 559.2, 548.8))
    assert sum(len(mesh.faces) for mesh in relative) == 36
    # The two files cut the same quads along the same diagonals.
    assert triangle_soup(relative) == triangle_soup(absolute)


@pytest.mark.parametrize(
    "face", ["f 1 2 3 4", "f -4 -3 -2 -1", "f 1 -3 3 -1", "f 1//1 2//1 3//1 4//1", "f 1 2 \\\n 3 4"]
)
def test_a_quad_is_a_quad_however_it_is_written(tmp_path: Path, face: str) -> None:
    (mesh,) = read_mesh(obj(tmp_path, QUAD + "vn 0 0 1\n" + face + "\n"), AS_FILED)
    assert (len(mesh.vertices), len(mesh.faces)) == (4, 2)
    assert mesh.faces.dtype == np.int32


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty (0 bytes)"),
        ("# nothing\n", "cannot be read as a mesh|holds no triangle"),
        (QUAD, "cannot be read as a mesh|holds no triangle"),
        (QUAD + "f 1 2 9\n", "line 5 has a face with index '9': it must be within 1..4"),
        (QUAD + "f 1 2 0\n", "index '0'"),
        (QUAD + "f 1 2 -5\n", "index '-5'"),
        (QUAD + "f 1 2 x\n", "index 'x'"),
        (QUAD + "f 1/1 2/2 3/3\n", "within 1..0, the texture coordinates"),
        (QUAD + "f 1 2\n", "has a face of 2 corners"),
        (QUAD + "f 1 2 2\n", "holds no triangle with an area"),
        (QUAD.replace("v 1 1 0", "v nan 1 0") + "f 1 2 3\n", "not finite|cannot be read as a mesh"),
        (QUAD.replace("v 1 1 0", "v inf 1 0") + "f 1 2 3\n", "not finite|cannot be read as a mesh"),
        (QUAD.replace("v 1 1 0", "v 1 1") + "f 1 2 3\n", "cannot be read as a mesh|three coordinates"),
        (QUAD.replace("v 1 1 0", "v 1e200 1 0") + "f 1 2 3\n", "not finite"),
    ],
)
def test_a_mesh_without_a_surface_is_one_sentence(tmp_path: Path, text: str, words: str) -> None:
    path = obj(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        open_scene(path, RIG)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert any(word in message for word in words.split("|")), message
    assert "\n" not in message


@pytest.mark.parametrize("suffix", ["ply", "stl", "glb", "obj"])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.95])
def test_cut_short_files_are_refused_or_hold_less_but_never_crash(tmp_path: Path, suffix: str, share: float) -> None:
    whole = trimesh.creation.icosphere(subdivisions=2).export(file_type=suffix)
    data = whole.encode() if isinstance(whole, str) else whole
    path = tmp_path / f"cut.{suffix}"
    path.write_bytes(data[: int(len(data) * share)])
    if suffix == "obj":  # text may end after any face; half a word must still be noticed
        path.write_bytes(path.read_bytes() + b"\nf 1 2")
    with pytest.raises(SceneError, match=f"cut.{suffix}"):
        open_scene(path, RIG)


@pytest.mark.parametrize("suffix", ["ply", "stl", "glb", "obj"])
def test_every_format_gives_the_same_sphere_back(tmp_path: Path, suffix: str) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    path = tmp_path / f"ball.{suffix}"
    ball.export(path)
    (mesh,) = read_mesh(path, Placement((1, 2, 3), up="z", scale=0.5))
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - (1, 2, 3), axis=1), 0.5, atol=1e-6)
    assert (len(mesh.vertices), len(mesh.faces)) == (len(ball.vertices), len(ball.faces))


def test_up_and_front_of_a_file_become_up_and_towards_the_rig(tmp_path: Path) -> None:
    path = obj(tmp_path, "v 0 0 0\nv 0 5 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    (y_up,) = read_mesh(path, Placement((0, 0, 0), up="y", anchor="origin"))
    np.testing.assert_allclose(y_up.vertices.min(axis=0), (0, -5, -1))
    (z_up,) = read_mesh(path, Placement((0, 0, 0), up="z", anchor="origin"))
    np.testing.assert_allclose(z_up.vertices.min(axis=0), (0, -1, 0))
    np.testing.assert_allclose(z_up.vertices.max(axis=0), (1, 0, 5))


def test_anchor_scale_and_fit_put_a_mesh_where_they_say(tmp_path: Path) -> None:
    path = obj(tmp_path, "v 0 0 0\nv 2 0 0\nv 0 4 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\n")
    (based,) = read_mesh(path, Placement((1, 1, 1), anchor="base", fit_height_m=0.4))
    assert np.ptp(based.vertices[:, 1]) == pytest.approx(0.4)
    assert based.vertices[:, 1].max() == pytest.approx(1)
    assert based.vertices[:, 0].mean() == pytest.approx(0.95)
    (turned,) = read_mesh(path, Placement((0, 0, 0), rotation=turn(roll_deg=90), fit_height_m=0.4))
    np.testing.assert_allclose(turned.vertices.max(axis=0) + turned.vertices.min(axis=0), 0, atol=1e-12)
    assert np.ptp(turned.vertices[:, 1]) == pytest.approx(0.4)


def test_a_mesh_opened_by_itself_stands_before_a_wall(tmp_path: Path) -> None:
    rig, scene = open_scene(obj(tmp_path, QUAD + "f 1 2 3 4\n"), RIG)
    assert rig is RIG
    mesh, wall = scene.objects
    assert isinstance(mesh, Mesh)
    assert isinstance(wall, Mesh)
    assert np.ptp(mesh.vertices[:, 1]) == pytest.approx(0.35)
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), (0, 0, 1.05), atol=1e-12)
    np.testing.assert_allclose(wall.vertices[:, 2], 1.6)


def test_wide_flat_and_lying_meshes_still_fit(tmp_path: Path) -> None:
    floor = obj(tmp_path, "v 0 0 0\nv 9 0 0\nv 9 0 3\nv 0 0 3\nf 1 2 3 4\n")
    (mesh,) = meshes_of(open_scene(floor, RIG)[1])
    assert np.ptp(mesh.vertices, axis=0).max() == pytest.approx(0.7)
    with pytest.raises(SceneError, match="flat and has no height"):
        read_mesh(floor, Placement((0, 0, 1), fit_height_m=0.2))


def checker(path: Path) -> None:
    cv2.imwrite(str(path), np.array([[[0, 0, 255], [0, 255, 0]], [[255, 0, 0], [255, 255, 255]]], np.uint8))


def colour_at(mesh: Mesh, vertex: Any) -> list[float]:
    """What the renderer finds just inside the mesh's corner that lies at `vertex`."""
    assert mesh.uv is not None
    assert mesh.texture is not None
    u, v = mesh.uv[np.argmin(np.linalg.norm(mesh.vertices - vertex, axis=1))] * 0.98 + 0.01
    height, width = mesh.texture.shape[:2]
    return [float(value) for value in mesh.texture[int(v * height), int(u * width)]]


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_textures_stand_upright_whatever_the_files_v_axis(tmp_path: Path, suffix: str) -> None:
    checker(tmp_path / "flag.png")
    (tmp_path / "thing.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd flag.png\n")
    places = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    path = obj(tmp_path, "mtllib thing.mtl\n" + QUAD + places + "usemtl m\nf 1/1 2/2 3/3 4/4\n")
    if suffix == "glb":
        trimesh.load_scene(path).export(tmp_path / "thing.glb")
        path = tmp_path / "thing.glb"
    (mesh,) = read_mesh(path, Placement((0, 0, 0), anchor="origin"))
    # World y is down, so the file's top left (0, 1) is at y = -1.
    assert colour_at(mesh, (0, -1, 0)) == [1, 0, 0]
    assert colour_at(mesh, (1, -1, 0)) == [0, 1, 0]
    assert colour_at(mesh, (0, 0, 0)) == [0, 0, 1]


def test_a_texture_that_repeats_is_tiled(tmp_path: Path) -> None:
    checker(tmp_path / "flag.png")
    (tmp_path / "thing.mtl").write_text("newmtl m\nmap_Kd flag.png\n")
    places = "vt 1 1\nvt 3 1\nvt 3 2\nvt 1 2\n"
    path = obj(tmp_path, "mtllib thing.mtl\n" + QUAD + places + "usemtl m\nf 1/1 2/2 3/3 4/4\n")
    (mesh,) = read_mesh(path, Placement((0, 0, 0), anchor="origin"))
    assert mesh.texture is not None
    assert mesh.uv is not None
    assert mesh.texture.shape == (2, 4, 3)
    assert (mesh.uv.min(), mesh.uv.max()) == (0, 1)
    assert colour_at(mesh, (0, -1, 0)) == [1, 0, 0]


def test_materials_without_a_texture_give_linear_colours_and_a_missing_library_grey(tmp_path: Path) -> None:
    path = obj(tmp_path, "mtllib thing.mtl\n" + QUAD + "usemtl m\nf 1 2 3 4\n")
    (mesh,), (remark,) = mesh_files.read_mesh(path, AS_FILED)
    assert mesh.albedo == (0.8, 0.8, 0.8)
    assert remark == f"{path}: its material library 'thing.mtl' is missing: what has its materials is light grey"
    (tmp_path / "thing.mtl").write_text("newmtl m\nKd 1 0.2 0\n")
    assert read_mesh(path, AS_FILED)[0].albedo == pytest.approx((1, 0.2, 0), abs=1e-6)
    (tmp_path / "thing.mtl").write_text("newmtl m\nmap_Kd gone.png\n")
    with pytest.raises(SceneError, match=r"gone.png is missing: .*thing.mtl names it"):
        read_mesh(path, AS_FILED)


def test_vertex_colours_colour_their_faces(tmp_path: Path) -> None:
    colours = np.array([[255, 0, 0, 255]] * 3 + [[0, 0, 255, 255]] * 3, np.uint8)
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0], [4, 0, 0], [3, 1, 0]]
    part = trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5]], vertex_colors=colours, process=False)
    part.export(tmp_path / "c.ply")
    (mesh,) = read_mesh(tmp_path / "c.ply", Placement((0, 0, 0), anchor="origin"))
    assert colour_at(mesh, (0, 0, 0)) == [1, 0, 0]
    assert colour_at(mesh, (3, 0, 0)) == [0, 0, 1]


def test_a_scene_graphs_transforms_are_applied(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    ball = trimesh.creation.icosphere(subdivisions=1)
    for k, x in enumerate((0.0, 5.0)):
        scene.add_geometry(ball, node_name=f"n{k}", transform=np.diag([0.1, 0.1, 0.1, 1]) + np.eye(4, k=3) * x)
    scene.export(tmp_path / "two.glb")
    meshes = read_mesh(tmp_path / "two.glb", Placement((0, 0, 0), anchor="origin"))
    assert sorted(round(float(mesh.vertices[:, 0].mean()), 6) for mesh in meshes) == [0, 5]
    assert all(np.ptp(mesh.vertices[:, 1]) <= 0.2 for mesh in meshes)


@needs_data
def test_the_ducks_node_scale_and_texture_are_used() -> None:
    (mesh,) = read_mesh(DATA / "duck.glb", Placement((0, 0, 0), anchor="origin"))
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), (1.6548, 1.5404, 1.1526), atol=1e-3)
    assert mesh.texture is not None
    assert mesh.uv is not None
    colours = mesh.texture[(mesh.uv[:, 1] * 511).astype(int), (mesh.uv[:, 0] * 511).astype(int)]
    red, green, blue = np.median(colours, axis=0)
    assert red > 0.4
    assert blue < green < red


@needs_data
@pytest.mark.parametrize(
    "name", sorted(path.name for path in DATA.glob("*.*") if path.suffix in {".obj", ".ply", ".glb"})
)
def test_every_shared_mesh_opens_as_a_scene(name: str) -> None:
    facts = {item["name"]: item for item in json.loads((DATA / "meshes.json").read_text())}
    _, scene = open_scene(DATA / name, RIG)
    meshes = meshes_of(scene)
    wanted = 36 if name.startswith("cornell") else facts[name]["triangles"]
    assert sum(len(mesh.faces) for mesh in meshes) == wanted
    corners = np.concatenate([mesh.vertices for mesh in meshes])
    extent = np.ptp(corners, axis=0)
    assert extent[1] == pytest.approx(0.35) or (extent.max() == pytest.approx(0.7) and extent[1] < 0.35)
    np.testing.assert_allclose((corners.max(axis=0) + corners.min(axis=0)) / 2, (0, 0, 1.05), atol=1e-9)


@needs_data
def test_corner_normals_do_not_multiply_the_vertices() -> None:
    (bunny,) = meshes_of(open_scene(DATA / "bunny_6k.obj", RIG)[1])
    assert len(bunny.vertices) == 3301


def test_indices_out_of_range_in_a_binary_file(tmp_path: Path) -> None:
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    )
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    points = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    for name, corners in (("high", (0, 1, 7)), ("low", (0, 1, -2))):
        path = tmp_path / f"{name}.ply"
        path.write_bytes(head.encode() + points + struct.pack("<B3i", 3, *corners))
        with pytest.raises(SceneError, match=f"{name}.ply"):
            open_scene(path, RIG)


def test_a_scene_places_and_paints_meshes(tmp_path: Path) -> None:
    checker(tmp_path / "flag.png")
    obj(tmp_path, QUAD + "f 1 2 3 4\n")
    shutil.copy(tmp_path / "thing.obj", tmp_path / "other.obj")
    table = '[[objects]]\ntype = "mesh"\nname = "card"\nfile = "thing.obj"\nposition_m = [0, 0, 1]\n'
    path = tmp_path / "scene.toml"
    path.write_text(table + "albedo = [0.1, 0.2, 0.3]\nfit_height_m = 0.2\n")
    (card,) = meshes_of(open_scene(path, RIG)[1])
    assert (card.name, card.albedo) == ("card", (0.1, 0.2, 0.3))
    assert np.ptp(card.vertices[:, 1]) == pytest.approx(0.2)
    path.write_text(table + 'texture = "flag.png"\n')
    with pytest.raises(SceneError, match=r"objects\[0\].*no texture coordinates"):
        open_scene(path, RIG)


def test_objects_that_show_the_same_file_share_its_arrays(tmp_path: Path) -> None:
    glb = SmallGlb.square()
    glb.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = glb.array(UPRIGHT)
    glb.paint(baseColorTexture=glb.texture([[[255, 0, 0], [0, 255, 0]]]))
    glb.json["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [3, 0, 0]}]
    glb.json["scenes"] = [{"nodes": [0, 1]}]
    glb.write(tmp_path / "two.glb")
    checker(tmp_path / "flag.png")
    table = '[[objects]]\ntype = "mesh"\nfile = "two.glb"\n'
    path = tmp_path / "scene.toml"
    path.write_text(
        f"{table}position_m = [0, 0, 1]\n{table}position_m = [0, 0, 2]\nyaw_deg = 30\n"
        f'{table}position_m = [0, 0, 3]\ntexture = "flag.png"\n{table}position_m = [0, 0, 4]\ntexture = "flag.png"\n'
        + 2
        * f'{table}position_m = [0, 0, 5]\nmaterial = {{ type = "glossy", gloss = 0.3, exponent = 20 }}\n'
    )
    meshes = meshes_of(open_scene(path, RIG)[1])
    own, painted, glossy = meshes[:4], meshes[4:8], meshes[8:]
    assert len(glossy) == 4
    for group in (own, painted, glossy):
        assert len({id(mesh.faces) for mesh in group}) == 1
        assert len({id(mesh.uv) for mesh in group}) == 1
        assert len({id(mesh.texture) for mesh in group}) == 1
    assert own[0].texture is not painted[0].texture


def test_the_triangle_limit_counts_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_files, "MAX_TRIANGLES", 6)
    obj(tmp_path, QUAD + "f 1 2 3 4\n")
    path = tmp_path / "scene.toml"
    table = '[[objects]]\ntype = "mesh"\nfile = "thing.obj"\nposition_m = [0, 0, 1]\n'
    path.write_text(table * 3)
    assert len(meshes_of(open_scene(path, RIG)[1])) == 3
    path.write_text(table * 4)
    with pytest.raises(SceneError, match=r"objects\[3\].*with 2 triangles, brings .* to 8: at most 6 are allowed"):
        open_scene(path, RIG)


def test_a_place_that_flattens_a_part_leaves_no_triangle(tmp_path: Path) -> None:
    glb = SmallGlb.square()
    glb.json["nodes"] = [{"mesh": 0, "scale": [0, 1, 1]}, {"mesh": 0, "scale": [1, 1, 0]}]
    glb.json["scenes"] = [{"nodes": [0]}]
    with pytest.raises(SceneError, match="no triangle with an area"):
        read_mesh(glb.write(tmp_path / "flat.glb"), AS_FILED)
    glb.json["scenes"] = [{"nodes": [0, 1]}]
    meshes = read_mesh(glb.write(tmp_path / "flat.glb"), AS_FILED)
    assert len(meshes) == 1


FAR_OFF = "v 100000 100000 100000\nv 100001 100000 100000\nv 100001 100001 100000.5\nv 100000 100001 99999\nf 1 2 3 4\n"
FLAT = "v -50 0 -50\nv 50 0 -50\nv 50 0 50\nv -50 0 50\nf 1 2 3 4\n"


@pytest.mark.parametrize("text", [FAR_OFF, FLAT, QUAD + "f 1 2 3 4\n"])
def test_a_mesh_opens_on_a_gate_that_shows_it_whole_and_no_wall(tmp_path: Path, text: str) -> None:
    rig = check_rig(320)
    _, scene = open_scene(obj(tmp_path, text), rig)
    assert [gate.name for gate in scene.gates] == ["The whole mesh"]
    buffers = render(rig, scene)
    lit, nearer = buffers.projector_row >= 0, buffers.inverse_depth > 1.001 / 1.6
    seen = weights(row_windows(rig, scene.gates[0].settings), buffers.projector_row) > 0
    assert np.count_nonzero(lit & nearer) > 500
    np.testing.assert_array_equal(seen & lit, nearer & lit)
