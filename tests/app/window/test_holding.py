"""What may not change while something records or sweeps: the window asks, waits, and shows the gate that is there."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from questions import answer_next
from scene_texts import A_WALL
from slopegate.app.panels.capture import CapturePanel
from slopegate.app.session.session import Intent
from slopegate.app.window.window import Window
from slopegate.core.rig.settings import gate
from slopegate.drivers.captures.model import Gate
from slopegate.drivers.captures.storage import open_capture
from slopegate.drivers.files.rig_files import shipped_rigs
from slopegate.drivers.scenes.scene_files import shipped_scenes


@pytest.fixture
def capture(qtbot: QtBot, window: Window, tmp_path: Path) -> CapturePanel:
    """One that has begun and takes long."""
    window.docks.switch("capture")
    panel = window.docks.bring("slices")
    assert isinstance(panel, CapturePanel)
    panel.where.setText(str(tmp_path / "slices"))
    panel.plan.choose("depth")
    panel.plan.count.setValue(8)
    panel.dark.setChecked(False)
    panel.frames.setValue(1000)
    qtbot.waitUntil(panel.start.isEnabled)
    qtbot.mouseClick(panel.start, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: window.session.held("gate") is not None)
    return panel


def end(qtbot: QtBot, window: Window, capture: CapturePanel) -> None:
    capture.run.cancel()
    qtbot.waitUntil(lambda: window.session.held("program") is None)


def test_the_gate_of_the_slice_that_is_exposed_is_shown_and_locked(
    qtbot: QtBot, window: Window, capture: CapturePanel, tmp_path: Path
) -> None:
    wanted, controls = window.session.resolved, window.gate
    qtbot.waitUntil(lambda: window.session.present[0] != wanted)
    present, _ = window.session.present
    assert Gate.of(present.gate) in open_capture(tmp_path / "slices").manifest.slices
    assert controls.settings.delay.spin.value() == present.gate.delay_us
    assert f"delay {present.gate.delay_us:.0f}" in controls.named.sent.toolTip()
    assert controls.named.warning.toolTip() == "Held by the capture: let it end, or end it there."
    for field in (controls.settings.delay.spin, controls.plane.spins[1], controls.named.choice):
        assert not field.isEnabled()
        assert "the capture" in field.toolTip()
    assert not window.session.ask(Intent(gate(20.0, 2000.0, 500.0)))
    assert window.messages.text == "The gate is held by the capture: let it end, or end it there."
    end(qtbot, window, capture)
    assert window.session.present == (wanted, window.session.intent)
    assert controls.settings.delay.spin.value() == wanted.gate.delay_us
    assert controls.settings.delay.spin.isEnabled()
    assert controls.named.warning.toolTip() == ""


def test_a_pause_gives_the_gate_back_and_keeps_the_source(qtbot: QtBot, window: Window, capture: CapturePanel) -> None:
    qtbot.mouseClick(capture.pause, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: window.session.held("gate") is None)
    assert window.gate.settings.delay.spin.isEnabled()
    assert window.session.held("source") is not None
    end(qtbot, window, capture)


def test_another_scene_and_rig_and_quitting_ask_first(qtbot: QtBot, window: Window, capture: CapturePanel) -> None:
    source, fate = window.session.source, "What it has taken is kept and can be resumed."
    for do, doing in (
        (lambda: window.open(shipped_scenes()[1].path), f"Opening {shipped_scenes()[1].path.name}"),
        (lambda: window.use_rig(shipped_rigs()[-1].rig), "Another rig"),
        (window.close, "Quitting"),
        (window.menus.noise.trigger, "Changing the camera"),
    ):
        asked = answer_next("Let it go on")
        do()
        assert asked == [f"{doing} ends the capture. {fate}"]
        assert capture.run.busy
        assert (window.session.source, window.isVisible(), window.opener.busy) == (source, True, False)
        assert window.menus.noise.isChecked() == source.options.noise
    end(qtbot, window, capture)


def test_what_was_allowed_ends_the_capture_and_keeps_its_slices(
    qtbot: QtBot, window: Window, capture: CapturePanel, tmp_path: Path
) -> None:
    scene = tmp_path / "wall.toml"
    scene.write_text(A_WALL)
    answer_next("End it")
    with qtbot.waitSignal(window.opener.opened):
        window.open(scene)
    assert window.session.source.where == scene
    assert capture.status.text().startswith("The capture was cancelled")
    assert open_capture(tmp_path / "slices").missing()


def test_a_scene_that_is_ready_meanwhile_waits(
    qtbot: QtBot, window: Window, capture: CapturePanel, tmp_path: Path
) -> None:
    before = window.session.source
    scene = tmp_path / "wall.toml"
    scene.write_text(A_WALL)
    window.opener.open(scene, before.options)  # as if it had been chosen before the capture began
    qtbot.waitUntil(lambda: "comes when the capture has ended" in window.progress.text)
    assert window.session.source is before
    with qtbot.waitSignal(window.opener.opened):
        end(qtbot, window, capture)
    assert window.session.source.where == scene


def test_quitting_that_was_allowed_keeps_what_there_is(
    qtbot: QtBot, window: Window, capture: CapturePanel, tmp_path: Path
) -> None:
    answer_next("End it")
    qtbot.keyClick(QApplication.focusWidget() or window, Qt.Key.Key_Q, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: not window.isVisible())
    assert open_capture(tmp_path / "slices").missing()
