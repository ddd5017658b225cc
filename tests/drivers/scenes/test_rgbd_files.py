import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rigs import calibrated
from slopegate.core.gating.gate import slab, slope_ratio
from slopegate.core.rig.rig import Rig, RigCamera
from slopegate.core.rig.settings import LineTimes, PixelClocks
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import MeasuredScene
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.scenes.rgbd_files import rig_of_capture
from slopegate.drivers.scenes.scene_files import SceneError, open_scene

RIG = load_rig(None)
DATA = Path(__file__).parents[4] / "shared" / "data" / "scenes"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the shared captures are not here")
FOLDERS = sorted(path.name for path in DATA.iterdir()) if DATA.is_dir() else []
FACTS: dict[str, Any] = {"intrinsics": {"fx": 50.0, "fy": 60.0, "cx": 1.5, "cy": 1.0}}
DEPTH_MM = np.array([[0, 1000, 2000, 65535], [500, 1500, 2500, 3000], [1, 2, 3, 4]], np.uint16)
PHOTO = np.full((3, 4, 3), 255, np.uint8)


def folder_with(folder: Path, facts: dict[str, Any] | None = None, **maps: NDArray[Any]) -> Path:
    """A capture: photo, scene.json and the given maps (`.npy` for floats, `.png` for whole numbers)."""
    cv2.imwrite(str(folder / "color.png"), PHOTO)
    (folder / "scene.json").write_text(json.dumps(FACTS if facts is None else facts))
    for name, values in maps.items():
        if values.dtype.kind == "f":
            np.save(folder / f"{name}.npy", values)
        else:
            cv2.imwrite(str(folder / f"{name}.png"), values)
    return folder


def opened(folder: Path) -> tuple[Rig, MeasuredScene]:
    rig, scene = open_scene(folder, RIG)
    assert scene.capture is not None
    assert rig.camera.lens == scene.capture.lens
    return rig, scene.capture


def refusal(path: Path) -> str:
    with pytest.raises(SceneError) as caught:
        open_scene(path, RIG)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_lens_of_a_photo_is_not_the_one_that_was_calibrated(tmp_path: Path) -> None:
    known = calibrated(RIG)
    _, capture = opened(folder_with(tmp_path, depth_mm=DEPTH_MM))
    assert rig_of_capture(known, capture.lens).calibration is None
    assert rig_of_capture(known, known.camera.lens).calibration == known.calibration


def test_depth_in_millimetres_becomes_inverse_depth_and_none_becomes_zero(tmp_path: Path) -> None:
    _, capture = opened(folder_with(tmp_path, depth_mm=DEPTH_MM))
    assert capture.inverse_depth.dtype == np.float32
    assert capture.inverse_depth[0].tolist() == [0, 1, 0.5, 0]
    np.testing.assert_allclose(capture.inverse_depth[1], [2, 2 / 3, 0.4, 1 / 3], rtol=1e-7)


def test_the_first_pixels_centre_moves_from_0_to_one_half(tmp_path: Path) -> None:
    _, capture = opened(folder_with(tmp_path, depth_mm=DEPTH_MM))
    lens = capture.lens
    assert (lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy) == (4, 3, 50, 60, 2.0, 1.5)


def test_the_photo_is_linear_light(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, depth_mm=DEPTH_MM)
    cv2.imwrite(str(folder / "color.png"), np.full((3, 4, 3), (0, 128, 255), np.uint8))
    _, capture = opened(folder)
    np.testing.assert_allclose(capture.photo[2, 3], [1, 0.2158605, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "facts", "scale"),
    [
        ("depth_m", {}, 1.0),
        ("depth_cm", {}, 0.01),
        ("depth", {"depth_scale_m": 0.0002}, 0.0002),
        ("depth", {"depth_units": "millimetre, uint16, 0 = no data"}, 0.001),
        ("depth", {"depth_units": "metres"}, 1.0),
    ],
)
def test_the_unit_of_depth_is_named_by_file_or_json(
    tmp_path: Path, name: str, facts: dict[str, Any], scale: float
) -> None:
    _, capture = opened(folder_with(tmp_path, FACTS | facts, **{name: DEPTH_MM}))
    np.testing.assert_allclose(capture.inverse_depth[1], 1 / (DEPTH_MM[1] * scale), rtol=1e-6)


