"""A picture with one pixel marked, by click or by arrow keys."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from slopegate.app.widgets.sentence import write_in_middle
from slopegate.app.widgets.theme import colours
from slopegate.core.rig.arrays import Bytes

_STEPS = {
    Qt.Key.Key_Left: (-1, 0),
    Qt.Key.Key_Right: (1, 0),
    Qt.Key.Key_Up: (0, -1),
    Qt.Key.Key_Down: (0, 1),
}


class PictureView(QWidget):
    """Shows RGB (h, w, 3) uint8, fitted; coordinates are those of the image that it is a picture of."""

    picked = Signal(int, int)
    """Column and row of the pixel that the user marked."""

    def __init__(self, name: str, hint: str = "", parent: QWidget | None = None) -> None:
        """`name` is what screen readers say, `hint` tells what marking a pixel is good for; empty: none is marked."""
        super().__init__(parent)
        self._image: QImage | None = None
        self._empty = ""
        self._size = (1, 1)
        self._marked: tuple[int, int] | None = None
        self._marks = bool(hint)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName(name)
        if hint:
            self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            self.setToolTip(f"Click a pixel, or move with the arrow keys (Shift: by ten), {hint}")

    def sizeHint(self) -> QSize:
        return QSize(200, 150)

    def minimumSizeHint(self) -> QSize:
        return QSize(120, 80)

    @property
    def marked(self) -> tuple[int, int] | None:
        """Column and row of the marked pixel."""
        return self._marked

    @property
    def middle(self) -> tuple[int, int]:
        """Column and row of the pixel in the middle."""
        return self._size[0] // 2, self._size[1] // 2

    def say_empty(self, text: str) -> None:
        """Say this in place of the picture while there is none."""
        self._empty = text
        self.update()

    def show_picture(self, rgb: Bytes | None, size: tuple[int, int] = (1, 1)) -> None:
        """Show a picture (h, w, 3) of an image of this (width, height); None for nothing."""
        if rgb is None:
            self._image = self._marked = None
        else:
            height, width = rgb.shape[:2]
            packed = np.ascontiguousarray(rgb)
            self._image = QImage(packed.data, width, height, 3 * width, QImage.Format.Format_RGB888).copy()
            if size != self._size:
                self._marked = None
        self._size = size
        self.update()

    def mark(self, column: int, row: int) -> None:
        """Mark a pixel; one outside of the image is moved to its edge."""
        self._marked = (min(max(column, 0), self._size[0] - 1), min(max(row, 0), self._size[1] - 1))
        self.update()

    def at(self, column: float, row: float) -> QPointF:
        """Where a continuous image coordinate is on the widget."""
        frame = self._frame()
        return QPointF(
            frame.left() + column * frame.width() / self._size[0], frame.top() + row * frame.height() / self._size[1]
        )

    def _frame(self) -> QRectF:
        scale = min(self.width() / self._size[0], self.height() / self._size[1])
        width, height = scale * self._size[0], scale * self._size[1]
        return QRectF((self.width() - width) / 2, (self.height() - height) / 2, width, height)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(colours(self.palette()).background))
        if self._image is not None:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(self._frame(), self._image)
        elif self._empty:
            write_in_middle(painter, self._empty, self.rect(), QColor(colours(self.palette()).text))
        if self._marked is not None:
            self._paint_mark(painter, self.at(self._marked[0] + 0.5, self._marked[1] + 0.5))
        if self.hasFocus():
            painter.setPen(QPen(self.palette().highlight().color(), 1))
            painter.drawRect(self.rect().adjusted(0, 0, -1, -1))
        painter.end()

    def _paint_mark(self, painter: QPainter, centre: QPointF) -> None:
        for colour, width in (("#000000", 3), ("#ffffff", 1)):
            painter.setPen(QPen(QColor(colour), width))
            painter.drawEllipse(centre, 5, 5)
            for dx, dy in _STEPS.values():
                painter.drawLine(centre + QPointF(5 * dx, 5 * dy), centre + QPointF(10 * dx, 10 * dy))

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if self._image is None or not self._marks or event.button() != Qt.MouseButton.LeftButton:
            return
        frame, where = self._frame(), event.position()
        if frame.contains(where):
            column = (where.x() - frame.left()) / frame.width() * self._size[0]
            row = (where.y() - frame.top()) / frame.height() * self._size[1]
            self.pick(int(column), int(row))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        step = _STEPS.get(Qt.Key(event.key()))
        if step is None or self._image is None:
            super().keyPressEvent(event)
            return
        far = 10 if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 1
        column, row = self._marked or self.middle
        self.pick(column + far * step[0], row + far * step[1])

    def pick(self, column: int, row: int) -> None:
        """Mark a pixel as a click does."""
        self.mark(column, row)
        assert self._marked is not None
        self.picked.emit(*self._marked)
