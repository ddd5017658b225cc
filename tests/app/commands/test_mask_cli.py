"""The contract of `mask` and `depth`: numbers that hold, files that can be read, refusals in a sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rigs import calibrated
from settings_inside import read_settings
from slopegate.app.cli import main
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.measure.mask import best_gate, overlap
from slopegate.core.render.render import render
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig, rig_to_toml
from slopegate.drivers.scenes.scene_files import open_scene

Capture = pytest.CaptureFixture[str]

SCENE = """
title = "Card"
ambient = 0.03
[[objects]]
name = "card"
type = "plane"
centre_m = [0.0, 0.0, 1.0]
width_m = 0.4
height_m = 0.3
tilt_deg = 15
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, 2.0]
width_m = 6.0
height_m = 5.0
"""


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder with the check rig binned 8 x 8 and a card before a wall."""
    text = rig_to_toml(load_rig(None))
    binned = {
        "width = 1600": "width = 200",
        "height = 1200": "height = 150",
        "= 1666.6666666666667": "= 208.33333333333334",
        "cx = 800.0": "cx = 100.0",
        "cy = 600.0": "cy = 75.0",
        "= 996.66866": f"= {996.66866 * 8!r}",
    }
    for old, new in binned.items():
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "rig.toml").write_text(text, "utf-8")
    (tmp_path / "card.toml").write_text(SCENE, "utf-8")
    return tmp_path


def run(capsys: Capture, home: Path, command: str, *more: str) -> tuple[int, Any]:
    code = main([command, str(home / "card.toml"), "--rig", str(home / "rig.toml"), "--json", *more])
    out = capsys.readouterr()
    return code, json.loads(out.out) if out.out else out.err


def card(home: Path) -> np.ndarray:
    rig, scene = open_scene(home / "card.toml", load_rig(home / "rig.toml"))
    return render(rig, scene).inverse_depth > 0.75


@pytest.mark.parametrize("what", ["--keep", "--hide"])
@pytest.mark.parametrize("measured", [False, True])
def test_a_painted_card_is_kept_or_hidden(capsys: Capture, home: Path, what: str, measured: bool) -> None:
    painted = card(home)
    cv2.imwrite(str(home / "painted.png"), painted.astype(np.uint8) * 255)
    words = ["--region-png", str(home / "painted.png"), what, "--mask-out", str(home / "mask.png")]
    code, said = run(capsys, home, "mask", *words, *(["--measured"] if measured else []))
    assert code == 0
    assert said["good"]
    assert said["iou"] > 0.97
    assert said["achieved_iou"] > 0.95
    assert said["settings"]["complement"] == (what == "--hide")
    assert (said["sweep_frames"] > 0) == measured
    rig, scene = open_scene(home / "card.toml", load_rig(home / "rig.toml"))
    buffers, sent = render(rig, scene), said["sent"]
    settings = gate(sent["line_time_us"], sent["delay_us"], sent["exposure_us"])
    seen = weights(row_windows(rig, settings), buffers.projector_row) > 0
    np.testing.assert_array_equal(cv2.imread(str(home / "mask.png"), cv2.IMREAD_UNCHANGED) > 0, seen)
    lit = buffers.projector_row >= 0
    if not measured:
        assert overlap(~seen if what == "--hide" else seen, painted, lit) == pytest.approx(said["iou"])


def test_a_rectangle_is_the_same_region(capsys: Capture, home: Path) -> None:
    rig, scene = open_scene(home / "card.toml", load_rig(home / "rig.toml"))
    region = np.zeros((150, 200), bool)
    region[40:110, 60:140] = True
    code, said = run(capsys, home, "mask", "--region", "60", "40", "140", "110")
    assert code == 0
    assert said["iou"] == pytest.approx(best_gate(rig, render(rig, scene).projector_row, region).iou)


def test_a_region_without_a_good_gate_is_exit_code_1_with_the_nearest(capsys: Capture, home: Path) -> None:
    code, said = run(capsys, home, "mask", "--region", "2", "2", "20", "20")
    assert code == 1
    assert not said["good"]
    assert 0 < said["iou"] < 0.5
    main(["mask", str(home / "card.toml"), "--rig", str(home / "rig.toml"), "--region", "2", "2", "20", "20"])
    assert "no gate does it well; the nearest one keeps the region" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--region", "5", "5", "5", "9"], "region is (5, 5, 5, 9)"),
        (["--region", "0", "0", "201", "9"], "200 x 150"),
        (["--region-png", "{}/small.png"], "small.png is 4 x 3 pixels: it must be of the image's size, 200 x 150"),
        (["--region-png", "{}/none.png"], "none.png"),
        (["--region", "0", "0", "9", "9", "--mask-out", "{}/x.jpg"], "x.jpg"),
        ([], "--region"),
        (["--region", "0", "0", "9", "9", "--keep", "--hide"], "--hide"),
    ],
)
def test_mask_refuses_in_a_sentence(capsys: Capture, home: Path, words: list[str], named: str) -> None:
    cv2.imwrite(str(home / "small.png"), np.full((3, 4, 3), 255, np.uint8))
    code, said = run(capsys, home, "mask", *(word.format(home) for word in words))
    assert code == 2
    assert named in said
    assert said.count("\n") == 1


