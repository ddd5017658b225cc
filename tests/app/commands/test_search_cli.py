"""`slopegate search`: what it prints, and its exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from search_card import speckle
from slopegate.app.cli import main


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A board at 1 m that leans back by about 20 degrees, before a wall at 1.6 m."""
    folder = tmp_path_factory.mktemp("board")
    height, width, f = 240, 320, 300.0
    rows, columns = np.indices((height, width)) + 0.5
    y = (rows - height / 2) / f
    board = 1.0 / (1 + np.tan(np.radians(20.0)) * y)
    on = (np.abs(columns - 160) < 90) & (rows > 25) & (rows < 165)
    depth = np.where(on, board, 1.6)
    photo = cv2.resize(speckle(1, 160), (width, height), interpolation=cv2.INTER_NEAREST)
    cv2.imwrite(str(folder / "color.png"), (255 * photo).astype(np.uint8))
    cv2.imwrite(str(folder / "depth_mm.png"), np.rint(1000 * depth).astype(np.uint16))
    facts = {"name": "board", "intrinsics": {"fx": f, "fy": f, "cx": 159.5, "cy": 119.5}, "depth_units": "mm"}
    (folder / "scene.json").write_text(json.dumps(facts), encoding="utf-8")
    return folder


TARGET = ["--target", "70", "25", "250", "165"]


def test_json_holds_the_gate_and_code_0(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["search", str(capture), *TARGET, "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["found"] is True
    assert values["cause"] == "found"
    assert (values["method"], values["target"]) == ("fast", [70, 25, 250, 165])
    assert set(values["settings"]) == {"clock_mhz", "line_time_us", "delay_us", "exposure_us"}
    assert values["target_tilt_deg"] == pytest.approx(20, abs=5)
    assert values["target_distance_m"] == pytest.approx(1.0, abs=0.05)
    assert values["slab"]["near_m"] < 1.0 < values["slab"]["far_m"] < 1.6
    assert 12 <= values["keypoints_kept"] <= values["keypoints_found"]
    assert values["frames"] <= values["max_frames"] == 48


def test_equal_seeds_make_equal_searches(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    printed = []
    for seed in ("4", "4", "5"):
        main(["search", str(capture), *TARGET, "--json", "--seed", seed, "--max-frames", "9"])
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1]
    assert printed[0] != printed[2]


def test_the_table_names_everything(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["search", str(capture), *TARGET, "--no-noise"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("board, fast search: found, the gate shows ")
    for label in ("pixel clock", "delay", "exposure", "tilt", "distance", "thickness", "keypoints", "frames"):
        assert f"\n  {label} " in out


def test_a_part_of_a_whole_image_is_code_1_with_its_gate(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The photo covers board and wall: a gate that shows one of them leaves the other out."""
    assert main(["search", str(capture), "--json"]) == 1
    values = json.loads(capsys.readouterr().out)
    assert (values["found"], values["cause"]) == (False, "part")
    assert values["settings"] is not None
    assert values["slab"] is not None
    assert 0.5 <= values["keypoints_kept"] / values["keypoints_found"] < 0.8
    assert main(["search", str(capture)]) == 1
    kept = f"{values['keypoints_kept']} of {values['keypoints_found']} keypoints"
    assert capsys.readouterr().out.startswith(f"board, fast search: part of it, the gate shows {kept};")


def test_not_found_is_code_1_with_the_reason(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["search", str(capture), "--target", "0", "0", "40", "40", "--json"]) == 1
    captured = capsys.readouterr()
    values = json.loads(captured.out)
    assert (values["found"], values["settings"], values["slab"]) == (False, None, None)
    assert values["cause"] == "too few keypoints"
    assert "24 are needed" in values["reason"]
    assert captured.err == ""
    assert main(["search", str(capture), "--method", "paper", "--max-frames", "4", *TARGET]) == 1
    assert "not found, the target was not found within 4 frames" in capsys.readouterr().out


@pytest.mark.parametrize(("scene", "warned"), [("alarm", True), ("table", False)])
def test_a_scene_that_moves_is_warned_about(scene: str, warned: bool, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["search", scene, "--json", "--max-frames", "1"]) == 1
    warnings = json.loads(capsys.readouterr().out)["warnings"]
    assert any("something moves" in warning for warning in warnings) == warned


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--target", "0", "0", "321", "100"], "within the image of 320 x 240 pixels"),
        (["--target", "0", "0", "10", "100"], "at least 16 pixels"),
        (["--target", "0", "0", "100"], "expected 4 arguments"),
        (["--target", "0", "0", "1e2", "100"], "must be a whole number from 0 to 100000"),
        (["--method", "magic"], "invalid choice"),
        (["--max-frames", "0"], "whole number from 1"),
        (["--seed", "-1"], "whole number from 0"),
    ],
)
def test_bad_input_is_code_2_and_one_sentence(
    capture: Path, capsys: pytest.CaptureFixture[str], words: list[str], sentence: str
) -> None:
    assert main(["search", str(capture), *words]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert sentence in captured.err
    assert captured.err.count("\n") == 1


def test_a_scene_that_is_not_there_is_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["search", "nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_bench_scores_both_methods(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--search", "1", "--seed", "3", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("1 cases of seed 3")
    assert "frames, median" in out
    assert len(json.loads((tmp_path / "search.json").read_text(encoding="utf-8"))["results"]) == 2
    assert main(["bench", "--search", "1", "--seed", "3", "--out", str(tmp_path), "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)["summary"]["fast"]) > {"findable", "right", "median_iou"}
