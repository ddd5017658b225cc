"""`slopegate transport plan` and `acquire` on the bench: what is acquired relights as `render --pattern` renders."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from cli_calls import refusal, report
from rigs import check_rig
from slopegate.drivers.files.rig_files import rig_to_toml

Capture = pytest.CaptureFixture[str]
SCENE = """
title = "Card and wall"
ambient = 0.02
[[objects]]
type = "plane"
name = "wall"
centre_m = [0.0, 0.0, 2.0]
width_m = 6.0
height_m = 6.0
[[objects]]
type = "plane"
name = "card"
centre_m = [0.0, 0.0, 0.8]
width_m = 0.3
height_m = 0.3
"""
GATE = ("--clock-mhz", "78", "--delay-us", "2662", "--exposure-us", "600")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "rig.toml").write_text(rig_to_toml(check_rig(64)), "utf-8")
    (tmp_path / "card.toml").write_text(SCENE, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def scene(*words: str) -> list[str]:
    return ["transport", *words[:1], "card.toml", "--rig", "rig.toml", *words[1:]]


def decibels(found: np.ndarray, truth: np.ndarray, peak: float) -> float:
    return float(10 * np.log10(peak**2 / np.mean((found - truth) ** 2)))


@pytest.mark.parametrize("codes", ["hadamard", "adaptive"])
def test_relit_by_a_pattern_it_is_what_the_bench_renders(capsys: Capture, home: Path, codes: str) -> None:
    pattern = np.random.default_rng(2).integers(0, 256, (4, 4), np.uint8)
    cv2.imwrite("pattern.png", pattern)
    words = ("--count", "2", "--grid", "4x4", "--codes", codes, "--no-noise", "--out", "t")
    told = report(capsys, *scene("acquire", *words))
    assert (told["grid"], told["codes"], told["complete"], len(told["slices"])) == ("4x4", codes, True, 2)
    assert told["psnr_check"] > 60
    shown = report(capsys, "transport", "show", "t")
    assert {"grid", "slices", "codes", "frames", "complete", "psnr_check"} <= set(shown)
    assert shown == {key: value for key, value in told.items() if key != "folder"}
    plan = report(capsys, *scene("plan", *words[:6]))
    assert {"frames", "seconds", "bytes", "noise_gain"} <= set(plan)
    assert plan["frames"] >= told["frames"]
    assert plan["seconds"] > 0
    report(capsys, "relight", "t", "--pattern", "pattern.png", "--out", "relit.npy")
    everything = ("--clock-mhz", "78", "--delay-us", "0", "--exposure-us", "16666.666666666668", "--out", "truth.npy")
    report(capsys, "render", "card.toml", "--rig", "rig.toml", "--pattern", "pattern.png", *everything)
    relit, truth = np.load("relit.npy"), np.load("truth.npy")
    assert decibels(relit, truth, truth.max()) > 60


def test_one_gate_is_one_slice_and_a_run_cut_short_goes_on(capsys: Capture, home: Path) -> None:
    told = report(capsys, *scene("acquire", *GATE, "--grid", "4x2", "--seed", "5", "--out", "t"))
    (one,) = told["slices"]
    assert one["gate"]["exposure_us"] == 600
    assert told["psnr_check"] < 40  # a slice alone is not the fully lit image
    before = {path.name: path.read_bytes() for path in (home / "t").glob("slice*.npz")}
    for path in (home / "t").glob("slice*"):
        path.unlink()
    again = report(capsys, *scene("acquire", "--resume", "--out", "t"))
    assert again["complete"]
    assert {path.name: path.read_bytes() for path in (home / "t").glob("slice*.npz")} == before
    assert "not empty" in refusal(capsys, *scene("acquire", *GATE, "--out", "t"))
    assert "must be of this scene" in refusal(capsys, "transport", "acquire", "spot", "--resume", "--out", "t")
    other = ("transport", "acquire", "card.toml", "--rig", "beside", "--resume", "--out", "t")
    assert "begun with another scene, camera, projector or rig" in refusal(capsys, *other)


def test_a_camera_in_colour_relights_in_colour(capsys: Capture, home: Path) -> None:
    words = ("--count", "1", "--grid", "4x2", "--no-noise", "--pixel-format", "bayer_rg12", "--out", "t")
    report(capsys, *scene("acquire", *words))
    told = report(capsys, "relight", "t", "--out", "a.npy")
    assert told["colour"]
    assert np.load("a.npy").shape == (48, 64, 3)
    assert "mono12 or bayer_rg12" in refusal(capsys, *scene("acquire", *words[:-3], "mono8", "--out", "u"))


def test_parts_are_chosen(capsys: Capture, home: Path) -> None:
    words = scene("acquire", "--count", "1", "--grid", "4x2", "--codes", "gray", "--no-noise", "--parts", "direct")
    told = report(capsys, *words, "--out", "t")
    assert told["complete"]
    assert "no part" in refusal(capsys, *words[:-1], "glow", "--out", "u")
    assert not (home / "u").exists()


def test_light_between_surfaces_is_in_the_slices_too(capsys: Capture, home: Path) -> None:
    """It arrives at any phase, not only where direct light does."""
    (home / "card.toml").write_text(SCENE.replace("ambient = 0.02", "indirect = true"), "utf-8")
    told = report(capsys, *scene("acquire", "--count", "2", "--grid", "4x2", "--no-noise", "--out", "t"))
    assert told["psnr_check"] > 60
    assert sum(item["gate"]["exposure_us"] for item in told["slices"]) == pytest.approx(16666.7, abs=4)
