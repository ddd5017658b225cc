"""Measuring on the live image with a real mouse and real keys."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from slopegate.app.panels.measure import MeasurePanel
from slopegate.app.session.source import Options
from slopegate.app.window.window import Window
from slopegate.core.rig.rig import Rig
from small_window import make_source

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def panel(window: Window) -> MeasurePanel:
    made = window.docks.bring("measure")
    assert isinstance(made, MeasurePanel)
    return made


def place(window: Window, column: float, row: float) -> QPoint:
    """Where an image point is on the view."""
    view = window.live.view
    seen, image = view.seen(), view.image
    assert image is not None
    x = seen.left() + column * seen.width() / image.shape[1]
    return QPoint(round(x), round(seen.top() + row * seen.height() / image.shape[0]))


def drag(qtbot: QtBot, window: Window, tool: QWidget, start: tuple[int, int], end: tuple[int, int]) -> None:
    first, last = place(window, *start), place(window, *end)
    move_pointer(qtbot, tool, first)
    qtbot.mousePress(tool, LEFT, pos=first)
    move_pointer(qtbot, tool, last)
    qtbot.mouseRelease(tool, LEFT, pos=last)


def test_a_region_by_key_and_mouse_shows_the_figures_of_its_counts(
    qtbot: QtBot, window: Window, panel: MeasurePanel
) -> None:
    window.live.view.setFocus()
    qtbot.keyClick(window.live.view, Qt.Key.Key_F6)
    tool = panel.tools["rectangle"]
    qtbot.waitUntil(lambda: tool.active)
    drag(qtbot, window, tool, (100, 80), (220, 160))
    qtbot.waitUntil(lambda: "" in panel.found)
    assert not tool.active
    assert window.live.view.hasFocus()
    box = window.live.region
    assert box is not None
    assert np.abs(np.array(box) - (100, 80, 220, 160)).max() <= 3
    image = window.live.view.image[box[1] : box[3], box[0] : box[2]]
    assert panel.found[""].mean == pytest.approx(image.mean(), abs=2)
    qtbot.waitUntil(lambda: len(panel.over_time.curves.get("", ((),))[0]) >= 2)
    qtbot.mouseClick(panel.clear, LEFT)
    qtbot.waitUntil(lambda: panel.found == {} and window.live.region is None)


def test_an_ellipse_and_the_whole_image_are_regions_and_a_mosaic_has_figures_by_filter(
    qtbot: QtBot, window: Window, panel: MeasurePanel, rig: Rig
) -> None:
    qtbot.mouseClick(panel.whole, LEFT)
    qtbot.waitUntil(lambda: panel.found[""].pixels == window.live.view.image.size)
    qtbot.mouseClick(panel.buttons["ellipse"], LEFT)
    drag(qtbot, window, panel.tools["ellipse"], (100, 80), (200, 160))
    wanted = np.pi / 4 * 100 * 80
    qtbot.waitUntil(lambda: abs(panel.found[""].pixels / wanted - 1) < 0.06)
    window.session.adopt(make_source(rig, Options(pixel_format="bayer_rg12", noise=False)))
    qtbot.mouseClick(panel.whole, LEFT)
    qtbot.waitUntil(lambda: set(panel.found) == {"R", "G", "B"})
    assert not panel.display.colours.isEnabled()


def test_a_line_shows_the_counts_along_it(qtbot: QtBot, window: Window, panel: MeasurePanel) -> None:
    window.menus.pause.trigger()  # the frame on show stays
    qtbot.keyClick(window, Qt.Key.Key_F7)
    drag(qtbot, window, panel.tools["profile"], (20, 120), (300, 120))
    qtbot.waitUntil(lambda: "" in panel.along.curves)
    x, y = panel.along.curves[""]
    assert x[-1] == pytest.approx(280, abs=3)
    image = window.live.view.image
    assert image[115:125].min() <= y.min() <= y.max() <= image[115:125].max()
    assert y.max() > 5 * y.min()  # the card is lit, what is beside it is not
    panel.beside.setValue(5)
    qtbot.waitUntil(lambda: len(panel.along.curves[""][1]) == len(y))
    qtbot.mouseClick(panel.copy, LEFT)
    table = QGuiApplication.clipboard().text().splitlines()
    assert "pixels along the line\tcounts" in table
    assert len(table) > len(y)


def test_two_clicks_measure_by_depth_and_without_depth_by_the_slab(
    qtbot: QtBot, window: Window, panel: MeasurePanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    qtbot.keyClick(window, Qt.Key.Key_F8)
    tool = panel.tools["distance"]
    for spot in ((140, 120), (180, 120)):  # both on the card, 1 m away
        at = place(window, *spot)
        move_pointer(qtbot, tool, at)
        qtbot.mouseClick(tool, LEFT, pos=at)
    wanted_cm = 100 * 40 / window.session.source.rig.camera.lens.fx

    def says(how: str) -> bool:
        words = panel.distance.text().split()
        return how in panel.distance.text() and abs(float(words[1]) - wanted_cm) < 0.06 * wanted_cm

    qtbot.waitUntil(lambda: says("cm by the scene's depth"))
    monkeypatch.setattr("slopegate.app.panels.measure.known_buffers", lambda source: None)
    qtbot.waitUntil(lambda: says("in the slab's middle, at 1.00 m"))
    lit = window.session.source.presets[-1]
    window.session.use(lit)
    qtbot.waitUntil(lambda: "no depth is known there" in panel.distance.text())


def test_what_is_hidden_draws_and_measures_nothing(qtbot: QtBot, window: Window, panel: MeasurePanel) -> None:
    qtbot.mouseClick(panel.whole, LEFT)
    qtbot.waitUntil(lambda: bool(panel.found))
    window.docks.open("section")
    qtbot.waitUntil(lambda: not panel.isVisible())
    assert window.live.region is None
    assert not panel._timer.isActive()


def test_the_scale_bar_is_as_long_as_it_says_and_blank_without_a_slab(
    qtbot: QtBot, window: Window, panel: MeasurePanel
) -> None:
    bar = window.live.scale_bar
    panel.display.scale.click()
    qtbot.waitUntil(lambda: bar.bar()[1].endswith("at 1.00 m"))
    length_px, text = bar.bar()
    image_px = length_px * window.live.view.devicePixelRatioF() / window.live.view.scale
    assert text.startswith("20 cm")
    assert image_px == pytest.approx(0.2 * window.session.source.rig.camera.lens.fx, rel=0.01)
    assert window.menus.scale.isChecked()
    window.session.use(window.session.source.presets[-1])
    qtbot.waitUntil(lambda: bar.bar() == (0.0, ""))


def test_marks_maps_and_percents_are_chosen_in_menu_and_panel_alike(
    qtbot: QtBot, window: Window, panel: MeasurePanel
) -> None:
    qtbot.keyClick(window, Qt.Key.Key_F9, Qt.KeyboardModifier.ShiftModifier)
    assert panel.display.dark.isChecked()
    view = window.live.view
    qtbot.waitUntil(lambda: bool((view.screen_pixels() == 0xFF00A0FF).any()))
    panel.display.dark.click()
    assert not window.menus.dark.isChecked()
    qtbot.waitUntil(lambda: not (view.screen_pixels() == 0xFF00A0FF).any())
    window.menus.colours["viridis"].trigger()
    assert panel.display.colours.currentText() == "viridis"
    qtbot.waitUntil(lambda: bool((view.screen_pixels() & 255 != view.screen_pixels() >> 16 & 255).any()))
    panel.display.auto_bright.setValue(40.0)
    window.live.levels.set_auto()
    assert window.live.levels.white.value() < view.image.max()


def test_copies_of_the_image_and_of_its_counts(qtbot: QtBot, window: Window, panel: MeasurePanel) -> None:
    clipboard = QGuiApplication.clipboard()
    window.live.view.setFocus()
    qtbot.keyClick(window.live.view, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: "Copied the image" in window.messages.text)
    seen = window.live.view.seen().size() * window.devicePixelRatioF()
    assert clipboard.image().size() == seen
    window.menus.pause.trigger()
    both = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
    qtbot.keyClick(window.live.view, Qt.Key.Key_C, both)
    rows = [list(map(int, line.split("\t"))) for line in clipboard.text().splitlines()]
    np.testing.assert_array_equal(rows, window.live.view.image)


def test_a_snapshot_at_once_is_a_new_file_every_time(
    qtbot: QtBot, window: Window, tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "not yet" / "there"  # type: ignore[operator]
    window._keep_folder(folder)
    window.live.view.setFocus()
    window.menus.pause.trigger()
    for _ in range(3):  # faster than the disk
        qtbot.keyClick(window.live.view, Qt.Key.Key_F12)
    qtbot.waitUntil(lambda: not window.saver.busy)
    names = sorted(path.name for path in folder.iterdir())
    assert [name.split("-")[5] for name in names] == ["0001", "0002", "0003"]
    assert all(name.startswith("a-card-before-a-wall-") for name in names)
    assert str(folder) in window.messages.text
    read = cv2.imread(str(folder / names[2]), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, window.live.view.image)
    folder.rename(folder.with_name("gone"))
    folder.write_text("no folder")
    qtbot.keyClick(window.live.view, Qt.Key.Key_F12)
    qtbot.waitUntil(lambda: str(folder) in window.messages.text and "Saved" not in window.messages.text)
