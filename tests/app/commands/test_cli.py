"""The contract of `slab`, `plan` and of every refusal."""

import json
import math
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cli_calls import refusal
from rigs import bent, calibrated, turned
from slopegate.app import commands
from slopegate.app.cli import main
from slopegate.app.commands.registry import COMMANDS
from slopegate.core.gating.gate import slab
from slopegate.core.gating.slab_mesh import bend_m
from slopegate.core.rig.plus_minus import plus_minus
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig, rig_to_toml

Capture = pytest.CaptureFixture[str]
COMMANDS_FOLDER = Path(commands.__path__[0])

# Model section 3: the plane through (y = 0, z = 1.05 m).
CHECK_FIGURES = [
    (50, 77.7, -1697.2),
    (76, 15.3, 1853.2),
    (78, 0.0, 2028.2),
    (80, -14.9, 2194.5),
    (108, -73.6, 3876.2),
]


def program(*words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """The real thing, in a process of its own."""
    command = [sys.executable, "-W", "error", "-m", "slopegate.app", *words]
    return subprocess.run(command, cwd=cwd, check=False, capture_output=True, text=True, timeout=280)


def strict(text: str) -> dict[str, Any]:
    """Parse one JSON object that has no NaN and no Infinity."""

    def refuse(word: str) -> float:
        raise AssertionError(f"{word} is not JSON")

    found = json.loads(text, parse_constant=refuse)
    assert isinstance(found, dict)
    return found


def answer(capsys: Capture, *words: str) -> dict[str, Any]:
    assert main([*words, "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return strict(out)


def slab_words(clock: float, delay: float, exposure: float) -> list[str]:
    return ["slab", "--clock-mhz", repr(clock), "--delay-us", repr(delay), "--exposure-us", repr(exposure)]


@pytest.mark.parametrize(("clock", "tilt", "delay"), CHECK_FIGURES)
def test_slab_gives_the_check_figures(capsys: Capture, clock: float, tilt: float, delay: float) -> None:
    found = answer(capsys, *slab_words(clock, delay, 400))
    assert found["tilt_deg"] == pytest.approx(tilt, abs=0.06)
    assert found["distance_m"] == pytest.approx(1.05, abs=1e-4)
    assert found["B"] == pytest.approx(78 / clock)
    assert found["line_time_us"] == pytest.approx(996.66866 / clock)
    assert found["thickness_m"] == pytest.approx(found["far_m"] - found["near_m"])
    assert found["windows_us"] == [[pytest.approx((delay - 200) % 16666.7), pytest.approx((delay + 200) % 16666.7)]]


def test_slab_has_the_keys_of_the_contract(capsys: Capture) -> None:
    found = answer(capsys, *slab_words(76, 1853, 400))
    assert list(found) == [
        "line_time_us",
        "B",
        "tilt_deg",
        "distance_m",
        "near_m",
        "far_m",
        "thickness_m",
        "hinge_y_m",
        "planes",
        "windows_us",
        "warnings",
    ]
    assert found["warnings"] == []
    assert list(found["planes"]) == ["near", "centre", "far"]
    for name, distance in (("near", "near_m"), ("centre", "distance_m"), ("far", "far_m")):
        plane = found["planes"][name]
        assert list(plane) == ["A", "normal", "offset_m"]
        assert math.hypot(*plane["normal"]) == pytest.approx(1)
        assert plane["offset_m"] / plane["normal"][2] == pytest.approx(found[distance])
        assert plane["A"] * found[distance] == pytest.approx(0.1 * (found["B"] + 1) / 2)
        # Every plane of this clock holds the hinge.
        assert plane["normal"][1] * found["hinge_y_m"] == pytest.approx(plane["offset_m"])


def test_the_hinge_of_an_upright_gate_is_null(capsys: Capture) -> None:
    assert answer(capsys, *slab_words(78, 2028, 400))["hinge_y_m"] is None


def test_line_time_and_clock_say_the_same(capsys: Capture) -> None:
    by_clock = answer(capsys, *slab_words(76, 1853, 400))
    words = ["slab", "--line-time-us", repr(by_clock["line_time_us"]), "--delay-us", "1853", "--exposure-us", "400"]
    assert answer(capsys, *words) == by_clock


def test_a_slab_that_reaches_infinity_is_null_not_infinity(capsys: Capture) -> None:
    found = answer(capsys, *slab_words(78, 100, 4000))
    assert found["far_m"] is None
    assert found["thickness_m"] is None
    assert found["near_m"] > 0
    assert any("infinity" in warning for warning in found["warnings"])


def test_a_clock_off_the_ladder_is_computed_as_asked_and_said(capsys: Capture) -> None:
    found = answer(capsys, *slab_words(77, 2000, 400))
    assert found["B"] == pytest.approx(78 / 77)
    (warning,) = found["warnings"]
    assert "77 MHz" in warning
    assert "76 MHz" in warning or "78 MHz" in warning


def test_delay_and_exposure_that_would_be_rounded_are_said(capsys: Capture) -> None:
    found = answer(capsys, *slab_words(78, 2028.25, 60.5))
    assert any("2028 us" in warning for warning in found["warnings"])
    assert any("100 us" in warning and "60.5 us" in warning for warning in found["warnings"])


def test_an_exposure_of_several_periods_counts_light_several_times(capsys: Capture) -> None:
    found = answer(capsys, *slab_words(78, 2028, 2.5 * 16666.7))
    assert len(found["windows_us"]) >= 3
    assert sum(end - start for start, end in found["windows_us"]) == pytest.approx(2.5 * 16666.7)
    assert any("2 times" in warning for warning in found["warnings"])


@given(
    st.floats(0.05, 300), st.floats(-1e6, 1e6), st.floats(0, 1e6, exclude_min=True), st.sampled_from([[], ["--json"]])
)
def test_slab_answers_whatever_is_finite(clock: float, delay: float, exposure: float, form: list[str]) -> None:
    assert main([*slab_words(clock, delay, exposure), *form]) == 0


def test_another_rig_is_used(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "wide.toml"
    path.write_text(rig_to_toml(load_rig(None)).replace("[0.0, -0.1, 0.0]", "[0.0, -0.2, 0.0]"), "utf-8")
    narrow, wide = (answer(capsys, *slab_words(78, 2028, 400), *rig) for rig in ([], ["--rig", str(path)]))
    assert wide["distance_m"] == pytest.approx(2 * narrow["distance_m"])


def test_a_camera_without_a_pixel_clock_takes_line_times(capsys: Capture, tmp_path: Path) -> None:
    lines = rig_to_toml(load_rig(None)).splitlines()
    lines = [line for line in lines if not line.startswith("ladder_mhz")]
    lines = [
        "line_time_us = { min = 8, max = 100, step = 0.5 }" if "clocks_per_line" in line else line for line in lines
    ]
    path = tmp_path / "lines.toml"
    path.write_text("\n".join(lines), "utf-8")
    rig = ["--rig", str(path)]
    assert "no pixel clock, give line_time_us instead" in refusal(capsys, *slab_words(78, 2028, 400), *rig)
    words = ["slab", "--delay-us", "2028", "--exposure-us", "400", *rig]
    assert answer(capsys, *words, "--line-time-us", "12.5")["warnings"] == []
    (warning,) = answer(capsys, *words, "--line-time-us", "12.7")["warnings"]
    assert "12.5 us" in warning
    planned = answer(capsys, *plan_words(10, 1.05, 0.1), *rig)
    assert planned["clock_mhz"] is None
    assert planned["line_time_us"] % 0.5 == pytest.approx(0)


def plan_words(tilt: float, distance: float, thickness: float) -> list[str]:
    return ["plan", "--tilt-deg", repr(tilt), "--distance-m", repr(distance), "--thickness-m", repr(thickness)]


@pytest.mark.parametrize(("clock", "tilt", "delay"), CHECK_FIGURES)
def test_plan_gives_the_check_figures_back(capsys: Capture, clock: float, tilt: float, delay: float) -> None:
    exact_tilt = slab(load_rig(None), gate(996.66866 / clock, delay, 400)).tilt_deg
    found = answer(capsys, *plan_words(exact_tilt, 1.05, 0.1))
    assert found["clock_mhz"] == clock
    assert found["delay_us"] == pytest.approx(delay, abs=0.55)
    assert found["delay_us"] % 1 == 0
    assert found["exact"]["clock_mhz"] == pytest.approx(clock, rel=1e-4)
    assert found["exact"]["delay_us"] == pytest.approx(delay, abs=0.5)


@pytest.mark.parametrize("wish", [(15, 1.05, 0.1), (-40, 0.6, 0.03), (0, 2.0, 0.5), (72.5, 1.3, 0.02)])
def test_plan_and_slab_agree(capsys: Capture, wish: tuple[float, float, float]) -> None:
    planned = answer(capsys, *plan_words(*wish))
    assert list(planned) == [
        "clock_mhz",
        "line_time_us",
        "delay_us",
        "exposure_us",
        "exact",
        "achieved",
        "residual",
        "warnings",
    ]
    names = ("tilt_deg", "distance_m", "thickness_m")
    applied = answer(capsys, *slab_words(planned["clock_mhz"], planned["delay_us"], planned["exposure_us"]))
    assert applied["warnings"] == []
    exact = planned["exact"]
    asked = answer(capsys, *slab_words(exact["clock_mhz"], exact["delay_us"], exact["exposure_us"]))
    for name, value in zip(names, wish, strict=True):
        assert planned["achieved"][name] == pytest.approx(applied[name], abs=1e-9)
        assert planned["residual"][name] == pytest.approx(applied[name] - value, abs=1e-9)
        assert asked[name] == pytest.approx(value, abs=1e-9)


def test_plan_says_when_a_wish_is_beyond_the_camera(capsys: Capture) -> None:
    steep = answer(capsys, *plan_words(-86, 1.0, 0.03))
    assert steep["clock_mhz"] == 128
    assert any("128" in warning for warning in steep["warnings"])
    thin = answer(capsys, *plan_words(0, 1.0, 1e-3))
    assert thin["exposure_us"] == 100
    assert any("100 to 50000 us" in warning for warning in thin["warnings"])


def test_plan_says_how_wide_a_plane_that_leans_sideways_is_held(capsys: Capture) -> None:
    lean = math.radians(3.0)
    wish = ["--thickness-m", "0.08"]
    leaning = answer(capsys, "plan", f"--plane={math.sin(lean)},0,{math.cos(lean)},-1.05", *wish)["warnings"]
    assert "leans sideways by 3.0 degrees" in leaning[0]
    assert "up to 0.76 m left and right" in leaning[0]
    assert answer(capsys, "plan", "--plane=0,0,1,-1.05", *wish)["warnings"] == []


def test_a_plane_by_its_coefficients_is_the_plane_by_its_tilt(capsys: Capture) -> None:
    # Through (0, 0, 1.05 m), the top leaning away by 15 degrees; seen from the camera, which is 5 cm below the origin.
    lean = math.radians(15)
    a, b, c = 0.0, math.sin(lean), math.cos(lean)
    d = -(c * 1.05 - b * 0.05)
    for sign in (1, -3):
        words = ["plan", f"--plane={a * sign!r},{b * sign!r},{c * sign!r},{d * sign!r}"]
        by_plane = answer(capsys, *words, "--thickness-m", "0.05")
        by_tilt = answer(capsys, *plan_words(15, 1.05, 0.05 / c))
        assert by_plane["clock_mhz"] == by_tilt["clock_mhz"]
        assert by_plane["exact"]["line_time_us"] == pytest.approx(by_tilt["exact"]["line_time_us"])
        assert by_plane["exact"]["delay_us"] == pytest.approx(by_tilt["exact"]["delay_us"])
        assert by_plane["exact"]["exposure_us"] == pytest.approx(by_tilt["exact"]["exposure_us"], rel=0.02)


GATE = ["--clock-mhz", "78", "--delay-us", "2028", "--exposure-us", "400"]
RENDER = ["render", "three_targets", *GATE]

REFUSED = {
    "unknown command": (["gate"], "gate"),
    "unknown option": (["slab", *GATE, "--gain", "3"], "--gain"),
    "abbreviated option": (["slab", "--clock", "78", "--delay-us", "1", "--exposure-us", "1"], "--clock-mhz"),
    "nothing given": (["slab"], "required"),
    "no clock": (["slab", "--delay-us", "2028", "--exposure-us", "400"], "--line-time-us"),
    "no delay": (["slab", "--clock-mhz", "78", "--exposure-us", "400"], "--delay-us"),
    "clock and line time": (["slab", *GATE, "--line-time-us", "12"], "not allowed with"),
    "no value": (["slab", "--delay-us", "1", "--exposure-us", "1", "--clock-mhz"], "--clock-mhz"),
    "a word": (["slab", *GATE[:4], "--exposure-us", "long"], "'long' is not a number"),
    "NaN": (["slab", *GATE[:4], "--exposure-us", "nan"], "--exposure-us"),
    "infinity": (["slab", *GATE[:2], "--delay-us", "inf", "--exposure-us", "1"], "--delay-us"),
    "minus infinity": (["slab", *GATE[:2], "--delay-us", "-inf", "--exposure-us", "1"], "--delay-us"),
    "zero exposure": (["slab", *GATE[:4], "--exposure-us", "0"], "--exposure-us"),
    "negative exposure": (["slab", *GATE[:4], "--exposure-us", "-1e3"], "-1e3"),
    "negative clock": (["slab", "--clock-mhz", "-78", *GATE[2:]], "--clock-mhz"),
    "zero line time": (["slab", "--line-time-us", "0", *GATE[2:]], "--line-time-us"),
    "endless line": (["slab", "--clock-mhz", "1e-5", *GATE[2:]], "line"),
    "denormal clock": (["slab", "--clock-mhz", "1e-320", *GATE[2:]], "line"),
    "endless delay": (["slab", *GATE[:2], "--delay-us", "1e300", "--exposure-us", "1"], "--delay-us"),
    "no rig file": (["slab", *GATE, "--rig", "none.toml"], "none.toml"),
    "folder for a rig": (["slab", *GATE, "--rig", "."], ". is not an ordinary file"),
    "no scene": (["slab", *GATE, "--scene", "nowhere"], "nowhere"),
    "plan without a wish": (["plan", "--thickness-m", "1"], "--tilt-deg"),
    "plan without a tilt": (["plan", "--thickness-m", "1", "--distance-m", "1"], "--tilt-deg"),
    "plan of both kinds": ([*plan_words(0, 1, 0.1), "--plane", "0,0,1,-1"], "--plane"),
    "plan without thickness": (["plan", "--tilt-deg", "0", "--distance-m", "1"], "--thickness-m"),
    "flat tilt": (plan_words(90, 1, 0.1), "tilt"),
    "tilt between camera and projector": (plan_words(89.9, 1, 0.1), "tilt"),
    "no distance": (plan_words(0, 0, 0.1), "--distance-m"),
    "negative distance": (plan_words(0, -1, 0.1), "--distance-m"),
    "no thickness": (plan_words(0, 1, 0), "--thickness-m"),
    "NaN tilt": (["plan", "--tilt-deg", "nan", "--distance-m", "1", "--thickness-m", "1"], "--tilt-deg"),
    "three coefficients": (["plan", "--plane", "0,0,1", "--thickness-m", "0.1"], "0,0,1"),
    "plane without direction": (
        ["plan", "--plane", "0,0,0,1", "--thickness-m", "0.1"],
        "--plane 0,0,0,1: it must be A, B, C, D",
    ),
    "plane behind the camera": (
        ["plan", "--plane", "0,0,1,1.05", "--thickness-m", "0.1"],
        "--plane 0,0,1,1.05: it must be A, B, C, D of a plane that the camera sees in front of it",
    ),
    "plane that only the camera sees from above": (
        ["plan", "--plane=0,1,0,0.05", "--thickness-m", "0.1"],
        "--plane 0,1,0,0.05: it must be A, B, C, D of a plane that",
    ),
    "render without a scene": (["render", *GATE, "--out", "a.png"], "SCENE"),
    "render without an image": (RENDER, "--out"),
    "unknown picture": ([*RENDER, "--out", "a.jpg"], "a.jpg"),
    "no folder": ([*RENDER, "--out", "none/a.png"], "none"),
    "folder as image": ([*RENDER, "--out", "."], "."),
    "mask of a wrong kind": ([*RENDER, "--out", "a.png", "--mask-out", "m.npy"], "m.npy"),
    "depth of a wrong kind": ([*RENDER, "--out", "a.png", "--depth-out", "d.png"], "d.png"),
    "one file for two": ([*RENDER, "--out", "a.png", "--mask-out", "./a.png"], "named twice"),
    "no samples": ([*RENDER, "--out", "a.png", "--samples", "0"], "--samples"),
    "negative samples": ([*RENDER, "--out", "a.png", "--samples", "-2"], "--samples"),
    "half a sample": ([*RENDER, "--out", "a.png", "--samples", "1.5"], "'1.5' must be a whole number from 1 to 64"),
    "digits in thousands": ([*RENDER, "--out", "a.png", "--seed", "9" * 5000], "9' must be a whole number from 0"),
    "negative seed": ([*RENDER, "--out", "a.png", "--seed", "-1"], "--seed"),
    "noise and none": ([*RENDER, "--out", "a.png", "--noise", "--no-noise"], "--no-noise"),
    "negative time": ([*RENDER, "--out", "a.png", "--time-s", "-1"], "--time-s"),
    "unknown scene": (["render", "moon", *GATE, "--out", "a.png"], "moon"),
    "folder that is no scene": (["render", ".", *GATE, "--out", "a.png"], "."),
    "rig before the command": (["--rig", "a.toml", "slab", *GATE], "after the command"),
    "window with a missing rig": (["--rig", "none.toml"], "none.toml"),
    "camera without a family": (["--camera", "webcam"], "FAMILY:WHERE"),
    "camera that is nowhere": (["--camera", "video:"], "'video:'"),
    "camera before the command": (["--camera", "video:0", "scenes"], "for the window"),
    "running free without a camera": (["--free-running"], "--camera"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_input_gets_one_sentence(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    words, named = REFUSED[name]
    assert named in refusal(capsys, *words)
    assert not any(tmp_path.iterdir())


def test_a_whole_period_has_no_complement(capsys: Capture, tmp_path: Path) -> None:
    out = tmp_path / "a.npy"
    words = ["render", "three_targets", *GATE[:4], "--exposure-us", "16666.7", "--complement", "--out", str(out)]
    assert "exposure_us" in refusal(capsys, *words)
    assert not out.exists()


@pytest.mark.parametrize("command", [[], *[[name] for name in COMMANDS]])
def test_help_explains_every_option_and_ends_with_an_example(capsys: Capture, command: list[str]) -> None:
    assert main([*command, "--help"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "example" in out
    assert f"slopegate {command[0]}" in out.split("example")[1] if command else "slopegate plan" in out
    options = out.split("\noptions:\n")[1].split("\n\n")[0]
    lines = options.splitlines()
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        described = len(line.strip().split("  ")) > 1 or following.startswith(" " * 10)
        assert described or not line.startswith("  -"), line


@pytest.fixture
def known_rig(tmp_path: Path) -> Path:
    """A rig file that tells how well it is known."""
    path = tmp_path / "known.toml"
    path.write_text(rig_to_toml(calibrated(load_rig(None))), "utf-8")
    return path


def test_read_outs_of_a_calibrated_rig_carry_their_standard_errors(capsys: Capture, known_rig: Path) -> None:
    words = [*slab_words(76, 1853, 400), "--rig", str(known_rig)]
    plain, known = answer(capsys, *words[:-2]), answer(capsys, *words)
    errors = known.pop("standard_errors")
    assert known == plain, "the read-outs are the same"
    told = slab(load_rig(known_rig), gate(plain["line_time_us"], 1853, 400)).errors
    assert errors == asdict(told)
    assert 0.001 < errors["distance_m"] < 0.02
    assert main(words) == 0
    table = capsys.readouterr().out
    assert f"{plain['distance_m']:.4f} +- {errors['distance_m']:.4f} m" in table
    assert f"{plain['tilt_deg']:.2f} +- {errors['tilt_deg']:.2f} deg" in table
    assert main(words[:-2]) == 0
    assert "+-" not in capsys.readouterr().out


def test_a_slab_that_is_turned_and_bent_says_so(capsys: Capture, tmp_path: Path) -> None:
    rig, path = calibrated(bent(turned(load_rig(None)))), tmp_path / "bent.toml"
    path.write_text(rig_to_toml(rig), "utf-8")
    words = [*slab_words(76, 600, 400), "--rig", str(path)]
    found = answer(capsys, *words)
    across, _, ahead = found["planes"]["centre"]["normal"]
    assert found["turn_deg"] == pytest.approx(math.degrees(math.atan(across / ahead)))
    assert abs(found["turn_deg"]) > 5
    assert found["bend_depths_m"] == [pytest.approx(share * found["distance_m"]) for share in (0.5, 2)]
    assert found["bend_m"] == bend_m(load_rig(path), gate(found["line_time_us"], 600, 400), *found["bend_depths_m"])
    assert found["bend_m"] > 0.05
    assert main(words) == 0
    table = capsys.readouterr().out
    assert plus_minus(found["turn_deg"], found["standard_errors"]["turn_deg"]) in table
    assert f"{found['bend_m']:.4f} m" in table
    behind = answer(capsys, *slab_words(76, -2000, 400), "--rig", str(path))
    assert (behind["distance_m"], behind["bend_m"], behind["bend_depths_m"]) == (None, None, None)


def test_a_plan_with_a_calibrated_rig_says_how_well_it_is_met(capsys: Capture, known_rig: Path) -> None:
    words = ["plan", "--tilt-deg", "15", "--distance-m", "1.05", "--thickness-m", "0.1"]
    plain, known = answer(capsys, *words), answer(capsys, *words, "--rig", str(known_rig))
    errors = known["achieved"].pop("standard_errors")
    assert known == plain
    assert set(errors) == {"tilt_deg", "turn_deg", "distance_m", "near_m", "far_m", "thickness_m"}
    assert main([*words, "--rig", str(known_rig)]) == 0
    table = capsys.readouterr().out
    assert f"{plain['achieved']['distance_m']:.4f} +- {errors['distance_m']:.4f} m" in table
    assert f"{plain['achieved']['thickness_m']:.4f} +- {errors['thickness_m']:.4f} m" in table


@pytest.mark.parametrize("command", ["slab", "plan", "render"])
def test_the_examples_of_the_help_work(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([command, "--help"]) == 0
    example = capsys.readouterr().out.split("example")[1].split("\n")[1].split()
    assert example[:2] == ["slopegate", command]
    assert main(example[1:]) == 0


def test_the_table_for_people_has_the_same_figures(capsys: Capture) -> None:
    assert main(slab_words(77, 2000, 400)) == 0
    out, err = capsys.readouterr()
    found = answer(capsys, *slab_words(77, 2000, 400))
    assert f"{found['tilt_deg']:.4f} deg" in out
    assert f"{found['distance_m']:.4f} m" in out
    assert err == "".join(f"warning: {warning}\n" for warning in found["warnings"])
    assert main(plan_words(15, 1.05, 0.1)) == 0
    assert "76.0000 MHz" in capsys.readouterr().out


def test_scenes_lists_what_ships(capsys: Capture) -> None:
    scenes = answer(capsys, "scenes")["scenes"]
    assert "three_targets" in [scene["key"] for scene in scenes]
    assert all(scene["title"] and scene["description"] for scene in scenes)
    assert main(["scenes"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [scene["key"] for scene in scenes]


def test_the_real_program_answers_and_refuses(tmp_path: Path) -> None:
    done = program(*slab_words(78, 2028, 400), "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert strict(done.stdout)["hinge_y_m"] is None
    for words in (["slab", *GATE[:4], "--exposure-us", "nan"], [*RENDER, "--out", str(tmp_path / "a.bmp")]):
        refused = program(*words)
        assert (refused.returncode, refused.stdout) == (2, "")
        assert refused.stderr.count("\n") == 1


def test_figures_alone_load_neither_window_nor_renderer() -> None:
    """Half a second of imports would be felt by every script that calls this in a loop."""
    code = (
        "import sys; from slopegate.app.cli import main;"
        f"assert main({slab_words(78, 2028, 400)!r}) == 0; assert main({plan_words(15, 1.05, 0.1)!r}) == 0;"
        "print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=280)
    loaded = {name.split(".")[0] for name in done.stderr.split()}
    assert not loaded & {
        "PySide6",
        "numba",
        "llvmlite",
        "cv2",
        "embreex",
        "mapbox_earcut",
        "pyqtgraph",
        "OpenGL",
        "tifffile",
        "OpenEXR",
    }
    assert "numpy" in loaded


def test_the_help_loads_no_command_and_no_numbers() -> None:
    """Typing `slopegate --help` is answered at once."""
    code = "import sys; from slopegate.app.cli import main; main(['--help']); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=280)
    loaded = set(done.stderr.split())
    assert not loaded & {"numpy", "cv2", "pydantic", "numba", "PySide6", "importlib.metadata", "secrets"}
    assert not loaded & {f"slopegate.app.commands.{name.replace('-', '_')}" for name in COMMANDS}


def test_every_command_is_one_file_and_one_line() -> None:
    names = [path.stem for path in COMMANDS_FOLDER.glob("*.py") if "\ndef run(" in path.read_text("utf-8")]
    assert sorted(names) == sorted([*(name.replace("-", "_") for name in COMMANDS), "window"])


def test_a_reader_that_goes_away_is_no_fault() -> None:
    command = [sys.executable, "-m", "slopegate.app", "render", "--help"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""


def test_a_delay_beyond_the_cameras_range_is_said_to_be_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["slab", "--clock-mhz", "78", "--delay-us", "99999", "--exposure-us", "400"]) == 0
    said = capsys.readouterr().err
    assert "the delay of 99999 us is beyond the camera's range of -16667 to 33334 us: it would get 33332 us" in said
    assert "modulo the projector's period of 16666.7 us" in said
    assert "its tilt means nothing" in said


def test_a_plane_that_faces_sideways_is_refused_under_the_options_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "--plane", "1,0,0,-1", "--thickness-m", "0.1"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("slopegate: --plane 1,0,0,-1: it must be")
    assert "no gate faces exactly sideways" in said