def test_a_gate_that_the_rig_cannot_make_is_a_warning(capsys: Capture, home: Path) -> None:
    flat = '[[gates]]\nname = "Flat"\nclock_mhz = 500\ndelay_us = 9000\nexposure_us = 500\n'
    (home / "card.toml").write_text((home / "card.toml").read_text("utf-8") + flat, "utf-8")
    words = ["mask", str(home / "card.toml"), "--rig", str(home / "rig.toml"), "--region", "60", "40", "140", "110"]
    assert main(words) in {0, 1}
    assert "warning: " in (said := capsys.readouterr().err)
    assert "gates[0] ('Flat'): its camera has no pixel clock of 500 MHz: it is made with the nearest, 128 MHz" in said


@pytest.mark.parametrize("noise", ["--noise", "--no-noise"])
def test_depth_says_what_it_took_and_how_far_it_is_off(capsys: Capture, home: Path, noise: str) -> None:
    code, said = run(capsys, home, "depth", "--out", str(home / "depth.tif"), noise)
    assert code == 0
    assert said["frames"] < said["plain_frames"] / 5
    assert said["error"]["known_share"] > 0.99
    assert said["error"]["wrong_share"] < 1e-3
    assert said["error"]["p95_mm"] < 21
    assert read_settings(home / "depth.tif")["frames"] == said["frames"]


def test_depth_of_a_calibrated_rig_tells_and_keeps_its_standard_errors(capsys: Capture, home: Path) -> None:
    _, plain = run(capsys, home, "depth", "--no-noise")
    assert "standard_error" not in plain
    (home / "rig.toml").write_text(rig_to_toml(calibrated(load_rig(home / "rig.toml"))), "utf-8")
    code, said = run(capsys, home, "depth", "--out", str(home / "depth.npy"), "--no-noise")
    assert code == 0
    told = said["standard_error"]
    errors = np.load(home / "depth_error.npy")
    assert told["file"] == str(home / "depth_error.npy")
    assert told["median_m"] == pytest.approx(float(np.nanmedian(errors)))
    assert told["rig_median_m"] < told["median_m"]
    assert told["sweep_median_m"] < told["median_m"]
    np.testing.assert_array_equal(np.isfinite(errors), np.isfinite(np.load(home / "depth.npy")))
    words = ["depth", str(home / "card.toml"), "--rig", str(home / "rig.toml"), "--no-noise"]
    assert main([*words, "--out", str(home / "other.ply")]) == 0
    out = capsys.readouterr().out
    assert "standard error" in out
    assert "_error" not in out, "points hold their own"
    (home / "depth.npy").unlink()
    assert main([*words, "--out", str(home / "depth.npy")]) == 2
    assert "depth_error.npy exists already" in capsys.readouterr().err
    assert not (home / "depth.npy").exists(), "refused before the sweep"


def test_what_was_swept_is_a_scene_for_every_command(capsys: Capture, home: Path) -> None:
    folder = home / "swept"
    code, said = run(capsys, home, "depth", "--scene-out", str(folder), "--no-noise")
    assert (code, said["scene_folder"]) == (0, str(folder))
    assert main(["depth", str(folder), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["rig"] == said["rig"]
    assert again["error"]["wrong_share"] < 1e-3
    code, sentence = run(capsys, home, "depth", "--scene-out", str(folder))
    assert code == 2
    assert "exists already" in sentence


def test_finer_rows_and_averages_are_taken_over(capsys: Capture, home: Path) -> None:
    _, coarse = run(capsys, home, "depth", "--finest-rows", "4")
    _, fine = run(capsys, home, "depth", "--finest-rows", "0.5", "--average", "2", "--nearest-m", "0.5")
    assert fine["error"]["rms_mm"] < coarse["error"]["rms_mm"] / 3
    assert fine["sweep"] == {"nearest_m": 0.5, "finest_rows": 0.5, "least_share": 2e-5, "repeats": 2}


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--out", "{}/depth.jpg"], "depth.jpg"),
        (["--finest-rows", "0.01"], "finest_rows"),
        (["--average", "0"], "--average"),
        (["--nearest-m", "nan"], "--nearest-m"),
    ],
)
def test_depth_refuses_in_a_sentence(capsys: Capture, home: Path, words: list[str], named: str) -> None:
    code, said = run(capsys, home, "depth", *(word.format(home) for word in words))
    assert code == 2
    assert named in said


def test_people_are_told_the_same_as_programs(capsys: Capture, home: Path) -> None:
    assert main(["depth", str(home / "card.toml"), "--rig", str(home / "rig.toml")]) == 0
    out = capsys.readouterr().out
    _, said = run(capsys, home, "depth")
    assert f"depth from {said['frames']} settings" in out
    assert f"{said['error']['median_mm']:.4f}" in out


def test_a_person_in_a_real_capture_is_kept(capsys: Capture, home: Path, shared: Callable[[str], Path]) -> None:
    """The person that stands nearest, of five in a corridor: what a gate can tell from the others by depth."""
    folder = shared("data/scenes/five_people")
    rig, scene = open_scene(folder, load_rig(None))
    buffers = render(rig, scene)
    near = (buffers.inverse_depth > 1 / 2.3) & (buffers.projector_row >= 0)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(near.astype(np.uint8))
    assert count > 1
    person = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    cv2.imwrite(str(home / "person.png"), person.astype(np.uint8) * 255)
    words = ["--region-png", str(home / "person.png"), "--json"]
    code = main(["mask", str(folder), *words])
    said = json.loads(capsys.readouterr().out)
    assert code == 0
    assert said["iou"] > 0.6
    assert said["achieved_iou"] == pytest.approx(said["iou"], abs=0.06)
