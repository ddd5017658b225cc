"""What the section is drawn with: a plot that finds back to its whole range, and dots."""

from __future__ import annotations

import pyqtgraph as pg
from pyqtgraph.functions import create_qpolygonf, ndarray_from_qpolygonf
from PySide6.QtCore import QRectF, Qt, Signal
from PySide6.QtGui import QMouseEvent, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QStyleOptionGraphicsItem, QWidget
from slopegate.app.widgets.plot_theme import pen
from slopegate.core.rig.rig import Floats


class FitPlot(pg.PlotWidget):  # type: ignore[misc]
    """Wishes to be fitted at a double click, and at another size until the user has moved or zoomed the view."""

    fit_wished = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._moved = False
        box = self.getViewBox()
        box.sigResized.connect(self._on_resized)
        box.sigRangeChangedManually.connect(self._on_moved)
        self.setToolTip("Double click to show everything")

    def fit(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        """Show this much, also at another size."""
        self._moved = False
        self.setRange(xRange=x, yRange=y, padding=0.03)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Wish for everything."""
        self.fit_wished.emit()
        event.accept()

    def _on_moved(self) -> None:
        self._moved = True

    def _on_resized(self) -> None:
        if not self._moved:
            self.fit_wished.emit()


def polygon(points: Floats) -> QPolygonF:
    """(N, 2) numbers as Qt's points, without a Python object each."""
    if len(points) == 0:
        return QPolygonF()
    out: QPolygonF = create_qpolygonf(len(points))
    ndarray_from_qpolygonf(out)[:] = points
    return out


class PointsItem(pg.GraphicsObject):  # type: ignore[misc]
    """Dots of a fixed size on the screen; far cheaper to move than a scatter plot of symbols."""

    def __init__(self) -> None:
        super().__init__()
        self.dots = QPolygonF()
        self._pen = QPen()

    def set_points(self, points: Floats) -> None:
        """Show these (N, 2) points."""
        self.prepareGeometryChange()
        self.dots = polygon(points)
        self.update()

    def set_pen(self, colour: str, size_px: float) -> None:
        """Colour and size of the dots."""
        self.prepareGeometryChange()
        self._pen = pen(colour, size_px)
        self._pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        self.update()

    def viewTransformChanged(self) -> None:
        """Dots keep their size in pixels, so they cover another area."""
        self.prepareGeometryChange()

    def boundingRect(self) -> QRectF:
        """The dots with their size on the screen, or Qt would leave bits of them behind."""
        across, up = self.pixelVectors()
        reach = self._pen.widthF() / 2 + 1
        x, y = (abs(across.x()) * reach, abs(up.y()) * reach) if across is not None else (0.0, 0.0)
        return self.dots.boundingRect().adjusted(-x, -y, x, y) if not self.dots.isEmpty() else QRectF()

    def paint(self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None) -> None:
        """Draw all dots at once."""
        painter.setPen(self._pen)
        painter.drawPoints(self.dots)
