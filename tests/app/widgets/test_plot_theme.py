"""Axes say what their labels say."""

from __future__ import annotations

import pyqtgraph as pg
from pytestqt.qtbot import QtBot

from slopegate.app.widgets.plot_theme import dress, plot_colours


def test_an_axis_is_never_scaled_behind_its_label(qtbot: QtBot) -> None:
    plot = pg.PlotWidget()
    qtbot.addWidget(plot)
    plot.setLabel("bottom", "exposure (\u00b5s)")
    dress(plot, plot_colours(False))
    plot.plot([1e5, 2e6], [1e-5, 2e-5])
    with qtbot.waitExposed(plot):
        plot.show()
    for side in ("bottom", "left"):
        axis = plot.getAxis(side)
        assert axis.autoSIPrefixScale == 1.0
        assert "x" not in axis.labelString().replace("exposure", "").partition("(")[2]
