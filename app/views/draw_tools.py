"""Tools that draw on the live image: a rectangle, an ellipse, a line, a polygon, a brush."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF

from slopegate.app.views.live_view import LiveView
from slopegate.app.views.overlay import Overlay

_KEYS = (Qt.Key.Key_Escape, Qt.Key.Key_Return, Qt.Key.Key_Enter, Qt.Key.Key_Backspace)
_CLOSE_PX = 10.0
"""A click this near to a polygon's first corner closes it."""
_CLICK_PX = 4.0
"""A press that moves less is a click."""


class Tool(Overlay):
    """An overlay that takes the mouse while it is active. Esc or the right button give up what was begun."""

    ended = Signal()
    """The tool is active no more, by `stop`, Esc or the right button."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setCursor(Qt.CursorShape.CrossCursor)

    @property
    def active(self) -> bool:
        """Whether the tool has the mouse."""
        return not self.isHidden()

    def start(self) -> None:
        """Take the mouse over the image; another tool that has it gives it up."""
        for other in self._view.findChildren(Tool):
            if other is not self:
                other.stop()
        self.forget()
        self.setGeometry(self._view.rect())
        self.show()
        self.raise_()
        self.setFocus()

    def stop(self) -> None:
        """Give the mouse back to the image."""
        if self.active:
            self.forget()
            if self.hasFocus():
                self._view.setFocus()
            self.hide()
            self.ended.emit()

    def forget(self) -> None:
        """Drop the shape that is being drawn."""
        raise NotImplementedError

    def event(self, event: QEvent) -> bool:
        """Keys are the tool's before they are the window's shortcuts (Esc is one)."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.ShortcutOverride and event.key() in _KEYS:
            event.accept()
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key.Key_Escape:
            self.stop()
        else:
            super().keyPressEvent(event)

    def line_pen(self) -> QPen:
        """How shapes under way are drawn: seen on dark and on bright."""
        return QPen(QColor("#ffd400"), 2, Qt.PenStyle.SolidLine)


class RectangleTool(Tool):
    """Drag a rectangle over the live image; stays active for the next one until stopped."""

    chosen = Signal(int, int, int, int)
    """x0, y0, x1, y1 in image pixels: columns x0 .. x1 - 1 and rows y0 .. y1 - 1, never empty."""

    def __init__(self, view: LiveView) -> None:
        self._from: tuple[float, float] | None = None
        self._to = (0.0, 0.0)
        super().__init__(view)

    def forget(self) -> None:
        """Drop the rectangle that is being dragged."""
        self._from = None
        self.update()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self._from = self._to = self.to_image(event.position())
        elif event.button() == Qt.MouseButton.RightButton:
            self.stop()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._from is not None:
            self._to = self.to_image(event.position())
            self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._from is None or event.button() != Qt.MouseButton.LeftButton:
            return
        (xa, ya), (xb, yb) = self._from, self.to_image(event.position())
        self.forget()
        x0, x1, y0, y1 = (round(edge) for edge in (min(xa, xb), max(xa, xb), min(ya, yb), max(ya, yb)))
        if x1 > x0 and y1 > y0:
            self.chosen.emit(x0, y0, x1, y1)

    def paintEvent(self, event: QPaintEvent) -> None:
        if self._from is not None:
            painter = QPainter(self)
            painter.setPen(self.line_pen())
            painter.drawRect(QRectF(self.to_view(*self._from), self.to_view(*self._to)).normalized())


class EllipseTool(RectangleTool):
    """Drag the rectangle about an ellipse; `chosen` is that rectangle."""

    def paintEvent(self, event: QPaintEvent) -> None:
        if self._from is not None:
            painter = QPainter(self)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            painter.setPen(self.line_pen())
            painter.drawEllipse(QRectF(self.to_view(*self._from), self.to_view(*self._to)).normalized())


