import math
import os
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from slopegate.core.gating.gate import slab
from slopegate.core.rig.settings import LineTimes, PixelClocks
from slopegate.core.scene.materials import SKIN_LOBES, Glass, Gloss, Skin, SkinLobe
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Mesh, Scene, Sphere
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.light_toml import LEAST_VISIBILITY_M
from slopegate.drivers.scenes.scene_files import SceneError, open_scene

RIG = load_rig(None)
BALL = '[[objects]]\ntype = "sphere"\ncentre_m = [0, 0, 1]\nradius_m = 0.1\n'
CARD = '[[objects]]\ntype = "plane"\ncentre_m = [0, 0, 1.05]\nwidth_m = 0.2\nheight_m = 0.3\n'
FOG = "[fog]\n"
SKIN = 'material = { type = "skin", '
GATE = '[[gates]]\nname = "g"\n'


def opened(folder: Path, text: str) -> Scene:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    rig, scene = open_scene(path, RIG)
    assert rig is RIG
    return scene


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(SceneError) as caught:
        opened(folder, text)
    message = str(caught.value)
    assert "scene.toml" in message
    assert "\n" not in message
    return message


def test_every_kind_of_object_is_built(tmp_path: Path) -> None:
    quad = '[[objects]]\ntype = "quad"\ncorner_m = [0, 0, 1]\nedge_u_m = [1, 0, 0]\nedge_v_m = [0, 1, 0]\n'
    box = '[[objects]]\ntype = "box"\nname = "crate"\ncentre_m = [0, 0, 1]\nsize_m = [1, 2, 3]\nalbedo = 0.25\n'
    scene = opened(tmp_path, 'title = "T"\ndescription = "D"\nambient = 0.5\n' + BALL + CARD + quad + box)
    assert (scene.name, scene.description, scene.ambient) == ("T", "D", 0.5)
    ball, card, sheet, crate = scene.objects
    assert isinstance(ball, Sphere)
    assert ball.radius_m == 0.1
    assert all(isinstance(item, Mesh) for item in (card, sheet, crate))
    assert (crate.name, crate.albedo) == ("crate", (0.25, 0.25, 0.25))
    assert card.name == "plane 1"
    assert not scene.moving


def test_a_texture_is_srgb_made_linear_with_its_top_row_first(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "flag.png"), np.array([[[0, 0, 255]], [[128, 128, 128]]], np.uint8))
    card = opened(tmp_path, CARD + 'texture = "flag.png"\n').objects[0]
    assert isinstance(card, Mesh)
    assert card.texture is not None
    assert card.texture.dtype == np.float32
    np.testing.assert_allclose(card.texture[0, 0], [1, 0, 0])
    np.testing.assert_allclose(card.texture[1, 0], 0.2158605, atol=1e-6)


def test_gates_by_slab_suit_the_rig_and_by_settings_stay_as_written(tmp_path: Path) -> None:
    by_slab = GATE + "tilt_deg = 15\ndistance_m = 1.05\nthickness_m = 0.06\ncomplement = true\n"
    by_hand = GATE + "clock_mhz = 80\ndelay_us = 2194\nexposure_us = 600\n"
    planned, written = opened(tmp_path, BALL + by_slab + by_hand).gates
    assert planned.complement
    assert planned.asked_slab == (15, 1.05, 0.06)
    assert (written.complement, written.asked_slab) == (False, None)
    read = slab(RIG, planned.settings)
    assert read.tilt_deg == pytest.approx(15, abs=0.5)
    assert read.distance_m == pytest.approx(1.05, abs=0.01)
    assert not isinstance(RIG.camera.shutter.line, LineTimes)
    assert written.settings.line_time_us == RIG.camera.shutter.line.line_time_us(80)
    assert (written.settings.delay_us, written.settings.exposure_us) == (2194, 600)


