"""Sessions kept as files, recent files, a scene read again, and gates of one's own: in the real window."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from scene_texts import A_WALL
from slopegate.app.panels.mask import MaskPanel
from slopegate.app.session.session import Intent, PlaneWish
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import rig_to_toml


def write_scene(folder: Path, title: str = "A wall") -> Path:
    path = folder / "wall.toml"
    path.write_text(A_WALL.replace("A wall", title), "utf-8")
    return path


def open_and_wait(qtbot: QtBot, window: Window, where: Path, title: str) -> None:
    window.open(where)
    qtbot.waitUntil(lambda: window.session.source is not None and window.session.source.scene.name == title)
    qtbot.waitUntil(lambda: window.live.frame is not None)


def name_of(window: Window) -> str:
    source = window.session.source
    return "" if source is None else source.scene.name


def test_a_session_reopens_as_it_was(qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    folder.mkdir()
    open_and_wait(qtbot, window, write_scene(folder), "A wall")
    window.session.ask(Intent(PlaneWish(2.0, 1.4, 0.3), complement=True))
    mask = window.docks.bring("mask")
    assert isinstance(mask, MaskPanel)
    image = window.live.view.image
    assert image is not None
    height, width = image.shape[:2]
    mask._paint(lambda to, add: to.rectangle((3, 2, width // 2, height // 2), add))
    mask.hide_it.setChecked(True)
    mask.radius.setValue(17)
    region, wanted = mask.region, window.session.intent
    assert region is not None
    region = region.copy()
    window.files.save_session(folder / "one.slopegate")
    layout, workspace = window.docks.layouts(), window.docks.workspace
    # something else in between
    window.docks.switch("light")
    (tmp_path / "other").mkdir()
    open_and_wait(qtbot, window, write_scene(tmp_path / "other", "Another"), "Another")
    mask.radius.setValue(3)
    mask.keep.setChecked(True)
    # and moved to where its scene still lies beside it
    moved = folder.rename(tmp_path / "moved")
    open_and_wait(qtbot, window, moved / "one.slopegate", "A wall")
    assert window.session.intent == wanted
    assert window.session.source is not None
    assert window.session.source.rig == rig
    assert window.docks.workspace == workspace
    assert set(window.docks.layouts()) >= set(layout)
    assert mask.region is not None
    np.testing.assert_array_equal(mask.region, region)
    assert (mask.hide_it.isChecked(), mask.radius.value()) == (True, 17)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"version": 7}, "has version 7 and this program reads up to 1"),
        ({"scene": None}, "must name either a scene or a camera"),
        ({"scene": "gone.toml"}, "which is missing"),
        ({"exec": "import os"}, "exec"),
        ({"rig_toml": "width = 3"}, "the rig of"),
        ({"gate": {"line_time_us": -1, "delay_us": 0, "exposure_us": 1}}, "gate.line_time_us"),
        ({"camera": "nothing", "scene": None}, "nothing"),
    ],
)
def test_what_is_no_session_is_told_and_what_runs_goes_on(
    qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path, change: dict[str, object], sentence: str
) -> None:
    before = window.session.source
    whole = {"format": "slopegate-session", "scene": "wall.toml", "rig_toml": rig_to_toml(rig)} | change
    path = tmp_path / "s.slopegate"
    path.write_text(json.dumps({key: value for key, value in whole.items() if value is not None}), "utf-8")
    window.open(path)
    qtbot.waitUntil(lambda: sentence in window.messages.text)
    assert window.session.source is before


def test_an_edited_scene_is_read_again_with_its_gate(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    path = write_scene(tmp_path)
    open_and_wait(qtbot, window, path, "A wall")
    assert window.session.ask(Intent(gate(window.session.resolved.gate.line_time_us, 3000.0, 700.0)))
    held = window.session.resolved
    write_scene(tmp_path, "A better wall")
    window.files.again.trigger()
    qtbot.waitUntil(lambda: name_of(window) == "A better wall")
    assert window.session.resolved == held
    path.write_text("[[objects", "utf-8")
    window.files.again.trigger()
    qtbot.waitUntil(lambda: "is not valid TOML" in window.messages.text)
    assert name_of(window) == "A better wall"


def test_what_was_opened_is_offered_again(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    path = write_scene(tmp_path)
    open_and_wait(qtbot, window, path, "A wall")
    (tmp_path / "b").mkdir()
    other = write_scene(tmp_path / "b", "Another")
    open_and_wait(qtbot, window, other, "Another")
    window.files.menu.aboutToShow.emit()
    first, second = window.files.menu.actions()[:2]
    assert (first.toolTip(), second.toolTip()) == (str(other), str(path))
    second.trigger()
    qtbot.waitUntil(lambda: name_of(window) == "A wall")
    assert window.files.recent[0] == str(path)
    other.unlink()
    window.files.menu.aboutToShow.emit()
    assert [action.isEnabled() for action in window.files.menu.actions()[:2]] == [True, False]


def test_a_gate_is_kept_used_and_forgotten(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    assert window.session.ask(Intent(PlaneWish(0.0, 1.2, 0.2)))
    kept = window.session.resolved
    window.gate_menu.keep_as("Mine")
    assert window.session.use(window.session.source.presets[-1])
    assert window.session.resolved != kept
    mine = next(action for action in window.gate_menu.menu.actions() if action.text() == "Mine")
    mine.trigger()
    assert window.session.resolved == kept
    window.gate_menu.save_to(tmp_path / "shared.toml")
    assert "Mine" in (tmp_path / "shared.toml").read_text("utf-8")
    window.gate_menu.load_from(tmp_path / "none.toml")
    assert "is missing" in window.messages.text
    window.gate_menu.keep_as("a\nb")
    assert "name is" in window.messages.text
    assert window.menus.gate_menu.actions()[-1].menu() is window.gate_menu.menu
    assert Qt.Key.Key_K in [key.key() for key in window.gate_menu.keep.shortcut()]
