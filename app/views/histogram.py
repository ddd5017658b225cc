"""The histogram of the shown counts, and the levels between black and white."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPointF, QRect, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF, QShowEvent
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QLabel, QPushButton, QSizePolicy, QWidget

from slopegate.app.widgets.number_box import CountBox
from slopegate.app.widgets.paint import auto_levels
from slopegate.app.widgets.theme import colours
from slopegate.core.rig.arrays import Counts, Indices, Words

BINS = 256
STRIDE = 8
"""Every eighth row and column: 30 000 of 2 million pixels, 0.1 ms instead of 19."""
_REACH_PX = 8.0
_BAR_PX = 9


def sample_histogram(counts: Counts, max_count: int) -> Indices:
    """How many of a sample of the pixels (H, W) fall in each of 256 equal bins of 0..max_count, (256,) int64.

    Both rows of a mosaic are sampled, and both columns.
    """
    sample = np.concatenate([counts[::STRIDE, ::STRIDE].ravel(), counts[1::STRIDE, 1::STRIDE].ravel()])
    index = sample.astype(np.int64) * BINS // (max_count + 1)
    return np.bincount(np.minimum(index, BINS - 1), minlength=BINS)


class HistogramView(QWidget):
    """Counts to the right, numbers of pixels up (logarithmic); the two levels can be dragged."""

    dragged = Signal(int, int)
    """New black and white levels, by mouse."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setMinimumSize(48, 48)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setToolTip("Counts of the shown frame, logarithmic. Drag the lines to set black and white.")
        self.setAccessibleName("Histogram")
        self._bins: Indices = np.zeros(BINS, np.int64)
        self._max_count = 4095
        self._levels = (0, 4095)
        self._bar: Words | None = None
        self._held: int | None = None

    def sizeHint(self) -> QSize:
        return QSize(320, 48)

    def show_bins(self, bins: Indices, max_count: int) -> None:
        """Another frame's histogram."""
        self._bins, self._max_count = bins, max_count
        self.update()

    def show_levels(self, black: int, white: int) -> None:
        """Where the two lines stand."""
        self._levels = (black, white)
        self.update()

    def show_colours(self, table: Words | None) -> None:
        """Draw below what colour each count has, (65536,) 0xffRRGGBB; None draws no bar."""
        self._bar = table
        self.update()

    def _x(self, count: float) -> float:
        return count / self._max_count * (self.width() - 1)

    def paintEvent(self, event: QPaintEvent) -> None:
        scheme = colours(self.palette())
        painter = QPainter(self)
        painter.fillRect(self.rect(), scheme.background)
        height, width = self.height(), self.width()
        tallest = max(float(np.log1p(self._bins.max())), 1.0)
        tops = height - np.log1p(self._bins) / tallest * (height - 4)
        edges = np.linspace(0, width, BINS + 1)
        outline = [QPointF(0, height)]
        for index in range(BINS):
            outline += [QPointF(edges[index], tops[index]), QPointF(edges[index + 1], tops[index])]
        outline.append(QPointF(width, height))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(scheme.surface))
        painter.drawPolygon(QPolygonF(outline))
        for level, colour in zip(self._levels, (scheme.camera, scheme.projector), strict=True):
            painter.setPen(QPen(QColor(colour), 2))
            x = min(max(self._x(level), 1.0), width - 2.0)
            painter.drawLine(QPointF(x, 0), QPointF(x, height))
        if self._bar is not None:
            self._draw_bar(painter, self._bar)
        painter.end()

    def _draw_bar(self, painter: QPainter, table: Words) -> None:
        counts = np.linspace(0, self._max_count, max(self.width(), 1)).astype(np.int64)
        row = np.ascontiguousarray(table[counts])
        bar = QImage(row.data, row.size, 1, 4 * row.size, QImage.Format.Format_RGB32)
        painter.drawImage(QRect(0, self.height() - _BAR_PX, self.width(), _BAR_PX), bar)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        distances = [abs(event.position().x() - self._x(level)) for level in self._levels]
        nearest = int(np.argmin(distances))
        self._held = nearest if distances[nearest] <= _REACH_PX else None

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._held is None:
            return
        count = round(event.position().x() / max(self.width() - 1, 1) * self._max_count)
        count = min(max(count, 0), self._max_count)
        black, white = self._levels
        if self._held == 0:
            self.dragged.emit(min(count, white - 1), white)
        else:
            self.dragged.emit(black, max(count, black + 1))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._held = None


