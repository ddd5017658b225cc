"""The real window on devices: pictures, a GenTL camera, one that hangs, one whose board makes the delay."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QMimeData, QPoint, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from pytestqt.qtbot import QtBot
from slopegate.app.window import Window
from slopegate.core.rig import Rig

BAR = 30
"""Columns of the white bar in the pictures, so that frame k is told from the others."""


def pictures(folder: Path) -> Path:
    folder.mkdir()
    for k in range(4):
        image = np.full((120, 160), 20, np.uint8)
        image[:, k * BAR : (k + 1) * BAR] = 200
        cv2.imwrite(str(folder / f"{k}.png"), image)
    return folder


def film(path: Path) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (160, 120))
    for k in range(5):
        writer.write(np.full((120, 160, 3), 40 * k, np.uint8))
    writer.release()
    return path


def drop(window: Window, path: Path) -> None:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path))])
    copy, left, none = Qt.DropAction.CopyAction, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
    enter = QDragEnterEvent(QPoint(9, 9), copy, data, left, none)
    window.dragEnterEvent(enter)
    assert enter.isAccepted()
    window.dropEvent(QDropEvent(QPoint(9, 9), copy, data, left, none))


def runs(window: Window, name: str) -> bool:
    source, frame = window.session.source, window.live.frame
    shape = None if source is None else (source.camera.info.height, source.camera.info.width)
    return source is not None and name in source.scene.name and frame is not None and frame.image.shape == shape


def tab(window: Window, title: str) -> tuple[bool, str]:
    """Whether it can be used, and what it says of itself."""
    tabs = window.plots.tabs
    (index,) = (index for index in range(tabs.count()) if tabs.tabText(index).replace("&", "") == title)
    return tabs.isTabEnabled(index), tabs.tabToolTip(index)


@pytest.mark.parametrize("make", [lambda path: pictures(path / "walk"), lambda path: film(path / "film.avi")])
def test_pictures_and_films_play_when_dropped(
    qtbot: QtBot, window: Window, tmp_path: Path, make: Callable[[Path], Path]
) -> None:
    path = make(tmp_path)
    drop(window, path)
    qtbot.waitUntil(lambda: runs(window, path.name), timeout=10_000)
    seen: set[int] = set()

    def moves() -> bool:
        assert window.live.frame is not None
        seen.add(int(window.live.frame.image[60].astype(int).argmax() // BAR + window.live.frame.image.max()))
        return len(seen) >= 3

    qtbot.waitUntil(moves, timeout=10_000)
    assert window.live.travelled.text().endswith("no gate")
    assert window.menus.scenes.currentText() == window.session.source.scene.name
    # a plain camera: no gate to set, and everything that needs one says so
    box = window.gate.settings
    for widget in (box.line.spin, box.delay.slider, box.exposure.spin, window.gate.plane.spins[0]):
        assert not widget.isEnabled()
        assert "no shutter" in widget.toolTip()
    assert "no shutter" in window.gate.named.warning.toolTip()
    qtbot.waitUntil(lambda: window.plots.top.currentIndex() == 1)
    for title in ("Section y\u2013z", "Timing", "Mask", "Search", "Depth", "Slices"):
        able, why = tab(window, title)
        assert not able
        assert "no shutter" in why
    assert tab(window, "Alarm") == (True, "")
    for key in ("]", ".", ";"):
        qtbot.keyClick(window, key)
    qtbot.keyClick(window, Qt.Key.Key_M, Qt.KeyboardModifier.ControlModifier)
    assert window.messages.text == ""
    assert not window.menus.noise.isEnabled()


def test_a_scene_after_a_plain_camera_has_everything_again(
    qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path
) -> None:
    window.open(pictures(tmp_path / "walk"))
    qtbot.waitUntil(lambda: runs(window, "walk"))
    qtbot.waitUntil(lambda: window.plots.top.currentIndex() == 1)
    from .conftest import make_source

    window.session.adopt(make_source(rig))
    qtbot.waitUntil(lambda: window.plots.top.currentIndex() == 0)
    assert all(tab(window, title)[0] for title in ("Section y\u2013z", "Timing", "Mask", "Search", "Depth", "Slices"))
    assert window.plots.tabs.currentWidget() is window.plots.section
    assert window.gate.settings.delay.spin.isEnabled()
    assert "Alt+D" in window.gate.settings.delay.spin.toolTip()
    assert window.menus.noise.isEnabled()