@pytest.mark.parametrize("units", [None, "micrometre"])
def test_depth_without_a_known_unit_is_not_guessed(tmp_path: Path, units: str | None) -> None:
    facts = FACTS if units is None else FACTS | {"depth_units": units}
    assert "has no unit" in refusal(folder_with(tmp_path, facts, depth=DEPTH_MM))


def test_values_that_are_no_depth_are_missing_light(tmp_path: Path) -> None:
    bad = np.array([[math.nan, math.inf, -math.inf, -1.0], [0.0, 1e-300, 1e300, 5e-324], [2.0, 4.0, 1.0, 0.5]])
    _, capture = opened(folder_with(tmp_path, depth_m=bad))
    assert np.isfinite(capture.inverse_depth).all()
    assert not capture.inverse_depth[:2].any()
    assert capture.inverse_depth[2].tolist() == [0.5, 0.25, 1, 2]


def test_disparity_uses_focal_baseline_and_offset(tmp_path: Path) -> None:
    stereo = {"focal_px": 100.0, "baseline_m": 0.2, "disparity_offset_px": 5.0}
    disparity = np.array([[0, 640, 320, 64]] * 3, np.uint16)
    facts = FACTS | {"stereo": stereo, "disparity": {"encoding": "uint16 = disparity_px * 64; 0 = unknown"}}
    _, capture = opened(folder_with(tmp_path, facts, disparity=disparity))
    np.testing.assert_allclose(capture.inverse_depth[0], [0, 15 / 20, 10 / 20, 6 / 20], rtol=1e-6)
    floats = np.array([[math.nan, 10.0, -3.0, math.inf]] * 3)
    (tmp_path / "disparity.png").unlink()
    _, capture = opened(folder_with(tmp_path, facts | {"disparity": {}}, disparity=floats))
    np.testing.assert_allclose(capture.inverse_depth[0], [0, 15 / 20, 0, 0], rtol=1e-6)


def test_a_negative_offset_never_turns_depth_round(tmp_path: Path) -> None:
    stereo = {"focal_px": 100.0, "baseline_m": 0.2, "disparity_offset_px": -5.0}
    _, capture = opened(folder_with(tmp_path, FACTS | {"stereo": stereo}, disp=np.array([[4.0, 5.0, 6.0, 10.0]] * 3)))
    np.testing.assert_allclose(capture.inverse_depth[0], [0, 0, 1 / 20, 5 / 20], rtol=1e-6)


def test_depth_is_preferred_to_disparity(tmp_path: Path) -> None:
    _, capture = opened(folder_with(tmp_path, depth_mm=DEPTH_MM, disparity=np.full((3, 4), 9, np.uint16)))
    assert capture.inverse_depth[0, 1] == 1


def test_a_focal_length_alone_puts_the_axis_in_the_middle(tmp_path: Path) -> None:
    facts = {"stereo": {"focal_px": 100.0, "baseline_m": 0.2}}
    _, capture = opened(folder_with(tmp_path, facts, disparity=np.full((3, 4), 9.0)))
    assert (capture.lens.fx, capture.lens.cx, capture.lens.cy) == (100, 2.0, 1.5)


def test_distortion_of_the_captures_own_lens_is_kept(tmp_path: Path) -> None:
    facts = {"intrinsics": FACTS["intrinsics"] | {"distortion": [0.1, -0.05, 0.0, 0.0]}}
    _, capture = opened(folder_with(tmp_path, facts, depth_mm=DEPTH_MM))
    assert capture.lens.distortion == (0.1, -0.05, 0.0, 0.0)


def test_b_keeps_its_clock_with_the_captures_lens(tmp_path: Path) -> None:
    rig, _ = opened(folder_with(tmp_path, depth_mm=DEPTH_MM))
    line = rig.camera.shutter.line
    assert isinstance(line, PixelClocks)
    assert slope_ratio(rig, line.line_time_us(78)) == pytest.approx(1, abs=1e-7)
    assert (rig.projector, rig.projector_offset_m) == (RIG.projector, RIG.projector_offset_m)
    assert (rig.camera.shutter.delay_us, rig.camera.shutter.exposure_us) == (
        RIG.camera.shutter.delay_us,
        RIG.camera.shutter.exposure_us,
    )