def test_objects_share_a_motion_about_their_own_centres_or_a_common_pivot(tmp_path: Path) -> None:
    keys = "keys = [{time_s = 0}, {time_s = 1, offset_m = [0, 0, 1], yaw_deg = 90}]\n"
    moving = CARD + 'motion = "m"\n' + BALL + 'motion = "m"\n'
    card, ball = opened(tmp_path, moving + "[motions.m]\n" + keys).objects
    assert card.motion is not None
    assert ball.motion is not None
    assert (card.motion.pivot_m, ball.motion.pivot_m) == ((0, 0, 1.05), (0, 0, 1))
    scene = opened(tmp_path, moving + "[motions.m]\nloop = false\npivot_m = [0, 0, 2]\n" + keys)
    assert scene.moving
    assert all(item.motion is not None and item.motion.pivot_m == (0, 0, 2) for item in scene.objects)
    rotation, shift = card.motion.pose(0.999999999)
    np.testing.assert_allclose(rotation @ (0.1, 0, 1.05) + shift, [0, 0, 2.15], atol=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ambient = 1", "the file must have either [[objects]] or a capture"),
        ('capture = "."\n' + BALL, "the file must have either [[objects]] or a capture"),
        ('capture = "gone"', "capture is 'gone': there is no such folder"),
        ("objects = []", "objects is []: it must be a list of [[objects]] tables with at least one entry"),
        ("objects = 3", "objects is 3"),
        (BALL + "colour = 1", "objects[0].colour is not a key"),
        ("titel = 'x'\n" + BALL, "titel is not a key"),
        (BALL + BALL.replace("0.1", "-0.1"), "objects[1].radius_m is -0.1: it must be a length in metres"),
        (BALL.replace("0.1", "nan"), "objects[0].radius_m is nan"),
        (BALL.replace("0.1", "0"), "objects[0].radius_m is 0"),
        (BALL.replace("0.1", "true"), "objects[0].radius_m is True"),
        (BALL.replace("0.1", '"0.1"'), "objects[0].radius_m is '0.1'"),
        (BALL.replace("0.1", "1" + "0" * 400), "objects[0].radius_m is 1000"),
        (BALL.replace("[0, 0, 1]", "[0, 0]"), "objects[0].centre_m is [0, 0]: it must be three lengths"),
        (BALL.replace("[0, 0, 1]", "[0, 0, inf]"), "objects[0].centre_m is [0, 0, inf]"),
        (BALL.replace("radius_m = 0.1", ""), "objects[0].radius_m is missing"),
        (BALL.replace("radius_m", "radus_m"), "objects[0].radus_m is not a key that is known there"),
        (BALL.replace("sphere", "cube"), "objects[0].type is 'cube': it must be one of box, mesh, plane, quad, sphere"),
        (BALL.replace('type = "sphere"', ""), "objects[0].type is missing"),
        (BALL + "albedo = [1, 0.5, 1.5]", "objects[0].albedo is [1, 0.5, 1.5]: it must be a number or three numbers"),
        (CARD + 'albedo = 1\ntexture = "a.png"', "objects[0] has both albedo and texture"),
        (CARD + 'texture = "a.png"', "a.png is missing"),
        (CARD + 'texture = "a\\u0000.png"', "objects[0]"),
        (CARD + 'texture = "."', "objects[0]"),
        (CARD + 'texture = "scene.toml"', "scene.toml is no picture"),
        (CARD + "tilt_deg = 720", "objects[0].tilt_deg is 720"),
        (BALL + 'motion = "gone"', "objects[0]: motion is 'gone': it must be the name of a [motions] table"),
        (BALL + "[motions.m]\nkeys = []", "motions.m.keys is []"),
        (BALL + "[motions.m]\nkeys = [{time_s = 1}]", "motions.m has key frames at other times"),
        (BALL + "[motions.m]\nkeys = [{time_s = 0}, {time_s = 0}]", "motions.m has key frames at other times"),
        (BALL + GATE, "gates[0] must have exactly one of these sets of keys"),
        (BALL + GATE + "clock_mhz = 78\ndelay_us = 0\n", "gates[0] must have exactly one"),
        (BALL + GATE + "clock_mhz = 0\ndelay_us = 0\nexposure_us = 1\n", "gates[0].clock_mhz is 0"),
        ("ambient = -1\n" + BALL, "ambient is -1: it must be a finite number of at least 0"),
        ("indirect = 1\n" + BALL, "indirect is 1: it must be true or false"),
        ("fog = 3\n" + BALL, "fog is 3: it must be a table of keys and values"),
        (BALL + FOG, "fog has no density: it must have scattering_per_m or visibility_m"),
        (BALL + FOG + "scattering_per_m = -1", "fog.scattering_per_m is -1.0: it must be from 0 to 1000 per metre"),
        (BALL + FOG + "absorption_per_m = 2e3", "fog.absorption_per_m is 2000.0: it must be from 0 to 1000 per metre"),
        (BALL + FOG + "scattering_per_m = 1001", "the mean free path is 1 mm"),
        (BALL + FOG + "scattering_per_m = nan", "fog.scattering_per_m is nan: it must be a finite number"),
        (BALL + FOG + "visibility_m = 0.001", "fog.visibility_m is 0.001: it must be a distance in metres of at least"),
        (BALL + FOG + "visibility_m = 4\ng = 1", "fog.g is 1.0: it must be between -1 and 1, both excluded"),
        (BALL + FOG + "visibility_m = 4\ng = -1.5", "fog.g is -1.5"),
        (BALL + FOG + "visibility_m = 4\nscattering_per_m = 1", "fog has both visibility_m and coefficients"),
        (BALL + FOG + "visibility_m = 4\nhi_m = [1, 1, -1]", "fog.lo_m is (-inf, -inf, 0.0): it must be below hi_m"),
        (BALL + FOG + "visibility_m = 4\nlo_m = [0, nan, 1]", "fog.lo_m is [0, nan, 1]: it must be three lengths"),
        (BALL + FOG + "density = 1", "fog.density is not a key that is known there"),
        (BALL + 'material = "glass"', "objects[0].material is 'glass': it must be a table of keys and values"),
        (BALL + "material = {}", "objects[0].material.type is missing: it must be one of glass, glossy, matt, skin"),
        (BALL + 'material = { type = "ice" }', "objects[0].material.type is 'ice': it must be one of glass, glossy"),
        (BALL + 'material = { type = "glossy" }', "objects[0].material.gloss is missing"),
        (
            BALL + 'material = { type = "glossy", gloss = 2 }',
            "objects[0].material.gloss is 2.0: it must be",
        ),
        (
            BALL + 'material = { type = "glossy", gloss = 0.5, exponent = 0 }',
            "objects[0].material.exponent is 0.0: it must be from 1 to 100000",
        ),
        (BALL + 'material = { type = "glass", gloss = 1 }', "objects[0].material.gloss is not a key that is known"),
        (
            BALL + 'material = { type = "glass", index = 0.9 }',
            "objects[0].material.index is 0.9: it must be",
        ),
        (BALL + SKIN + "lobes = [] }", "objects[0].material.lobes is []: it must be a list of lobes"),
        (BALL + SKIN + "lobes = [{ sigma_mm = -1, weight = 0.1 }] }", "material.lobes[0].sigma_mm is -1: it must be"),
        (
            BALL + SKIN + "lobes = [{ sigma_mm = 1, weight = 3 }] }",
            "material.lobes[0].weight is 3: it must be",
        ),
        (
            BALL + SKIN + "lobes = [{ sigma_mm = 1, weight = 0.6 }, { sigma_mm = 2, weight = 0.6 }] }",
            "add up to at most 1 per colour",
        ),
        (BALL + 'material = { type = "skin", veins = "gone.png" }', "gone.png is missing"),
        ("[[objects]\n", "is not valid TOML"),
        ("a = " + "[" * 100_000, "is not valid TOML"),
        ("[" + ".".join("a" * 5000) + "]\n" + BALL, "a is not a key"),
        ("[" + ".".join(["title", *"a" * 5000]) + "]\n" + BALL, "title is nested too deeply"),
        ("motions = 3\n" + BALL, "motions is 3"),
        ("motions.m = 3\n" + BALL, "motions.m is 3: it must be a table of keys and values"),
        ('[[objects]]\ntype = "mesh"\nposition_m = [0, 0, 1]\nfile = "gone.obj"', "gone.obj is missing"),
        ('[[objects]]\ntype = "mesh"\nposition_m = [0, 0, 1]\nfile = "scene.toml"', "scene.toml is no mesh"),
        (
            '[[objects]]\ntype = "mesh"\nposition_m = [0, 0, 1]\nfile = "a.obj"\nscale = 1\nfit_height_m = 1',
            "objects[0] has both scale and fit_height_m",
        ),
        (
            '[[objects]]\ntype = "quad"\ncorner_m = [0, 0, 1]\nedge_u_m = [1, 0, 0]\nedge_v_m = [2, 0, 0]',
            "objects[0]: quad 0 has no triangle with an area",
        ),
    ],
)
def test_what_cannot_be_meant_is_one_sentence_with_file_and_field(tmp_path: Path, text: str, words: str) -> None:
    assert words in refusal(tmp_path, text)


