"""Pictures of a calibration: the live chart with its corners and where to hold it, coverage, and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from slopegate.app.widgets.picture_view import PictureView
from slopegate.app.widgets.theme import colours
from slopegate.core.rig.arrays import Doubles, Ints

SEEN, WANTED, THERE = QColor("#4dd0ff"), QColor("#ffd400"), QColor("#7dff7a")
"""Of the corners that are found, the outline that is wanted, and both where they meet."""
ARROW_SHARE = 0.12
"""Of a picture's width, that the longest arrow of its residuals has."""
_KEYS = {
    Qt.Key.Key_Left: (-1.0, 0.0),
    Qt.Key.Key_Right: (1.0, 0.0),
    Qt.Key.Key_Up: (0.0, -1.0),
    Qt.Key.Key_Down: (0.0, 1.0),
}
KEY_SHARE = 0.03
"""Of the picture's width, that an arrow key moves by."""
WHEEL_STEP = 120.0


@dataclass(frozen=True, eq=False)
class ChartMarks:
    """What is drawn over the chart's picture: corners (N, 2) and outlines (4, 2) in its pixels; None for nothing."""

    corners: Doubles | None = None
    wanted: Doubles | None = None
    there: bool = False
    """Whether the chart is held as wanted."""


class ChartPicture(PictureView):
    """The live picture of the chart. Where it can be moved by hand, dragging and keys do so."""

    moved = Signal(float, float)
    """To the right and down, as shares of the picture's width."""
    turned = Signal(float, float)
    """The same with Shift held: the right edge and the top edge away from the camera."""
    pushed = Signal(float)
    """Steps of the wheel, or of + and -: nearer is above 0."""

    def __init__(self) -> None:
        super().__init__("The chart as the camera sees it")
        self._marks_over = ChartMarks()
        self._by_hand = False
        self._from: QPointF | None = None

    def show_marks(self, marks: ChartMarks) -> None:
        """Draw these over the picture."""
        self._marks_over = marks
        self.update()

    def set_by_hand(self, able: bool) -> None:
        """Whether the chart can be moved with mouse and keys."""
        self._by_hand = able
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus if able else Qt.FocusPolicy.NoFocus)
        self.setCursor(Qt.CursorShape.OpenHandCursor if able else Qt.CursorShape.ArrowCursor)
        self.setToolTip(
            "Drag the chart, or move it with the arrow keys; with Shift it is tilted. The wheel, or + and -, bring it "
            "nearer and farther."
            if able
            else ""
        )

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        if self._image is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        marks = self._marks_over
        if marks.wanted is not None and np.isfinite(marks.wanted).all():
            outline = QPolygonF([self.at(*point) for point in marks.wanted.tolist()])
            style = Qt.PenStyle.SolidLine if marks.there else Qt.PenStyle.DashLine
            for colour, width in ((QColor("#000000"), 5.0), (THERE if marks.there else WANTED, 2.5)):
                painter.setPen(QPen(colour, width, style if width < 5 else Qt.PenStyle.SolidLine))
                painter.drawPolygon(outline)
        if marks.corners is not None:
            for colour, width in ((QColor("#000000"), 5.0), (THERE if marks.there else SEEN, 3.0)):
                pen = QPen(colour, width)
                pen.setCapStyle(Qt.PenCapStyle.RoundCap)
                painter.setPen(pen)
                painter.drawPoints(QPolygonF([self.at(*point) for point in marks.corners.tolist()]))
        painter.end()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if self._by_hand and event.button() == Qt.MouseButton.LeftButton:
            self._from = event.position()
            self.setCursor(Qt.CursorShape.ClosedHandCursor)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._from is None:
            return
        gap, wide = event.position() - self._from, max(self._frame().width(), 1.0)
        self._from = event.position()
        tilts = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        (self.turned if tilts else self.moved).emit(gap.x() / wide, gap.y() / wide)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._from is not None:
            self._from = None
            self.setCursor(Qt.CursorShape.OpenHandCursor)

    def wheelEvent(self, event: QWheelEvent) -> None:
        if self._by_hand and self.hasFocus():
            self.pushed.emit(event.angleDelta().y() / WHEEL_STEP)
            event.accept()
        else:
            super().wheelEvent(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        step = _KEYS.get(Qt.Key(event.key()))
        if self._by_hand and step is not None:
            tilts = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
            (self.turned if tilts else self.moved).emit(KEY_SHARE * step[0], KEY_SHARE * step[1])
        elif self._by_hand and event.text() in {"+", "-"}:
            self.pushed.emit(1.0 if event.text() == "+" else -1.0)
        else:
            super().keyPressEvent(event)


class PictureMap(QWidget):
    """A small empty frame of a picture's proportions, with a title below it; what it shows is painted by its kinds."""

    def __init__(self, title: str, hint: str) -> None:
        super().__init__()
        self._title, self._note, self._size = title, "", (4, 3)
        self.setAccessibleName(title)
        self.setToolTip(hint)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def sizeHint(self) -> QSize:
        return QSize(150, 110)

    def minimumSizeHint(self) -> QSize:
        return QSize(100, 76)

    @property
    def note(self) -> str:
        """What stands below it."""
        return f"{self._title}: {self._note}" if self._note else self._title

    def _show(self, size: tuple[int, int], note: str) -> None:
        self._size, self._note = size, note
        self.setAccessibleDescription(note)
        self.update()

    def _frame(self) -> QRectF:
        """Where the picture is."""
        room = self.height() - self.fontMetrics().height() - 3
        scale = max(min((self.width() - 2) / self._size[0], (room - 2) / self._size[1]), 1e-6)
        width, height = scale * self._size[0], scale * self._size[1]
        return QRectF((self.width() - width) / 2, 1 + (room - 2 - height) / 2, width, height)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter, tone = QPainter(self), colours(self.palette())
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        frame = self._frame()
        painter.fillRect(frame, QColor(tone.background))
        painter.save()
        painter.setClipRect(frame)
        self._paint(painter, frame)
        painter.restore()
        painter.setPen(QPen(QColor(tone.muted), 1))
        painter.drawRect(frame)
        painter.setPen(self.palette().windowText().color())
        high = self.fontMetrics().height()
        below = QRectF(0, self.height() - high - 1, self.width(), high)
        text = self.fontMetrics().elidedText(self.note, Qt.TextElideMode.ElideRight, self.width())
        painter.drawText(below, Qt.AlignmentFlag.AlignCenter, text)
        painter.end()

    def _paint(self, painter: QPainter, frame: QRectF) -> None:
        """Paint what there is inside of the frame."""


class CoverageMap(PictureMap):
    """Where a picture has corners, cell by cell."""

    _count: Ints | None = None

    def show_coverage(self, count: Ints, size: tuple[int, int]) -> None:
        """How many corners (rows, columns) each cell of a picture of this width and height has."""
        self._count = count
        self._show(size, f"{100 * float((count > 0).mean()):.0f} % covered")

    def forget(self) -> None:
        """Show no corners of any picture."""
        self._count = None
        self._show(self._size, "")

    def _paint(self, painter: QPainter, frame: QRectF) -> None:
        if self._count is None:
            return
        rows, columns = self._count.shape
        wide, high = frame.width() / columns, frame.height() / rows
        full = QColor(colours(self.palette()).slab)
        most = max(int(self._count.max()), 1)
        for (row, column), count in np.ndenumerate(self._count):
            if count:
                full.setAlphaF(0.35 + 0.65 * float(count) / most)
                painter.fillRect(QRectF(frame.left() + column * wide, frame.top() + row * high, wide, high), full)
        painter.setPen(QPen(QColor(colours(self.palette()).grid), 1))
        for column in range(1, columns):
            x = frame.left() + column * wide
            painter.drawLine(QPointF(x, frame.top()), QPointF(x, frame.bottom()))
        for row in range(1, rows):
            y = frame.top() + row * high
            painter.drawLine(QPointF(frame.left(), y), QPointF(frame.right(), y))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Corners (N, 2) of a view in one picture and how far the fit misses them (N, 2), pixels; whether it is marked."""

    at: Doubles
    missed: Doubles
    marked: bool = False


@dataclass(frozen=True, eq=False)
class _Arrows:
    views: tuple[Residuals, ...] = field(default=())
    scale: float = 1.0


class ResidualMap(PictureMap):
    """An arrow at each corner: from where the fit has it to where it was found, magnified."""

    _arrows = _Arrows()

    def show_residuals(self, views: Sequence[Residuals], size: tuple[int, int]) -> None:
        """Those of all views; marked ones in another colour, over the others."""
        lengths = [np.hypot(*view.missed.T) for view in views if len(view.at)]
        joined = np.concatenate(lengths) if lengths else np.zeros(1)
        usual = max(float(np.percentile(joined, 95)), 1e-6)
        scale = float(10 ** np.floor(np.log10(ARROW_SHARE * size[0] / usual)))
        self._arrows = _Arrows(tuple(sorted(views, key=lambda view: view.marked)), scale)
        rms = float(np.sqrt((joined**2).mean()))
        self._show(size, f"rms {rms:.2f} px, arrows \u00d7{scale:.0f}" if lengths else "")

    def _paint(self, painter: QPainter, frame: QRectF) -> None:
        tone, scale = colours(self.palette()), frame.width() / self._size[0]
        for view in self._arrows.views:
            colour = QColor(tone.error if view.marked else tone.camera)
            for (x, y), (dx, dy) in zip(view.at.tolist(), view.missed.tolist(), strict=True):
                start = QPointF(frame.left() + x * scale, frame.top() + y * scale)
                painter.setPen(QPen(colour, 1))
                painter.drawLine(start, start + QPointF(dx, dy) * self._arrows.scale * scale)
                pen = QPen(colour, 2.5)
                pen.setCapStyle(Qt.PenCapStyle.RoundCap)
                painter.setPen(pen)
                painter.drawPoint(start)
