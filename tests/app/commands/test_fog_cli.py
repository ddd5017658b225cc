"""The contract of `fog`: figures of every exposure, the optimum measured and predicted, refusals in a sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_calls import refusal, report
from slopegate.app.cli import main
from slopegate.drivers.files.rig_files import rig_to_toml
from small_window import small_rig

Capture = pytest.CaptureFixture[str]

SCENE = """
title = "A card in fog"
[[objects]]
name = "card"
type = "plane"
centre_m = [0.0, 0.0, 1.05]
width_m = 0.3
height_m = 0.2
albedo = [0.9, 0.9, 0.9]
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, 2.0]
width_m = 6.0
height_m = 6.0
albedo = [0.3, 0.3, 0.3]
"""
FOG = """
[fog]
scattering_per_m = 0.8
"""
GATE = ["--clock-mhz", "78", "--delay-us", "2028"]
CARD = ["--region", "80", "60", "240", "180"]


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder with a small rig and a card before a wall, with and without fog."""
    (tmp_path / "rig.toml").write_text(rig_to_toml(small_rig()), "utf-8")
    (tmp_path / "fog.toml").write_text(SCENE + FOG, "utf-8")
    (tmp_path / "clear.toml").write_text(SCENE, "utf-8")
    return tmp_path


QUICK = ["--max-order", "1"]
"""Without a bake: direct light and airlight."""


def sweep(capsys: Capture, home: Path, *more: str, scene: str = "fog.toml") -> dict[str, Any]:
    return report(capsys, "fog", str(home / scene), "--rig", str(home / "rig.toml"), *GATE, *QUICK, *more)


def test_it_has_the_keys_of_the_contract(capsys: Capture, home: Path) -> None:
    found = sweep(capsys, home, *CARD, "--count", "12")
    for key in ("exposure_us", "ncc", "contrast", "cnr", "predicted_ncc"):
        assert len(found[key]) == 12
        assert all(isinstance(value, float) for value in found[key])
    assert found["exposure_us"] == sorted(set(found["exposure_us"]))
    assert found["exposure_us"][0] == 100
    assert found["exposure_us"][-1] == 16667
    assert found["best_us"] in found["exposure_us"]
    assert found["predicted_us"] in found["exposure_us"]
    assert found["settings"] == {"clock_mhz": 78.0, "line_time_us": pytest.approx(63.88889), "delay_us": 2028.0}
    assert found["region"] == [80, 60, 240, 180]
    assert found["parts"] == ["direct", "airlight", "ambient"]
    assert found["warnings"] == []
    assert all(-1 <= value <= 1 for value in found["ncc"])


def test_the_long_end_is_the_regular_image_and_the_prediction_is_what_is_seen(capsys: Capture, home: Path) -> None:
    found = sweep(capsys, home, *CARD, "--count", "16", "--frames", "8")
    assert len(found["ncc"]) == 16
    assert found["ncc"][-1] == pytest.approx(found["regular_ncc"], abs=1e-3)
    assert found["contrast"][-1] == pytest.approx(found["regular_contrast"], abs=1e-3)
    np.testing.assert_allclose(found["ncc"], found["predicted_ncc"], atol=3e-3)
    best, told = (found["exposure_us"].index(found[key]) for key in ("best_us", "predicted_us"))
    assert found["ncc"][best] == max(found["ncc"])
    assert abs(best - told) <= 1
    assert 0 < best < 15


def test_the_same_seed_gives_the_same_numbers(capsys: Capture, home: Path) -> None:
    first, second, other = (sweep(capsys, home, "--count", "4", "--seed", seed) for seed in ("1", "1", "2"))
    assert first == second
    assert first["ncc"] != other["ncc"]
    assert first["predicted_ncc"] == other["predicted_ncc"]


