"""A plot of one pixel's light in every slice, against the delay of the slices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QLabel, QStackedLayout, QWidget

from slopegate.app.widgets.plot_theme import dress, fill, pen, plot_colours
from slopegate.app.widgets.theme import is_dark
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.settings import GateSettings


class IntensityPlot(QWidget):
    """One bar per slice, as wide as its exposure; the slice on show stands out."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._slices: tuple[GateSettings, ...] = ()
        self._light: Doubles = np.zeros(0)
        self._shown: int | None = None
        self._plot = pg.PlotWidget(self)
        self._plot.setMenuEnabled(False)
        self._plot.hideButtons()
        self._plot.setMouseEnabled(x=False, y=False)
        self._plot.setLabel("bottom", "delay (\u00b5s)")
        self._plot.setLabel("left", "counts")
        self._bars = pg.BarGraphItem(x=[], height=[], width=1.0)
        self._plot.addItem(self._bars)
        hint = QLabel("Click the picture to see a pixel's light in every slice.")
        hint.setWordWrap(True)
        hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._pages = QStackedLayout(self)
        self._pages.addWidget(hint)
        self._pages.addWidget(self._plot)
        self.setAccessibleName("Light against delay")
        self._dress()

    @property
    def light(self) -> Doubles:
        """The light that is shown: counts above the dark level, one per slice."""
        return self._light

    def show_light(self, slices: Sequence[GateSettings], light: Doubles) -> None:
        """Show counts above the dark level (N,), one per slice by rising delay; empty shows nothing."""
        self._slices, self._light = tuple(slices), light
        self._draw()

    def show_slice(self, place: int | None) -> None:
        """Mark the slice that is on show; None marks none."""
        if place != self._shown:
            self._shown = place
            self._draw()

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()

    def _dress(self) -> None:
        dress(self._plot, plot_colours(is_dark(self.palette())))
        self._draw()

    def _draw(self) -> None:
        scheme = plot_colours(is_dark(self.palette()))
        count = self._light.size
        self._pages.setCurrentIndex(1 if count else 0)
        if count == 0:
            return
        brushes = [fill(scheme.slab if place == self._shown else scheme.camera, 255) for place in range(count)]
        self._bars.setOpts(
            x=[float(item.delay_us) for item in self._slices[:count]],
            width=[item.exposure_us for item in self._slices[:count]],
            height=self._light,
            brushes=brushes,
            pens=[pen(scheme.background, 1.0)] * count,
        )
        # noise alone must not look like light
        top = max(float(self._light.max()), 20.0)
        self._plot.setYRange(min(0.0, float(self._light.min())), 1.05 * top, padding=0)
