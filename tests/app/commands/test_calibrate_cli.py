"""The contract of `calibrate` with a folder: what it tells, what it leaves out, and refusals in a sentence."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from chart_views import HiddenPair, Look, hidden_pair, pictures, poses, seen
from cli_calls import refusal, report
from pose_pictures import write_frames, write_poses
from slopegate.app.cli import main
from slopegate.core.calibration.chart import chart_from
from slopegate.core.rig.calibration import GEOMETRY
from slopegate.drivers.files.rig_files import load_rig

Capture = pytest.CaptureFixture[str]
TEXT = "6x5:30"
CHART = chart_from(TEXT)
PAIR = hidden_pair(6, (400, 300), (320, 240))
HELD = poses(PAIR, CHART, 6, 6)
USUAL = ("--chart", TEXT, "--projector", "320x240")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six good poses."""
    return write_poses(tmp_path_factory.mktemp("calibrate") / "poses", PAIR, CHART, HELD)


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of them to spoil."""
    return Path(shutil.copytree(made, tmp_path / "poses"))


def calibrated(capsys: Capture, folder: Path, *words: str) -> dict[str, Any]:
    return report(capsys, "calibrate", str(folder), *USUAL, "--out", str(folder.parent / "rig.toml"), *words)


def apart(found: dict[str, Any], pair: HiddenPair = PAIR) -> np.ndarray:
    """By how many of its standard errors each number is off."""
    numbers = [found["parameters"][name] for name in GEOMETRY]
    values, errors = (np.array([one[key] for one in numbers]) for key in ("value", "standard_error"))
    return np.asarray((values - pair.values) / errors)


def alike(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two results are the same, but for the order in which sums were taken."""
    return all(
        value == pytest.approx(other["parameters"][name], rel=1e-5, abs=1e-9)
        for name, value in one["parameters"].items()
    )


def test_a_folder_becomes_a_rig_file(capsys: Capture, made: Path, tmp_path: Path) -> None:
    out = tmp_path / "rig.toml"
    words = ["calibrate", str(made), *USUAL, "--out", str(out), "--chart-error-percent", "0.5"]
    found = report(capsys, *words)
    assert found["rms_px"] < 0.1
    assert found["rms_px"] == pytest.approx(
        np.hypot(found["camera_rms_px"], found["projector_rms_px"]) / np.sqrt(2), rel=1e-3
    )
    assert [view["name"] for view in found["views"]] == [f"pose_{k}" for k in ("01", "02", "03", "04", "05", "06")]
    assert all(view["used"] and view["corners"] == 30 and view["rms_px"] < 0.12 for view in found["views"])
    assert all(view["held_out_px"] < 0.5 for view in found["views"])
    assert found["left_out"] == found["outliers"] == found["differences"] == found["compared"] == []
    assert (found["camera"], found["projector"]) == ([400, 300], [320, 240])
    assert (np.abs(apart(found)) < 4).all()
    assert (np.abs(apart(found)) < 3).mean() > 0.9
    length = found["parameters"]["offset_y_m"]
    assert length["standard_error"] > 0.005 * abs(length["value"])
    assert np.sum(found["coverage"]["camera"]) == np.sum(found["coverage"]["projector"]) == 180
    assert "6 views, distances to" in found["judged"]["text"]
    assert found["warnings"] == [
        "shutter, period and blur are those of the default rig (Check rig): give yours with --rig"
    ]
    rig = load_rig(out)
    assert (rig.camera.lens.fx, rig.camera.lens.width) == (found["parameters"]["camera.fx"]["value"], 400)
    assert rig.calibration is not None
    facts = dict(rig.calibration.facts)
    assert facts == found["facts"]
    assert facts["geometry.chart"] == TEXT
    for which in ("camera", "projector"):
        bent = found["distortion"][which]
        assert bent["undetermined"] == [name for name, moved in bent["alone_px"].items() if moved > 3]
        assert any(which in remark for remark in found["remarks"]) is bool(bent["undetermined"])
    assert facts["geometry.chart_error_percent"] == "0.5"
    assert rig.calibration.standard_errors["offset_y_m"] == pytest.approx(length["standard_error"])
    assert "exists already" in refusal(capsys, *words)
    assert main([*words, "--overwrite", "--compare", str(out)]) == 0
    out_text, err = capsys.readouterr()
    assert "Numbers of the rig, with their standard errors" in out_text
    assert f"Against {out}" in out_text
    assert "inconsistent" not in err