def test_gates_that_the_rig_cannot_make_are_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    wished = (
        "tilt_deg = 0\ndistance_m = 1\nthickness_m = 0.1\n",
        "tilt_deg = 89\ndistance_m = 0.1\nthickness_m = 0.1\n",
        "clock_mhz = 500\ndelay_us = 9000\nexposure_us = 500\n",
        "clock_mhz = 78\ndelay_us = 9000\nexposure_us = 1e6\n",
    )
    gates = "".join(f'[[gates]]\nname = "G{index}"\n{keys}' for index, keys in enumerate(wished))
    path.write_text(BALL + gates, "utf-8")
    _, scene = open_scene(path, RIG)
    assert [preset.name for preset in scene.gates] == ["G0", "G2", "G3"]
    impossible, fast, long = scene.remarks
    assert impossible.startswith(f"{path}: gates[1] ('G1') is left out, for this rig cannot make it: tilt_deg is 89")
    limits = RIG.camera.shutter
    assert isinstance(limits.line, PixelClocks)
    highest = limits.line.ladder_mhz[-1]
    assert (
        f"gates[2] ('G2'): its camera has no pixel clock of 500 MHz: it is made with the nearest, {highest:g}" in fast
    )
    assert scene.gates[1].settings.line_time_us == limits.line.line_time_us(highest)
    assert "gates[3] ('G3'): its camera has exposures of" in long
    assert scene.gates[2].settings.exposure_us == limits.exposure_us.nearest(1e6)


