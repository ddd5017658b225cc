"""The contract of `render`: what the files hold, and that one number is the same wherever it is written."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray

from settings_inside import read_settings
from slopegate.app.cli import main
from slopegate.drivers.files.rig_files import load_rig, rig_to_toml
from slopegate.drivers.scenes.scene_files import scene_path

Array = NDArray[Any]
Capture = pytest.CaptureFixture[str]

PERIOD = 16666.7
ALBEDO, AMBIENT, DISTANCE = 0.5, 0.1, 1.05
LIT = ALBEDO / DISTANCE**2
ROOM = AMBIENT * ALBEDO
GATE = {"--clock-mhz": 78.0, "--delay-us": 2028.2, "--exposure-us": 400.0}

WALL = f"""
title = "Wall"
ambient = {AMBIENT}
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, {DISTANCE}]
width_m = 5.0
height_m = 5.0
albedo = {ALBEDO}
"""


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder with a small rig, the check rig binned 8 x 8, and a scene of one frontal wall that fills the view."""
    text = rig_to_toml(load_rig(None))
    binned = {
        "width = 1600": "width = 200",
        "height = 1200": "height = 150",
        "= 1666.6666666666667": "= 208.33333333333334",
    }
    binned |= {"cx = 800.0": "cx = 100.0", "cy = 600.0": "cy = 75.0", "= 996.66866": f"= {996.66866 * 8!r}"}
    for old, new in binned.items():
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "rig.toml").write_text(text, "utf-8")
    (tmp_path / "wall.toml").write_text(WALL, "utf-8")
    return tmp_path


def words(home: Path, out: str, *more: str, scene: str = "wall.toml", **changed: float) -> list[str]:
    gate = GATE | {f"--{name}": value for name, value in changed.items()}
    numbers = [f"{name}={value!r}" for name, value in gate.items()]
    where = str(home / scene) if "." in scene else scene
    return [
        "render",
        where,
        "--rig",
        str(home / "rig.toml"),
        *numbers,
        "--out",
        str(home / out),
        "--overwrite",
        *more,
        "--json",
    ]


def report(capsys: Capture, *command: str) -> dict[str, Any]:
    assert main(command) == 0
    out, err = capsys.readouterr()
    assert err == ""
    found = json.loads(out)
    assert isinstance(found, dict)
    return found


def rendered(capsys: Capture, home: Path, *more: str, **changed: Any) -> Array:
    report(capsys, *words(home, "image.npy", *more, **changed))
    return np.asarray(np.load(home / "image.npy"))


def test_one_period_is_the_fully_lit_image(capsys: Capture, home: Path) -> None:
    once = rendered(capsys, home, **{"exposure-us": PERIOD})
    assert once.shape == (150, 200)
    assert once.dtype == np.float32
    # The projector's frame does not reach the camera's lowest rows: there is the room's light alone.
    np.testing.assert_allclose(once[:100], LIT + ROOM, rtol=1e-5)
    twice = rendered(capsys, home, **{"exposure-us": 2 * PERIOD})
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-5)


def test_room_light_grows_with_the_exposure_and_projector_light_does_not(capsys: Capture, home: Path) -> None:
    for exposure in (400.0, 1600.0):
        image = rendered(capsys, home, **{"exposure-us": exposure})
        room = ROOM * exposure / PERIOD
        np.testing.assert_allclose(image[40:100], LIT + room, rtol=1e-5)
    missed = rendered(capsys, home, **{"delay-us": 1500.0})
    np.testing.assert_allclose(missed, ROOM * 400 / PERIOD, rtol=1e-5)


def test_a_gate_and_its_complement_make_the_fully_lit_image(capsys: Capture, home: Path) -> None:
    gate = {"clock-mhz": 70.0}
    slab = rendered(capsys, home, **gate)
    rest = rendered(capsys, home, "--complement", **gate)
    full = rendered(capsys, home, **gate, **{"exposure-us": PERIOD})
    assert 0.05 < np.mean(slab > LIT) < 0.95
    np.testing.assert_allclose(slab + rest, full, rtol=1e-5)


def test_mask_and_depth_say_what_the_image_shows(capsys: Capture, home: Path) -> None:
    files = ["--mask-out", str(home / "mask.png"), "--depth-out", str(home / "depth.npy")]
    image = rendered(capsys, home, *files, **{"clock-mhz": 70.0})
    mask = cv2.imread(str(home / "mask.png"), cv2.IMREAD_UNCHANGED)
    assert mask.dtype == np.uint8
    assert set(np.unique(mask)) == {0, 255}
    np.testing.assert_array_equal(mask == 255, image > LIT)
    depth = np.load(home / "depth.npy")
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, DISTANCE, rtol=1e-5)