def test_faulty_views_are_left_out_by_name_and_the_result_is_as_without_them(capsys: Capture, folder: Path) -> None:
    rng = np.random.default_rng(1)
    good = pictures(PAIR, CHART, HELD[0], rng)
    moved = good.copy()
    moved[20:] = pictures(PAIR, CHART, (HELD[0][0], HELD[0][1] + [0.003, 0, 0]), rng)[20:]
    middle = seen(PAIR, CHART.points_m, HELD[1])[1][:, 0].mean()
    half = replace(PAIR, projector=replace(PAIR.projector, cx=PAIR.projector.cx + 320 - middle))
    faulty = {
        "moved": (moved, "moved: chart or camera moved by"),
        "blurred": (pictures(PAIR, CHART, HELD[1], rng, Look(camera_blur_px=5)), "blurred: the chart is blurred"),
        "bright": (pictures(PAIR, CHART, HELD[2], rng, Look(white=700)), "% of the chart is saturated"),
        "half": (pictures(half, CHART, HELD[1], rng), "half: the projector lights only"),
        "empty": (np.full_like(good, 60) + np.arange(36, dtype=np.uint8)[:, None, None] // 34, "no 6x5:30 was found"),
    }
    alone = calibrated(capsys, folder)
    for name, (frames, _) in faulty.items():
        if name == "empty":
            frames[-1] = 59
        write_frames(folder / name, frames)
    found = calibrated(capsys, folder, "--overwrite")
    left_out = {one["name"]: one["why"] for one in found["left_out"]}
    assert set(left_out) == set(faulty)
    for name, (_, said) in faulty.items():
        assert said in left_out[name]
        assert any(said in warning and warning.startswith("left out: ") for warning in found["warnings"])
    assert {view["name"] for view in found["views"] if view["used"]} == {f"pose_0{k}" for k in range(1, 7)}
    assert alike(found, alone)
    assert set(found["facts"]["geometry.left_out"].split(", ")) == set(faulty)


def test_an_outlier_is_named_and_left_out_with_consent(capsys: Capture, folder: Path) -> None:
    knocked = replace(PAIR, projector=replace(PAIR.projector, cx=PAIR.projector.cx + 3, cy=PAIR.projector.cy - 2))
    write_frames(folder / "pose_07", pictures(knocked, CHART, HELD[3], np.random.default_rng(2)))
    found = calibrated(capsys, folder)
    assert found["outliers"] == ["pose_07"]
    assert found["left_out"] == []
    assert any(
        warning.startswith("pose_07 does not fit the others") and "--leave-out pose_07" in warning
        for warning in found["warnings"]
    )
    consent = calibrated(capsys, folder, "--leave-out", "outliers", "--overwrite")
    named = calibrated(capsys, folder, "--leave-out", "pose_07", "--overwrite")
    assert [one["why"] for one in consent["left_out"]] == ["pose_07: left out as asked"]
    assert alike(consent, named)
    assert consent["outliers"] == named["outliers"] == []
    assert consent["rms_px"] < 0.1 < found["rms_px"]


def test_16_bits_colours_and_the_other_order_are_read_alike(capsys: Capture, folder: Path) -> None:
    for number, pose in enumerate(sorted(folder.iterdir())):
        files = sorted(pose.iterdir())
        frames = [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) for path in files]
        if number in (1, 2):
            frames = [*frames[-2:], *frames[:-2]]  # white and black first
        for path, frame in zip(files, frames, strict=True):
            path.unlink()
            if number in (0, 1):
                cv2.imwrite(str(path), frame.astype(np.uint16) * 16)
            elif number in (2, 3):
                cv2.imwrite(str(path.with_suffix(".bmp")), np.repeat(frame[:, :, None], 3, axis=2))
            else:
                cv2.imwrite(str(path.with_suffix(".tif")), frame)
    found = calibrated(capsys, folder)
    assert all(view["used"] for view in found["views"])
    assert (np.abs(apart(found)) < 4).all()