def test_a_camera_with_line_times_keeps_its_range_of_b(tmp_path: Path) -> None:
    shutter = replace(RIG.camera.shutter, line=LineTimes(10.0, 30.0, 0.5))
    start = replace(RIG, camera=RigCamera(RIG.camera.lens, shutter))
    rig, _ = open_scene(folder_with(tmp_path, depth_mm=DEPTH_MM), start)
    line = rig.camera.shutter.line
    assert isinstance(line, LineTimes)
    assert slope_ratio(rig, line.max_us) == pytest.approx(slope_ratio(start, 30.0))


def test_gates_of_a_capture_are_planned_for_its_own_camera(tmp_path: Path) -> None:
    gates = [{"name": "wall", "tilt_deg": 0, "distance_m": 2.0, "thickness_m": 0.3}]
    rig, scene = open_scene(folder_with(tmp_path, FACTS | {"gates": gates, "title": "T"}, depth_mm=DEPTH_MM), RIG)
    assert scene.name == "T"
    assert slab(rig, scene.gates[0].settings).distance_m == pytest.approx(2.0, abs=0.05)


def test_a_scene_file_names_a_capture_and_its_gates(tmp_path: Path) -> None:
    gates = [{"name": "theirs", "tilt_deg": 0, "distance_m": 1.0, "thickness_m": 0.3}]
    (tmp_path / "theirs").mkdir()
    folder = folder_with(tmp_path / "theirs", FACTS | {"gates": gates, "title": "T"}, depth_mm=DEPTH_MM)
    path = tmp_path / "mine.toml"
    path.write_text('title = "Mine"\nambient = 0.25\ncapture = "theirs"\n')
    rig, scene = open_scene(path, RIG)
    assert (scene.name, scene.ambient, scene.gates[0].name) == ("Mine", 0.25, "theirs")
    np.testing.assert_array_equal(scene.capture.inverse_depth, opened(folder)[1].inverse_depth)
    mine = '[[gates]]\nname = "mine"\ntilt_deg = 0\ndistance_m = 2.0\nthickness_m = 0.3\n'
    path.write_text('capture = "theirs"\n' + mine)
    _, scene = open_scene(path, RIG)
    assert (scene.name, [gate.name for gate in scene.gates]) == ("T", ["mine"])
    assert slab(rig, scene.gates[0].settings).distance_m == pytest.approx(2.0, abs=0.05)


def test_a_capture_may_have_fog_and_a_scene_file_may_change_it(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FACTS | {"fog": {"scattering_per_m": 0.5}, "indirect": True}, depth_mm=DEPTH_MM)
    own = open_scene(folder, RIG)[1]
    assert (own.fog, own.indirect) == (Fog(0.5), True)
    text = 'capture = "."\n'
    for added, fog, indirect in (
        ("", Fog(0.5), True),
        ("indirect = false\n", Fog(0.5), False),
        ("[fog]\nscattering_per_m = 0\n", Fog(0.0), True),
        ("[fog]\nabsorption_per_m = 2\nhi_m = [1, 1, 1]\n", Fog(0, 2, hi_m=(1, 1, 1)), True),
    ):
        path = tmp_path / "scene.toml"
        path.write_text(text + added, encoding="utf-8")
        scene = open_scene(path, RIG)[1]
        assert (scene.fog, scene.indirect) == (fog, indirect)


Change = Callable[[Path], object]


