"""`slopegate calibrate-timing` on scenes, captures and cameras: what it tells and writes, and every refusal."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli_calls import refusal, report
from rigs import LADDER, check_rig
from slopegate.app.cli import main
from slopegate.app.commands import calibrate_timing, capture_camera
from slopegate.core.calibration.informative import FIRST
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.scene.shapes import turn
from slopegate.drivers.calibrations.timing_run import MOST_FRAMES, USUAL_FRAMES
from slopegate.drivers.cameras.believed import PULSE_US
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.files.rig_files import load_rig, rig_to_toml
from small_window import small_rig
from timed_captures import captured, gates_of
from timed_scenes import JITTER, hidden_plane
from ueye_stub import CLOCKS_PER_LINE, SERIAL, stub

Capture = pytest.CaptureFixture[str]
SCENE = """
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, 1.1]
width_m = 5.0
height_m = 4.0
tilt_deg = 8
yaw_deg = 15
"""
NUMBERS = ("delay_offset_us", "active_fraction", "period_us", "clocks_per_line")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / "wall.toml").write_text(SCENE, "utf-8")
    (tmp_path / "rig.toml").write_text(rig_to_toml(check_rig(160)), "utf-8")
    return tmp_path


def test_the_command_allows_what_the_run_does() -> None:
    """The limits stand in both, for the help is not to wait for what the run imports."""
    told = calibrate_timing.LEAST_FRAMES, calibrate_timing.MOST_FRAMES, calibrate_timing.USUAL_FRAMES
    assert told == (FIRST, MOST_FRAMES, USUAL_FRAMES)


def words(home: Path, *more: str) -> list[str]:
    return ["calibrate-timing", "--rig", str(home / "rig.toml"), "--out", str(home / "out.toml"), *more]


def wall(home: Path, *more: str) -> list[str]:
    return words(home, str(home / "wall.toml"), *more)


def test_a_practice_rig_is_found_and_told_at_the_end(capsys: Capture, home: Path) -> None:
    said = report(capsys, *wall(home, "--practice", "3", "--faults", "jitter_us=5", "--frames", "60"))
    found = load_rig(home / "out.toml")
    assert said["delay_offset_us"]["value"] == found.camera.shutter.delay_offset_us
    assert said["period_us"]["value"] == found.projector.period_us
    assert said["active_fraction"]["value"] == found.projector.active_fraction
    assert isinstance(found.camera.shutter.line, PixelClocks)
    assert said["clocks_per_line"]["value"] == found.camera.shutter.line.clocks_per_line
    assert found.calibration is not None
    for name in NUMBERS:
        assert said[name]["standard_error"] == pytest.approx(found.calibration.standard_errors[name])
        assert said["truth"][name]["off"] == pytest.approx(said[name]["value"] - said["truth"][name]["value"])
        assert abs(said["truth"][name]["sigmas"]) < 4
    assert abs(said["truth"]["delay_offset_us"]["value"]) > 20
    for line in said["line_time_us"]:
        clock = line["clock_mhz"]
        assert line["value"] == pytest.approx(said["clocks_per_line"]["value"] / clock)
        assert 0 < line["standard_error"] < 0.02 * line["value"]
    assert said["rows"] == {"camera": "down", "projector": "down"}
    assert set(said["next_gate"]) == {"clock_mhz", "line_time_us", "delay_us", "exposure_us"}
    assert said["frames"] == 60
    assert said["jitter_us"] < 30
    assert {"saturated", "without_edges", "off", "lost", "duplicated", "discarded"} == set(said["left_out"])
    assert {one["name"] for one in said["differences"]} == set(NUMBERS)
    assert said["facts"]["timing.frames"] == "60"
    assert not said["enough"]


def plane_of_wall(rig: Rig) -> str:
    """The scene's wall, as a plane from the camera."""
    normal = turn(8.0, 15.0)[:, 2]
    distance_m = float(normal @ (np.array([0.0, 0.0, 1.1]) - rig.camera_centre_m))
    return ",".join(map(repr, [*normal.tolist(), -distance_m]))


