"""The transport panel with a camera that films the projector's window on a second virtual screen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QDialog
from pytestqt.qtbot import QtBot

import two_screens
from screen_camera import FULL, ScreenCamera, turned_map
from slopegate.app.devices.projector_dialog import ProjectorDialog
from slopegate.app.panels.transport import TransportPanel
from slopegate.app.window.window import Window
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.transport.sliced import camera_image
from slopegate.drivers.transports.storage import open_transport
from small_window import make_source

HERE = str(Path(__file__))
LEFT = Qt.MouseButton.LeftButton
SETTLE_FRAMES = 20
"""So many that a busy machine's screen has surely copied the pattern by then."""
needs_two_screens = pytest.mark.skipif(not two_screens.inside(), reason="run inside by the first test of this file")


@pytest.mark.timeout(900)
def test_all_of_this_on_two_screens() -> None:
    assert "1 passed" in two_screens.run_inside(HERE)


@needs_two_screens
@pytest.mark.timeout(600)
def test_what_the_map_lights_is_acquired_through_the_window(
    qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("slopegate.app.devices.projector_window.DRAW_TIMEOUT_S", 60.0)
    window.resize(1200, 780)
    window.move(0, 0)
    lens, raster = rig.camera.lens, Raster(1280, 720)
    sees = turned_map(raster, lens.height, lens.width)
    window.session.adopt(replace(make_source(rig), camera=ScreenCamera(sees), buffers=None, rendered=None))
    panel = window.docks.bring("transport")
    assert isinstance(panel, TransportPanel)
    panel.grid.setCurrentText("4x2")
    panel.codes.setCurrentIndex(panel.codes.findData("hadamard"))
    panel.place.where.setText(str(tmp_path / "screen"))
    qtbot.waitUntil(lambda: "show a pattern on it first (Ctrl+J)" in panel.note.text())
    QTest.keyClick(window, Qt.Key.Key_J, Qt.KeyboardModifier.ControlModifier)
    (dialog,) = window.findChildren(QDialog)
    assert isinstance(dialog, ProjectorDialog)
    dialog.settle.setValue(SETTLE_FRAMES)
    qtbot.mouseClick(dialog.toggle, LEFT)
    qtbot.waitUntil(lambda: "Hide ends it" in dialog.status.text())
    dialog.close()
    qtbot.waitUntil(panel.start.isEnabled)
    assert "1 slice of all light, for this camera has no gate" in panel.note.text()
    qtbot.mouseClick(panel.start, LEFT)
    qtbot.waitUntil(lambda: not panel.run.busy, timeout=500_000)
    assert f"are in {tmp_path / 'screen'}" in panel.status.text()
    folder = open_transport(tmp_path / "screen")
    one, grid = folder.slice(0), folder.grid
    assert folder.manifest.slices == [None]
    assert folder.manifest.settle_frames == SETTLE_FRAMES
    wanted = sees.transport(grid)
    np.testing.assert_allclose(one.total, wanted.sum(axis=2), atol=1.0)
    for block in range(grid.count):
        row, column = divmod(block, grid.columns)
        seen = camera_image(one, raster, int(grid.column_edges[column]), int(grid.row_edges[row]))
        np.testing.assert_allclose(seen, wanted[:, :, block], atol=0.002 * FULL)
    window.close()
