import base64
import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes import gltf_file
from slopegate.drivers.scenes.gltf_file import read_gltf
from slopegate.drivers.scenes.mesh_parts import MeshFile, MeshPart
from small_glb import CORNERS, SQUARE, UPRIGHT, SmallGlb

CASES = Path(__file__).parents[4] / "shared" / "cases"
needs_cases = pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not here")
FILE = Path("folder/thing.glb")
PIXELS = [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]]


def opened(glb: SmallGlb) -> MeshFile:
    return read_gltf(FILE, glb.packed())


def placed(part: MeshPart) -> Any:
    """Corners of the part in the file's axes, rounded."""
    points = (
        part.vertices if part.transform is None else part.vertices @ part.transform[:3, :3].T + part.transform[:3, 3]
    )
    return points.round(6) + 0.0


def refused(glb: SmallGlb) -> str:
    with pytest.raises(SceneError) as caught:
        opened(glb)
    message = str(caught.value)
    assert message.startswith(str(FILE))
    assert "\n" not in message
    return message


@pytest.mark.parametrize("kind", ["float32", "uint8", "uint16", "int16"])
def test_a_square_is_a_square_whatever_its_numbers_are_stored_as(kind: str) -> None:
    (part,) = opened(SmallGlb.square(kind)).parts
    assert placed(part)[part.faces].tolist() == np.array(SQUARE, float)[np.array(CORNERS).reshape(2, 3)].tolist()
    assert (part.factor, part.colours, part.texture, part.uv) == (None, None, None, None)


@pytest.mark.parametrize(("kind", "full"), [("uint8", 255), ("uint16", 65535), ("int8", 127), ("int16", 32767)])
def test_normalized_numbers_are_shares_of_their_range(kind: str, full: int) -> None:
    glb = SmallGlb()
    glb.mesh(POSITION=glb.array(np.array(SQUARE) * full, kind, normalized=True))
    assert placed(opened(glb).parts[0]).tolist() == SQUARE
    if kind.startswith("int"):  # the one number below -1
        glb = SmallGlb()
        glb.mesh(POSITION=glb.array(np.array(SQUARE) * (-full - 1), kind, normalized=True))
        assert placed(opened(glb).parts[0]).tolist() == (-np.array(SQUARE)).tolist()


def test_strides_and_offsets_are_kept_to() -> None:
    glb = SmallGlb()
    rows = np.full((4, 5), 9, np.float32)
    rows[:, 1:4] = SQUARE
    view = glb.view(rows.tobytes(), byteStride=20)
    accessor = {"bufferView": view, "byteOffset": 4, "componentType": 5126, "count": 4, "type": "VEC3"}
    glb.json["accessors"].append(accessor)
    glb.mesh(POSITION=0)
    assert placed(opened(glb).parts[0]).tolist() == SQUARE


def test_sparse_numbers_replace_those_of_the_buffer_or_zeros() -> None:
    for base in (True, False):
        glb = SmallGlb()
        glb.array(SQUARE if base else np.zeros((4, 3)))
        which = [2] if base else [1, 2, 3]
        there = [[2, 2, 0]] if base else [[1, 0, 0], [2, 2, 0], [0, 1, 0]]
        glb.json["accessors"][0]["sparse"] = {
            "count": len(which),
            "indices": {"bufferView": glb.view(np.array(which, np.uint8).tobytes()), "componentType": 5121},
            "values": {"bufferView": glb.view(np.array(there, np.float32).tobytes())},
        }
        if not base:
            del glb.json["accessors"][0]["bufferView"]
        glb.mesh(POSITION=0)
        assert placed(opened(glb).parts[0]).tolist() == [[0, 0, 0], [1, 0, 0], [2, 2, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("mode", "indices", "faces"),
    [
        (4, None, [[0, 1, 2]]),
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (6, [0, 1, 2, 3], [[0, 1, 2], [0, 2, 3]]),
    ],
)
def test_strips_fans_and_files_without_indices(mode: int, indices: list[int] | None, faces: list[list[int]]) -> None:
    glb = SmallGlb()
    glb.mesh(indices, mode, POSITION=glb.array(SQUARE[:3] if indices is None else SQUARE))
    (part,) = opened(glb).parts
    found = [sorted(map(tuple, placed(part)[face].tolist())) for face in part.faces]
    assert found == [sorted(tuple(map(float, SQUARE[corner])) for corner in face) for face in faces]


def test_points_and_lines_are_left_out_with_a_remark() -> None:
    glb = SmallGlb.square()
    glb.json["meshes"][0]["primitives"] += [{"attributes": {"POSITION": 0}, "mode": mode} for mode in (0, 1, 2, 3)]
    file = opened(glb)
    assert (len(file.parts), file.remarks) == (1, ("its points and lines are left out",))


def test_nodes_turn_scale_and_move_what_hangs_on_them() -> None:
    glb = SmallGlb.square()
    half = math.sqrt(0.5)
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]
    glb.json["nodes"] = [
        {"matrix": matrix, "camera": 0, "children": [1]},
        {"mesh": 0, "translation": [1, 0, 0], "rotation": [0, 0, half, half], "scale": [2, -3, 1]},
    ]
    # (x, y, 0) becomes (2 x, -3 y, 0), then by a quarter turn (3 y, 2 x, 0).
    assert placed(opened(glb).parts[0]).tolist() == [[6, 6, 7], [6, 8, 7], [9, 8, 7], [9, 6, 7]]


