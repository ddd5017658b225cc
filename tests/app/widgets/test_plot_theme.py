"""Axes say what their labels say."""

from __future__ import annotations

import pyqtgraph as pg
from pytestqt.qtbot import QtBot

from slopegate.app.widgets.plot_theme import dress, plot_colours


def test_an_axis_is_never_scaled_behind_its_label(qtbot: QtBot) -> None:
    plot = pg.PlotWidget()
    qtbot.addWidget(plot)
    plot.setLabel("bottom", "exposure (\u00b5s)")
    plot.setLabel("left", "share")
    dress(plot, plot_colours(False))
    with qtbot.waitExposed(plot):
        plot.show()
    plot.getViewBox().setRange(xRange=(0.0, 2e6), yRange=(0.0, 2e-5), padding=0)
    for side in ("bottom", "left"):
        assert plot.getAxis(side).autoSIPrefixScale == 1.0
