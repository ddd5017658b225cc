"""The mouse pointer, moved for real: the display tells the window when it gets round to it."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QPoint, Qt
from PySide6.QtGui import QCursor, QMouseEvent
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot


class _Arrival(QObject):
    """Sees a move of the pointer to a place on the screen."""

    def __init__(self, target: QPoint) -> None:
        super().__init__()
        self._target = target
        self.seen = False

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QMouseEvent) and event.type() == QEvent.Type.MouseMove and isinstance(watched, QWidget):
            self.seen |= event.globalPosition().toPoint() == self._target
        return False


def move_pointer(qtbot: QtBot, widget: QWidget, point: QPoint) -> None:
    """Move the pointer to a point of the widget; back when the window has been told."""
    if QCursor.pos() == widget.mapToGlobal(point):  # no move, no event
        _move(qtbot, widget, point + QPoint(1 if point.x() < widget.width() - 1 else -1, 0))
    _move(qtbot, widget, point)


def double_click(qtbot: QtBot, widget: QWidget, point: QPoint) -> None:
    """Click twice and let the button go, which `mouseDClick` leaves out: it would be held in later tests."""
    qtbot.mouseDClick(widget, Qt.MouseButton.LeftButton, pos=point)
    qtbot.mouseRelease(widget, Qt.MouseButton.LeftButton, pos=point)


def _move(qtbot: QtBot, widget: QWidget, point: QPoint) -> None:
    arrival = _Arrival(widget.mapToGlobal(point))
    QApplication.instance().installEventFilter(arrival)
    try:
        qtbot.mouseMove(widget, point)
        qtbot.waitUntil(lambda: arrival.seen, timeout=30_000)
    finally:
        QApplication.instance().removeEventFilter(arrival)
