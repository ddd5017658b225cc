"""The transport panel in the real window: plan, acquire, pause, cancel, resume, and where the result goes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QWidget
from pytestqt.qtbot import QtBot

from slopegate.app.panels.relight import RelightPanel
from slopegate.app.panels.transport import TransportPanel, costs_text
from slopegate.app.session.source import Options
from slopegate.app.window.window import Window
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.transport.plan import plan_transport
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.transports.storage import open_transport
from small_window import make_source

LEFT = Qt.MouseButton.LeftButton
UNHURRIED = Options(noise=True, rate_hz=20.0)


@pytest.fixture
def panel(qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path) -> TransportPanel:
    window.session.adopt(make_source(rig, UNHURRIED))
    made = window.docks.bring("transport")
    assert isinstance(made, TransportPanel)
    made.plan.count.setValue(2)
    type_grid(qtbot, made.grid, "4x2")
    choose(made.codes, "hadamard")
    type_folder(qtbot, made, tmp_path / "light")
    return made


def type_grid(qtbot: QtBot, box: QComboBox, text: str) -> None:
    line = box.lineEdit()
    assert line is not None
    line.selectAll()
    qtbot.keyClicks(line, text)


def type_folder(qtbot: QtBot, panel: TransportPanel, path: Path) -> None:
    panel.place.where.selectAll()
    qtbot.keyClicks(panel.place.where, str(path))


def choose(box: QComboBox, data: str) -> None:
    box.setCurrentIndex(box.findData(data))
    assert box.currentData() == data


def click(qtbot: QtBot, widget: QWidget) -> None:
    assert widget.isEnabled()
    qtbot.mouseClick(widget, LEFT)


def acquire(qtbot: QtBot, panel: TransportPanel) -> None:
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: not panel.run.busy)


def test_what_it_will_take_is_said_before_it_begins(qtbot: QtBot, panel: TransportPanel) -> None:
    qtbot.waitUntil(lambda: "2 slices of" in panel.note.text())
    assert "(the paper: 50 s)" in panel.note.text()
    few = panel.note.text()
    type_grid(qtbot, panel.grid, "32x32")
    assert panel.note.text() != few
    assert "(the paper: 15 min 0 s)" in panel.note.text()
    type_grid(qtbot, panel.grid, "32")
    assert "'32'" in panel.note.text()
    assert not panel.start.isEnabled()
    type_grid(qtbot, panel.grid, "4x2")
    assert panel.start.isEnabled()


def test_the_time_that_is_told_is_what_frames_took(qtbot: QtBot, panel: TransportPanel) -> None:
    untold = "in a time that the first of them will tell"
    qtbot.waitUntil(lambda: untold in panel.note.text())
    panel.frames.setValue(100)
    acquire(qtbot, panel)
    qtbot.waitUntil(lambda: "At most" in panel.note.text() and untold not in panel.note.text())


def test_a_scene_is_acquired_seen_to_fill_and_relit(
    qtbot: QtBot, window: Window, panel: TransportPanel, tmp_path: Path
) -> None:
    acquire(qtbot, panel)
    assert f"All 2 slices are in {tmp_path / 'light'}" in panel.status.text()
    folder = open_transport(tmp_path / "light")
    assert folder.complete
    assert (str(folder.grid), folder.manifest.codes, folder.manifest.seed) == ("4x2", "hadamard", 0)
    assert "ambient" not in folder.manifest.parts
    qtbot.waitUntil(lambda: panel.camera._image is not None and panel.projector._image is not None)
    assert panel.bar.value() == panel.bar.maximum()
    click(qtbot, panel.open)
    qtbot.waitUntil(lambda: isinstance(window.docks.docks["relight"].panel, RelightPanel))
    relight = window.docks.docks["relight"].panel
    assert isinstance(relight, RelightPanel)
    qtbot.waitUntil(lambda: relight.relit is not None and not relight.busy)
    assert "PSNR" in relight.likeness.text()
    following = panel.place.path
    assert following.parent == tmp_path
    assert following.name.endswith("-transport")


def test_pause_cancel_and_resume(qtbot: QtBot, panel: TransportPanel, tmp_path: Path) -> None:
    panel.frames.setValue(200)
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.bar.isVisible() and panel.bar.value() > 0)
    click(qtbot, panel.pause)
    qtbot.waitUntil(lambda: panel.status.text().startswith("Paused"))
    assert panel.pause.text() == "Continue"
    frame = panel.camera._image
    assert frame is not None  # of what the patterns light, until a slice is finished
    assert panel.projector._image is None
    taken = panel.bar.value()
    click(qtbot, panel.pause)
    qtbot.waitUntil(lambda: panel.bar.value() > taken)
    click(qtbot, panel.cancel)
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert "0 of 2 slices are kept" in panel.status.text()
    assert panel.start.text() == "Resume"
    assert "2 of 2 slices are missing" in panel.note.text()
    assert not panel.plan.isEnabled()
    panel.plan.choose("list")  # of which nothing is typed: what the folder was begun with counts
    acquire(qtbot, panel)
    assert open_transport(tmp_path / "light").complete
    assert panel.start.text() == "Acquire"


def test_the_live_gate_and_a_found_target_are_slices(
    qtbot: QtBot, window: Window, panel: TransportPanel, tmp_path: Path
) -> None:
    panel.plan.choose("found")
    assert "no target has been found" in panel.note.text()
    assert not panel.start.isEnabled()
    source = window.session.source
    assert source is not None
    window.desk.keep_found(source.presets[1].settings)
    assert "1 slice of" in panel.note.text()
    acquire(qtbot, panel)
    (gate,) = open_transport(tmp_path / "light").manifest.slices
    assert gate is not None
    assert gate.settings() == source.presets[1].settings
    panel.plan.choose("live")
    type_folder(qtbot, panel, tmp_path / "live")
    acquire(qtbot, panel)
    (gate,) = open_transport(tmp_path / "live").manifest.slices
    assert gate is not None
    resolved = window.session.resolved
    assert resolved is not None
    assert gate.settings() == resolved.sent
    window.desk.session.adopt(make_source(source.rig, UNHURRIED))
    panel.plan.choose("found")
    assert "no target has been found" in panel.note.text()


def adopt_a_camera(window: Window, rig: Rig) -> VirtualCamera:
    """Show what a camera sees of which nothing else is known."""
    source = make_source(rig)
    camera = source.rendered
    assert camera is not None
    window.session.adopt(replace(source, rendered=None, buffers=None))
    return camera


def test_a_camera_needs_a_screen_and_is_acquired_behind_the_live_image(
    qtbot: QtBot, window: Window, panel: TransportPanel, rig: Rig, tmp_path: Path
) -> None:
    camera = adopt_a_camera(window, rig)
    panel.plan.choose("live")
    panel.transfer.setValue(0)
    qtbot.waitUntil(lambda: "No screen is chosen for the projector" in panel.note.text())
    assert not panel.start.isEnabled()
    window.desk.screen = lambda: (VirtualProjector(camera), 0)
    type_folder(qtbot, panel, tmp_path / "device")
    assert "1 slice of" in panel.note.text()
    acquire(qtbot, panel)
    folder = open_transport(tmp_path / "device")
    assert folder.complete
    assert folder.manifest.counts_per_unit is None
    whole = folder.slice(0)
    lit = whole.total > 0.5 * whole.total.max()
    assert 0.05 < lit.mean() < 0.5
    assert np.isclose(whole.layers[0].value.sum(), whole.total.sum(), rtol=0.05)


def test_another_source_ends_what_is_acquired_with_a_camera(
    qtbot: QtBot, window: Window, panel: TransportPanel, rig: Rig, tmp_path: Path
) -> None:
    camera = adopt_a_camera(window, rig)
    window.desk.screen = lambda: (VirtualProjector(camera), 0)
    panel.plan.choose("live")
    panel.frames.setValue(1000)
    qtbot.waitUntil(panel.start.isEnabled)
    click(qtbot, panel.start)
    qtbot.waitUntil(lambda: panel.bar.isVisible() and panel.bar.value() > 0)
    window.session.adopt(make_source(rig, UNHURRIED))
    qtbot.waitUntil(lambda: not panel.run.busy)
    assert "A card before a wall was stopped" in panel.status.text()
    assert open_transport(tmp_path / "light").missing() == [0]
    assert panel.start.text() == "Resume"


def test_a_wrong_folder_is_told(qtbot: QtBot, window: Window, panel: TransportPanel, tmp_path: Path) -> None:
    (tmp_path / "light").mkdir()
    (tmp_path / "light" / "other.txt").touch()
    acquire(qtbot, panel)
    assert str(tmp_path / "light") in panel.status.text()
    assert panel.start.isEnabled()


def test_costs_are_short() -> None:
    plan = plan_transport("hadamard", BlockGrid(Raster(1280, 720), 32, 32), (1200, 1600), 5, 1, 0.02, 0.0)
    said = costs_text(plan)
    assert said.startswith(f"At most {plan.frames} frames, 1 min 47 s")
    assert f" (the paper: 15 min 0 s), {plan.bytes / 1e9:.2g} GB at a time; " in said
    assert said.endswith(f"; {plan.noise_gain:.1f} times less noise than with one block after the other.")
    assert costs_text(plan, timed=False).startswith(f"At most {plan.frames} frames, in a time that the first of them")