def test_depth_is_unknown_where_nothing_stands(capsys: Capture, home: Path) -> None:
    (home / "small.toml").write_text(WALL.replace("5.0", "0.4"), "utf-8")
    files = ["--mask-out", str(home / "mask.png"), "--depth-out", str(home / "depth.npy")]
    found = report(capsys, *words(home, "image.npy", *files, scene="small.toml"))
    depth, image = np.load(home / "depth.npy"), np.load(home / "image.npy")
    assert 0 < np.isnan(depth).mean() < 1
    assert (image[np.isnan(depth)] == 0).all()
    mask = cv2.imread(str(home / "mask.png"), cv2.IMREAD_UNCHANGED) > 0
    assert not (mask & np.isnan(depth)).any()
    assert found["lit_fraction"] == pytest.approx(mask.mean())
    assert set(found["files"]) == {"image", "mask", "depth"}


def test_the_parts_of_an_image_add_up_to_it(capsys: Capture, home: Path) -> None:
    skin = """material = { type = "skin" }"""
    (home / "skin.toml").write_text(WALL.replace("albedo = 0.5", f"albedo = 0.5\n{skin}"), "utf-8")
    folder = home / "parts"
    found = report(capsys, *words(home, "image.npy", "--parts-out", str(folder), scene="skin.toml"))
    assert found["parts"] == ["direct", "subsurface", "ambient"]
    assert {path.name for path in folder.iterdir()} == {"direct.npy", "subsurface.npy", "ambient.npy"}
    image, parts = np.load(home / "image.npy"), {path.stem: np.load(path) for path in folder.iterdir()}
    assert all(light.dtype == np.float32 and light.max() > 0 for light in parts.values())
    np.testing.assert_allclose(sum(parts.values()), image, rtol=1e-6)
    only = report(capsys, *words(home, "only.npy", "--parts", "ambient", scene="skin.toml"))
    assert only["parts"] == ["ambient"]
    np.testing.assert_array_equal(np.load(home / "only.npy"), parts["ambient"])
    report(capsys, *words(home, "first.npy", "--max-order", "1", scene="skin.toml"))
    np.testing.assert_allclose(np.load(home / "first.npy"), parts["direct"] + parts["ambient"], rtol=1e-6)


