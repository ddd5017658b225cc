"""`slopegate calibrate --camera` and `--practice`: poses taken live, what is kept of them, and every refusal."""

from __future__ import annotations

import io
import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

import two_screens
from cli_calls import refusal
from slopegate.app.cli import main
from slopegate.app.commands import capture_camera
from slopegate.core.calibration.chart import Chart, chart_from
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.uncertainty import numbers_of
from slopegate.drivers.calibrations.practice import PracticeRig, PracticeWorld, hidden_rig
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.files.rig_files import load_rig, rig_to_toml
from small_practice import CHART, practice_poses, small_rig
from two_screens import PROJECTOR, screen_pixels

HERE = str(Path(__file__))
needs_two_screens = pytest.mark.skipif(not two_screens.inside(), reason="run inside by the first test of this file")
Capture = pytest.CaptureFixture[str]


@pytest.mark.timeout(900)
def test_all_of_this_on_two_screens() -> None:
    assert "5 passed" in two_screens.run_inside(HERE, "-k", "hands or start or there_is")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, qapp: QApplication) -> Path:
    (tmp_path / "small.toml").write_text(rig_to_toml(small_rig()), "utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("slopegate.app.devices.projector_window.DRAW_TIMEOUT_S", 60.0)
    return tmp_path


def practise(capsys: Capture, *words: str) -> dict[str, Any]:
    given = ("--rig", "small.toml", "--chart", CHART, "--json")
    assert main(["calibrate", *words, *given]) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    return told


def test_practice_finds_its_hidden_numbers_and_keeps_pictures_that_read_back(home: Path, capsys: Capture) -> None:
    told = practise(capsys, "--practice", "5", "--views", "5", "--keep", "poses", "--out", "found.toml")
    hidden = told["hidden"]
    assert hidden["numbers"] == 24
    assert hidden["within"]["3"] >= 22, "by chance one rig of fifteen has a number beyond"
    assert set(told["old_rig"]["moved"]) <= {one["name"] for one in hidden["parameters"]}
    assert told["old_rig"]["sentences"][-1].startswith("a gate that the old rig has upright at 1 m really stands at ")
    assert [view["name"] for view in told["views"]] == [f"pose_0{k}" for k in range(1, 6)]
    again = practise(capsys, "poses", "--projector", "256x192", "--out", "again.toml")
    assert [view["pictures_sha256"] for view in again["views"]] == [view["pictures_sha256"] for view in told["views"]]
    assert numbers_of(load_rig("again.toml")) == pytest.approx(numbers_of(load_rig("found.toml")), rel=1e-6)
    other = practise(capsys, "--practice", "5", "--views", "3", "--out", "other.toml")
    assert other["hidden"]["parameters"][0]["old"] == hidden["parameters"][0]["old"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "give a FOLDER of pictures, --camera"),
        (("poses", "--practice"), "a FOLDER and --practice exclude each other"),
        (("--camera", "video:0", "--practice", "2"), "--camera and --practice exclude each other"),
        (("poses", "--screen", "HDMI-1"), "--screen goes with --camera, not with a FOLDER"),
        (("--practice", "--wait-s", "3"), "--wait-s goes with --camera, not with --practice"),
        (("poses", "--views", "5"), "--views goes with --camera or --practice, not with a FOLDER"),
        (("--practice", "--projector", "64x48"), "--projector goes with a FOLDER"),
        (("--practice", "-1"), "a whole number from 0 to"),
        (("--practice", "--views", "2"), "a whole number from 3 to"),
        (("--practice", "--chart", "100x100:500"), "is nowhere seen whole by camera and projector"),
    ],
)
def test_what_does_not_go_together_is_refused(words: tuple[str, ...], said: str, home: Path, capsys: Capture) -> None:
    assert said in refusal(capsys, "calibrate", *words, "--rig", "small.toml", "--out", "rig.toml")
    assert not (home / "rig.toml").exists()


class Hands(io.StringIO):
    """Holds the chart at the next pose whenever it is asked to press Enter; the end of the input after the last."""

    def __init__(self, practice: PracticeRig, count: int) -> None:
        super().__init__()
        self._practice = practice
        self._poses = practice_poses(practice.truth, practice.chart, count, 7)

    def readline(self, size: int | None = -1, /) -> str:
        if not self._poses:
            return ""
        self._practice.move(self._poses.pop(0))
        return "\n"


def screen_rig() -> Rig:
    """The small rig with the projector of the second screen."""
    rig = small_rig()
    whole = load_rig("check").projector.lens
    return Rig(rig.camera, type(rig.projector)(whole, rig.projector.period_us), rig.projector_offset_m)