def test_a_scene_without_fog_is_said_to_have_none(capsys: Capture, home: Path) -> None:
    found = sweep(capsys, home, "--count", "3", scene="clear.toml")
    assert found["warnings"] == ["this scene has no fog"]
    assert found["regular_ncc"] > 0.99


def test_people_are_told_the_same_as_programs(capsys: Capture, home: Path) -> None:
    words = ["fog", str(home / "fog.toml"), "--rig", str(home / "rig.toml"), *GATE, *QUICK, "--count", "5"]
    assert main(words) == 0
    out = capsys.readouterr().out
    found = sweep(capsys, home, "--count", "5")
    assert f"most like the scene without fog at {found['best_us']:g} us" in out
    assert f"predicted before a frame was taken: {found['predicted_us']:g} us" in out
    assert f"{found['regular_ncc']:.4f}" in out
    assert len(out.splitlines()) == 3 + 5 + 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([*GATE, "--region", "0", "0", "321", "9"], "region is (0, 0, 321, 9)"),
        ([*GATE, "--count", "1"], "--count"),
        ([*GATE, "--frames", "1"], "--frames"),
        (["--clock-mhz", "78"], "--delay-us"),
        (["--delay-us", "2028"], "--clock-mhz"),
        ([*GATE, "--exposure-us", "400"], "--exposure-us"),
    ],
)
def test_fog_refuses_in_a_sentence(capsys: Capture, home: Path, words: list[str], said: str) -> None:
    assert said in refusal(capsys, "fog", str(home / "fog.toml"), "--rig", str(home / "rig.toml"), *words)


def test_all_light_counts_unless_some_is_named(capsys: Capture, home: Path) -> None:
    """Multiple scattering is light of the fog, too: it lowers the contrast of the long exposures."""
    once, all_light, some = (
        report(capsys, "fog", str(home / "fog.toml"), "--rig", str(home / "rig.toml"), *GATE, *CARD, *more)
        for more in (
            ["--count", "3", *QUICK],
            ["--count", "3", "--paths", "8"],
            ["--count", "3", "--parts", "direct,airlight,ambient"],
        )
    )
    assert all_light["parts"] == ["direct", "airlight", "scatter", "indirect", "ambient"]
    assert all_light["contrast"][-1] < once["contrast"][-1] - 0.01
    assert some["ncc"] == once["ncc"]


@pytest.mark.slow
def test_the_stop_sign_on_the_fog_road_is_best_seen_at_the_exposure_that_is_predicted(capsys: Capture) -> None:
    """Figure 10 of the paper: an optimum between what is too little of the sign and what is too much of the fog.

    By an upright gate, which needs some exposure to reach over the leaning sign; the gate that leans with it shows all
    of it from the least exposure on, and is best there.
    """
    words = ["--clock-mhz", "78", "--delay-us", "3042", "--region", "1105", "105", "1415", "380"]
    found = report(capsys, "fog", "fog_road", *words, "--paths", "16")
    assert len(found["ncc"]) == 40
    best, told = (found["exposure_us"].index(found[key]) for key in ("best_us", "predicted_us"))
    assert abs(best - told) <= 1
    assert 0 < best < 39
    assert found["ncc"][best] > found["ncc"][0]
    assert found["ncc"][best] > found["ncc"][-1] + 0.01
    assert found["ncc"][-1] == pytest.approx(found["regular_ncc"], abs=1e-3)
    assert found["contrast"][best] > 5 * found["contrast"][-1]


def test_a_plane_that_leans_sideways_is_warned_of(capsys: Capture, home: Path) -> None:
    words = ["fog", str(home / "fog.toml"), "--rig", str(home / "rig.toml"), *QUICK, *CARD, "--count", "3", "--json"]
    assert main([*words, "--plane=0.2,-0.1,1,-1.1"]) == 0
    out, err = capsys.readouterr()
    told = "the plane leans sideways by 11.3 degrees, which no gate can follow"
    assert told in out + err
    assert "a slab this thin" not in out + err
