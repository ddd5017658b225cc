"""The window with the projector beside the camera: what a gate keeps, and the same scene with both rigs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog
from pytestqt.qtbot import QtBot

from beside import write_beside
from rigs import calibrated, turned
from settings_inside import read_settings
from slopegate.app.window.window import Window
from slopegate.drivers.files.rig_files import load_rig, rig_to_toml, shipped_rigs
from small_window import small_rig

WHY = "This rig's gates are no slabs"


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A rig file and a scene file."""
    return write_beside(tmp_path, 320)


@pytest.fixture
def window(qtbot: QtBot, tmp_path: Path, files: tuple[Path, Path]) -> Iterator[Window]:
    made = Window(load_rig(files[0]), tmp_path / "config" / "window.json")
    qtbot.addWidget(made)
    made.resize(1400, 900)
    made.show()
    with qtbot.waitSignal(made.ready, timeout=60_000):
        made.open_first(str(files[1]))
    yield made
    made.close()


def wait_for_frame(qtbot: QtBot, window: Window) -> float:
    """Mean count above black of the frame that was made with what is wanted now."""

    def shown() -> bool:
        frame, resolved = window.live.frame, window.session.resolved
        return frame is not None and resolved is not None and frame.stamp.applied == resolved.sent

    qtbot.waitUntil(shown)
    frame = window.live.copy_frame()
    assert frame is not None
    assert window.session.source is not None
    return float(frame.image.astype(np.float64).mean()) - window.session.source.camera.info.black_count


def choose(window: Window, name: str) -> None:
    """A named gate from the menu."""
    next(action for action in window.menus.gate_menu.actions() if action.text() == name).trigger()


def test_named_gates_are_the_epipolar_ones_and_those_given_by_settings(qtbot: QtBot, window: Window) -> None:
    names = [action.text() for action in window.menus.gate_menu.actions()]
    assert names[:2] == ["&Undo gate", "&Redo gate"]
    assert names[3:7] == [
        "Epipolar (delay 0)",
        "Everything but the epipolar light",
        "Forty rows down",
        "Everything lit",
    ]
    direct = wait_for_frame(qtbot, window)
    choose(window, "Everything but the epipolar light")
    rest = wait_for_frame(qtbot, window)
    choose(window, "Everything lit")
    both = wait_for_frame(qtbot, window)
    assert direct > 5 * rest  # which is ambient light alone
    assert direct + rest == pytest.approx(both, rel=0.05)
    assert WHY in window.messages.text
    assert "('The card')" in window.messages.text


def test_a_snapshot_says_that_there_is_no_slab(qtbot: QtBot, window: Window, tmp_path: Path) -> None:
    wait_for_frame(qtbot, window)
    with qtbot.waitSignal(window.saver.finished):
        window.save_frame(tmp_path / "kept.tif")
    facts = read_settings(tmp_path / "kept.tif")
    assert facts["slab"] is None
    assert facts["no_slab"].startswith(WHY)


def test_what_the_gate_keeps_stands_in_place_of_its_plane(qtbot: QtBot, window: Window) -> None:
    plane = window.gate.plane
    assert plane.title() == "What the gate keeps"
    assert plane.meaning.isVisible()
    assert plane.meaning.text() == "Epipolar: all direct light, and indirect that moved up to 2.5 rows."
    for spin in plane.spins:
        assert not spin.isEnabled()
        assert spin.toolTip().startswith(WHY)
        assert spin.text() == "\u2013"
    assert not any(label.isVisible() for label in plane.achieved)
    choose(window, "Forty rows down")
    assert plane.meaning.text() == "Non-epipolar: no direct light, indirect that moved +37.6 to +42.3 rows."
    qtbot.keyClick(window.gate.named.complement, Qt.Key.Key_Space)
    assert plane.meaning.text() == "All but indirect light that moved +37.6 to +42.2 rows."  # by whole us
    choose(window, "Epipolar (delay 0)")
    qtbot.keyClick(window.gate.settings.line.slider, Qt.Key.Key_Left)  # a slower clock: windows cross the facing rows
    assert plane.meaning.text().startswith("Direct light in ")


def test_panels_that_need_a_slab_say_why_and_the_others_work(qtbot: QtBot, window: Window) -> None:
    for key in ("search", "depth"):
        assert window.docks.docks[key].missing.startswith(WHY)
    for key in ("slab", "section", "timing", "mask", "alarm", "slices"):
        assert window.docks.docks[key].missing == ""
    section = window.docks.open("section")
    qtbot.waitUntil(lambda: section.view.lit.dots.size() > 0)
    lit = section.view.lit.dots.size()
    assert section.view.note.text().startswith("Epipolar: all direct light")
    assert section.view.note.toolTip().startswith(WHY)
    choose(window, "Everything but the epipolar light")
    qtbot.waitUntil(lambda: section.view.lit.dots.size() == 0)
    assert lit > 100
    timing = window.docks.open("timing")
    qtbot.waitUntil(lambda: timing.view.exposed.polygon().size() == 4)


