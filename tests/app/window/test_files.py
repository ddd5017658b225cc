"""Sessions kept as files, recent files, a scene read again, and gates of one's own: in the real window."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from scene_texts import A_WALL
from slopegate.app.panels.alarm import AlarmPanel
from slopegate.app.panels.mask import MaskPanel
from slopegate.app.panels.measure import MeasurePanel
from slopegate.app.panels.search import SearchPanel
from slopegate.app.panels.skin import SkinPanel
from slopegate.app.session.display import Display
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


Made = TypeVar("Made", MeasurePanel, SearchPanel, AlarmPanel, SkinPanel)


def panel_of(window: Window, kind: type[Made]) -> Made:
    key = kind.__name__.removesuffix("Panel").lower()
    made = window.docks.bring(key)
    assert isinstance(made, kind)
    return made


def what_is_marked(window: Window) -> tuple[object, ...]:
    measure = panel_of(window, MeasurePanel)
    region = measure._region
    return (
        None if region is None else (region.box, region.inside.tolist()),
        measure._line,
        measure._ends,
        panel_of(window, SearchPanel).target,
        panel_of(window, AlarmPanel)._box,
        panel_of(window, SkinPanel).vein.box,
    )


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


def test_what_is_measured_and_marked_reopens(qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path) -> None:
    open_and_wait(qtbot, window, write_scene(tmp_path), "A wall")
    measure = panel_of(window, MeasurePanel)
    measure._take_shape(lambda painted: painted.polygon(np.array([[20.0, 20.0], [90.0, 30.0], [40.0, 99.0]])))
    measure.set_line(((10.25, 20.5), (200.0, 30.125)))
    measure.set_ends(((50.5, 60.0), (70.0, 80.75)))
    measure.beside.setValue(7)
    panel_of(window, SearchPanel).set_target((10, 20, 110, 90))
    panel_of(window, AlarmPanel)._set_box((5, 6, 70, 80))
    panel_of(window, SkinPanel).vein.set_box((30, 31, 60, 61))
    shown = Display(colour_map="viridis", mark_saturated=True, mark_dark=True, dark_percent=3.0, scale_bar=True)
    window.live.show_as(shown)
    window.live.levels.set_levels(100, 2000)
    window.live.levels.srgb.setChecked(False)
    before = what_is_marked(window)
    assert None not in before
    kept = tmp_path / "one.slopegate"
    window.files.save_session(kept)
    (tmp_path / "other").mkdir()
    open_and_wait(qtbot, window, write_scene(tmp_path / "other", "Another"), "Another")
    measure = panel_of(window, MeasurePanel)
    assert what_is_marked(window) == (None,) * 6
    window.live.show_as(Display())
    window.live.levels.set_full()
    window.live.levels.srgb.setChecked(True)
    open_and_wait(qtbot, window, kept, "A wall")
    assert what_is_marked(window) == before
    assert measure.beside.value() == 7
    again = Window(rig, tmp_path / "elsewhere" / "window.json")
    qtbot.addWidget(again, before_close_func=Window.close_unasked)
    again.show()
    again.open_first(str(kept))
    qtbot.waitUntil(lambda: again.live.frame is not None and name_of(again) == "A wall")
    qtbot.waitUntil(lambda: again.docks.made)
    assert what_is_marked(again) == before
    for one in (window, again):
        assert one.live.display == shown
        levels = one.live.levels
        assert (levels.black.value(), levels.white.value(), levels.srgb.isChecked()) == (100, 2000, False)
        qtbot.waitUntil(lambda one=one: panel_of(one, MeasurePanel).found != {})


def test_what_a_session_marks_is_not_for_another_scene(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    open_and_wait(qtbot, window, write_scene(tmp_path), "A wall")
    window.docks.set_panel_states({"search": {"target": "10 20 110 90"}})
    assert window.docks.docks["search"].panel is None
    (tmp_path / "other").mkdir()
    open_and_wait(qtbot, window, write_scene(tmp_path / "other", "Another"), "Another")
    assert panel_of(window, SearchPanel).target is None


@pytest.mark.parametrize("box", ["10 20 400 90", "20 20 10 90", "1 2 3", "nan 1 2 3", "a b c d", 7, -1.5])
def test_a_rectangle_that_the_image_has_not_is_left_out(window: Window, box: str | float) -> None:
    search = panel_of(window, SearchPanel)
    search.set_state({"target": box})
    assert search.target is None


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