def test_files_that_are_no_scene(tmp_path: Path) -> None:
    for name, data, words in (
        ("bytes.toml", b"\xff\xfe\x00", "not UTF-8"),
        ("empty.toml", b"", "empty (0 bytes)"),
        ("notes.txt", b"hello", "is no scene: it must be a .toml scene"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(SceneError, match=name) as caught:
            open_scene(tmp_path / name, RIG)
        assert words in str(caught.value)
    with pytest.raises(SceneError, match="is missing"):
        open_scene(tmp_path / "gone.toml", RIG)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_in_place_of_a_picture_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.png")
    assert "not an ordinary file" in refusal(tmp_path, CARD + 'texture = "pipe.png"')


coefficients = st.floats(0, 1000)
edges = st.floats(-50, 50) | st.sampled_from([-math.inf, math.inf])


@given(scattering=coefficients, absorption=coefficients, g=st.floats(-0.999, 0.999), box=st.tuples(*[edges] * 6))
def test_fog_comes_back_as_it_was_written(
    scattering: float, absorption: float, g: float, box: tuple[float, ...]
) -> None:
    lo, hi = zip(*((min(pair), max(pair)) for pair in zip(box[::2], box[1::2], strict=True)), strict=True)
    assume(all(low < high for low, high in zip(lo, hi, strict=True)))
    text = (
        f"{BALL}[fog]\nscattering_per_m = {scattering!r}\nabsorption_per_m = {absorption!r}\ng = {g!r}\n"
        f"lo_m = {list(lo)}\nhi_m = {list(hi)}\n"
    )
    with TemporaryDirectory() as folder:
        assert opened(Path(folder), text).fog == Fog(scattering, absorption, g, lo, hi)


@given(visibility_m=st.floats(LEAST_VISIBILITY_M, 1e6))
def test_fog_by_its_visibility_only_scatters_and_fills_all_before_the_rig(visibility_m: float) -> None:
    with TemporaryDirectory() as folder:
        fog = opened(Path(folder), f"{BALL}[fog]\nvisibility_m = {visibility_m!r}\n").fog
    assert fog is not None
    assert fog.visibility_m == pytest.approx(visibility_m)
    assert (fog.absorption_per_m, fog.g) == (0, 0)
    assert (fog.lo_m, fog.hi_m) == ((-math.inf, -math.inf, 0), (math.inf, math.inf, math.inf))


def test_a_plain_scene_has_no_fog_and_asks_for_no_indirect_light(tmp_path: Path) -> None:
    plain = opened(tmp_path, BALL)
    assert (plain.fog, plain.indirect, plain.objects[0].material) == (None, False, None)
    assert opened(tmp_path, "indirect = true\n" + BALL).indirect


def test_every_material_is_read_on_every_kind_of_object(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh = '[[objects]]\ntype = "mesh"\nposition_m = [0, 0, 1]\nfile = "m.obj"\n'
    for table, material in (
        ('{ type = "matt" }', None),
        ('{ type = "glossy", gloss = 0.3 }', Gloss(0.3, 50)),
        ('{ type = "glossy", gloss = 0.3, exponent = 7 }', Gloss(0.3, 7)),
        ('{ type = "glass" }', Glass(1.5)),
        ('{ type = "glass", index = 1.33 }', Glass(1.33)),
    ):
        scene = opened(tmp_path, "".join(f"{item}material = {table}\n" for item in (BALL, CARD, mesh)))
        assert [item.material for item in scene.objects] == [material] * 3


@given(
    gloss=st.floats(0, 1),
    exponent=st.floats(1, 1e5),
    index=st.floats(1, 4),
    lobes=st.lists(st.tuples(st.floats(1e-3, 100), st.tuples(*[st.floats(0, 0.2)] * 3)), min_size=1, max_size=5),
)
def test_materials_come_back_as_they_were_written(
    gloss: float, exponent: float, index: float, lobes: list[tuple[float, tuple[float, float, float]]]
) -> None:
    listed = ", ".join(f"{{ sigma_mm = {sigma!r}, weight = {list(weight)} }}" for sigma, weight in lobes)
    tables = (
        f'{{ type = "glossy", gloss = {gloss!r}, exponent = {exponent!r} }}',
        f'{{ type = "glass", index = {index!r} }}',
        f'{{ type = "skin", lobes = [{listed}] }}',
    )
    with TemporaryDirectory() as folder:
        scene = opened(Path(folder), "".join(f"{BALL}material = {table}\n" for table in tables))
    glossy, glass, skin = (item.material for item in scene.objects)
    assert (glossy, glass) == (Gloss(gloss, exponent), Glass(index))
    assert isinstance(skin, Skin)
    assert skin.lobes == tuple(SkinLobe(*lobe) for lobe in lobes)


def test_glass_is_clear_unless_it_has_a_colour(tmp_path: Path) -> None:
    glass = 'material = { type = "glass" }\n'
    clear, green = opened(tmp_path, BALL + glass + CARD + glass + "albedo = [0.5, 1, 0.5]\n").objects
    assert (clear.albedo, green.albedo) == ((1, 1, 1), (0.5, 1, 0.5))


def test_skin_has_a_measured_profile_and_veins_from_a_picture_as_it_is(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "veins.png"), np.array([[0, 128, 255]], np.uint8))
    cv2.imwrite(str(tmp_path / "fine.png"), np.array([[0, 32768, 65535]], np.uint16))
    own = "lobes = [{ sigma_mm = 1.5, weight = [0.4, 0.3, 0.2] }], absorbed = 0.5, depth_mm = 3 }\n"
    text = f'{BALL}material = {{ type = "skin", veins = "veins.png" }}\n'
    text += f'{BALL}material = {{ type = "skin", veins = "fine.png", {own}'
    measured, given_ = (item.material for item in opened(tmp_path, text).objects)
    assert isinstance(measured, Skin)
    assert isinstance(given_, Skin)
    assert measured.veins is not None
    assert measured.veins.dtype == np.float32
    np.testing.assert_allclose(measured.veins, [[0, 128 / 255, 1]])
    assert measured.lobes == SKIN_LOBES
    assert given_.lobes == (SkinLobe(1.5, (0.4, 0.3, 0.2)),)
    assert (given_.absorbed, given_.depth_mm) == ((0.5,) * 3, 3)
    assert given_.veins is not None
    np.testing.assert_allclose(given_.veins, [[0, 32768 / 65535, 1]])


def test_veins_keep_texture_coordinates_and_need_them(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "veins.png"), np.array([[0, 255]], np.uint8))
    veins = 'material = { type = "skin", veins = "veins.png" }\n'
    mesh = '[[objects]]\ntype = "mesh"\nposition_m = [0, 0, 1]\nfile = "m.obj"\n'
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    (tmp_path / "m.obj").write_text(corners + "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    for colour in ("", "albedo = 0.5\n"):
        card, filed = opened(tmp_path, CARD + colour + veins + mesh + colour + veins).objects
        assert isinstance(card, Mesh)
        assert isinstance(filed, Mesh)
        assert card.uv is not None
        assert filed.uv is not None
        assert sorted(map(tuple, filed.uv)) == [(0, 0), (0, 1), (1, 1)]
        assert isinstance(filed.material, Skin)
    (tmp_path / "m.obj").write_text(corners + "f 1 2 3\n")
    assert "it has no texture coordinates" in refusal(tmp_path, mesh + veins)