class LineTool(Tool):
    """Drag a line, or click its two ends. With Shift it runs along a row, a column or a diagonal."""

    chosen = Signal(float, float, float, float)
    """Column and row of the first end, then of the last, continuous; never the same."""

    def __init__(self, view: LiveView) -> None:
        self._from: tuple[float, float] | None = None
        self._to = (0.0, 0.0)
        self._pressed: QPointF | None = None
        super().__init__(view)

    def forget(self) -> None:
        """Drop the end that is set."""
        self._from = self._pressed = None
        self.update()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.RightButton:
            self.stop()
        if event.button() != Qt.MouseButton.LeftButton:
            return
        if self._from is None:
            self._from = self._to = self.to_image(event.position())
            self._pressed = event.position()
        else:
            self._end(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._from is not None:
            self._to = self._other_end(event)
            self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._pressed is None or event.button() != Qt.MouseButton.LeftButton:
            return
        moved = event.position() - self._pressed
        self._pressed = None
        if max(abs(moved.x()), abs(moved.y())) >= _CLICK_PX:  # else it was the click on the first end
            self._end(event)

    def _end(self, event: QMouseEvent) -> None:
        start, end = self._from, self._other_end(event)
        if start is not None and start != end:
            self.forget()
            self.chosen.emit(*start, *end)

    def _other_end(self, event: QMouseEvent) -> tuple[float, float]:
        assert self._from is not None
        column, row = self.to_image(event.position())
        if not event.modifiers() & Qt.KeyboardModifier.ShiftModifier:
            return column, row
        dx, dy = column - self._from[0], row - self._from[1]
        if min(abs(dx), abs(dy)) < np.tan(np.pi / 8) * max(abs(dx), abs(dy)):
            dx, dy = (dx, 0.0) if abs(dx) > abs(dy) else (0.0, dy)
        else:
            least = min(abs(dx), abs(dy))
            dx, dy = float(np.copysign(least, dx)), float(np.copysign(least, dy))
        return self._from[0] + dx, self._from[1] + dy

    def paintEvent(self, event: QPaintEvent) -> None:
        if self._from is not None:
            painter = QPainter(self)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            painter.setPen(self.line_pen())
            painter.drawLine(self.to_view(*self._from), self.to_view(*self._to))
            painter.drawEllipse(self.to_view(*self._from), 4, 4)


class PolygonTool(Tool):
    """Click corners; a double click, Enter or a click on the first corner closes the polygon."""

    chosen = Signal(object)
    """Corners (N, 2) float64 in continuous image columns and rows, N >= 3."""
    refused = Signal(str)
    """Why it was not closed."""

    def __init__(self, view: LiveView) -> None:
        self._corners: list[tuple[float, float]] = []
        self._pointer: QPointF | None = None
        super().__init__(view)

    def forget(self) -> None:
        """Drop the corners set so far."""
        self._corners.clear()
        self.update()

    def _close(self) -> None:
        if len(self._corners) >= 3:
            corners = np.array(self._corners)
            self.forget()
            self.chosen.emit(corners)
        else:
            self.refused.emit(f"A polygon needs at least three corners, and this has {len(self._corners)}.")

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.RightButton:
            self.stop()
        if event.button() != Qt.MouseButton.LeftButton:
            return
        if len(self._corners) >= 3:
            away = self.to_view(*self._corners[0]) - event.position()
            if abs(away.x()) < _CLOSE_PX and abs(away.y()) < _CLOSE_PX:
                self._close()
                return
        self._corners.append(self.to_image(event.position()))
        self.update()

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self._close()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self._pointer = event.position()
        self.update()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self._close()
        elif event.key() == Qt.Key.Key_Backspace and self._corners:
            self._corners.pop()
            self.update()
        else:
            super().keyPressEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        if not self._corners:
            return
        painter = QPainter(self)
        painter.setPen(self.line_pen())
        points = [self.to_view(*corner) for corner in self._corners]
        painter.drawPolyline(QPolygonF([*points, self._pointer or points[-1]]))
        painter.drawEllipse(points[0], _CLOSE_PX / 2, _CLOSE_PX / 2)


class BrushTool(Tool):
    """Paint with a round brush."""

    stroked = Signal(object, float)
    """Points (N, 2) float64 of a stroke so far unsent, in image columns and rows, and the brush's radius in pixels."""
    lifted = Signal()
    """A stroke is complete."""

    def __init__(self, view: LiveView) -> None:
        self.radius_px = 20.0
        """In image pixels."""
        self._last: tuple[float, float] | None = None
        self._pointer: QPointF | None = None
        super().__init__(view)

    def forget(self) -> None:
        """End the stroke."""
        self._last = None
        self.update()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self._last = self.to_image(event.position())
            self.stroked.emit(np.array([self._last]), self.radius_px)
        elif event.button() == Qt.MouseButton.RightButton:
            self.stop()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self._pointer = event.position()
        if self._last is not None:
            here = self.to_image(event.position())
            self.stroked.emit(np.array([self._last, here]), self.radius_px)
            self._last = here
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._last is not None and event.button() == Qt.MouseButton.LeftButton:
            self._last = None
            self.lifted.emit()

    def paintEvent(self, event: QPaintEvent) -> None:
        viewport = self.viewport()
        if self._pointer is not None and viewport is not None:
            painter = QPainter(self)
            painter.setPen(self.line_pen())
            radius = self.radius_px * viewport.scale / self._view.devicePixelRatioF()
            painter.drawEllipse(self._pointer, radius, radius)
