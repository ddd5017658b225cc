"""The live view under real wheel, mouse and key events."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from slopegate.app.views.histogram import BINS, LevelsBar, sample_histogram
from slopegate.app.views.live_view import LiveView

WIDTH, HEIGHT = 1600, 1200
IMAGE = (np.arange(HEIGHT)[:, None] + 2 * np.arange(WIDTH)).astype(np.uint16)


@pytest.fixture
def view(qtbot: QtBot) -> LiveView:
    made = LiveView()
    qtbot.addWidget(made)
    made.resize(800, 600)
    with qtbot.waitExposed(made):
        made.show()
    with qtbot.waitSignal(made.painted):
        made.show_frame(IMAGE, "mono12")
    return made


def wheel(view: LiveView, at: QPoint, notches: int) -> None:
    event = QWheelEvent(
        QPointF(at),
        QPointF(view.mapToGlobal(at)),
        QPoint(),
        QPoint(0, 120 * notches),
        Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier,
        Qt.ScrollPhase.NoScrollPhase,
        False,
    )
    QApplication.sendEvent(view, event)


def hover(qtbot: QtBot, view: LiveView, x: int, y: int) -> tuple[int, int]:
    """What the view says of the place where the pointer came to rest."""
    heard: list[tuple[int, int]] = []
    connection = view.hovered.connect(lambda column, row: heard.append((column, row)))
    move_pointer(qtbot, view, QPoint(x, y))
    view.disconnect(connection)
    return heard[-1]


def test_the_whole_image_is_fitted_and_hovering_names_the_pixel(qtbot: QtBot, view: LiveView) -> None:
    assert view.viewport is None
    assert view.scale == 0.5
    assert hover(qtbot, view, 100, 50) == (200, 100)
    assert hover(qtbot, view, 799, 599) == (1598, 1198)


def test_painted_comes_once_per_frame(qtbot: QtBot, view: LiveView) -> None:
    heard: list[int] = []
    view.painted.connect(lambda: heard.append(1))
    view.repaint()
    assert heard == []
    view.show_frame(IMAGE, "mono12")
    view.repaint()
    view.repaint()
    assert heard == [1]


def test_wheel_zooms_to_the_cursor_and_back_out_to_the_whole(qtbot: QtBot, view: LiveView) -> None:
    at = QPoint(600, 450)
    before = hover(qtbot, view, at.x(), at.y())
    for _ in range(20):
        wheel(view, at, 1)
    assert view.scale > 20
    assert hover(qtbot, view, at.x() + 1, at.y()) == before
    for _ in range(30):
        wheel(view, at, -1)
    assert view.viewport is None
    assert view.scale == 0.5


def test_dragging_takes_the_image_along(qtbot: QtBot, view: LiveView) -> None:
    view.one_to_one()
    assert view.scale == 1.0
    grabbed = hover(qtbot, view, 400, 300)
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=QPoint(400, 300))
    move_pointer(qtbot, view, QPoint(300, 280))
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=QPoint(300, 280))
    assert hover(qtbot, view, 300, 280) == grabbed


def test_keys_zoom_pan_and_fit(qtbot: QtBot, view: LiveView) -> None:
    view.setFocus()
    for key in (Qt.Key.Key_Plus, Qt.Key.Key_Plus, Qt.Key.Key_Plus):
        qtbot.keyClick(view, key)
    assert view.scale == pytest.approx(0.5 * 1.25**3)
    assert view.viewport is not None
    left = view.viewport.left
    qtbot.keyClick(view, Qt.Key.Key_Right)
    assert view.viewport.left > left
    qtbot.keyClick(view, Qt.Key.Key_1)
    assert view.scale == 1.0
    qtbot.keyClick(view, Qt.Key.Key_F)
    assert view.viewport is None


def test_one_to_one_puts_counts_through_the_levels_onto_the_screen(qtbot: QtBot, view: LiveView) -> None:
    view.set_levels(0, 4095, False)
    view.one_to_one()
    view.repaint()
    shown = (view.screen_pixels() & 255).astype(int)
    assert view.viewport is not None
    top, left = round(view.viewport.top), round(view.viewport.left)
    wanted = IMAGE[top : top + 600, left : left + 800].astype(float) / 4095 * 255
    assert np.abs(shown - wanted).max() <= 1
    grabbed = view.grab().toImage().pixelColor(10, 20)
    assert grabbed.red() == grabbed.blue() == shown[20, 10]


def test_colour_frames_are_shown_in_colour(qtbot: QtBot, view: LiveView) -> None:
    mosaic = np.zeros((HEIGHT, WIDTH), np.uint16)
    mosaic[0::2, 0::2] = 4095
    view.show_frame(mosaic, "bayer_rg12")
    view.repaint()
    assert view.screen_pixels()[300, 400] == 0xFFFF0000
    view.show_frame(IMAGE, "mono12")
    view.repaint()
    assert view.screen_pixels()[300, 400] & 0xFF == (view.screen_pixels()[300, 400] >> 16) & 0xFF


def test_another_size_of_image_is_fitted_anew(qtbot: QtBot, view: LiveView) -> None:
    view.one_to_one()
    view.show_frame(np.zeros((100, 300), np.uint16), "mono12")
    assert view.viewport is None
    view.repaint()
    assert hover(qtbot, view, 400, 10) == (-1, -1)


def test_histogram_counts_a_fair_sample() -> None:
    image = np.full((400, 600), 100, np.uint16)
    image[200:] = 4095
    bins = sample_histogram(image, 4095)
    assert bins.shape == (BINS,)
    assert bins.sum() == bins[100 // 16] + bins[255]
    assert bins[255] == bins[100 // 16]
    assert sample_histogram(np.full((16, 16), 65535, np.uint16), 4095)[255] > 0


def test_levels_stay_apart_and_can_be_dragged(qtbot: QtBot) -> None:
    bar = LevelsBar()
    qtbot.addWidget(bar)
    bar.resize(900, 60)
    with qtbot.waitExposed(bar):
        bar.show()
    heard: list[tuple[int, int, bool]] = []
    bar.changed.connect(lambda *args: heard.append(args))
    bar.set_levels(1000, 2000)
    bar.black.setValue(3000)
    assert (bar.black.value(), bar.white.value()) == (3000, 3001)
    bar.white.setValue(10)
    assert (bar.black.value(), bar.white.value()) == (9, 10)
    bar.set_full()
    assert heard[-1] == (0, 4095, True)
    view = bar.histogram
    end = QPoint(view.width() - 2, 20)
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=end)
    move_pointer(qtbot, view, QPoint(view.width() // 2, 20))
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=QPoint(view.width() // 2, 20))
    assert bar.white.value() == pytest.approx(2048, abs=16)
    bar.show_counts(np.random.default_rng(0).normal(800, 20, (400, 400)).astype(np.uint16))
    bar.auto.click()
    assert 700 < bar.black.value() < 800 < bar.white.value() < 900
