"""The plot of what a timing still lacks: standard errors over the gates that were taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QSize, Qt
from PySide6.QtWidgets import QStackedLayout, QVBoxLayout, QWidget

from slopegate.app.widgets.plot_theme import dress, pen, plot_colours, swatch
from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.theme import is_dark
from slopegate.core.calibration.informative import GOAL, lacking
from slopegate.core.calibration.timing import GateTiming

_NAMES: Final = ("delay offset", "line time, over a period", "active fraction of a period")
_LEAST_US, _MOST_US = 1e-4, 1e5
"""What is drawn: a number that nothing tells yet has an error without end."""
_LEAST_GATES: Final = 40
"""That the axis reaches to, at least."""
_LEAST_ROOM = QSize(140, 110)


@dataclass(frozen=True)
class TimesLacking:
    """Standard errors as times, microseconds: of the delay offset, and of what line time and active fraction come to
    over a period of the projector."""

    offset_us: float
    line_us: float
    active_us: float


@dataclass(frozen=True)
class TimingLack:
    """After so many gates: what is known, and what is asked for."""

    frames: int
    known: TimesLacking
    wanted: TimesLacking


def lack_of(frames: int, timing: GateTiming) -> TimingLack:
    """What the gates themselves tell, with the geometry taken to be true."""
    times = lacking(timing)
    wanted = GOAL.offset_us, GOAL.line_share * timing.period_us, GOAL.active_fraction * timing.period_us
    known = TimesLacking(*(share * most for share, most in zip(times, wanted, strict=True)))
    return TimingLack(frames, known, TimesLacking(*wanted))


class LackPlot(QWidget):
    """How standard errors shrink from gate to gate, each down to what is asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.lacks: list[TimingLack] = []
        self.setAccessibleName("Standard errors over the gates taken")
        self.setToolTip(
            "Standard errors of times as the gates alone tell them, the geometry taken to be true: each line has to "
            "come below the dashed one of its colour"
        )
        self.plot = pg.PlotWidget(self)
        self.plot.setMenuEnabled(False)
        self.plot.hideButtons()
        self.plot.setMouseEnabled(x=False, y=False)
        self.plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.plot.setMinimumSize(_LEAST_ROOM)
        self.plot.setLogMode(x=False, y=True)
        self.plot.setLabel("bottom", "gates taken")
        self.plot.setLabel("left", "standard error, \u00b5s")
        self.legend = Sentence()
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self._curves = [self.plot.plot() for _ in _NAMES]
        self._goals = [pg.InfiniteLine(angle=0) for _ in _NAMES]
        for goal in self._goals:
            self.plot.addItem(goal)
        self._arrange()
        self._dress()

    def _arrange(self) -> None:
        hint = Sentence("How well the gates tell the timing is drawn here.")
        hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        drawn = QWidget()
        column = QVBoxLayout(drawn)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(2)
        column.addWidget(self.plot, 1)
        column.addWidget(self.legend)
        self.pages = QStackedLayout(self)
        self.pages.addWidget(hint)
        self.pages.addWidget(drawn)

    def show_lacks(self, lacks: Sequence[TimingLack]) -> None:
        """Show these; none shows the hint."""
        self.lacks = list(lacks)
        self.pages.setCurrentIndex(1 if lacks else 0)
        if not lacks:
            return
        frames = np.array([one.frames for one in lacks], np.float64)
        names = [one.name for one in fields(TimesLacking)]
        known = np.array([[getattr(one.known, name) for name in names] for one in lacks], np.float64)
        known = np.clip(np.nan_to_num(known, nan=_MOST_US), _LEAST_US, _MOST_US)
        wanted = np.array([getattr(lacks[-1].wanted, name) for name in names], np.float64)
        for curve, errors in zip(self._curves, known.T, strict=True):
            curve.setData(frames, errors)
        for goal, error in zip(self._goals, np.log10(wanted), strict=True):
            goal.setValue(float(error))
        ends = np.log10([min(known.min(), wanted.min()), max(known.max(), wanted.max())])
        self.plot.setYRange(float(ends[0]) - 0.1, float(ends[1]) + 0.1, padding=0)
        decades = range(math.floor(ends[0]), math.ceil(ends[1]) + 1)
        # powers of ten alone: what the plot would write between them has no room where it is low
        self.plot.getAxis("left").setTicks([[(decade, f"{10.0**decade:g}") for decade in decades]])
        self.plot.setXRange(0.0, max(float(frames[-1]), _LEAST_GATES), padding=0)

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()

    def _dress(self) -> None:
        scheme = plot_colours(is_dark(self.palette()))
        dress(self.plot, scheme)
        tones = (scheme.camera, scheme.projector, scheme.slab)
        for curve, goal, tone in zip(self._curves, self._goals, tones, strict=True):
            curve.setPen(pen(tone, 2))
            goal.setPen(pen(tone, 1, dashed=True))
        signs = [swatch(tone, "&#9473;", name) for tone, name in zip(tones, _NAMES, strict=True)]
        self.legend.setText(" &nbsp; ".join([*signs, swatch(scheme.muted, "- -", "asked for")]))
