"""Sheets over the live image that know where each image point is on the screen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, QRect, QRectF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from slopegate.app.views.live_view import LiveView
from slopegate.app.widgets.paint import Viewport, fitted
from slopegate.core.measure.lengths import length_text, round_length
from slopegate.core.rig.arrays import Bools


class Overlay(QWidget):
    """A transparent sheet over the live view that knows where each image point is on the screen."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self._view = view
        self.setAttribute(Qt.WidgetAttribute.WA_NoSystemBackground)
        self.setGeometry(view.rect())
        self.hide()
        view.installEventFilter(self)
        view.zoomed.connect(self.update)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep the size of the view."""
        if watched is self._view and event.type() == QEvent.Type.Resize:
            self.setGeometry(self._view.rect())
        return False

    def viewport(self) -> Viewport | None:
        """What the view shows, in device pixels; None before the first image."""
        image = self._view.image
        if image is None:
            return None
        ratio = self._view.devicePixelRatioF()
        size = (max(round(self._view.width() * ratio), 1), max(round(self._view.height() * ratio), 1))
        return self._view.viewport or fitted((image.shape[1], image.shape[0]), size)

    def to_image(self, position: QPointF) -> tuple[float, float]:
        """Widget coordinates -> continuous image column and row, cut to the image; (0, 0) without one."""
        viewport, image = self.viewport(), self._view.image
        if viewport is None or image is None:
            return 0.0, 0.0
        ratio = self._view.devicePixelRatioF()
        column, row = viewport.to_image(position.x() * ratio, position.y() * ratio)
        return min(max(column, 0.0), float(image.shape[1])), min(max(row, 0.0), float(image.shape[0]))

    def to_view(self, column: float, row: float) -> QPointF:
        """Continuous image column and row -> widget coordinates."""
        viewport = self.viewport()
        if viewport is None:
            return QPointF()
        scale = viewport.scale / self._view.devicePixelRatioF()
        return QPointF((column - viewport.left) * scale, (row - viewport.top) * scale)


class Layer(Overlay):
    """A sheet that only shows: the mouse goes through it."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)


class RegionLayer(Layer):
    """Shows a region of the image, tinted."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self._region: Bools | None = None
        self._colour, self._filled = QColor("#ffd400"), True
        self._drawn: tuple[object, QImage] | None = None

    def show_region(self, region: Bools | None, colour: QColor, filled: bool = True) -> None:
        """Tint these pixels (H, W) of the image, or outline them only; None shows nothing."""
        self._region, self._colour, self._filled, self._drawn = region, colour, filled, None
        self.setVisible(region is not None)
        self.update()

    def show_box(
        self, box: tuple[int, int, int, int], shape: tuple[int, int], colour: QColor, filled: bool = True
    ) -> None:
        """The same for the pixels x0 .. x1 - 1 of rows y0 .. y1 - 1 of an image of this height and width."""
        x0, y0, x1, y1 = box
        region = np.zeros(shape, bool)
        region[y0:y1, x0:x1] = True
        self.show_region(region, colour, filled)

    def paintEvent(self, event: QPaintEvent) -> None:
        viewport, image = self.viewport(), self._view.image
        if self._region is None or viewport is None or image is None or image.shape != self._region.shape:
            return
        ratio = self._view.devicePixelRatioF()
        key = (viewport, self.size(), ratio)
        if self._drawn is None or self._drawn[0] != key:
            self._drawn = (key, self._tinted(self._region, viewport, ratio))
        QPainter(self).drawImage(0, 0, self._drawn[1])

    def _tinted(self, region: Bools, viewport: Viewport, ratio: float) -> QImage:
        width, height = round(self.width() * ratio), round(self.height() * ratio)
        columns = np.floor(viewport.left + (np.arange(width) + 0.5) / viewport.scale).astype(np.int64)
        rows = np.floor(viewport.top + (np.arange(height) + 0.5) / viewport.scale).astype(np.int64)
        seen = np.zeros((height, width), bool)
        inside_r, inside_c = (rows >= 0) & (rows < region.shape[0]), (columns >= 0) & (columns < region.shape[1])
        seen[np.ix_(inside_r, inside_c)] = region[np.ix_(rows[inside_r], columns[inside_c])]
        edge = np.zeros_like(seen)
        edge[1:] |= seen[1:] != seen[:-1]
        edge[:, 1:] |= seen[:, 1:] != seen[:, :-1]
        tint, line = (_premultiplied(self._colour, alpha) for alpha in (80 if self._filled else 0, 255))
        pixels = np.where(edge, line, np.where(seen, tint, np.uint32(0)))
        drawn = QImage(pixels.data, width, height, 4 * width, QImage.Format.Format_ARGB32_Premultiplied).copy()
        drawn.setDevicePixelRatio(ratio)
        return drawn


@dataclass(frozen=True)
class Segment:
    """A line on the image, from one continuous column and row to another, with what is said of it."""

    start: tuple[float, float]
    end: tuple[float, float]
    colour: QColor
    text: str = ""
    """Beside its middle."""


class SegmentLayer(Layer):
    """Shows lines on the image."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self._segments: tuple[Segment, ...] = ()

    def show_segments(self, segments: tuple[Segment, ...]) -> None:
        """Show these, instead of any before."""
        if segments != self._segments:
            self._segments = segments
            self.setVisible(bool(segments))
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        if self.viewport() is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for one in self._segments:
            start, end = self.to_view(*one.start), self.to_view(*one.end)
            for colour, width in ((QColor("#000000"), 4.0), (one.colour, 2.0)):
                painter.setPen(QPen(colour, width))
                painter.drawLine(start, end)
                painter.drawEllipse(start, 3, 3)
                painter.drawEllipse(end, 3, 3)
        for one in self._segments:
            if one.text:
                middle = (self.to_view(*one.start) + self.to_view(*one.end)) / 2
                write_on_image(painter, one.text, middle + QPointF(10, -10), self.rect())


