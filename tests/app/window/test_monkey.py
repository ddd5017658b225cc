"""Thousands of random actions in a real window: no bug, no wrong number, no slice lost, and it always answers."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QTimer
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QApplication, QColorDialog, QFileDialog, QInputDialog
from pytestqt.qtbot import QtBot

from monkey import Monkey
from slopegate.app.window.window import Window
from slopegate.core.rig.settings import PixelClocks
from slopegate.drivers.captures.storage import is_capture, open_capture

ACTIONS = 1500
SCENE = """
title = "A wall at {z} m"
[[objects]]
name = "wall"
type = "plane"
centre_m = [0.0, 0.0, {z}]
width_m = 4.0
height_m = 3.0
"""


@pytest.fixture
def monkey(
    request: pytest.FixtureRequest, window: Window, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Monkey]:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    scenes = []
    for number, text in enumerate((SCENE.format(z=1.2), SCENE.format(z=2.5), "title = 3", SCENE.format(z=-1))):
        scenes.append(tmp_path / f"scene-{number}.toml")
        scenes[-1].write_text(text, "utf-8")
    out = tmp_path / "out"
    out.mkdir()
    made = Monkey(window, request.param, scenes, out)
    for name in ("getOpenFileName", "getSaveFileName"):
        monkeypatch.setattr(QFileDialog, name, made.file)
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", made.folder)
    monkeypatch.setattr(QInputDialog, "getText", made.text)
    monkeypatch.setattr(QColorDialog, "getColor", made.colour)
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda _: True)
    yield made
    made.rest()
    window.set_theme("light")


def wrong_numbers(window: Window) -> str:
    """What the gate's boxes show that is not the gate that is there; nothing where all is right."""
    present, source = window.session.present, window.session.source
    if present is None or source is None:
        return ""
    gate, box, line = present[0].gate, window.gate.settings, source.rig.camera.shutter.line
    wanted = [float(gate.delay_us), gate.exposure_us]
    shown = [box.delay.value, box.exposure.value]
    if isinstance(line, PixelClocks):
        wanted.append(line.clock_mhz(gate.line_time_us))
        shown.append(box.line.value)
    pairs = zip(shown, wanted, strict=True)
    return "" if all(abs(one - other) < 1e-3 for one, other in pairs) else f"shown {shown}, there {wanted}"


@pytest.mark.slow
@pytest.mark.parametrize("monkey", [1, 2], indirect=True)
def test_whatever_is_pressed_all_stays_right(
    qtbot: QtBot, window: Window, monkey: Monkey, bugs: list[logging.LogRecord], tmp_path: Path
) -> None:
    answered: list[int] = []
    for number in range(int(os.environ.get("SLOPEGATE_MONKEY_ACTIONS", ACTIONS))):
        monkey.act()
        QTimer.singleShot(0, window, lambda number=number: answered.append(number))
        QApplication.processEvents()
        here = f"after action {number}: {monkey.last}"
        assert not bugs, f"{here}: {[record.getMessage() for record in bugs]}"
        qtbot.waitUntil(lambda number=number: answered[-1:] == [number])
        assert window.isVisible(), here
        wrong = wrong_numbers(window)
        assert not wrong, f"{here}: {wrong}"
    monkey.rest()
    for hold in window.session.holds("program"):
        hold.stop()
    qtbot.waitUntil(lambda: not window.session.holds("program") and not window.opener.busy)
    captures = [path for path in (tmp_path / "home").rglob("*") if path.is_dir() and is_capture(path)]
    slices = 0
    for path in captures:
        folder = open_capture(path)
        for index, record in folder.records().items():
            if not record.empty:
                folder.total(index)  # raises where the slice is damaged
            slices += 1
    print(f"{sum(monkey.did.values())} actions, {len(captures)} captures with {slices} slices: {dict(monkey.did)}")