def test_the_rig_itself_has_an_offset_of_nothing_and_words_say_so(capsys: Capture, home: Path) -> None:
    assert main(wall(home, "--frames", "14", "--plane", plane_of_wall(check_rig(160)))) == 0
    out, err = capsys.readouterr()
    assert out.startswith("wall on small: the timing from ")
    for word in ("delay offset", "line time", "camera rows", "projector rows", "jitter"):
        assert f"  {word}" in out
    assert out.endswith(f"  {home / 'out.toml'} is written\n")
    assert (
        "Against the rig before\n  none of 4 numbers moved by more than 3 standard errors\n  a gate that the old" in out
    )
    assert re.search(
        r"warning: not known well enough after \d+ gates: .*about \d+ gates should do \(--frames \d+\)", err
    )
    found = load_rig(home / "out.toml")
    assert found.calibration is not None
    assert abs(found.camera.shutter.delay_offset_us) < 4 * found.calibration.standard_errors["delay_offset_us"] < 20


def test_a_true_rig_is_told_from_the_one_believed(capsys: Capture, home: Path) -> None:
    rig = check_rig(160)
    shutter = replace(rig.camera.shutter, delay_offset_us=1234.5)
    true = replace(rig, camera=replace(rig.camera, shutter=shutter))
    (home / "true.toml").write_text(rig_to_toml(true), "utf-8")
    more = ("--true-rig", str(home / "true.toml"), "--frames", "48", "--plane", plane_of_wall(rig))
    said = report(capsys, *wall(home, *more))
    assert said["truth"]["delay_offset_us"]["value"] == 1234.5
    assert said["delay_offset_us"]["value"] == pytest.approx(1234.5, abs=10)
    (moved,) = [one for one in said["differences"] if one["name"] == "delay_offset_us"]
    assert (moved["old"], moved["new"]) == (0.0, said["delay_offset_us"]["value"])
    against = said["old_rig"]
    assert against["moved"][0] == "delay_offset_us"
    assert "delay_offset_us from 0" in against["sentences"][0]
    # gates came 1234.5 us too early: of the 100 projector rows of 1 m, those of that time are missing
    rows = 100 - 1234.5 * rig.projector.rows_per_us
    assert against["really"]["distance_m"] == pytest.approx(100 / rows, rel=0.02)
    assert "standard_errors" in against["really"]
    assert " really stands at 2.3" in against["sentences"][-1]