def watched(monkeypatch: pytest.MonkeyPatch, poses: int) -> PracticeRig:
    """A practice rig whose projector is the second screen, and hands that hold its chart."""
    chart: Chart = chart_from(CHART)
    practice = PracticeRig(screen_rig(), chart, 4, PracticeWorld(blur_px=(0.0, 0.0)), live=True)
    inner = practice.camera.read

    def read(buffer: Counts, timeout_s: float) -> FrameStamp | None:
        practice.camera.light_with((screen_pixels(PROJECTOR)[..., 1] / 255).astype(np.float32))
        return inner(buffer, timeout_s)

    monkeypatch.setattr(practice.camera, "read", read)
    monkeypatch.setattr(capture_camera, "open_camera", lambda *_: practice.camera)
    monkeypatch.setattr("sys.stdin", Hands(practice, poses))
    return practice


WORDS = (
    "calibrate", "--camera", "video:0", "--screen", PROJECTOR[0], "--rig", "screen.toml", "--chart", CHART,
    "--settle-frames", "12", "--transfer-us", "0", "--out", "found.toml", "--json",
)  # fmt: skip


@needs_two_screens
def test_hands_at_the_terminal_calibrate_with_the_second_screen(
    home: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    (home / "screen.toml").write_text(rig_to_toml(screen_rig()), "utf-8")
    practice = watched(monkeypatch, 4)
    assert main([*WORDS, "--views", "4"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert err.count("press Enter") == 4
    assert [view["used"] for view in told["views"]] == [True] * 4
    found = told["parameters"]["camera.fx"]
    assert abs(found["value"] - practice.truth.camera.lens.fx) < 4 * found["standard_error"]
    assert sorted(path.name for path in (home / "found_poses").iterdir()) == [f"pose_0{k}" for k in range(1, 5)]
    assert not [window for window in QApplication.topLevelWindows() if window.isVisible()]


@needs_two_screens
def test_another_start_goes_on_with_what_was_kept(home: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "screen.toml").write_text(rig_to_toml(screen_rig()), "utf-8")
    watched(monkeypatch, 2)
    assert main([*WORDS]) == 2  # the input ended
    assert "2 of 2 views can be used" in capsys.readouterr().err
    assert not (home / "found.toml").exists()
    watched(monkeypatch, 1)
    assert main([*WORDS, "--views", "3"]) == 0
    out, err = capsys.readouterr()
    assert "pose_01, taken before: 24 corners" in err
    assert len(json.loads(out)["views"]) == 3


@needs_two_screens
def test_ctrl_c_at_the_start_of_a_pose_says_what_is_kept(
    home: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    (home / "screen.toml").write_text(rig_to_toml(screen_rig()), "utf-8")
    watched(monkeypatch, 2)
    hold = Hands.readline

    def interrupted(hands: Hands, size: int | None = -1, /) -> str:
        if len(hands._poses) == 1:
            os.kill(os.getpid(), signal.SIGINT)
        return hold(hands, size)

    monkeypatch.setattr(Hands, "readline", interrupted)
    assert main([*WORDS]) == 130
    told = capsys.readouterr().err.splitlines()[-1]
    assert "interrupted: poses kept in found_poses: 1; start it again to go on, or fit those: " in told
    assert told.endswith("slopegate calibrate found_poses --chart 6x4:40 --rig screen.toml --out found.toml")
    assert not (home / "found.toml").exists()


@needs_two_screens
def test_a_screen_that_is_not_there_is_answered(home: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "screen.toml").write_text(rig_to_toml(screen_rig()), "utf-8")
    watched(monkeypatch, 1)
    words = [word if word != PROJECTOR[0] else "DP-7" for word in WORDS]
    assert "--screen is 'DP-7'" in refusal(capsys, *words)
    assert not (home / "found_poses").exists()


@needs_two_screens
def test_a_chart_that_is_not_there_is_said_and_counts_as_no_view(
    home: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    (home / "screen.toml").write_text(rig_to_toml(screen_rig()), "utf-8")
    practice = watched(monkeypatch, 1)
    monkeypatch.setattr(practice, "move", lambda pose: None)
    assert main([*WORDS]) == 2
    assert "sees no light of the projector" in capsys.readouterr().err


def test_the_projectors_blur_and_gamma_are_told_and_the_blur_is_written_on_request(home: Path, capsys: Capture) -> None:
    told = practise(capsys, "--practice", "5", "--views", "3", "--keep", "poses", "--out", "found.toml", "--with-blur")
    truth = hidden_rig(small_rig(), 5)
    blur, gamma = told["projector_blur_px"], told["response"]
    assert blur["value"] == pytest.approx(truth.projector.blur_px, abs=max(0.1, 2 * blur["standard_error"]))
    assert len(blur["map"]) == 6
    assert gamma["gamma"] == pytest.approx(1.0, abs=0.01)
    assert load_rig("found.toml").projector.blur_px == pytest.approx(blur["value"], abs=1e-3)
    assert "+-" in told["facts"]["geometry.projector_blur_px"]
    assert not any("grey levels" in warning for warning in told["warnings"])
    again = practise(capsys, "poses", "--projector", "256x192", "--out", "again.toml")
    assert again["projector_blur_px"]["value"] == pytest.approx(blur["value"])
    assert again["response"] is None
    assert load_rig("again.toml").projector.blur_px == 0