def test_the_same_scene_is_looked_at_by_both_rigs(
    qtbot: QtBot, window: Window, files: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The menu offers what ships, and files; the gates follow the rig."""
    rigs = window.menus.rigs
    assert next(entry.key for entry in shipped_rigs()) == "check"
    assert {entry.rig for entry in shipped_rigs()} < set(rigs)
    assert rigs[load_rig(files[0])].isChecked()
    above = tmp_path / "above.toml"
    above.write_text(rig_to_toml(calibrated(small_rig())), "utf-8")
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(above), ""))
    with qtbot.waitSignal(window.opener.opened, timeout=30_000):
        window.menus.rig_menu.actions()[-1].trigger()
    assert rigs[small_rig()].isChecked()
    assert window.session.source.rig.calibration == calibrated(small_rig()).calibration
    assert window.session.source.where == files[1]
    assert window.gate.named.choice.currentText() == "The card"
    plane = window.gate.plane
    assert plane.title() == "Plane on the axis"
    assert plane.spins[1].isEnabled()
    assert plane.achieved[1].isVisible()
    assert plane.achieved[1].text().startswith("= 0.8")
    assert not plane.meaning.isVisible()
    assert window.docks.docks["search"].missing == ""
    with qtbot.waitSignal(window.opener.opened, timeout=30_000):
        rigs[load_rig(files[0])].trigger()
    assert window.gate.named.choice.currentText() == "Epipolar (delay 0)"
    above.write_text("nonsense", "utf-8")
    window.menus.rig_menu.actions()[-1].trigger()
    assert "above.toml" in window.messages.text
    assert rigs[load_rig(files[0])].isChecked()


def test_another_rig_does_not_begin_with_the_gate_of_the_last_one(
    qtbot: QtBot, window: Window, tmp_path: Path, files: tuple[Path, Path]
) -> None:
    window.close()
    again = Window(small_rig(), tmp_path / "config" / "window.json")
    qtbot.addWidget(again)
    again.show()
    with qtbot.waitSignal(again.ready, timeout=60_000):
        again.open_first(None)
    assert again.session.source.where == files[1]
    assert again.gate.named.choice.currentText() == "The card"
    again.close()


def test_a_mask_that_no_gate_makes_says_what_gates_of_this_rig_keep(qtbot: QtBot, window: Window) -> None:
    wait_for_frame(qtbot, window)
    mask = window.docks.open("mask")
    mask.rectangle.chosen.emit(120, 80, 160, 120)
    qtbot.mouseClick(mask.find_button, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: "bands of the picture's rows" in mask.predicted.text())
    assert window.gate.named.choice.currentText() == "Epipolar (delay 0)"


@pytest.mark.parametrize(
    ("roll_deg", "offset_m", "first"),
    [
        (180.0, (0.0, -0.1, 0.0), "Forty rows down"),  # opposed scans: slabs, but no upright ones
        (90.0, (0.0, -0.1, 0.0), "Forty rows down"),  # rows along the baseline and across the camera's
        (90.0, (-0.1, 0.0, 0.0), "Forty rows down"),  # slabs that lean sideways, and stand upright at no clock
        (3.0, (-0.1, 0.0, 0.0), "The card"),  # thick slabs, and nearly epipolar
    ],
)
def test_rigs_turned_about_their_axis_open_and_every_gate_of_theirs_is_shown(
    qtbot: QtBot,
    tmp_path: Path,
    files: tuple[Path, Path],
    roll_deg: float,
    offset_m: tuple[float, float, float],
    first: str,
) -> None:
    rig = turned(small_rig(), (0.0, 0.0, roll_deg), offset_m)
    made = Window(rig, tmp_path / "config" / "window.json")
    qtbot.addWidget(made)
    made.resize(1400, 900)
    made.show()
    with qtbot.waitSignal(made.ready, timeout=60_000):
        made.open_first(str(files[1]))
    section = made.docks.open("section")
    assert made.gate.named.choice.currentText() == first
    for action in made.menus.gate_menu.actions():
        action.trigger()
        wait_for_frame(qtbot, made)
        resolved = made.session.resolved
        assert made.gate.plane.meaning.isVisible() == (resolved.slab is None)
        qtbot.waitUntil(lambda: section.view.note.text() != "")
    made.close()
