"""The relight panel in the real window: slices as layers, live pictures, and what a click on either side shows."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QColorDialog, QFileDialog, QListWidget
from pytestqt.qtbot import QtBot

from exact_transport import write_transport
from slopegate.app.panels.relight import BY_BLOCK, DUAL, OF_PIXEL, RELIT, RelightPanel
from slopegate.app.widgets.picture_view import PictureView
from slopegate.app.window.window import Window
from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.rig import Rig
from small_window import small_scene

LEFT, CONTROL = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.ControlModifier
CARD, WALL = (160, 120), (20, 120)
"""A pixel of the card, which the first slice holds, and one of the wall behind it, which the last one holds."""


@pytest.fixture
def panel(qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path) -> RelightPanel:
    write_transport(tmp_path / "light", rig, small_scene(rig), 3)
    window.open(tmp_path / "light")
    made = window.docks.docks["relight"].panel
    assert isinstance(made, RelightPanel)
    qtbot.waitUntil(lambda: made.relit is not None and not made.busy)
    return made


def rgb_of(view: PictureView) -> Bytes:
    """What a view shows, before it is fitted: (h, w, 3)."""
    image = view._image
    assert image is not None
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    return rows[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).copy()


def settled(qtbot: QtBot, panel: RelightPanel) -> Bytes:
    """The camera's picture, when all that was asked for is shown."""
    qtbot.waitUntil(lambda: not panel.busy)
    return rgb_of(panel.camera)


def pixel(qtbot: QtBot, panel: RelightPanel, where: tuple[int, int]) -> tuple[int, ...]:
    rgb = settled(qtbot, panel)
    return tuple(int(value) for value in rgb[where[1] * rgb.shape[0] // 240, where[0] * rgb.shape[1] // 320])


def tick(qtbot: QtBot, rows: QListWidget, place: int) -> None:
    at = rows.visualItemRect(rows.item(place))
    qtbot.mouseClick(rows.viewport(), LEFT, pos=QPoint(at.left() + 10, at.center().y()))


def select(qtbot: QtBot, rows: QListWidget, place: int, more: bool = False) -> None:
    at = rows.visualItemRect(rows.item(place)).center()
    modifier = CONTROL if more else Qt.KeyboardModifier.NoModifier
    qtbot.mouseClick(rows.viewport(), LEFT, modifier, pos=at)


def test_a_folder_opens_in_the_workspace_and_all_white_is_the_captured_white(
    qtbot: QtBot, window: Window, panel: RelightPanel
) -> None:
    assert window.docks.workspace == "transport"
    assert "light: 3 slices, 16x8 blocks" in panel.bar.said.toolTip()
    assert "the captured white to the last bit" in panel.likeness.text()
    card, wall = pixel(qtbot, panel, CARD), pixel(qtbot, panel, WALL)
    assert card[0] == card[1] == card[2] > wall[0] > 0
    assert len(panel.layers.lights) == 3
    assert "at 1." in panel.layers.rows.item(0).text()


def test_slices_are_hidden_coloured_and_made_brighter(
    qtbot: QtBot, panel: RelightPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = panel.layers.rows
    wall = pixel(qtbot, panel, WALL)
    tick(qtbot, rows, 0)
    assert pixel(qtbot, panel, CARD) == (0, 0, 0)
    assert pixel(qtbot, panel, WALL) == wall
    tick(qtbot, rows, 0)
    select(qtbot, rows, 2)
    monkeypatch.setattr(QColorDialog, "getColor", lambda *_: QColor(255, 0, 0))
    qtbot.mouseClick(panel.layers.colour, LEFT)
    assert pixel(qtbot, panel, WALL) == (wall[0], 0, 0)
    select(qtbot, rows, 0, more=True)
    panel.layers.gain.spin.setFocus()
    panel.layers.gain.spin.selectAll()
    qtbot.keyClicks(panel.layers.gain.spin, "0.25\t")
    assert [light.gain for light in panel.layers.lights] == [0.25, 1.0, 0.25]
    assert 0 < pixel(qtbot, panel, WALL)[0] < wall[0]
    assert "0.25 \u00d7" in rows.item(2).text()
    qtbot.mouseClick(panel.layers.reset, LEFT)
    assert pixel(qtbot, panel, WALL) == wall


def test_a_picture_lights_the_blocks_that_it_shows(
    qtbot: QtBot, panel: RelightPanel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lit = pixel(qtbot, panel, WALL)
    half = np.zeros((8, 16), np.uint8)
    half[:, 8:] = 255
    cv2.imwrite(str(tmp_path / "half.png"), half)
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(tmp_path / "half.png"), ""))
    select(qtbot, panel.layers.rows, 2)
    qtbot.mouseClick(panel.layers.picture, LEFT)
    qtbot.waitUntil(lambda: "half.png" in panel.layers.rows.item(2).text())
    assert pixel(qtbot, panel, WALL) == (0, 0, 0)
    assert pixel(qtbot, panel, (300, 120)) == lit
    qtbot.mouseClick(panel.layers.plain, LEFT)
    assert pixel(qtbot, panel, WALL) == lit
    (tmp_path / "half.png").write_bytes(b"no picture")
    qtbot.mouseClick(panel.layers.picture, LEFT)
    qtbot.waitUntil(lambda: "half.png" in panel.text.text())
    assert panel.layers.lights[2].picture is None


def test_a_pixel_shows_its_projector_image_and_a_block_its_camera_image(qtbot: QtBot, panel: RelightPanel) -> None:
    settled(qtbot, panel)
    assert panel.projector_mode.currentText() == DUAL
    dual = rgb_of(panel.projector)
    qtbot.mouseClick(panel.camera, LEFT, pos=panel.camera.at(CARD[0] + 0.5, CARD[1] + 0.5).toPoint())
    settled(qtbot, panel)
    assert panel.projector_mode.currentText() == OF_PIXEL
    column, row = panel.camera.marked
    assert f"Column {column}, row {row}: Slice 1 at" in panel.text.text()
    one = rgb_of(panel.projector)
    bright = one[:, :, 0] == 255
    assert 0 < bright.sum() <= 1.2 * one.shape[0] * one.shape[1] / (16 * 8)
    assert (one[~bright] == 0).all()
    row, column = (int(axis.mean()) for axis in np.nonzero(bright))
    raster = panel.relit.loaded.raster
    at = panel.projector.at((column + 0.5) * raster.width / one.shape[1], (row + 0.5) * raster.height / one.shape[0])
    qtbot.mouseClick(panel.projector, LEFT, pos=at.toPoint())
    camera = settled(qtbot, panel)
    assert panel.camera_mode.currentText() == BY_BLOCK
    marked = camera[CARD[1] * camera.shape[0] // 240, CARD[0] * camera.shape[1] // 320]
    assert (marked == 255).all()
    assert 0 < (camera[:, :, 0] > 0).mean() < 0.1
    panel.projector_mode.setCurrentText(DUAL)
    panel.projector_mode.activated.emit(0)
    panel.camera_mode.setCurrentText(RELIT)
    panel.camera_mode.activated.emit(0)
    settled(qtbot, panel)
    assert np.array_equal(rgb_of(panel.projector), dual)
    assert pixel(qtbot, panel, WALL)[0] > 0
