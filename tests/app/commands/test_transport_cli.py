"""`slopegate transport`, `relight`, `composite` and the export of it: what they tell, and every refusal."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from cli_calls import refusal, report
from made_transports import RASTER, SHAPE, half_lit, made_transport
from slopegate.app.cli import main

Capture = pytest.CaptureFixture[str]


def test_light_transport_is_exported(capsys: Capture, tmp_path: Path) -> None:
    made_transport(tmp_path / "t", taken=2)
    export = ["export", str(tmp_path / "t"), "--format", "exr", "--out", str(tmp_path / "t.exr")]
    told = report(capsys, *export)
    assert (told["slices"], told["missing"], told["format"]) == (2, [2], "exr")
    with OpenEXR.File(str(tmp_path / "t.exr"), separate_channels=True) as file:
        assert set(file.channels()) == {"Y", "white.Y", "slice_0000.Y", "slice_0001.Y"}
    assert "one of zarr, exr, png for light transport" in refusal(capsys, *export[:3], "ome-tiff", *export[4:])
    assert "no dark left to subtract" in refusal(capsys, *export, "--subtract-dark")


@pytest.fixture
def folder(tmp_path: Path) -> str:
    made_transport(tmp_path / "t")
    return str(tmp_path / "t")


@pytest.mark.parametrize("action", ["plan", "acquire", "show"])
def test_every_action_explains_each_option_and_gives_an_example(capsys: Capture, action: str) -> None:
    assert main(["transport", action, "--help"]) == 0
    out = capsys.readouterr().out
    assert f"slopegate transport {action}" in out.split("example")[1]
    lines = out.split("\n\n", 2)[2].splitlines()
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        assert not line.startswith("  -") or "  " in line.strip() or following.startswith(" " * 10), line


def test_show_says_what_a_folder_holds(capsys: Capture, folder: str) -> None:
    told = report(capsys, "transport", "show", folder)
    assert (told["grid"], told["codes"], told["frames"], told["complete"]) == ("4x2", "hadamard", 22, True)
    assert [item["empty"] for item in told["slices"]] == [False, True, False]
    assert told["psnr_check"] == 200  # the most that is told: these slices add up to the last bit
    assert main(["transport", "show", folder]) == 0
    assert "3 of 3 slices of Two halves, grid 4x2, hadamard codes" in capsys.readouterr().out


def test_show_of_an_unfinished_folder_says_what_is_missing(capsys: Capture, tmp_path: Path) -> None:
    made_transport(tmp_path / "u", taken=1)
    told = report(capsys, "transport", "show", str(tmp_path / "u"))
    assert (told["complete"], told["missing"], told["psnr_check"]) == (False, [1, 2], None)
    assert [item["taken"] for item in told["slices"]] == [True, False, False]


def test_a_foreground_before_a_new_background(capsys: Capture, folder: str, tmp_path: Path) -> None:
    behind = np.zeros((6, 8, 3), np.uint8)
    behind[:] = 0, 0, 255  # red, as OpenCV has it
    cv2.imwrite(str(tmp_path / "red.png"), behind)
    words = ["composite", folder, "--foreground", "0", "--background", str(tmp_path / "red.png")]
    out, matte = tmp_path / "a.npy", tmp_path / "m.png"
    told = report(capsys, *words, "--out", str(out), "--matte-out", str(matte))
    assert (told["foreground"], told["relight"]) == ([0], False)
    image, seen, half = np.load(out), cv2.imread(str(matte), cv2.IMREAD_UNCHANGED), SHAPE[1] // 2
    assert np.allclose(image[:, : half - 1], 1)
    assert np.allclose(image[:, half + 1 :], [1, 0, 0])  # white of the picture is white of the scene
    assert seen is not None
    assert (seen[:, : half - 1] == 255).all()
    assert (seen[:, half + 1 :] == 0).all()
    assert 0.4 < told["foreground_share"] < 0.6
    assert "exists already" in refusal(capsys, *words, "--relight", "--out", str(out))
    report(capsys, *words, "--relight", "--out", str(out), "--overwrite")
    relit = np.load(out)[1:, : half - 1]
    assert np.allclose(relit[..., 0], 1, atol=1e-5)
    assert np.allclose(relit[..., 1:], 0, atol=1e-5)
    assert main([*words, "--out", str(tmp_path / "a.png")]) == 0
    assert "% " in capsys.readouterr().out


def test_a_composite_that_makes_no_sense_is_refused(capsys: Capture, folder: str, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "b.png"), np.full((4, 4, 3), 255, np.uint8))
    words = ["composite", folder, "--background", str(tmp_path / "b.png"), "--out", str(tmp_path / "a.png")]
    for more, named in (
        (["--foreground", "0,3"], "from 0 to 2"),
        (["--foreground", "0,1,2"], "not all of them"),
        (["--foreground", "0,0"], "different slices"),
        (["--foreground", "0", "--matte-out", str(tmp_path / "a.png")], "named twice"),
        (["--foreground", "0", "--matte-out", str(tmp_path / "a.jpg")], ".png"),
    ):
        assert named in refusal(capsys, *words, *more)
    none = ["composite", folder, "--foreground", "0", "--background", "none.png", "--out", str(tmp_path / "a.png")]
    assert "none.png" in refusal(capsys, *none)
    assert not (tmp_path / "a.png").exists()


REFUSED = {
    "no subject": (["transport", "acquire", "--out", "o"], "give a SCENE"),
    "no action": (["transport"], "ACTION"),
    "both subjects": (["transport", "plan", "spot", "--camera", "ueye:1"], "exclude each other"),
    "a scene's screen": (["transport", "acquire", "spot", "--out", "o", "--screen", "X"], "--screen is for a camera"),
    "a camera's seed": (
        ["transport", "acquire", "--camera", "ueye:1", "--out", "o", "--seed", "1"],
        "--seed is for a SCENE",
    ),
    "a camera's noise": (
        ["transport", "acquire", "--camera", "ueye:1", "--out", "o", "--no-noise"],
        "--no-noise is for",
    ),
    "half a gate": (["transport", "plan", "spot", "--delay-us", "9"], "belong together"),
    "a gate without tilt": (
        ["transport", "plan", "spot", "--delay-us", "9", "--exposure-us", "9"],
        "needs --clock-mhz",
    ),
    "a gate and a range": (
        ["transport", "plan", "spot", "--clock-mhz", "78", "--delay-us", "9", "--exposure-us", "9", "--count", "2"],
        "one slice",
    ),
    "half a range": (["transport", "plan", "spot", "--near-m", "1"], "belong together"),
    "a range back": (["transport", "plan", "spot", "--near-m", "1", "--far-m", "0.5"], "must be above"),
    "a camera without a range": (
        ["transport", "plan", "--camera", "ueye:1", "--count", "2"],
        "how far the camera sees",
    ),
    "a plan to resume": (["transport", "acquire", "spot", "--out", "o", "--resume", "--grid", "4x2"], "no other plan"),
    "no grid": (["transport", "plan", "spot", "--grid", "4"], "columns x rows"),
    "a large grid": (["transport", "plan", "spot", "--grid", "4x900"], "grid rows is 900"),
    "other codes": (["transport", "plan", "spot", "--codes", "morse"], "hadamard"),
    "no folder": (["transport", "show", "nowhere"], "nowhere"),
    "no transport": (["relight", "nowhere", "--out", "a.npy"], "nowhere"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_sense_is_refused(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    words, named = REFUSED[name]
    assert named in refusal(capsys, *words)
    assert not any(tmp_path.iterdir())


def test_a_slice_in_colour_and_one_with_a_picture(capsys: Capture, folder: str, tmp_path: Path) -> None:
    picture = np.zeros((2, 4), np.uint8)
    picture[0] = 255, 51, 0, 0
    cv2.imwrite(str(tmp_path / "p.png"), picture)
    out = tmp_path / "a.npy"
    told = report(
        capsys, "relight", folder, "--slice", f"0={tmp_path / 'p.png'}", "--slice", "2=#0033ff", "--out", str(out)
    )
    assert told["colour"]
    image = np.load(out)
    assert image.shape == (*SHAPE, 3)
    left, right = half_lit(True), half_lit(False)
    share = image[:, :, 0] / np.where(left.total > 0, left.total, np.inf)
    width = SHAPE[1]
    assert np.allclose(share[1 : SHAPE[0] // 2, : width // 4], 1)
    assert np.allclose(share[1 : SHAPE[0] // 2, width // 4 : width // 2], 0.2)
    assert np.allclose(image[:, width // 2 :], right.total[:, width // 2 :, None] * np.array([0, 0.2, 1]))


def test_everything_white_is_the_floodlit_image_itself(capsys: Capture, folder: str, tmp_path: Path) -> None:
    for suffix in (".npy", ".exr", ".png"):
        told = report(capsys, "relight", folder, "--out", str(tmp_path / f"a{suffix}"))
        assert (told["weights"], told["colour"], told["unit"]) == ("tiling", False, "linear, E = 1")
        assert (told["psnr_db"], told["ssim"]) == (200, pytest.approx(1))
    assert np.array_equal(np.load(tmp_path / "a.npy"), half_lit(True).total + half_lit(False).total)
    seen = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED)
    assert seen is not None
    assert sorted(np.unique(seen)) == [188, 255]


def test_a_pattern_lights_every_slice(capsys: Capture, folder: str, tmp_path: Path) -> None:
    pattern = np.zeros((RASTER.height, RASTER.width), np.uint8)
    cv2.imwrite(str(tmp_path / "black.png"), pattern)
    report(capsys, "relight", folder, "--pattern", str(tmp_path / "black.png"), "--out", str(tmp_path / "a.npy"))
    assert np.abs(np.load(tmp_path / "a.npy")).max() < 1e-6


def test_lights_that_make_no_sense_are_refused(capsys: Capture, folder: str, tmp_path: Path) -> None:
    out = ("--out", str(tmp_path / "a.npy"))
    for words, named in (
        (["--slice", "3=red"], "has slices 0 to 2"),
        (["--slice", "1=red", "--slice", "1=blue"], "given twice"),
        (["--slice", "red"], "I=COLOUR"),
        (["--slice", "0=#12"], "#RRGGBB"),
        (["--slice", "0=nothing.png"], "nothing.png"),
        (["--weights", "heavy"], "least-squares"),
    ):
        assert named in refusal(capsys, "relight", folder, *words, *out)
    assert ".exr" in refusal(capsys, "relight", folder, "--out", str(tmp_path / "a.bmp"))


def test_a_doubtful_slice_is_warned_of(capsys: Capture, folder: str, tmp_path: Path) -> None:
    path = tmp_path / "t" / "slice_0002.json"
    facts = json.loads(path.read_text("utf-8")) | {"saturated_share": 0.3, "nonlinear_share": 0.2}
    path.write_text(json.dumps(facts), "utf-8")
    told = report(capsys, "transport", "show", folder)["warnings"]
    assert len(told) == 2
    assert all(warning.startswith("slice 2: ") for warning in told)
    assert main(["transport", "show", folder]) == 0
    assert "30% of the pixels are saturated" in capsys.readouterr().err


def test_patterns_need_a_display(capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("slopegate.app.commands.projecting.has_display", lambda: False)
    words = ["transport", "acquire", "--camera", "video:0", "--screen", "HDMI-1", "--out", "t"]
    assert "no display to show patterns on" in refusal(capsys, *words)
    assert not (tmp_path / "t").exists()