def test_the_projector_s_size_is_that_of_the_rig_or_guessed(capsys: Capture, made: Path, tmp_path: Path) -> None:
    rig = PAIR.rig(load_rig(None))
    from slopegate.drivers.files.rig_files import rig_to_toml

    (tmp_path / "old.toml").write_text(rig_to_toml(replace(rig, name="Old")))
    words = ("calibrate", str(made), "--chart", TEXT, "--out", str(tmp_path / "new.toml"))
    found = report(capsys, *words, "--rig", str(tmp_path / "old.toml"))
    assert found["projector"] == [320, 240]
    assert found["warnings"] == []
    assert load_rig(tmp_path / "new.toml").name == "new", "not that of the rig before"
    said = refusal(capsys, *words, "--overwrite")
    assert "has 36 pictures: a projector of 1280 x 720 pixels needs 44" in said
    beyond = refusal(capsys, *words[:-2], "--out", str(tmp_path / "x.toml"), "--projector", "300x160")
    assert "codes that a projector of 300 x 160 pixels does not have" in beyond


def picture(number: int) -> Path:
    return Path("pose_02", f"pattern_{number:02d}.png")


def cut(path: Path) -> None:
    """Take the last two rows away."""
    cv2.imwrite(str(path), np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))[:-2])


def swap(one: Path, other: Path) -> None:
    spare = one.with_name("spare")
    one.rename(spare)
    other.rename(one)
    spare.rename(other)


def keep(folder: Path, count: int) -> None:
    for pose in sorted(folder.iterdir())[count:]:
        shutil.rmtree(pose)


def mix(folder: Path) -> None:
    """Some pictures of another pose among those of one."""
    for number in range(10, 20):
        shutil.copy(folder / f"pose_03/pattern_{number:02d}.png", folder / picture(number))


def face_one_way(folder: Path) -> None:
    keep(folder, 1)
    for number, far in enumerate((1.05, 1.1, 1.15)):
        held = (HELD[0][0], HELD[0][1] * far)
        write_frames(folder / f"pose_1{number}", pictures(PAIR, CHART, held, np.random.default_rng(number)))


SPOILT: dict[str, Callable[[Path], object]] = {
    "no pictures": lambda folder: keep(folder, 0),
    "a frame missing": lambda folder: (folder / picture(7)).unlink(),
    "the last missing": lambda folder: (folder / picture(35)).unlink(),
    "out of order": lambda folder: swap(folder / picture(34), folder / picture(3)),
    "of two poses": mix,
    "mixed sizes": lambda folder: cut(folder / picture(5)),
    "another camera": lambda folder: [cut(path) for path in (folder / "pose_02").iterdir()],
    "damaged": lambda folder: (folder / picture(5)).write_bytes((folder / picture(5)).read_bytes()[:200]),
    "empty file": lambda folder: (folder / picture(5)).write_bytes(b""),
    "two views": lambda folder: keep(folder, 2),
    "one angle": face_one_way,
}


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("no pictures", "holds no pictures and no folders of pictures"),
        ("a frame missing", "pose_02: number 7 is missing among its pictures pattern_00.png to pattern_35.png"),
        ("the last missing", "pose_02 has 35 pictures: a projector of 320 x 240 pixels needs 36 (9 pairs for columns"),
        ("out of order", "pose_02: its pictures are out of order: pattern_03.png and pattern_34.png have changed"),
        ("of two poses", "pose_02: its pictures do not belong together"),
        ("mixed sizes", "pose_02: pattern_05.png has 400 x 298 pixels of 8 bits and pattern_00.png has 400 x 300"),
        (
            "another camera",
            "pose_02 has pictures of 400 x 298 pixels and pose_01 of 400 x 300: one camera has one size",
        ),
        ("damaged", "pattern_05.png"),
        ("empty file", "pattern_05.png is empty (0 bytes)"),
        ("two views", "2 of 2 views can be used: at least 3 are needed, each with the chart at another angle"),
        ("one angle", "all 4 views show the chart at one angle, tilted by"),
    ],
)
def test_what_cannot_be_calibrated_with_is_refused(capsys: Capture, folder: Path, how: str, said: str) -> None:
    SPOILT[how](folder)
    out = folder.parent / "rig.toml"
    assert said in refusal(capsys, "calibrate", str(folder), *USUAL, "--out", str(out))
    assert not out.exists()
    if how in ("a frame missing", "damaged"):  # a folder that is left out may hold anything
        assert calibrated(capsys, folder, "--leave-out", "pose_02")["left_out"][0]["name"] == "pose_02"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--chart", "11x9:30", "--projector", "320x240"], "no 11x9:30 was found"),
        (["--chart", "six by five"], "chart is 'six by five': it must be COLUMNSxROWS:SQUARE_MM"),
        ([*USUAL, "--leave-out", "pose_9"], "'pose_9' is to be left out and no folder in"),
        (["--projector", "320"], "'320' must be WIDTHxHEIGHT in pixels, as 1280x720"),
        ([*USUAL, "--compare", "nothing.xml"], "nothing.xml is missing"),
        ([*USUAL, "--compare", "some.txt"], "some.txt is no calibration that can be read"),
        ([*USUAL, "--chart-error-percent", "-1"], "must be a number from 0 to 10"),
    ],
)
def test_options_that_do_not_do_are_refused(
    capsys: Capture, made: Path, tmp_path: Path, words: list[str], said: str
) -> None:
    assert said in refusal(capsys, "calibrate", str(made), *words, "--out", str(tmp_path / "rig.toml"))