def change_json(**facts: Any) -> Change:
    return lambda folder: (folder / "scene.json").write_text(json.dumps(FACTS | facts))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda folder: (folder / "color.png").unlink(), "has no photo: a file such as color.png"),
        (lambda folder: (folder / "depth_mm.png").unlink(), "has no depth: "),
        (
            lambda folder: (folder / "scene.json").unlink(),
            "scene.json is missing: it must give the camera's intrinsics",
        ),
        (lambda folder: (folder / "color.png").write_bytes(b""), "color.png is empty (0 bytes)"),
        (lambda folder: (folder / "depth_mm.png").write_bytes(b""), "depth_mm.png is empty (0 bytes)"),
        (lambda folder: (folder / "scene.json").write_text(""), "scene.json is empty (0 bytes)"),
        (lambda folder: (folder / "scene.json").write_text("{"), "scene.json is not valid JSON"),
        (lambda folder: (folder / "scene.json").write_text("[" * 100_000), "scene.json is not valid JSON"),
        (lambda folder: (folder / "scene.json").write_text("[]"), "scene.json"),
        (lambda folder: (folder / "depth_mm.png").write_bytes(b"no picture"), "depth_mm.png cannot be decoded"),
        (
            lambda folder: cv2.imwrite(str(folder / "depth_mm.png"), DEPTH_MM[:2]),
            "depth_mm.png has 4 x 2 pixels, but color.png has 4 x 3",
        ),
        (lambda folder: cv2.imwrite(str(folder / "depth_mm.png"), DEPTH_MM * 0), "holds no usable value at all"),
        (lambda folder: cv2.imwrite(str(folder / "depth_mm.png"), PHOTO), "one plane of numbers is needed"),
        (change_json(fog={"g": 0.5}), "fog has no density"),
        (change_json(fog={"scattering_per_m": 1, "g": 2}), "scene.json: fog.g is 2.0: it must be between -1 and 1"),
        (change_json(width=5), "scene.json has 5 x 3 pixels, but color.png has 4 x 3"),
        (change_json(width="wide"), "scene.json: width is 'wide'"),
        (change_json(intrinsics={}), "scene.json has no calibration: intrinsics (fx, fy, cx, cy)"),
        (change_json(intrinsics=None), "scene.json: intrinsics is missing"),
        (change_json(intrinsics={"fx": 5, "fy": 5, "cx": 1}), "no calibration: intrinsics.cy must be given"),
        (
            change_json(intrinsics={"fx": -5, "fy": 5, "cx": 1, "cy": 1}),
            "intrinsics.fx is -5: it must be a finite number",
        ),
        (change_json(intrinsics=FACTS["intrinsics"] | {"distortion": [1.0]}), "intrinsics.distortion is [1.0]"),
        (change_json(gates=[{"name": "g"}]), "gates[0] must have exactly one of these sets"),
        (change_json(gates=3), "gates is 3"),
        (change_json(depth_scale_m=math.nan), "depth_scale_m is nan"),
    ],
)
def test_what_is_missing_or_wrong_is_one_sentence(tmp_path: Path, change: Change, words: str) -> None:
    folder = folder_with(tmp_path, depth_mm=DEPTH_MM)
    change(folder)
    assert words in refusal(folder)


def with_intrinsics(**numbers: float) -> dict[str, Any]:
    return {"intrinsics": {**FACTS["intrinsics"], **numbers}}


@pytest.mark.parametrize(
    ("facts", "sentence"),
    [
        (
            with_intrinsics(fx=0.0006),
            r"scene.json: intrinsics.fx is 0.0006: it must be a focal length in pixels, from 0.4 to",
        ),
        (with_intrinsics(fy=35e6), r"scene.json: intrinsics.fy is 35000000.0: it must be a focal length in pixels"),
        (
            with_intrinsics(fy=5.0),
            r"intrinsics.fy is 5.0: it must be within a factor of 4 of intrinsics.fx, which is 50",
        ),
        (
            with_intrinsics(cx=5000.0),
            r"intrinsics.cx is 5000.0: it must be within -4..8: in the picture, or at most 4 pixels",
        ),
        (with_intrinsics(cy=-99.0), r"intrinsics.cy is -99.0: it must be within -4..7: in the picture"),
        ({"stereo": {"focal_px": 0.02}}, r"scene.json: stereo.focal_px is 0.02: it must be a focal length in pixels"),
    ],
)
def test_a_calibration_that_no_camera_has_is_told_with_its_key(
    tmp_path: Path, facts: dict[str, Any], sentence: str
) -> None:
    assert re.search(sentence, refusal(folder_with(tmp_path, facts, depth_mm=DEPTH_MM)))


