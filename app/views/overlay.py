"""Sheets over the live image that know where each image point is on the screen."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QWidget

from slopegate.app.views.live_view import LiveView
from slopegate.app.widgets.paint import Viewport, fitted
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


class RegionLayer(Overlay):
    """Shows a region of the image, tinted; the mouse goes through it."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._region: Bools | None = None
        self._colour, self._filled = QColor("#ffd400"), True
        self._drawn: tuple[object, QImage] | None = None

    def show_region(self, region: Bools | None, colour: QColor, filled: bool = True) -> None:
        """Tint these pixels (H, W) of the image, or outline them only; None shows nothing."""
        self._region, self._colour, self._filled, self._drawn = region, colour, filled, None
        self.setVisible(region is not None)
        self.update()

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
        return QImage(pixels.data, width, height, 4 * width, QImage.Format.Format_ARGB32_Premultiplied).copy()


def _premultiplied(colour: QColor, alpha: int) -> np.uint32:
    red, green, blue = (part * alpha // 255 for part in (colour.red(), colour.green(), colour.blue()))
    return np.uint32(alpha << 24 | red << 16 | green << 8 | blue)