@pytest.mark.parametrize("shape", [(3, 4), (720, 1280)])
def test_a_pattern_lights_the_wall_block_by_block_without_room_light(
    capsys: Capture, home: Path, shape: tuple[int, int]
) -> None:
    levels = np.random.default_rng(1).integers(0, 256, shape, np.uint8)
    cv2.imwrite(str(home / "pattern.png"), levels)
    words_of = ["--pattern", str(home / "pattern.png")]
    found = report(capsys, *words(home, "image.npy", *words_of, **{"exposure-us": PERIOD}))
    assert found["parts"] == ["direct"]
    assert found["pattern"] == str(home / "pattern.png")
    image, rig = np.load(home / "image.npy"), load_rig(home / "rig.toml")
    lens = rig.camera.lens
    rays = rig.camera_rays(np.arange(lens.width) + 0.5, np.arange(lens.height)[:, None] + 0.5)
    column, row, _ = rig.to_projector(rig.camera_centre_m + DISTANCE * rays)
    seen = (column >= 0) & (column < 1280) & (row >= 0) & (row < 720)
    i, j = (row[seen] * shape[0] // 720).astype(int), (column[seen] * shape[1] // 1280).astype(int)
    assert (abs(image[seen] - LIT * levels[i, j] / 255) < 1e-6).mean() > 0.999
    assert (image[~seen] == 0).all()
    assert seen[:100].all()
    report(capsys, *words(home, "both.npy", *words_of, "--parts", "direct,ambient", **{"exposure-us": PERIOD}))
    np.testing.assert_allclose(np.load(home / "both.npy") - image, ROOM, rtol=1e-4)


def test_a_white_pattern_is_no_pattern(capsys: Capture, home: Path) -> None:
    cv2.imwrite(str(home / "white.png"), np.full((7, 9), 255, np.uint8))
    plain = rendered(capsys, home, "--parts", "direct", "--samples", "2")
    lit = rendered(capsys, home, "--pattern", str(home / "white.png"), "--samples", "2")
    np.testing.assert_array_equal(lit, plain)


@pytest.mark.parametrize(
    ("pattern", "named"),
    [("nowhere.png", "missing"), ("wall.toml", "is no PNG"), ("big.png", "1281 x 720 pixels"), ("deep.png", "16 bits")],
)
def test_a_pattern_that_cannot_be_shown_is_told_in_one_sentence(
    capsys: Capture, home: Path, pattern: str, named: str
) -> None:
    cv2.imwrite(str(home / "big.png"), np.zeros((720, 1281), np.uint8))
    cv2.imwrite(str(home / "deep.png"), np.zeros((7, 9), np.uint16))
    assert main(words(home, "image.npy", "--pattern", str(home / pattern))) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert named in err
    assert not (home / "image.npy").exists()


def test_a_part_that_the_scene_has_nothing_of_is_black(capsys: Capture, home: Path) -> None:
    report(capsys, *words(home, "fog.npy", "--parts", "airlight,scatter,subsurface"))
    assert (np.load(home / "fog.npy") == 0).all()


@pytest.mark.parametrize(
    ("option", "value", "named"),
    [
        ("--parts", "direct,mist", "'mist' is no part of the light"),
        ("--max-order", "0", "from 1 to 1000"),
        ("--paths", "0", "from 1 to 1000000"),
        ("--error", "-1", "from 0.01 to 100"),
        ("--parts-out", "wall.toml", "is a file"),
        ("--parts-out", "nowhere/parts", "there is no folder"),
    ],
)
def test_bad_wishes_about_parts_are_told_in_one_sentence(
    capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch, option: str, value: str, named: str
) -> None:
    monkeypatch.chdir(home)
    assert main(words(home, "image.npy", option, value)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert named in err
    assert not (home / "image.npy").exists()


def test_every_format_holds_the_same_light(capsys: Capture, home: Path) -> None:
    signal = rendered(capsys, home, **{"clock-mhz": 70.0})
    report(capsys, *words(home, "image.exr", **{"clock-mhz": 70.0}))
    with OpenEXR.File(str(home / "image.exr")) as image:
        np.testing.assert_array_equal(image.channels()["Y"].pixels, signal)
    sensor = report(capsys, *words(home, "image.tif", **{"clock-mhz": 70.0}))["sensor"]
    counts = tifffile.imread(home / "image.tif")
    assert counts.dtype == np.uint16
    expected = np.clip(signal * sensor["counts_per_unit"] + sensor["black_count"], 0, 4095)
    assert np.abs(counts - expected).max() <= 0.5 + 1e-3
    report(capsys, *words(home, "image.png", **{"clock-mhz": 70.0}))
    np.testing.assert_array_equal(cv2.imread(str(home / "image.png"), cv2.IMREAD_UNCHANGED), counts)


def test_counts_saturate_at_twelve_bits(capsys: Capture, home: Path) -> None:
    report(capsys, *words(home, "image.tif", **{"exposure-us": 3 * PERIOD}))
    assert tifffile.imread(home / "image.tif").max() == 4095


def test_noise_is_the_same_for_the_same_seed(capsys: Capture, home: Path) -> None:
    clean = report(capsys, *words(home, "clean.tif"))["sensor"]
    noisy = []
    for seed in ("3", "3", "4"):
        found = report(capsys, *words(home, "noisy.png", "--noise", "--seed", seed))
        assert (found["noise"], found["seed"], found["unit"]) == (True, int(seed), "counts")
        noisy.append(cv2.imread(str(home / "noisy.png"), cv2.IMREAD_UNCHANGED))
    np.testing.assert_array_equal(noisy[0], noisy[1])
    assert (noisy[0] != noisy[2]).mean() > 0.5
    lit = tifffile.imread(home / "clean.tif")[45:95].astype(float)
    error = noisy[0][45:95] - lit
    electrons = (lit - clean["black_count"]) * clean["electrons_per_count"]
    sigma = np.sqrt(electrons + clean["read_noise_e"] ** 2) / clean["electrons_per_count"]
    assert abs(error.mean()) < 5 * sigma.mean() / np.sqrt(error.size) + 0.5
    assert error.std() == pytest.approx(sigma.mean(), rel=0.05)
    linear = rendered(capsys, home, "--noise", "--seed", "3")
    assert linear.dtype == np.float32
    np.testing.assert_array_equal(linear, noisy[0])


def test_colour_has_the_luminance_of_the_grey_image(capsys: Capture, home: Path) -> None:
    (home / "red.toml").write_text(WALL.replace(f"albedo = {ALBEDO}", "albedo = [0.8, 0.4, 0.1]"), "utf-8")
    colour = rendered(capsys, home, "--colour", scene="red.toml")
    grey = rendered(capsys, home, scene="red.toml")
    assert colour.shape == (150, 200, 3)
    np.testing.assert_allclose(
        colour[60, 100], np.array([0.8, 0.4, 0.1]) * (LIT + ROOM * 400 / PERIOD) / ALBEDO, rtol=1e-5
    )
    np.testing.assert_allclose(colour @ [0.2126, 0.7152, 0.0722], grey, rtol=1e-5)
    report(capsys, *words(home, "image.png", "--colour", scene="red.toml"))
    blue, green, red = cv2.imread(str(home / "image.png"), cv2.IMREAD_UNCHANGED)[60, 100]
    assert red > green > blue


def test_samples_soften_the_staircase_at_the_edges_and_nothing_else(capsys: Capture, home: Path) -> None:
    # An upright slab cuts a wall that turns away to the right, so its edges run down the image.
    (home / "turned.toml").write_text(WALL + "yaw_deg = 30\n", "utf-8")
    more = ["--depth-out", str(home / "depth.npy")]
    seen = slice(0, 110)  # above where the projector's frame ends, which is an edge of another kind
    hard = rendered(capsys, home, *more, scene="turned.toml")[seen]
    found = report(capsys, *words(home, "soft.npy", "--samples", "3", scene="turned.toml"))
    soft = np.load(home / "soft.npy")[seen]
    # All rays of a row share its window: a staircase of B / (2 f_c b) in 1/z, and the ray's place within its pixel.
    inverse_depth = 1 / np.load(home / "depth.npy")[seen]
    edges = (1 / found["slab"]["near_m"], 1 / found["slab"]["far_m"])
    distance = np.minimum(*(np.abs(inverse_depth - edge) for edge in edges))
    stairs = 1 / (2 * 208.333 * 0.1) + np.abs(np.diff(inverse_depth)).max()
    differs = np.abs(hard - soft) > 0.02 * hard.max()
    assert distance[differs].max() <= stairs
    assert differs[distance < stairs / 2].mean() > 0.5


def test_the_settings_inside_the_picture_are_those_of_the_answer(capsys: Capture, home: Path) -> None:
    answer = report(capsys, *words(home, "image.png", "--noise"))
    inside = read_settings(home / "image.png")
    rig = inside.pop("rig_toml")
    assert rig == rig_to_toml(load_rig(home / "rig.toml"))
    files = answer.pop("files")
    assert files == {"image": str(home / "image.png")}
    assert inside == answer
    assert answer["settings"] == {
        "clock_mhz": 78.0,
        "line_time_us": pytest.approx(996.66866 * 8 / 78),
        "delay_us": 2028.2,
        "exposure_us": 400.0,
        "complement": False,
    }
    assert answer["slab"]["distance_m"] == pytest.approx(1.05, abs=1e-3)


def test_a_clock_off_the_ladder_is_rendered_as_asked_and_said(capsys: Capture, home: Path) -> None:
    found = report(capsys, *words(home, "image.npy", **{"clock-mhz": 77.3, "delay-us": 2000.0}))
    assert found["settings"]["clock_mhz"] == pytest.approx(77.3)
    (warning,) = found["warnings"]
    assert "77.3 MHz" in warning


def test_a_moving_scene_has_its_instants(capsys: Capture, home: Path) -> None:
    depths = []
    for instant in ("0", "0", "1.5"):
        more = ["--time-s", instant, "--depth-out", str(home / "depth.npy")]
        report(capsys, *words(home, "image.npy", *more, scene="door"))
        depths.append(np.load(home / "depth.npy"))
    np.testing.assert_array_equal(depths[0], depths[1])
    assert (np.abs(depths[0] - depths[2]) > 0.01).any()


def test_a_broken_scene_leaves_old_files_alone(capsys: Capture, home: Path) -> None:
    (home / "image.npy").write_bytes(b"old")
    (home / "wall.toml").write_text(WALL.replace("albedo", "albedoo"), "utf-8")
    assert main(words(home, "image.npy")) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "albedoo" in err
    assert (home / "image.npy").read_bytes() == b"old"


@pytest.mark.parametrize("option", ["--out", "--mask-out", "--depth-out", "--parts-out"])
def test_nothing_is_overwritten_unasked(capsys: Capture, home: Path, option: str) -> None:
    names = {"--out": "a.npy", "--mask-out": "m.png", "--depth-out": "d.npy", "--parts-out": "parts/direct.npy"}
    old = home / names[option]
    old.parent.mkdir(exist_ok=True)
    old.write_bytes(b"old")
    given = {name: str(home / file.split("/")[0]) for name, file in names.items()}
    asked = [word for word in words(home, "a.npy") if word != "--overwrite"]
    more = [word for name in ("--mask-out", "--depth-out", "--parts-out") for word in (name, given[name])]
    assert main([*asked, *more]) == 2
    assert f"{old} exists already: take another name, or allow to overwrite it" in capsys.readouterr().err
    assert old.read_bytes() == b"old"
    report(capsys, *asked, *more, "--overwrite")
    assert old.read_bytes() != b"old"


def test_the_real_program_renders_for_people(home: Path) -> None:
    command = [sys.executable, "-W", "error", "-m", "slopegate.app", *words(home, "image.png")[:-1]]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=280)
    assert "Wall on Check rig, 200 x 150 pixels" in done.stdout
    assert str(home / "image.png") in done.stdout
    assert "warning: the camera would round the delay" in done.stderr


def plane_distances(folder: Path, depth: Array) -> tuple[Array, list[float]]:
    """Distance of every pixel's surface from the capture's main plane, and the plane as a, b, c, d."""
    facts = json.loads((folder / "scene.json").read_text("utf-8"))
    plane, lens = facts["planes"][0], facts["intrinsics"]
    normal, offset = plane["normal"], plane["distance_m"]
    rows, columns = np.indices(depth.shape)
    x, y = (columns - lens["cx"]) / lens["fx"] * depth, (rows - lens["cy"]) / lens["fy"] * depth
    distance = normal[0] * x + normal[1] * y + normal[2] * depth
    sign = 1 if abs(np.nanmedian(distance + offset)) < abs(np.nanmedian(distance - offset)) else -1
    return np.abs(distance + sign * offset), [*normal, sign * offset]


# A gate cannot lean sideways, as the measured planes do a little: across a wide floor the slab must be thicker.
@pytest.mark.parametrize(
    ("name", "thickness_m"),
    [("floor_3bottles", 0.06), ("floor_bottles_chair", 0.16), ("osd_table_2cans", 0.06), ("five_people", 0.08)],
)
def test_a_gate_on_a_measured_plane_lights_it_and_not_what_stands_on_it(
    capsys: Capture, tmp_path: Path, shared: Callable[[str], Path], name: str, thickness_m: float
) -> None:
    folder = shared(f"data/scenes/{name}")
    out, mask_out, depth_out = (tmp_path / file for file in ("image.png", "mask.png", "depth.npy"))
    files = ["--out", str(out), "--mask-out", str(mask_out), "--depth-out", str(depth_out)]
    flood = ["--clock-mhz", "78", "--delay-us", "0", "--exposure-us", repr(PERIOD)]
    report(capsys, "render", str(folder), *flood, *files, "--json")
    lit = cv2.imread(str(mask_out), cv2.IMREAD_UNCHANGED) > 0
    distance, plane = plane_distances(folder, np.load(depth_out))
    coefficients = ",".join(map(repr, plane))
    wish = ["--plane", coefficients, "--thickness-m", repr(thickness_m), "--scene", str(folder)]
    found = report(capsys, "plan", *wish, "--json")
    on, off = lit & (distance < 0.01), lit & (distance > 2 * thickness_m)
    assert on.sum() > 5000
    assert off.sum() > 1000
    for settings in (found["exact"], found):
        gate = [f"--{key.replace('_', '-')}={settings[key]!r}" for key in ("clock_mhz", "delay_us", "exposure_us")]
        report(capsys, "render", str(folder), *gate, *files, "--overwrite", "--json")
        gated = cv2.imread(str(mask_out), cv2.IMREAD_UNCHANGED) > 0
        assert gated[on].mean() > 0.99
        assert gated[off].mean() < 0.01


def test_a_photo_with_depth_in_fog_says_what_it_has_not(capsys: Capture, home: Path) -> None:
    fog = "[fog]\nvisibility_m = 3.0\n"
    (home / "aloe.toml").write_text(f"capture = {str(scene_path('aloe'))!r}\n{fog}", "utf-8")
    assert main(words(home, "image.npy", scene="aloe.toml")) == 0
    out, _ = capsys.readouterr()
    found = json.loads(out)
    assert any("indirect light is left out" in warning for warning in found["warnings"])
    assert found["parts"] == ["direct", "airlight", "scatter", "indirect", "ambient"]