@pytest.mark.parametrize(
    ("depth_m", "sentence"),
    [
        (
            np.full((3, 4), 2.5e7),
            "depth_m.npy puts the nearest surface at 2.5e+07 m and the farthest at 2.5e+07 m: most",
        ),
        (
            np.full((3, 4), 1e-5),
            "puts the nearest surface at 1e-05 m and the farthest at 1e-05 m: most must lie between",
        ),
        (np.full((3, 4), 1e30), "holds no usable value|puts the nearest surface at 1e+30 m"),
    ],
)
def test_surfaces_where_none_can_be_are_told_with_their_distance(
    tmp_path: Path, depth_m: NDArray[Any], sentence: str
) -> None:
    told = refusal(folder_with(tmp_path, depth_m=depth_m))
    assert any(part in told for part in sentence.split("|"))


def test_the_factor_of_a_depth_scale_the_wrong_way_round_is_told(tmp_path: Path) -> None:
    told = refusal(folder_with(tmp_path, {**FACTS, "depth_scale_m": 5000}, depth=DEPTH_MM[:2].repeat(2, axis=0)[:3]))
    assert "puts the nearest surface at 2.5e+06 m" in told
    assert told.endswith("(depth_scale_m is 5000 metres per stored unit; 0.0002 if 5000 units are a metre)")


def test_single_depths_of_no_surface_are_left_out_and_remarked(tmp_path: Path) -> None:
    depth_m = np.array([[1.0, 2.0, 3.0, 4.0], [1e5, 1e-4, 0.0, np.nan], [5.0, 6.0, 7.0, 8.0]])
    _, scene = open_scene(folder_with(tmp_path, depth_m=depth_m), RIG)
    assert scene.capture is not None
    assert scene.capture.inverse_depth[1].tolist() == [0, 0, 0, 0]
    (remark,) = scene.remarks
    assert remark.endswith("depth_m.npy: 2 of 10 depths are nearer than 0.001 m or beyond 10000 m, left out")


def test_a_map_with_hardly_a_depth_is_told(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "color.png"), np.zeros((30, 40, 3), np.uint8))
    (tmp_path / "scene.json").write_text(json.dumps(with_intrinsics(cx=20.0, cy=15.0)))
    depth = np.zeros((30, 40))
    depth[0, :6] = 1.0
    np.save(tmp_path / "depth_m.npy", depth)
    assert "depth_m.npy has a depth at 6 of 1200 pixels (0.5 %): at least 1 % of them must have one" in refusal(
        tmp_path
    )
    depth[0, :12] = 1.0
    np.save(tmp_path / "depth_m.npy", depth)
    open_scene(tmp_path, RIG)


@pytest.mark.parametrize(
    ("case", "sentence"),
    [
        ("capture_out_of_view/cx_5000", "scene.json: intrinsics.cx is 5000.0: it must be within"),
        ("capture_out_of_view/depth_scale_5000", "depth.png puts the nearest surface at "),
        ("focal_length_not_pixels/folder", "scene.json: intrinsics.fx is "),
        ("pfm_header/three_channels", "depth_m.pfm is a PFM of three channels"),
    ],
)
def test_the_cases_that_cannot_be_meant(shared: Callable[[str], Path], case: str, sentence: str) -> None:
    assert sentence in refusal(shared(f"cases/{case}"))


@pytest.mark.parametrize(
    "case", ["exr_depth_alpha/folder", "tiff_lzw/depth_by_opencv", "tiff_lzw/photo_by_opencv", "pfm_header/comment"]
)
def test_the_cases_that_open(shared: Callable[[str], Path], case: str) -> None:
    _, capture = opened(shared(f"cases/{case}"))
    known = capture.inverse_depth[capture.inverse_depth > 0]
    assert 1 / known.max() == pytest.approx(1.0, abs=1e-3)
    assert 1 / known.min() == pytest.approx(1.636, abs=1e-3)


def test_a_truncated_depth_map_is_refused(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, depth_mm=np.random.default_rng(1).integers(1, 60000, (3, 4)).astype(np.uint16))
    path = folder / "depth_mm.png"
    path.write_bytes(path.read_bytes()[:-20])
    assert "depth_mm.png cannot be decoded" in refusal(folder)


