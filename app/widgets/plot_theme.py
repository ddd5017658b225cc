"""Colours of pyqtgraph's plots, to go with the window's."""

from __future__ import annotations

from typing import Any

import pyqtgraph as pg
from PySide6.QtGui import QColor, QPen

from slopegate.app.widgets.theme import DARK, LIGHT, Colours


def plot_colours(dark: bool) -> Colours:
    """The colours that go with a dark or a light window."""
    return DARK if dark else LIGHT


def pen(colour: str, width: float = 1.5, alpha: int = 255, dashed: bool = False) -> QPen:
    """A pen whose width is in screen pixels."""
    tone = QColor(colour)
    tone.setAlpha(alpha)
    made: QPen = pg.mkPen(tone, width=width, dash=[6, 4] if dashed else None)
    return made


def fill(colour: str, alpha: int) -> QColor:
    """A colour with an opacity of 0..255."""
    tone = QColor(colour)
    tone.setAlpha(alpha)
    return tone


def dress(plot: Any, colours: Colours) -> None:
    """Set background, axes and grid of a PlotWidget, with room for the labels at the ends of the axes."""
    plot.setBackground(colours.background)
    half = plot.fontMetrics().height() / 2
    plot.getPlotItem().layout.setContentsMargins(1, half, half, 1)
    for side in ("left", "bottom", "right"):
        axis = plot.getAxis(side)
        axis.setSIPrefixEnableRanges(())  # else the next line scales the figures of axes below 1, once
        axis.enableAutoSIPrefix(False)  # it writes "x0.001" beside the label and leaves the unit as it is
        axis.setPen(pg.mkPen(colours.muted))
        axis.setTextPen(pg.mkPen(colours.text))


def swatch(colour: str, sign: str, text: str) -> str:
    """One entry of a legend as rich text."""
    return f'<span style="color:{colour}">{sign}</span>&nbsp;{text.replace(" ", "&nbsp;")}'
