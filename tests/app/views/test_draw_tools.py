"""Drawing on the live image with a real mouse, at every zoom."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QColor
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from slopegate.app.views.draw_tools import BrushTool, PolygonTool, RectangleTool
from slopegate.app.views.live_view import LiveView
from slopegate.app.views.overlay import Overlay, RegionLayer

LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton


@pytest.fixture
def view(qtbot: QtBot) -> Iterator[LiveView]:
    """A view of 640 x 480 that shows an image of 320 x 240: two screen pixels an image pixel."""
    made = LiveView()
    qtbot.addWidget(made)
    made.resize(640, 480)
    with qtbot.waitExposed(made):
        made.show()
    with qtbot.waitSignal(made.painted):
        made.show_frame(np.full((240, 320), 1000, np.uint16), "mono12")
    yield made
    made.close()


def drag(qtbot: QtBot, tool: Overlay, *points: tuple[int, int]) -> None:
    move_pointer(qtbot, tool, QPoint(*points[0]))
    qtbot.mousePress(tool, LEFT, pos=QPoint(*points[0]))
    for point in points[1:]:
        move_pointer(qtbot, tool, QPoint(*point))
    qtbot.mouseRelease(tool, LEFT, pos=QPoint(*points[-1]))


@pytest.mark.parametrize("way", [((20, 40), (120, 240)), ((120, 240), (20, 40)), ((20, 240), (120, 40))])
def test_a_rectangle_dragged_either_way_is_the_same_pixels(
    qtbot: QtBot, view: LiveView, way: tuple[tuple[int, int], ...]
) -> None:
    tool = RectangleTool(view)
    got: list[tuple[int, ...]] = []
    tool.chosen.connect(lambda *box: got.append(box))
    tool.start()
    drag(qtbot, tool, *way)
    assert got == [(10, 20, 60, 120)]
    assert tool.active


def test_a_rectangle_beyond_the_image_ends_at_its_border_and_a_click_chooses_nothing(
    qtbot: QtBot, view: LiveView
) -> None:
    tool = RectangleTool(view)
    got: list[tuple[int, ...]] = []
    tool.chosen.connect(lambda *box: got.append(box))
    tool.start()
    drag(qtbot, tool, (600, 400), (900, 900))
    drag(qtbot, tool, (50, 50), (50, 50))
    assert got == [(300, 200, 320, 240)]


def test_a_rectangle_in_a_zoomed_view_is_where_the_image_is(qtbot: QtBot, view: LiveView) -> None:
    view.one_to_one()
    view.zoom_in()
    view.zoom_in()
    view.zoom_in()
    view.zoom_in()
    view.zoom_in()
    viewport = view.viewport
    assert viewport is not None
    tool = RectangleTool(view)
    got: list[tuple[int, ...]] = []
    tool.chosen.connect(lambda *box: got.append(box))
    tool.start()
    drag(qtbot, tool, (100, 100), (300, 200))
    first, last = viewport.to_image(100, 100), viewport.to_image(300, 200)
    assert got == [(round(first[0]), round(first[1]), round(last[0]), round(last[1]))]
    place = tool.to_view(*first)
    assert (place.x(), place.y()) == pytest.approx((100, 100))


@pytest.mark.parametrize("how", ["escape", "right"])
def test_escape_and_the_right_button_end_a_tool(qtbot: QtBot, view: LiveView, how: str) -> None:
    tool = RectangleTool(view)
    got: list[object] = []
    tool.chosen.connect(lambda *box: got.append(box))
    tool.start()
    qtbot.mousePress(tool, LEFT, pos=QPoint(10, 10))
    with qtbot.waitSignal(tool.ended):
        if how == "escape":
            qtbot.keyClick(tool, Qt.Key.Key_Escape)
        else:
            qtbot.mousePress(tool, RIGHT, pos=QPoint(30, 30))
            qtbot.mouseRelease(view, RIGHT, pos=QPoint(30, 30))
    qtbot.mouseRelease(view, LEFT, pos=QPoint(30, 30))  # what is held down here would be so in the tests that follow
    assert not tool.active
    assert got == []
    assert view.childAt(20, 20) is None


def test_a_polygon_closes_by_its_first_corner_by_double_click_and_by_enter(qtbot: QtBot, view: LiveView) -> None:
    tool = PolygonTool(view)
    got: list[np.ndarray] = []
    tool.chosen.connect(got.append)
    tool.start()
    for corner in ((100, 100), (300, 100), (200, 300), (103, 98)):
        qtbot.mouseClick(tool, LEFT, pos=QPoint(*corner))
    for corner in ((100, 100), (300, 100), (200, 300)):
        qtbot.mouseClick(tool, LEFT, pos=QPoint(*corner))
    qtbot.keyClick(tool, Qt.Key.Key_Return)
    assert len(got) == 2
    for corners in got:
        np.testing.assert_allclose(corners, [[50, 50], [150, 50], [100, 150]])


def test_a_line_is_no_polygon_and_backspace_takes_a_corner_back(qtbot: QtBot, view: LiveView) -> None:
    tool = PolygonTool(view)
    got: list[np.ndarray] = []
    said: list[str] = []
    tool.chosen.connect(got.append)
    tool.refused.connect(said.append)
    tool.start()
    for corner in ((100, 100), (300, 100), (200, 300)):
        qtbot.mouseClick(tool, LEFT, pos=QPoint(*corner))
    qtbot.keyClick(tool, Qt.Key.Key_Backspace)
    qtbot.keyClick(tool, Qt.Key.Key_Return)
    assert got == []
    assert said == ["A polygon needs at least three corners, and this has 2."]


def test_a_brush_sends_every_piece_of_its_stroke(qtbot: QtBot, view: LiveView) -> None:
    tool = BrushTool(view)
    tool.radius_px = 7.0
    got: list[tuple[np.ndarray, float]] = []
    tool.stroked.connect(lambda points, radius: got.append((points, radius)))
    tool.start()
    drag(qtbot, tool, (100, 100), (200, 100), (200, 200))
    move_pointer(qtbot, tool, QPoint(300, 300))
    assert [radius for _, radius in got] == [7.0] * 3
    ends = [tuple(points[-1]) for points, _ in got]
    assert ends == [(50.0, 50.0), (100.0, 50.0), (100.0, 100.0)]
    assert tuple(got[2][0][0]) == (100.0, 50.0)


def test_a_region_tints_its_pixels_and_leaves_the_mouse_to_the_view(qtbot: QtBot, view: LiveView) -> None:
    layer = RegionLayer(view)
    region = np.zeros((240, 320), bool)
    region[50:100, 100:200] = True
    before = view.grab().toImage()
    layer.show_region(region, QColor("#ff0000"))
    after = view.grab().toImage()
    changed = [after.pixel(x, y) != before.pixel(x, y) for x, y in ((300, 150), (203, 103), (190, 150), (300, 210))]
    assert changed == [True, True, False, False]
    assert view.childAt(300, 150) is None
    layer.show_region(None, QColor("#ff0000"))
    assert view.grab().toImage() == before


def test_an_overlay_keeps_the_size_of_the_view(qtbot: QtBot, view: LiveView) -> None:
    tool = RectangleTool(view)
    tool.start()
    view.resize(400, 400)
    assert tool.size() == view.size()
    assert tool.to_image(QPointF(-50, -50)) == (0.0, 0.0)


_ON_A_FINE_SCREEN = """
import numpy as np
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QApplication
from slopegate.app.views.live_view import LiveView
from slopegate.app.views.overlay import RegionLayer

application = QApplication([])
view = LiveView()
view.resize(320, 240)
view.show()
view.show_frame(np.zeros((240, 320), np.uint16), "mono12")
region = np.zeros((240, 320), bool)
region[40:60, 100:140] = True
RegionLayer(view).show_region(region, QColor("#ff0000"))
application.processEvents()
picture = view.grab().toImage()
assert picture.width() == 640, picture.width()
red = [(x, y) for y in range(480) for x in range(640) if picture.pixelColor(x, y).red() > 40]
left, top = (min(at[axis] for at in red) for axis in (0, 1))
right, bottom = (max(at[axis] for at in red) for axis in (0, 1))
assert (left, top, right, bottom) == (200, 80, 280, 120), (left, top, right, bottom)
"""


def test_a_region_is_tinted_where_it_is_on_a_screen_of_scale_2() -> None:
    surroundings = {**os.environ, "QT_SCALE_FACTOR": "2", "QT_QPA_PLATFORM": "offscreen"}
    ran = subprocess.run(
        [sys.executable, "-c", _ON_A_FINE_SCREEN], env=surroundings, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
