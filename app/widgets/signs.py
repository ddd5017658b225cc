"""Small signs of lines on buttons that Qt makes itself: its own can hardly be seen on a dark window."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QEvent, QPointF, Qt
from PySide6.QtGui import QColor, QIcon, QPainter, QPalette, QPen, QPixmap
from PySide6.QtWidgets import QToolBar, QToolButton

_MORE = (((4, 4), (8, 8), (4, 12)), ((9, 4), (13, 8), (9, 12)))
"""Lines in a square of 16, as all signs are."""


def drawn(sign: Sequence[Sequence[tuple[int, int]]], colour: QColor) -> QIcon:
    """An icon of these lines in a square of 16."""
    picture = QPixmap(48, 48)
    picture.setDevicePixelRatio(3.0)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(QPen(colour, 1.6))
    for line in sign:
        painter.drawPolyline([QPointF(x, y) for x, y in line])
    painter.end()
    return QIcon(picture)


class ToolBar(QToolBar):
    """A tool bar whose button for what has no room is seen."""

    def __init__(self, title: str) -> None:
        super().__init__(title)
        self._draw_more()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() in (QEvent.Type.PaletteChange, QEvent.Type.StyleChange):
            self._draw_more()

    def _draw_more(self) -> None:
        button = self.findChild(QToolButton, "qt_toolbar_ext_button")
        if button is not None:
            button.setIcon(drawn(_MORE, self.palette().color(QPalette.ColorRole.WindowText)))
            button.setToolTip("What the window has no room for")
