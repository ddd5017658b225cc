"""A small plot of one to three curves that follows what is measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QLabel, QStackedLayout, QWidget

from slopegate.app.widgets.plot_theme import dress, pen, plot_colours
from slopegate.app.widgets.theme import is_dark
from slopegate.core.rig.arrays import Doubles

HEIGHT_PX = 130


class TracePlot(QWidget):
    """Curves by name over one axis: R, G and B in their colours, any other in the theme's."""

    def __init__(self, name: str, across: str, hint: str, parent: QWidget | None = None) -> None:
        """`across` labels the axis; `hint` says what to do while there is nothing to show."""
        super().__init__(parent)
        self.setAccessibleName(name)
        self.setFixedHeight(HEIGHT_PX)
        self.curves: Mapping[str, tuple[Doubles, Doubles]] = {}
        """What is shown: x and y (N,) by name."""
        self._plot = pg.PlotWidget(self)
        self._plot.setMenuEnabled(False)
        self._plot.hideButtons()
        self._plot.setMouseEnabled(x=False, y=False)
        self._plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._plot.setLabel("bottom", across)
        self._plot.setLabel("left", "counts")
        self._lines: dict[str, pg.PlotCurveItem] = {}
        self._hint = QLabel(hint)
        self._hint.setWordWrap(True)
        self._hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._pages = QStackedLayout(self)
        self._pages.addWidget(self._hint)
        self._pages.addWidget(self._plot)
        self._dress()

    def show_curves(self, curves: Mapping[str, tuple[Doubles, Doubles]]) -> None:
        """Show these curves instead of any before; none shows the hint."""
        self.curves = curves
        self._pages.setCurrentIndex(1 if curves else 0)
        for gone in set(self._lines) - set(curves):
            self._plot.removeItem(self._lines.pop(gone))
        for name, (x, y) in curves.items():
            if name not in self._lines:
                self._lines[name] = pg.PlotCurveItem(pen=self._pen(name))
                self._plot.addItem(self._lines[name])
            self._lines[name].setData(x, y)
        if curves:
            xs, ys = (np.concatenate([pair[axis] for pair in curves.values()]) for axis in (0, 1))
            low, high = float(ys.min()), float(ys.max())
            spare = max(0.08 * (high - low), 1.0)  # noise of less than a count must not fill the plot
            self._plot.setYRange(low - spare, high + spare, padding=0)
            self._plot.setXRange(float(xs.min()), max(float(xs.max()), float(xs.min()) + 1e-6), padding=0)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()

    def _pen(self, name: str) -> object:
        scheme = plot_colours(is_dark(self.palette()))
        tones = {"R": scheme.error, "G": scheme.slab, "B": scheme.camera}
        return pen(tones.get(name, scheme.camera))

    def _dress(self) -> None:
        dress(self._plot, plot_colours(is_dark(self.palette())))
        for name, line in self._lines.items():
            line.setPen(self._pen(name))