def test_a_camera_is_timed_by_what_it_sees(capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A real camera's way, with the virtual one in the driver's place."""
    hidden = hidden_plane(4)
    (home / "rig.toml").write_text(rig_to_toml(hidden.believed), "utf-8")
    bench = hidden.bench(faults=JITTER)
    bench.camera.stop()
    monkeypatch.setattr(capture_camera, "open_camera", lambda *given: bench.camera)
    x, y, one = hidden.target.slopes
    more = ("--plane", f"{x!r},{y!r},{one!r},-1", "--frames", "60", "--both-edges")
    said = report(capsys, *words(home, "--camera", f"ueye:{SERIAL}", *more))
    assert abs(said["pulse_width_us"]["value"] - PULSE_US) < 3 * said["pulse_width_us"]["standard_error"]
    assert said["scene"] == "A plane"
    assert said["truth"] is None
    assert said["facts"]["timing.camera"] == "A plane"
    rows = {"camera": hidden.camera_up, "projector": hidden.projector_up}
    assert said["rows"] == {name: "up" if up else "down" for name, up in rows.items()}
    off_us = said["delay_offset_us"]["value"] - hidden.true.camera.shutter.delay_offset_us
    off_us = math.remainder(off_us, hidden.true.projector.period_us)
    assert abs(off_us) < 4 * said["delay_offset_us"]["standard_error"]


def test_a_capture_is_timed_with_the_rig_that_it_brings(capsys: Capture, home: Path) -> None:
    hidden = hidden_plane(4)
    captured(home / "c", hidden, gates_of(hidden.believed))
    x, y, one = hidden.target.slopes
    line = ["calibrate-timing", str(home / "c"), "--out", str(home / "out.toml")]
    said = report(capsys, *line, "--plane", f"{x!r},{y!r},{one!r},-1")
    assert said["scene"] == "A plane"
    assert said["rows"]["camera"] == ("up" if hidden.camera_up else "down")
    assert len(said["line_time_us"]) >= 4
    assert load_rig(home / "out.toml").calibration is not None
    told = refusal(capsys, *line, "--overwrite")
    assert "a capture does not tell where its plane is: give --chart or --plane" in told
    told = refusal(capsys, *line, "--overwrite", "--plane", "0,0,1,-1", "--practice", "3")
    assert "--practice is for a SCENE" in told
    told = refusal(capsys, *line, "--overwrite", "--plane", "0,0,1,-1", "--both-edges")
    assert "--both-edges is for a SCENE or a camera" in told


def test_both_edges_tell_the_triggers_pulse(capsys: Capture, home: Path) -> None:
    told = ("--practice", "3", "--frames", "40", "--both-edges")
    said = report(capsys, *wall(home, *told, "--faults", "jitter_us=5"))["pulse_width_us"]
    assert said["level"] == "high"
    assert said["standard_error"] < 3
    assert abs(said["value"] - PULSE_US) < 3 * said["standard_error"]
    assert main([*wall(home, *told), "--overwrite"]) == 0
    assert "trigger pulse" in capsys.readouterr().out


def test_a_camera_of_one_edge_is_told_before_a_gate_is_taken(
    capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hidden = hidden_plane(4)
    camera = VirtualCamera(hidden.true, hidden.scene)
    monkeypatch.setattr(capture_camera, "open_camera", lambda *given: camera)
    more = ("--camera", f"ueye:{SERIAL}", "--plane", "0,0,1,-1")
    told = refusal(capsys, *words(home, *more, "--both-edges"))
    assert "It cannot be told which edge of the trigger starts its frames." in told
    assert not (home / "out.toml").exists()


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        ((), "give a SCENE"),
        (("wall.toml", "--camera", "ueye:1"), "exclude each other"),
        (("wall.toml", "--screen", "HDMI-1"), "--screen is for a camera"),
        (("wall.toml", "--frames", "11"), "11 must be a whole number from 12 to 10000"),
        (("wall.toml", "--chart", "9x7:22", "--plane", "0,0,1,-1"), "not allowed with argument"),
        (("wall.toml", "--true-rig", "check", "--practice", "1"), "not allowed with argument"),
        (("wall.toml", "--plane", "0,0,1"), "must be four finite numbers"),
        (("wall.toml", "--plane", "0,0,1,0"), "D must not be 0"),
        (("wall.toml", "--chart", "2x2:5"), "from 3 to 100 inner corners"),
        (("wall.toml", "--faults", "gremlins"), "it must be one of trigger, link, plug, all"),
        (("wall.toml", "--chart", "9x7:22"), "no chart 9x7:22 was found in the picture"),
        (("wall.toml", "--plane", "0,0,-1,-1"), "share too little of the plane"),
        (("wall.toml", "--true-rig", "check"), "pixels of the camera is '160 x 120': it must be 1600 x 1200"),
        (("nothing.toml",), "is no file, no folder and none of the shipped scenes"),
        (("--camera", "ueye:1"), "give --chart or --plane, or --screen"),
        (("--camera", "ueye:1", "--plane", "0,0,1,-1", "--practice", "1"), "--practice is for a SCENE"),
        (("--camera", "ueye:1", "--plane", "0,0,1,-1", "--no-noise"), "--no-noise is for a SCENE"),
        (("--camera", "video:0", "--plane", "0,0,1,-1"), "cannot record with a gate"),
        (("--camera", "nonsense", "--plane", "0,0,1,-1"), "nonsense"),
    ],
)
def test_bad_input_is_one_sentence(
    capsys: Capture, home: Path, monkeypatch: pytest.MonkeyPatch, more: tuple[str, ...], complaint: str
) -> None:
    monkeypatch.chdir(home)
    assert complaint in refusal(capsys, *words(home, *more))
    assert not (home / "out.toml").exists()


def test_a_rig_file_that_is_there_is_kept(capsys: Capture, home: Path) -> None:
    (home / "out.toml").write_text("mine", "utf-8")
    assert "out.toml" in refusal(capsys, *wall(home))
    assert (home / "out.toml").read_text("utf-8") == "mine"


def test_a_real_driver_whose_camera_sees_no_chart_says_so(capsys: Capture, home: Path) -> None:
    """The stand-in for a uEye, whose frames show no scene."""
    stub().fresh()
    rig = small_rig(PixelClocks(CLOCKS_PER_LINE, LADDER))
    (home / "rig.toml").write_text(rig_to_toml(rig), "utf-8")
    told = refusal(capsys, *words(home, "--camera", f"ueye:{SERIAL}", "--chart", "9x7:22"))
    assert "no chart 9x7:22 was found in the picture" in told


def test_a_chart_of_another_size_is_refused_and_nothing_written(capsys: Capture, home: Path) -> None:
    told = refusal(capsys, *words(home, "chart_board", "--chart", "9x7:22", "--practice", "7", "--frames", "12"))
    assert told.startswith("slopegate: --chart 9x7:22 is not the chart that is seen: ")
    assert "the inner corners and the squares, in mm, of the chart that is seen" in told
    assert not (home / "out.toml").exists()
