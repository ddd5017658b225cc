"""The composite panel in the real window: the foreground by its slices, a new background, pictures and files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QFileDialog
from pytestqt.qtbot import QtBot

from exact_transport import write_transport
from slopegate.app.panels.composite import HINT, MATTE, CompositePanel
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from small_window import small_scene

LEFT = Qt.MouseButton.LeftButton
CARD, WALL = (120, 160), (120, 20)
"""Row and column of the card, which the first slice holds, and of the wall behind it, which the last one holds."""


@pytest.fixture
def panel(qtbot: QtBot, window: Window, rig: Rig, tmp_path: Path) -> CompositePanel:
    write_transport(tmp_path / "light", rig, small_scene(rig), 3)
    made = window.docks.bring("composite")
    assert isinstance(made, CompositePanel)
    assert not made.body.isVisible()
    window.desk.transports.read(tmp_path / "light")
    qtbot.waitUntil(made.body.isVisible)
    return made


def tick(qtbot: QtBot, panel: CompositePanel, place: int) -> None:
    at = panel.rows.visualItemRect(panel.rows.item(place))
    qtbot.mouseClick(panel.rows.viewport(), LEFT, pos=QPoint(at.left() + 10, at.center().y()))
    qtbot.waitUntil(lambda: not panel.busy)


def choose_background(
    qtbot: QtBot, panel: CompositePanel, path: Path, colour: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    cv2.imwrite(str(path), np.full((30, 50, 3), colour[::-1], np.uint8))
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(path), ""))
    qtbot.mouseClick(panel.background, LEFT)
    qtbot.waitUntil(lambda: not panel.busy)


def test_the_card_is_cut_out_and_stands_before_another_background(
    qtbot: QtBot, panel: CompositePanel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert panel.text.text() == HINT
    assert not panel.save.isEnabled()
    tick(qtbot, panel, 0)
    result = panel.result
    assert result is not None
    assert result.matte[CARD] == 1
    assert result.matte[WALL] == 0
    card = result.after[CARD]
    assert np.array_equal(result.shown[CARD], [result.before[CARD]] * 3)
    assert not result.after[WALL].any()
    assert f"covers {result.matte.mean():.1%}" in panel.text.text()
    choose_background(qtbot, panel, tmp_path / "sea.png", (0, 0, 255), monkeypatch)
    result = panel.result
    assert result is not None
    assert result.shown[WALL].tolist() == [0, 0, 255]
    assert np.array_equal(result.after[CARD], card)
    qtbot.mouseClick(panel.relit, LEFT, pos=QPoint(8, panel.relit.height() // 2))
    qtbot.waitUntil(lambda: not panel.busy)
    result = panel.result
    assert result is not None
    assert result.after[CARD].tolist() == [0, 0, pytest.approx(card[2], rel=1e-5)]
    tick(qtbot, panel, 0)
    assert panel.text.text() == HINT
    assert panel.result is None


def test_picture_and_matte_are_saved(
    qtbot: QtBot, panel: CompositePanel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tick(qtbot, panel, 0)
    panel.mode.setCurrentText(MATTE)
    panel.mode.activated.emit(1)
    result = panel.result
    assert result is not None
    for button, name in (
        (panel.save, "after.png"),
        (panel.save, "after.npy"),
        (panel.save_matte, "matte.png"),
        (panel.save_matte, "matte.exr"),
    ):
        monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_, name=name: (str(tmp_path / name), ""))
        qtbot.mouseClick(button, LEFT)
        qtbot.waitUntil(lambda name=name: panel.text.text() == f"Saved {tmp_path / name}")
    assert np.array_equal(np.load(tmp_path / "after.npy"), result.after)
    seen = cv2.imread(str(tmp_path / "after.png"))
    assert seen[CARD].min() > 200
    assert seen[WALL].max() == 0
    matte = cv2.imread(str(tmp_path / "matte.png"), cv2.IMREAD_UNCHANGED)
    assert (matte[CARD], matte[WALL]) == (255, 0)
    assert (tmp_path / "matte.exr").stat().st_size > 0
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(tmp_path / "after.doc"), ""))
    qtbot.mouseClick(panel.save, LEFT)
    qtbot.waitUntil(lambda: "after.doc" in panel.text.text())


def test_what_is_no_picture_and_a_black_one_are_told(
    qtbot: QtBot, panel: CompositePanel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tick(qtbot, panel, 0)
    before = panel.result
    (tmp_path / "broken.png").write_bytes(b"no picture")
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(tmp_path / "broken.png"), ""))
    qtbot.mouseClick(panel.background, LEFT)
    qtbot.waitUntil(lambda: "broken.png" in panel.text.text())
    assert panel.result is before
    panel.relit.setChecked(True)
    choose_background(qtbot, panel, tmp_path / "night.png", (0, 0, 0), monkeypatch)
    assert "background is 'black'" in panel.text.text()
    assert panel.result is None
    panel.relit.setChecked(False)
    for place in (1, 2):
        tick(qtbot, panel, place)
    assert "and not all of them" in panel.text.text()