def test_disparity_without_its_scale_or_baseline(tmp_path: Path) -> None:
    whole = np.full((3, 4), 9, np.uint16)
    stereo = {"focal_px": 100.0, "baseline_m": 0.2}
    assert "disparity.counts_per_px" in refusal(folder_with(tmp_path, FACTS | {"stereo": stereo}, disparity=whole))
    assert "no calibration: stereo.baseline_m must be given" in refusal(folder_with(tmp_path, FACTS))


def test_a_folder_that_is_no_scene(tmp_path: Path) -> None:
    assert "is no scene: it must hold a photo" in refusal(tmp_path)
    (tmp_path / "notes.txt").write_text("x")
    assert "is no scene" in refusal(tmp_path)


def test_the_json_itself_can_be_opened(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, depth_mm=DEPTH_MM)
    (rig, capture), (same_rig, same) = opened(folder), opened(folder / "scene.json")
    assert rig == same_rig
    np.testing.assert_array_equal(same.inverse_depth, capture.inverse_depth)
    np.testing.assert_array_equal(same.photo, capture.photo)


@needs_data
@pytest.mark.parametrize("name", FOLDERS)
def test_every_shared_capture_opens_or_says_what_is_missing(name: str) -> None:
    facts = json.loads((DATA / name / "scene.json").read_text())
    if not (DATA / name / "color.png").exists():
        assert "has no photo" in refusal(DATA / name)
        return
    if "intrinsics" not in facts:
        message = refusal(DATA / name)
        assert "focal_px" in message
        assert "stereo.baseline_m" in message
        return
    _, capture = opened(DATA / name)
    known = capture.inverse_depth > 0
    assert known.mean() == pytest.approx(facts["valid_fraction"], abs=1e-3)
    assert np.median(1 / capture.inverse_depth[known]) == pytest.approx(facts["depth_m"]["median"], abs=2e-3)


@needs_data
@pytest.mark.parametrize("name", [name for name in FOLDERS if (DATA / name / "depth_mm.png").exists()])
def test_the_main_plane_of_a_capture_lies_where_its_file_says(name: str) -> None:
    if not (DATA / name / "color.png").exists():
        pytest.skip("this one has no photo")
    fitted = json.loads((DATA / name / "scene.json").read_text())["planes"][0]
    line = fitted["inverse_depth_per_px"]
    _, capture = opened(DATA / name)
    v, u = np.mgrid[: capture.lens.height, : capture.lens.width]
    known = capture.inverse_depth > 0
    residual = (capture.inverse_depth - (line["a_u"] * u + line["b_v"] * v + line["c"]))[known]
    # Inliers of the fit lie within a few of its rms; in metres that is residual times depth squared.
    off_m = np.abs(residual) / capture.inverse_depth[known] ** 2
    assert (off_m < 0.05).mean() > 0.6 * fitted["inlier_fraction"]
    normal = np.array([line["a_u"] * capture.lens.fx, line["b_v"] * capture.lens.fy, 0.0])
    normal[2] = line["c"] + line["a_u"] * (capture.lens.cx - 0.5) + line["b_v"] * (capture.lens.cy - 0.5)
    given = np.array(fitted["normal"])
    assert abs(normal @ given) / np.linalg.norm(normal) == pytest.approx(1, abs=2e-4)


@needs_data
@pytest.mark.parametrize("name", ["aloe", "motorcycle"])
def test_disparity_gives_the_same_depth_as_the_depth_map(tmp_path: Path, name: str) -> None:
    for file in ("color.png", "disparity.png", "scene.json"):
        shutil.copy(DATA / name / file, tmp_path)
    _, by_depth = opened(DATA / name)
    _, by_disparity = opened(tmp_path)
    both = (by_depth.inverse_depth > 0) & (by_disparity.inverse_depth > 0)
    assert both.mean() > 0.9
    difference = 1 / by_depth.inverse_depth[both] - 1 / by_disparity.inverse_depth[both]
    assert np.abs(difference).max() < 0.005
