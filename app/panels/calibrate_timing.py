"""Fourth step of a calibration: gates on the chart that rests, until they tell when projector and camera scan."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Final

import numpy as np
from PySide6.QtCore import QObject, QPointF, QRectF, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QProgressBar, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from slopegate.app.panels.calibrate_numbers import NumbersTable
from slopegate.app.panels.calibrate_run import CalibrationRun
from slopegate.app.session.loading import WRITTEN_S, Loader, Progress
from slopegate.app.session.session import Session
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.app.widgets.theme import colours
from slopegate.core.calibration.informative import lacking
from slopegate.core.rig.calibration import TIMING
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.plane_gates import TimingOutcome
from slopegate.drivers.calibrations.timing_run import USUAL_FRAMES, TimingAttendance, TimingPlan, TimingProgress

POLL_MS: Final = 100
DECADES: Final = (-1.0, 2.5)
"""Of the plot: standard errors as multiples of what is asked for."""
ON_CHART, ANYWHERE = "chart", "patterns"


@dataclass(frozen=True)
class Lack:
    """After so many gates: standard errors of offset, line time and active fraction, over what is asked for."""

    frames: int
    offset: float
    line: float
    active: float


class LackPlot(QWidget):
    """How standard errors shrink from gate to gate, down to what is asked for."""

    def __init__(self) -> None:
        super().__init__()
        self._lacks: list[Lack] = []
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName("Standard errors over the gates taken")
        self.setToolTip("Standard errors over what is asked for: all three lines have to come below the dashed one")

    def sizeHint(self) -> QSize:
        return QSize(300, 120)

    def minimumSizeHint(self) -> QSize:
        return QSize(140, 84)

    def show_lacks(self, lacks: list[Lack]) -> None:
        """Show these."""
        self._lacks = lacks
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter, tone = QPainter(self), colours(self.palette())
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        high = self.fontMetrics().height()
        field = QRectF(1, 1, self.width() - 2, self.height() - high - 5)
        painter.fillRect(field, QColor(tone.background))
        painter.setPen(QPen(QColor(tone.muted), 1))
        painter.drawRect(field)
        low, top = DECADES

        def down(times: float) -> float:
            share = (np.log10(min(max(times, 10**low), 10**top)) - low) / (top - low)
            return float(field.bottom() - share * field.height())

        painter.setPen(QPen(QColor(tone.muted), 1, Qt.PenStyle.DashLine))
        painter.drawLine(QPointF(field.left(), down(1)), QPointF(field.right(), down(1)))
        most = max((one.frames for one in self._lacks), default=1)
        named = (("delay offset", tone.camera), ("line time", tone.projector), ("active fraction", tone.slab))
        x = 2.0
        for place, (name, colour) in enumerate(named):
            painter.setPen(QPen(QColor(colour), 2))
            points = [
                QPointF(
                    field.left() + field.width() * one.frames / most, down((one.offset, one.line, one.active)[place])
                )
                for one in self._lacks
            ]
            painter.drawPolyline(QPolygonF(points))
            painter.drawText(QPointF(x, self.height() - 4), name)
            x += self.fontMetrics().horizontalAdvance(name) + 12
        painter.end()


class TimingWork(QObject):
    """Takes gates in a thread of its own."""

    progressed = Signal(object)
    """A TimingProgress."""
    ended = Signal()
    failed = Signal(str)

    def __init__(self, session: Session, run: CalibrationRun) -> None:
        super().__init__(run)
        self._run = run
        self.outcome: TimingOutcome | None = None
        self.lacks: list[Lack] = []
        self._stop = threading.Event()
        self._newest: TimingProgress | None = None
        self._loader: Loader[list[TimingOutcome | None]] = Loader(lambda _: None, self)
        self._loader.finished.connect(self._on_finished)
        self._loader.failed.connect(self._on_failed)
        self._hold = session.hold(
            "the calibration of the timing", "Gates that were taken tell what they can.", self.stop
        )
        self._loader.release(self._hold)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._poll)

    @property
    def busy(self) -> bool:
        """Whether gates are being taken."""
        return self._loader.busy

    def begin(self, where: str) -> None:
        """Take gates on the chart, or on whatever is there. Raises UserError."""
        work = self._run.work
        if work is None:
            raise InputError("nothing is calibrated yet: begin with the chart")
        if work.result is None:
            raise InputError("there is no geometry yet, on which the timing rests: take three good views of the chart")
        if self.busy or self._run.busy:
            return
        self._stop, self.outcome, self.lacks, self._newest = threading.Event(), None, [], None
        attendance = TimingAttendance(self._keep, self._stop.is_set)
        plan = TimingPlan(work.chart if where == ON_CHART else None)
        time = work.device.timing(work.rig, plan, attendance)
        self._hold.begin(work.device.needs)
        self._timer.start(POLL_MS)

        def job(_: Progress) -> list[TimingOutcome | None]:
            return [time()]

        self._loader.start(job)

    def stop(self) -> None:
        """Take no more gates; those that were taken tell what they can."""
        self._stop.set()

    def close(self) -> None:
        """Stop, and wait for it."""
        self.stop()
        self._timer.stop()
        self._loader.close(WRITTEN_S)

    def forget(self) -> None:
        """Another calibration begins."""
        if not self.busy:
            self.outcome, self.lacks = None, []

    def _keep(self, progress: TimingProgress) -> None:
        self._newest = progress

    def _poll(self) -> None:
        newest, self._newest = self._newest, None
        if newest is None:
            return
        if newest.timing is not None and (not self.lacks or self.lacks[-1].frames < newest.frames):
            self.lacks.append(Lack(newest.frames, *lacking(newest.timing)))
        self.progressed.emit(newest)

    def _on_finished(self, found: list[TimingOutcome | None]) -> None:
        self._timer.stop()
        self._poll()
        self.outcome = found[0]
        self.ended.emit()

    def _on_failed(self, sentence: str) -> None:
        self._timer.stop()
        self.failed.emit(sentence)
        self.ended.emit()


class TimingStep(QWidget):
    """Gates, what they tell, and how well."""

    save_wished = Signal()
    apply_wished = Signal()

    def __init__(self, run: CalibrationRun, work: TimingWork) -> None:
        super().__init__()
        self._run, self._work = run, work
        self.told = Sentence(
            "Fix the chart where camera and projector see it whole, and leave it. Gates of many delays, clocks and "
            "exposures are taken; each time the one that tells most. The projector has to trigger the camera."
        )
        self.where, self.start, self.stop = ChoiceBox(), QPushButton("Take gates"), QPushButton("Stop")
        self.bar, self.status = QProgressBar(), Sentence()
        self.plot, self.table = LackPlot(), NumbersTable("Numbers of the timing")
        self.save, self.apply = QPushButton("Save rig file ..."), QPushButton("Apply to the running camera")
        self.told.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Maximum)
        self._explain()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(5)
        column.addWidget(self.told)
        column.addLayout(FlowLayout([self.where, self.start, self.stop]))
        column.addWidget(self.bar)
        column.addWidget(self.status)
        column.addWidget(self.plot, 2)
        column.addWidget(self.table, 2)
        column.addLayout(FlowLayout([self.save, self.apply]))
        self.start.clicked.connect(self._on_start)
        self.stop.clicked.connect(work.stop)
        self.save.clicked.connect(self.save_wished)
        self.apply.clicked.connect(self.apply_wished)
        work.progressed.connect(self._on_progress)
        work.failed.connect(lambda sentence: self.status.setText(f"{sentence}."))
        work.ended.connect(self._on_ended)
        run.changed.connect(self.refresh)
        self.refresh()

    def _explain(self) -> None:
        self.where.addItem("On the chart", ON_CHART)
        self.where.addItem("On any plane, by patterns", ANYWHERE)
        self.where.setAccessibleName("What gates are seen on")
        self.bar.setRange(0, USUAL_FRAMES)
        self.bar.setFormat("%v gates")
        tips: list[tuple[QWidget, str]] = [
            (
                self.where,
                "Which projector row lights what is told by the calibrated chart, or by the projector's patterns",
            ),
            (self.start, "Take gates until the timing is known well enough; camera and chart have to rest"),
            (self.stop, "Take no more; gates that were taken tell what they can"),
            (self.save, "Keep the rig with geometry and timing in a file"),
            (self.apply, "Look at what runs with this timing from now on"),
        ]
        for widget, tip in tips:
            widget.setToolTip(tip)

    def refresh(self) -> None:
        """Show what may be done, and what is known."""
        busy, outcome = self._work.busy, self._work.outcome
        self.start.setEnabled(self._run.work is not None and not busy and not self._run.busy)
        self.stop.setEnabled(busy)
        self.bar.setVisible(busy)
        for button in (self.save, self.apply):
            button.setEnabled(outcome is not None and not busy)
        self.plot.show_lacks(self._work.lacks)

    def show_outcome(self, believed: Rig, truth: Rig | None) -> None:
        """Show the numbers beside those in use, or beside the true ones of a practice rig."""
        outcome = self._work.outcome
        if outcome is not None:
            self.table.show_numbers(believed, outcome.rig, truth, TIMING)

    def _on_start(self) -> None:
        try:
            self.table.clear()
            self._work.begin(str(self.where.currentData()))
            self.status.setText("Looking at the plane ...")
        except UserError as error:
            self.status.setText(f"{error}.")
        self.refresh()

    def _on_progress(self, progress: TimingProgress) -> None:
        self.bar.setValue(progress.frames)
        lacks = "" if progress.verdict is None or progress.timing is None else f": {progress.verdict.reason}"
        self.status.setText(f"{progress.doing}{lacks}.")
        self.plot.show_lacks(self._work.lacks)

    def _on_ended(self) -> None:
        outcome = self._work.outcome
        if outcome is not None:
            reason = outcome.verdict.reason
            known = f"Not known well enough: {reason}"
            if outcome.verdict.enough:
                known = f"{reason[:1].upper()}{reason[1:]}"
            turned = [name for name in ("camera", "projector") if getattr(outcome.timing, name) == "up"]
            rows = f" Rows of the {' and the '.join(turned)} count against the scan." if turned else ""
            open_numbers = (
                f" These gates hardly tell {', '.join(outcome.open_numbers)}." if outcome.open_numbers else ""
            )
            self.status.setText(
                f"{known}. {outcome.frames} gates, {outcome.timing.edges} edges, jitter "
                f"{outcome.timing.jitter_us:.1f} \u00b5s.{rows}{open_numbers}"
            )
        self.refresh()