def test_only_the_default_scene_is_shown_and_said_to_be() -> None:
    glb = SmallGlb.square()
    glb.json |= {"nodes": [{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}], "scene": 1}
    glb.json["scenes"] = [{"nodes": [0]}, {"nodes": [1]}]
    file = opened(glb)
    assert placed(file.parts[0])[:, 0].min() == 5
    assert file.remarks == ("of its 2 scenes only scenes[1] is shown",)
    for key in ("scene", "scenes"):
        del glb.json[key]
    assert len(opened(glb).parts) == 2


def test_nodes_with_the_same_mesh_share_its_arrays() -> None:
    glb = SmallGlb.square()
    glb.paint(baseColorTexture=glb.texture(PIXELS))
    glb.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = glb.array(UPRIGHT)
    glb.json["nodes"] = [{"mesh": 0, "translation": [k, 0, 0]} for k in range(3)]
    glb.json["scenes"] = [{"nodes": [0, 1, 2]}]
    first, *others = opened(glb).parts
    assert first.shared is not None
    for k, part in enumerate(others, start=1):
        assert part.shared == first.shared
        assert part.vertices is first.vertices
        assert part.texture is first.texture
        assert placed(part)[:, 0].min() == k


def test_instances_are_placed_turned_and_scaled() -> None:
    glb = SmallGlb.square()
    half = round(math.sqrt(0.5) * 32767)
    places = {
        "TRANSLATION": glb.array([[0, 0, 0], [3, 0, 0]]),
        "ROTATION": glb.array([[0, 0, 0, 32767], [0, 0, half, half]], "int16", normalized=True),
        "SCALE": glb.array([[1, 1, 1], [2, 2, 2]]),
        "_ID": glb.array([0, 1]),
    }
    glb.json["nodes"] = [{"mesh": 0, "translation": [0, 0, 1], "extensions": {}}]
    glb.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"] = {"attributes": places}
    glb.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    first, second = opened(glb).parts
    assert placed(first).tolist() == [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    np.testing.assert_allclose(placed(second), [[3, 0, 1], [3, 2, 1], [1, 2, 1], [1, 0, 1]], atol=1e-4)


def test_a_skin_hangs_on_its_bones_and_not_on_its_node() -> None:
    glb = SmallGlb.square()
    attributes = glb.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = glb.array([[0, 1, 0, 0]] * 4, "uint8")
    attributes["WEIGHTS_0"] = glb.array([[1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0]])
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[1, 3, 1] = -1  # columns first: the second bone sits at y = 1
    glb.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": glb.array(inverse)}]
    glb.json["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [9, 9, 9]},
        {"children": [2], "translation": [0, 0, 1]},
        {"translation": [0, 3, 0]},
    ]
    glb.json["scenes"] = [{"nodes": [0, 1]}]
    (part,) = opened(glb).parts
    assert part.transform is None
    assert placed(part).tolist() == [[0, 0, 1], [1, 0, 1], [1, 3, 1], [0, 2, 1]]


def test_morph_targets_have_the_weights_of_the_node_or_else_of_the_mesh() -> None:
    glb = SmallGlb.square()
    up = {"POSITION": glb.array([[0, 0, 1]] * 4)}
    glb.json["meshes"][0]["primitives"][0]["targets"] = [up, {"POSITION": glb.array([[0, 0, 100]] * 4)}]
    glb.json["meshes"][0]["weights"] = [0.5, 0]
    glb.json["nodes"].append({"mesh": 0, "weights": [2, 0]})
    glb.json["scenes"] = [{"nodes": [0, 1]}]
    assert [placed(part)[0, 2] for part in opened(glb).parts] == [0.5, 2]


@pytest.mark.parametrize(("kind", "full"), [("float32", 1), ("uint8", 255), ("uint16", 65535)])
@pytest.mark.parametrize("alpha", [0, 1])
def test_vertex_colours_and_the_materials_factor_are_both_kept(kind: str, full: int, alpha: int) -> None:
    glb = SmallGlb.square()
    colours = np.hstack([np.eye(4, 3) * full, np.full((4, alpha), full)])
    more = {} if kind == "float32" else {"normalized": True}
    glb.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = glb.array(colours, kind, **more)
    glb.paint(baseColorFactor=[0.5, 1, 1, 1])
    (part,) = opened(glb).parts
    assert part.colours is not None
    assert part.colours[0].tolist() == np.eye(3).tolist()
    assert part.factor == (0.5, 1, 1)


def textured(use: dict[str, Any] | None = None, sampler: dict[str, int] | None = None) -> SmallGlb:
    glb = SmallGlb.square()
    attributes = glb.json["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"TEXCOORD_0": glb.array(UPRIGHT), "TEXCOORD_1": glb.array(np.array(UPRIGHT) * 3)}
    glb.paint(baseColorTexture=glb.texture(PIXELS, sampler=sampler) | (use or {}))
    return glb


def test_textures_go_by_the_set_of_coordinates_that_they_name() -> None:
    (part,) = opened(textured()).parts
    assert part.uv is not None
    assert part.texture is not None
    assert part.uv[0].tolist() == [[0, 1], [1, 1], [1, 0]]
    assert part.texture[0, 1].tolist() == [0, 1, 0]
    (part,) = opened(textured({"texCoord": 1})).parts
    assert part.uv is not None
    assert part.uv.max() == 3


def test_texture_transforms_scale_then_turn_counter_clockwise_then_move() -> None:
    change = {"scale": [2, 4], "rotation": math.pi / 2, "offset": [10, 20], "texCoord": 0}
    (part,) = opened(textured({"texCoord": 1, "extensions": {"KHR_texture_transform": change}})).parts
    assert part.uv is not None
    # A quarter turn takes u, to the right, to -v, upwards.
    places = {tuple(place) for place in part.uv.reshape(-1, 2).round(6).tolist()}
    assert places == {(10 + 4 * v, 20 - 2 * u) for u, v in UPRIGHT}


def test_a_texture_without_its_coordinates_is_remarked() -> None:
    file = opened(textured({"texCoord": 3}))
    assert file.parts[0].texture is None
    assert file.remarks == ("a texture is left out: meshes[0].primitives[0] has no TEXCOORD_3",)


def test_samplers_say_what_lies_beyond_the_edges() -> None:
    assert opened(textured()).parts[0].wrap == ("repeat", "repeat")
    assert opened(textured(sampler={"wrapS": 33071, "wrapT": 33648})).parts[0].wrap == ("clamp", "mirror")
    assert "wraps by 5" in refused(textured(sampler={"wrapS": 5}))


@pytest.mark.parametrize("shape", [(1, 3), (1, 3, 3)])
def test_textures_of_16_bits_keep_them(shape: tuple[int, ...]) -> None:
    glb = textured()
    values = np.zeros(shape, np.uint16)
    values[0, 1], values[0, 2] = 1000, 65535
    glb.json["meshes"][0]["primitives"][0].pop("material")
    glb.paint(baseColorTexture=glb.texture(values, "uint16"))
    (part,) = opened(glb).parts
    assert part.texture is not None
    np.testing.assert_allclose(part.texture[0, :, 0], [0, 1000 / 65535 / 12.92, 1], rtol=1e-5)


def test_the_diffuse_colour_of_the_older_material_is_taken() -> None:
    glb = SmallGlb.square()
    older = {"diffuseFactor": [0.1, 0.2, 0.3, 1]}
    glb.paint()["extensions"] = {"KHR_materials_pbrSpecularGlossiness": older}
    assert opened(glb).parts[0].factor == (0.1, 0.2, 0.3)


def test_what_is_not_shown_is_remarked_by_name() -> None:
    glb = SmallGlb.square()
    material = glb.paint() | {"alphaMode": "MASK", "extensions": {"KHR_materials_unlit": {}}}
    glb.json |= {"materials": [material], "animations": [{}]}
    glb.json["extensionsUsed"] = ["KHR_materials_unlit", "KHR_materials_transmission", "KHR_xmp_json_ld"]
    assert opened(glb).remarks == (
        "what the glTF extension KHR_materials_transmission adds is left out",
        "its animations are left out: it stands in its rest pose",
        "its cut-outs and transparency (alphaMode) are left out: those surfaces are whole",
        "its surfaces without shading (KHR_materials_unlit) are matt ones",
    )


@pytest.mark.parametrize(
    "name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu", "ACME_shape"]
)
def test_extensions_that_a_file_requires_are_done_or_refused_by_name(name: str) -> None:
    glb = SmallGlb.square()
    glb.json["extensionsRequired"] = ["KHR_mesh_quantization", name]
    assert f"requires the glTF extension {name}, which is not read" in refused(glb)
    glb.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    assert opened(glb).remarks == ()


def changed(**keys: Any) -> SmallGlb:
    glb = SmallGlb.square()
    glb.json |= keys
    return glb


def accessor(**keys: Any) -> SmallGlb:
    glb = SmallGlb.square()
    glb.json["accessors"][0] |= keys
    return glb


def primitive(**keys: Any) -> SmallGlb:
    glb = SmallGlb.square()
    glb.json["meshes"][0]["primitives"][0] |= keys
    return glb


@pytest.mark.parametrize(
    ("glb", "words"),
    [
        (changed(nodes=[{"children": [1]}, {"children": [0]}]), "shown twice, or within itself"),
        (changed(nodes=[{"children": [1, 1]}, {"mesh": 0}]), "nodes[1] is a child of two nodes"),
        (changed(nodes=[{"mesh": 3}]), "nodes[0].mesh is 3: the file has 1 meshes"),
        (changed(nodes=[{"mesh": -1}]), "nodes[0].mesh is -1: it must be a whole number from 0"),
        (changed(nodes=[{"mesh": 0, "matrix": [1] * 15}]), "nodes[0].matrix"),
        (changed(nodes=[{"mesh": 0, "translation": [1, 2, "x"]}]), "nodes[0].translation"),
        (changed(scene=4), "scene is 4"),
        (changed(scenes=[{"nodes": [7]}]), "scenes[0].nodes is 7"),
        (changed(asset={"version": "1.0"}), "glTF of version '1.0': only version 2.0"),
        (changed(asset={"version": "2.0", "minVersion": "2.1"}), "needs a reader of glTF '2.1'"),
        (changed(meshes=[{}]), "meshes[0].primitives is missing"),
        (changed(nodes={}), "nodes is {}"),
        (accessor(count=5), "accessors[0] ends at byte 60, but bufferViews[0] has 48 bytes"),
        (accessor(count=10**15), f"accessors[0].count is {10**15}: at most"),
        (accessor(byteOffset=4), "ends at byte 52"),
        (accessor(componentType=5130), "accessors[0].componentType is 5130: it must be one of 5120"),
        (accessor(type="VEC2"), "accessors[0].type is 'VEC2'"),
        (accessor(bufferView=9), "accessors[0].bufferView is 9"),
        (primitive(indices=0), "accessors[0].type is 'VEC3'"),
        (primitive(mode=7), "mode is 7"),
        (primitive(material=2), "material is 2: the file has 0 materials"),
    ],
)
def test_a_file_that_contradicts_itself_is_one_sentence(glb: SmallGlb, words: str) -> None:
    assert words in refused(glb)


def test_indices_beyond_the_vertices_and_half_triangles_are_refused() -> None:
    for indices, words in (([0, 1, 4], "indices has 4: it has 4 vertices"), ([0, 1, 2, 3], "a multiple of 3")):
        glb = SmallGlb()
        glb.mesh(indices, POSITION=glb.array(SQUARE))
        assert words in refused(glb)


def test_a_long_array_of_nothing_is_refused_before_it_is_made() -> None:
    glb = SmallGlb()
    glb.json["accessors"] = [{"componentType": 5126, "count": 6_000_000, "type": "VEC3"} for _ in range(9)]
    glb.json["meshes"] = [{"primitives": [{"attributes": {"POSITION": k}} for k in range(9)]}]
    assert "it has 18000000 triangles: at most 2000000" in refused(glb)
    for entry in glb.json["meshes"][0]["primitives"]:
        entry["indices"] = glb.array(CORNERS, "uint16")
    assert "beyond the file's own bytes" in refused(glb)


def test_instances_are_counted_before_they_are_made() -> None:
    glb = SmallGlb.square()
    glb.json["accessors"].append({"componentType": 5126, "count": 5_000_000, "type": "VEC3"})
    places = {"TRANSLATION": len(glb.json["accessors"]) - 1}
    glb.json["nodes"] = [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": places}}}]
    assert "it has 10000000 triangles" in refused(glb)


def test_textures_and_morph_targets_have_a_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf_file, "MAX_TEXELS", 3)
    assert "its textures have more than" in refused(textured())
    monkeypatch.setattr(gltf_file, "MAX_MOVES", 7)
    up = {"POSITION": 0}
    glb = primitive(targets=[up, up])
    glb.json["meshes"][0]["weights"] = [1, 0]
    assert len(opened(glb).parts) == 1
    glb.json["meshes"][0]["weights"] = [1, 1]
    assert "morph targets move more than 7 vertices" in refused(glb)


def test_nodes_may_be_nested_as_deep_as_they_like() -> None:
    deep = 20_000
    nodes = [{"children": [k + 1], "translation": [1, 0, 0]} for k in range(deep)]
    (part,) = opened(changed(nodes=[*nodes, {"mesh": 0}])).parts
    assert placed(part)[0].tolist() == [deep, 0, 0]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"glTF", "cut short"),
        (struct.pack("<4sII", b"glTF", 1, 12), "version 1"),
        (struct.pack("<4sII", b"glTF", 2, 999), "12 bytes of 999"),
        (struct.pack("<4sIIII", b"glTF", 2, 20, 99, 0), "reaches beyond its end"),
        (b"solid", "is no GLB file"),
    ],
)
def test_a_container_that_is_none_is_one_sentence(data: bytes, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        read_gltf(FILE, data)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is not valid JSON: expecting property name enclosed in double quotes (line 1, column 2)"),
        ("[" * 100_000, "nested too deeply"),
        ('{"asset": {"version": "2.0"}, "scene": NaN}', "scene is nan"),
        ('{"scene": ' + "9" * 5000 + "}", "a whole number in it has more than 4300 digits"),
        ("[]", "the file is []"),
        ("{}", "only version 2.0"),
        ('{"asset": {"version": "2.0"}, "nodes": [' + "{}," * 1_000_000 + "{}]}", "more than 1000000 values"),
    ],
)
def test_json_that_is_no_gltf_is_one_sentence(text: str, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        read_gltf(Path("thing.gltf"), text.encode())
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_buffers_and_pictures_may_lie_beside_the_file_or_in_its_text(tmp_path: Path) -> None:
    glb = textured()
    glb.packed()
    path = tmp_path / "thing.gltf"
    picture = glb.json["bufferViews"][glb.json["images"][0]["bufferView"]]
    start = picture["byteOffset"]
    (tmp_path / "a picture.png").write_bytes(glb.data[start : start + picture["byteLength"]])
    (tmp_path / "data.bin").write_bytes(glb.data)
    glb.json["images"] = [{"uri": "a%20picture.png"}]
    for uri in ("data.bin", "data:application/octet-stream;base64," + base64.b64encode(glb.data).decode()):
        glb.json["buffers"][0]["uri"] = uri
        path.write_bytes(b"\xef\xbb\xbf" + json.dumps(glb.json).encode())
        (part,) = read_gltf(path, path.read_bytes()).parts
        assert placed(part).tolist() == SQUARE
        assert part.texture is not None
        assert part.texture.shape == (2, 2, 3)


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("gone.bin", "gone.bin is missing"),
        ("https://example.org/data.bin", "it must be a file beside this one"),
        ("data:,abc", "must be base64"),
        ("data:;base64,a", "it is no base64"),
        ("data:;base64,AAAA", "buffers[0] has 3 bytes"),
        (None, "buffers[0] has no data"),
    ],
)
def test_a_buffer_that_is_not_there_is_one_sentence(tmp_path: Path, uri: str | None, words: str) -> None:
    glb = SmallGlb.square()
    glb.packed()
    if uri is not None:
        glb.json["buffers"][0]["uri"] = uri
    with pytest.raises(SceneError) as caught:
        read_gltf(tmp_path / "thing.gltf", json.dumps(glb.json).encode())
    assert words in str(caught.value)


@needs_cases
@pytest.mark.parametrize(
    ("name", "parts", "remark"),
    [
        ("glb_alpha_mask/mask.glb", 1, "cut-outs"),
        ("glb_camera_parent/camera_child.glb", 2, ""),
        ("glb_normalized_uv/uv_u8.glb", 1, ""),
        ("glb_normalized_uv/uv_u16.glb", 1, ""),
        ("glb_required_extension/instancing.glb", 3, ""),
        ("glb_sparse/sparse.glb", 1, ""),
        ("glb_texture_transform/textransform.glb", 1, ""),
        ("glb_vertex_colours/vc_float.glb", 1, ""),
        ("glb_vertex_colours/vc_material.glb", 1, ""),
        ("texture_16bit_grey/tex16.glb", 1, ""),
    ],
)
def test_every_case_is_read_whole(name: str, parts: int, remark: str) -> None:
    file = read_gltf(CASES / name, (CASES / name).read_bytes())
    assert len(file.parts) == parts
    assert [remark in text for text in file.remarks] == ([True] if remark else [])
