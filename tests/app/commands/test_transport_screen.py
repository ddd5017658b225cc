"""`slopegate transport acquire --camera --screen`: patterns in a window on a second virtual screen; every refusal."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

import two_screens
from cli_calls import refusal
from rigs import check_rig
from screen_camera import FULL, ScreenCamera, turned_map
from slopegate.app.cli import main
from slopegate.app.commands import capture_camera
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.sliced import camera_image
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.files.rig_files import rig_to_toml
from slopegate.drivers.transports.storage import open_transport
from two_screens import CONTROL, PROJECTOR

HERE = str(Path(__file__))
RASTER = Raster(1280, 720)
MAP = turned_map(RASTER)
WORDS = ("transport", "acquire", "--camera", "video:0", "--rig", "rig.toml", "--grid", "4x2", "--out", "t")
SCREEN = ("--screen", PROJECTOR[0], "--settle-frames", "20", "--transfer-us", "0")
needs_two_screens = pytest.mark.skipif(not two_screens.inside(), reason="run inside by the first test of this file")
Capture = pytest.CaptureFixture[str]


@pytest.mark.timeout(900)
def test_all_of_this_on_two_screens() -> None:
    assert "4 passed" in two_screens.run_inside(HERE)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, qapp: QApplication) -> Path:
    (tmp_path / "rig.toml").write_text(rig_to_toml(check_rig(64)), "utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(capture_camera, "open_camera", lambda *_: ScreenCamera(MAP))
    monkeypatch.setattr("slopegate.app.devices.projector_window.DRAW_TIMEOUT_S", 60.0)
    return tmp_path


@needs_two_screens
def test_what_is_acquired_is_the_map(home: Path, capsys: Capture) -> None:
    assert main([*WORDS, *SCREEN, "--json"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert "has no gate, so there is one slice, with everything in it" in err
    assert (told["complete"], [item["gate"] for item in told["slices"]]) == (True, [None])
    found, wanted = open_transport(home / "t").slice(0), MAP.transport(BlockGrid(RASTER, 4, 2))
    for block in range(8):
        row, column = divmod(block, 4)
        image = camera_image(found, RASTER, 320 * column + 100, 360 * row + 100)
        assert np.abs(image - wanted[:, :, block]).max() < 4, block  # counts, of FULL
    assert np.ptp(wanted) > FULL / 2
    assert not [window for window in QApplication.topLevelWindows() if window.isVisible()]


@needs_two_screens
def test_ctrl_c_ends_it_at_the_next_pattern(home: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    class Interrupted(ScreenCamera):
        def start(self) -> None:
            super().start()
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(capture_camera, "open_camera", lambda *_: Interrupted(MAP))
    assert main([*WORDS, *SCREEN]) == 130
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("slopegate: interrupted: 0 of 1 slices are kept in t; go on with: slopegate transport ")
    assert told.endswith(" --resume")
    assert open_transport(home / "t").missing() == [0]
    monkeypatch.setattr(capture_camera, "open_camera", lambda *_: ScreenCamera(MAP))
    capsys.readouterr()
    words = [word for word in WORDS if word not in ("--grid", "4x2")]
    assert main([*words, "--screen", PROJECTOR[0], "--transfer-us", "0", "--resume", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["complete"]


@needs_two_screens
def test_screens_that_are_not_there_are_answered_with_those_that_are(home: Path, capsys: Capture) -> None:
    for words, named in ((WORDS, "patterns need a screen"), ((*WORDS, "--screen", "DP-7"), "--screen is 'DP-7'")):
        said = refusal(capsys, *words)
        assert named in said
        assert f"{CONTROL[0]}: 1280 x 900" in said
        assert f"{PROJECTOR[0]}: 1280 x 720" in said
    assert not (home / "t").exists()


@needs_two_screens
def test_a_camera_that_does_not_open_is_said(home: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(*_: object) -> ScreenCamera:
        raise CameraError("no lens")

    monkeypatch.setattr(capture_camera, "open_camera", gone)
    assert main([*WORDS, *SCREEN]) == 2
    assert "video:0 did not open: no lens" in capsys.readouterr().err
    assert not (home / "t").exists()