def test_no_folder_is_refused(capsys: Capture, tmp_path: Path) -> None:
    words = ["calibrate", str(tmp_path / "none"), *USUAL, "--out", str(tmp_path / "rig.toml")]
    assert "none is no folder" in refusal(capsys, *words)


def test_kamino_is_met_and_its_published_calibration_is_not_believed(
    capsys: Capture, shared: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = shared("data/procam")
    words = ("calibrate", str(folder), "--chart", "9x7:75", "--out", str(tmp_path / "rig.toml"), "--overwrite")
    found = report(capsys, *words)
    assert found["rms_px"] <= 0.31
    assert "taken to have 1024 x 768 pixels" in found["warnings"][0]
    assert "k3" in found["distortion"]["camera"]["undetermined"]
    assert found["remarks"][0].startswith("the camera's k1, k2 and k3 are not determined by these views")
    known = json.loads((folder / "kamino_recomputed_012.json").read_text())
    turn, moved = np.array(known["R"]), np.array(known["T_mm"]) / 1000
    expected = np.concatenate(
        [
            *(
                [matrix[0][0], matrix[1][1], matrix[0][2] + 0.5, matrix[1][2] + 0.5, *bent]
                for matrix, bent in ((known["cam_K"], known["cam_dist"]), (known["proj_K"], known["proj_dist"]))
            ),
            cv2.Rodrigues(turn)[0].ravel(),
            -turn.T @ moved,
        ]
    )
    values, errors = (
        np.array([found["parameters"][name][key] for name in GEOMETRY]) for key in ("value", "standard_error")
    )
    assert (np.abs(values - expected) <= 3 * errors).all()
    published = folder / "kamino_calibration_result.xml"
    told = report(capsys, *words, "--projector", "1024x768", "--compare", str(published))
    assert told["compared"][0]["consistent"] is False
    assert len(told["compared"]) == 1
    (compared,) = found["compared"]
    assert (compared["consistent"], compared["unit"]) == (False, "mm")
    assert 300 < compared["misfit"]["epipolar_px"] < 700
    assert compared["fitted_misfit"]["epipolar_px"] < 0.3
    sigmas = {one["name"]: one["sigmas"] for one in told["differences"]}
    assert sigmas["camera.fx"] < 4
    assert sigmas["projector.fx"] > 100
    assert any("kamino_calibration_result.xml is inconsistent with the pictures" in one for one in found["warnings"])
