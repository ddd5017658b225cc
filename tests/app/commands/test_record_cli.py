"""`slopegate record`: what it writes and tells, what it refuses, and what Ctrl-C leaves."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import tifffile

from cli_calls import refusal, report
from scene_texts import CARD_AND_WALL, GATE_OF_CARD, card_home
from slopegate.app.cli import main
from slopegate.app.commands.report import print_json
from slopegate.drivers.captures.film import open_film

Capture = pytest.CaptureFixture[str]
SCENE = f"""{CARD_AND_WALL}motion = "swing"
[motions.swing]
keys = [ {{ time_s = 0.0, offset_m = [0, 0, 0] }}, {{ time_s = 1.0, offset_m = [0.2, 0, 0] }} ]
{GATE_OF_CARD}"""
PATIENCE_S = 60.0
GATE = ("--gate", "The card")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return card_home(tmp_path, SCENE)


def words(home: Path, *more: str, out: str = "r") -> list[str]:
    return ["record", str(home / "card.toml"), "--rig", str(home / "rig.toml"), "--out", str(home / out), *more]


def test_what_it_tells_is_what_is_in_the_folder(capsys: Capture, home: Path) -> None:
    told = report(capsys, *words(home, *GATE, "--frames", "12"))
    assert (told["frames"], told["lost"], told["ended"]) == (12, 0, "All frames that were asked for are recorded")
    assert told["seconds"] == pytest.approx(11 / 20)
    path = home / "r" / "frames_0000.tif"
    assert told["files"] == [path.name]
    assert told["bytes"] == path.stat().st_size
    assert told["preview"] == "preview.mp4"
    stack = tifffile.imread(path)
    assert stack.shape == (12, 240, 320)
    assert stack.dtype == np.uint16
    assert (stack[0] != stack[5]).mean() > 0.01, "the card moves"
    with tifffile.TiffFile(path) as tiff:
        record = json.loads(str(tiff.pages[3].description))["record"]
    assert record["number"] == 3
    assert record["applied"]["delay_us"] == told["gate"]["delay_us"]


def test_seconds_and_a_time_lapse_are_those_of_the_scene(capsys: Capture, home: Path) -> None:
    assert report(capsys, *words(home, *GATE, "--seconds", "0.5"))["frames"] == 10
    lapse = report(capsys, *words(home, *GATE, "--seconds", "120", "--every", "30", out="l"))
    assert (lapse["frames"], lapse["lost"], lapse["seconds"]) == (4, 0, pytest.approx(90.0))
    again = report(capsys, *words(home, *GATE, "--seconds", "0.5", "--overwrite"))
    assert again["frames"] == 10


def test_seconds_are_told_without_digits_of_no_meaning(capsys: Capture) -> None:
    exact = 0.1 + 0.2
    print_json({"seconds": 0.19999999999999998, "slices": [{"wait_s": exact, "seconds": None}], "delay_us": exact})
    told = json.loads(capsys.readouterr().out)
    assert told == {"seconds": 0.2, "slices": [{"wait_s": 0.3, "seconds": None}], "delay_us": exact}


def test_equal_seeds_are_equal_frames(capsys: Capture, home: Path) -> None:
    for out, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        report(capsys, *words(home, *GATE, "--frames", "3", "--seed", seed, out=out))
    a, b, c = (tifffile.imread(home / out / "frames_0000.tif") for out in "abc")
    np.testing.assert_array_equal(a, b)
    assert (a != c).any()


REFUSED = {
    "no gate": (("--frames", "1"), "give --clock-mhz, --delay-us and --exposure-us"),
    "both ends": ((*GATE, "--frames", "1", "--seconds", "1"), "not allowed with argument --frames"),
    "no pace": ((*GATE, "--every", "0"), "--every: 0 must be a number above 0"),
    "no frames": ((*GATE, "--frames", "0"), "--frames: 0 must be a whole number from 1"),
    "two ways": ((*GATE, "--delay-us", "1"), "contradict each other"),
    "wait": ((*GATE, "--wait-s", "1"), "--wait-s is for a camera"),
    "camera": ((*GATE, "--camera", "ueye:1"), "exclude each other"),
}


@pytest.mark.parametrize(("more", "sentence"), REFUSED.values(), ids=REFUSED)
def test_refusals_are_one_sentence_and_make_no_folder(
    capsys: Capture, home: Path, more: tuple[str, ...], sentence: str
) -> None:
    assert sentence in refusal(capsys, *words(home, *more))
    assert not (home / "r").exists()


def test_nothing_is_overwritten_unasked(capsys: Capture, home: Path) -> None:
    report(capsys, *words(home, *GATE, "--frames", "2"))
    assert "holds a recording already" in refusal(capsys, *words(home, *GATE, "--frames", "1"))
    assert len(open_film(home / "r")) == 2
    assert report(capsys, *words(home, *GATE, "--frames", "1", "--overwrite"))["frames"] == 1
    (home / "r" / "mine.txt").write_text("x", "utf-8")
    assert "mine.txt is no part of" in refusal(capsys, *words(home, *GATE, "--frames", "1", "--overwrite"))


def test_a_camera_without_a_gate_is_recorded_as_it_comes(capsys: Capture, home: Path) -> None:
    """Of a folder of pictures, which plays like a webcam."""
    (home / "pictures").mkdir()
    for number in range(3):
        tifffile.imwrite(home / "pictures" / f"{number}.tif", np.full((48, 64), 1000 * number, np.uint16))
    camera = ("record", "--camera", f"video:{home / 'pictures'}", "--out", str(home / "v"))
    told = report(capsys, *camera, "--frames", "7")
    assert (told["frames"], told["lost"], told["gate"]) == (7, 0, None)
    levels = tifffile.imread(home / "v" / "frames_0000.tif")[:, 0, 0]
    assert set(levels) == {0, 1000, 2000}
    assert "cannot record with a gate" in refusal(
        capsys, *camera[:-1], str(home / "w"), "--clock-mhz", "78", "--delay-us", "1", "--exposure-us", "2"
    )
    assert "is a recording at one gate, not a folder of pictures" in refusal(
        capsys, "record", "--camera", f"video:{home / 'v'}", "--out", str(home / "x"), "--frames", "1"
    )


Process = subprocess.Popen[str]


@pytest.fixture
def begun() -> Iterator[list[Process]]:
    """Processes that a test has begun."""
    found: list[Process] = []
    yield found
    for process in found:
        process.kill()
        process.communicate()


def begin(begun: list[Process], *command: str) -> Process:
    words = [sys.executable, "-m", "slopegate.app", *command]
    begun.append(subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
    return begun[-1]


def until_recorded(process: Process, folder: Path, frames: int) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not ((folder / "frames_0000.tif").exists() and len(open_film(folder)) >= frames):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s, "it did not begin in time"
        time.sleep(0.01)


def test_control_c_keeps_what_is_recorded_and_says_so(begun: list[Process], home: Path) -> None:
    open_ended = begin(begun, *words(home, *GATE, "--json"))
    until_recorded(open_ended, home / "r", 5)
    open_ended.send_signal(signal.SIGINT)
    out, err = open_ended.communicate(timeout=PATIENCE_S)
    assert (open_ended.returncode, err) == (0, "")
    told = json.loads(out)
    assert told["frames"] == len(open_film(home / "r")) >= 5
    assert told["ended"] == "It was stopped"
    early = begin(begun, *words(home, *GATE, "--seconds", "100000", out="s"))
    until_recorded(early, home / "s", 5)
    early.send_signal(signal.SIGINT)
    out, err = early.communicate(timeout=PATIENCE_S)
    assert (early.returncode, err) == (130, "")
    assert out.startswith(f"{len(open_film(home / 's'))} frames of Card and wall in ")
    assert "It was stopped" in out


def test_killed_it_keeps_its_frames_and_opens_again(begun: list[Process], home: Path, capsys: Capture) -> None:
    process = begin(begun, *words(home, *GATE))
    until_recorded(process, home / "r", 8)
    process.kill()
    process.wait(PATIENCE_S)
    found = open_film(home / "r")
    assert len(found) >= 8
    assert "cut short" in found.counted().ended
    assert len(tifffile.imread(home / "r" / "frames_0000.tif")) == len(found)
    capsys.readouterr()
    assert main(words(home, *GATE, "--frames", "1", "--overwrite")) == 0


def test_control_c_in_capture_says_how_to_go_on(begun: list[Process], home: Path) -> None:
    plan = ("--delays-us", ",".join(str(1000 + 10 * step) for step in range(300)), "--exposure-us", "400")
    command = ["capture", str(home / "card.toml"), "--rig", str(home / "rig.toml")]
    process = begin(begun, *command, "--out", str(home / "c d"), *plan, "--frames", "5")
    end_s = time.monotonic() + PATIENCE_S
    while not (home / "c d" / "slice_0001.tif").exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE_S)
    kept = len(list((home / "c d").glob("slice_*.tif")))
    assert (process.returncode, out) == (130, "")
    again = f"slopegate {' '.join(command)} --out '{home / 'c d'}' --resume"
    assert f"interrupted: {kept} of 300 slices are kept in {home / 'c d'}; go on with: " in err
    assert sorted(err.split("go on with: ")[1].split()) == sorted(again.split())
    assert err.count("\n") == 1