def write_on_image(painter: QPainter, text: str, at: QPointF, within: QRect) -> None:
    """Write white on a dark field, its lower left corner here but inside the view."""
    box = QRectF(painter.fontMetrics().boundingRect(text).adjusted(-5, -2, 5, 2))
    box.moveBottomLeft(at)
    box.moveLeft(min(max(box.left(), 2.0), max(within.width() - box.width() - 2, 2.0)))
    box.moveTop(min(max(box.top(), 2.0), max(within.height() - box.height() - 2, 2.0)))
    painter.fillRect(box, QColor(0, 0, 0, 190))
    painter.setPen(QColor("#ffffff"))
    painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)


class ScaleBar(Layer):
    """A bar at the lower left of the image that says how long it is, and at which distance; nothing until told."""

    _PART = 0.3
    """Of the view's width that it may take."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self._metres_per_pixel: float | None = None
        self._distance_m = 0.0

    def show_scale(self, metres_per_pixel: float | None, distance_m: float = 0.0) -> None:
        """A pixel of the image is so long at this distance; None draws no bar."""
        if (metres_per_pixel, distance_m) != (self._metres_per_pixel, self._distance_m):
            self._metres_per_pixel, self._distance_m = metres_per_pixel, distance_m
            self.update()

    def bar(self) -> tuple[float, str]:
        """Its length in pixels of the widget, and what it says; (0, "") where none is drawn."""
        viewport = self.viewport()
        if viewport is None or self._metres_per_pixel is None or self.width() < 60:
            return 0.0, ""
        shown_px = viewport.scale / self._view.devicePixelRatioF()
        metres = round_length(self._PART * self.width() / shown_px * self._metres_per_pixel)
        return metres / self._metres_per_pixel * shown_px, f"{length_text(metres)} at {self._distance_m:.2f} m"

    def paintEvent(self, event: QPaintEvent) -> None:
        length, text = self.bar()
        if not text:
            return
        painter = QPainter(self)
        wide = max(length, painter.fontMetrics().horizontalAdvance(text))
        high = painter.fontMetrics().height()
        field = QRectF(10, self.height() - high - 26, wide + 16, high + 18)
        painter.fillRect(field, QColor(0, 0, 0, 190))
        painter.setPen(QColor("#ffffff"))
        painter.drawText(field.adjusted(8, 3, -8, 0), Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignTop, text)
        painter.fillRect(QRectF(field.left() + 8, field.bottom() - 9, length, 4), QColor("#ffffff"))


def _premultiplied(colour: QColor, alpha: int) -> np.uint32:
    red, green, blue = (part * alpha // 255 for part in (colour.red(), colour.green(), colour.blue()))
    return np.uint32(alpha << 24 | red << 16 | green << 8 | blue)