class LevelsBar(QWidget):
    """Histogram, black and white level, automatic levels, display curve."""

    changed = Signal(int, int, bool)
    """Black level, white level, sRGB curve."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.histogram = HistogramView()
        self.black, self.white = CountBox(), CountBox()
        self.auto = QPushButton("Auto")
        self.auto.setToolTip("Levels from the frame on show (Ctrl+L)")
        self.full = QPushButton("F&ull")
        self.full.setToolTip("The sensor's whole range (Ctrl+Shift+L, Alt+U)")
        self.srgb = QCheckBox("s&RGB")
        self.srgb.setToolTip("Show linear counts through the sRGB curve, as screens expect; off: proportional grey")
        self.srgb.setChecked(True)
        self._counts: Counts | None = None
        self._max_count = 4095
        self._percents = (0.1, 0.1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.histogram, 1)
        for name, spin in (("&Black", self.black), ("&White", self.white)):
            label = QLabel(name)
            label.setBuddy(spin)
            spin.setAccessibleName(name[1:] + " level")
            spin.setToolTip(f"Counts shown as {name[1:].lower()}")
            row.addWidget(label)
            row.addWidget(spin)
        row.addWidget(self.auto)
        row.addWidget(self.full)
        row.addWidget(self.srgb)
        self.black.valueChanged.connect(self._lift_white)
        self.white.valueChanged.connect(self._lower_black)
        self.histogram.dragged.connect(self.set_levels)
        self.auto.clicked.connect(self.set_auto)
        self.full.clicked.connect(self.set_full)
        self.srgb.toggled.connect(lambda: self.set_levels(self.black.value(), self.white.value()))
        self.set_range(4095)

    def set_range(self, max_count: int) -> None:
        """The sensor's largest count; the levels become 0 and this."""
        self._max_count = max_count
        with QSignalBlocker(self.black), QSignalBlocker(self.white):
            self.black.setRange(0, max_count - 1)
            self.white.setRange(1, max_count)
        self.set_full()

    def show_counts(self, counts: Counts) -> None:
        """Take this frame, which must keep its values until the next call. Counted only while it is visible."""
        self._counts = counts
        if self.isVisible():
            self._count()

    def showEvent(self, event: QShowEvent) -> None:
        self._count()

    def _count(self) -> None:
        if self._counts is not None:
            self.histogram.show_bins(sample_histogram(self._counts, self._max_count), self._max_count)

    def set_levels(self, black: int, white: int) -> None:
        """Show counts between these as grey."""
        with QSignalBlocker(self.black), QSignalBlocker(self.white):
            self.black.setValue(black)
            self.white.setValue(white)
        self.histogram.show_levels(black, white)
        self.changed.emit(black, white, self.srgb.isChecked())

    def _lift_white(self) -> None:
        black = self.black.value()
        self.set_levels(black, max(self.white.value(), black + 1))

    def _lower_black(self) -> None:
        white = self.white.value()
        self.set_levels(min(self.black.value(), white - 1), white)

    def set_auto(self) -> None:
        """Levels from the frame on show."""
        if self._counts is not None:
            self.set_levels(*auto_levels(self._counts, self._max_count, *self._percents))

    def set_percents(self, dark: float, bright: float) -> None:
        """How many percent of the pixels automatic levels show as black, and how many as white."""
        self._percents = (dark, bright)
        hint = f"{dark:g} % of the pixels black, {bright:g} % white (set in Measure)"
        self.auto.setToolTip(f"Levels from the frame on show: {hint} (Ctrl+L)")

    def set_full(self) -> None:
        """The sensor's whole range."""
        self.set_levels(0, self._max_count)
