"""Fourth step of a calibration: gates on the chart that rests, until they tell when projector and camera scan."""

from __future__ import annotations

import re
import threading
from typing import Final

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtWidgets import QCheckBox, QProgressBar, QPushButton, QVBoxLayout, QWidget

from slopegate.app.panels.calibrate_device import TimingFound
from slopegate.app.panels.calibrate_lacks import LackPlot, TimingLack, lack_of
from slopegate.app.panels.calibrate_numbers import NumbersTable
from slopegate.app.panels.calibrate_run import CalibrationRun
from slopegate.app.session.describe import as_sentence, measured
from slopegate.app.session.loading import WRITTEN_S, Loader, Progress
from slopegate.app.session.session import Session
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.sentence import ONE_LINE, Sentence, keep_place
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.calibration.law import NAMES
from slopegate.core.calibration.timing import GateTiming
from slopegate.core.rig.calibration import TIMING
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.plane_gates import TimingOutcome
from slopegate.drivers.calibrations.timing_run import (
    USUAL_FRAMES,
    TimingAttendance,
    TimingPlan,
    TimingProgress,
    more_gates,
)

POLL_MS: Final = 100
ON_CHART, ANYWHERE = "chart", "patterns"
MUCH_MORE: Final = 1.05
"""Factor by which the geometry has to widen an error for it to be worth a sentence."""
_COMMAND: Final = "slopegate calibrate-timing --frames"
"""What takes more gates than the window does."""
_EDGES: Final = "Then take gates by the falling edge of the trigger, too: they tell how long its pulse is"
_LONG: Final = (
    "Gate 100 of at most 400: the delay offset is known to 0.55 \u00b5s and should be to 0.33 \u00b5s; the line time "
    "is known to 0.055 % and should be to 0.033 %; the active fraction is known to 0.055 % and should be to 0.033 %."
)
"""About what is said at most while gates are taken."""
_OPEN_WORDS: Final = {
    "active_fraction": "the active fraction",
    "line_time_us": "the line time",
    "period_us": "the period",
}


class TimingWork(QObject):
    """Takes gates in a thread of its own."""

    progressed = Signal(object)
    """A TimingProgress."""
    ended = Signal()
    failed = Signal(str)

    def __init__(self, session: Session, run: CalibrationRun) -> None:
        super().__init__(run)
        self._run = run
        self.found: TimingFound | None = None
        self.lacks: list[TimingLack] = []
        self._stop = threading.Event()
        self._newest: TimingProgress | None = None
        self._told: GateTiming | None = None
        """What the last of `lacks` is of."""
        self._loader: Loader[list[TimingFound | None]] = Loader(lambda _: None, self)
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

    @property
    def outcome(self) -> TimingOutcome | None:
        """What the gates told; None until they have."""
        return None if self.found is None else self.found.outcome

    def begin(self, where: str, both_edges: bool) -> None:
        """Take gates on the chart, or on whatever is there, then some by the trigger's other edge. Raises UserError."""
        work = self._run.work
        if work is None:
            raise InputError("nothing is calibrated yet: begin with the chart")
        if work.result is None:
            raise InputError("there is no geometry yet, on which the timing rests: take three good views of the chart")
        if self.busy or self._run.busy:
            return
        self._stop, self._newest = threading.Event(), None
        self._empty()
        attendance = TimingAttendance(self._keep, self._stop.is_set)
        plan = TimingPlan(work.chart if where == ON_CHART else None)
        time = work.device.timing(work.rig, plan, attendance, both_edges)
        self._hold.begin(work.device.needs)
        self._timer.start(POLL_MS)

        def job(_: Progress) -> list[TimingFound | None]:
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
            self._empty()

    def _empty(self) -> None:
        self.found, self.lacks, self._told = None, [], None

    def _keep(self, progress: TimingProgress) -> None:
        self._newest = progress

    def _poll(self) -> None:
        newest, self._newest = self._newest, None
        if newest is None:
            return
        if newest.timing is not None:
            self._add(newest.frames, newest.timing)
        self.progressed.emit(newest)

    def _add(self, frames: int, timing: GateTiming) -> None:
        if timing is not self._told:
            self._told = timing
            self.lacks.append(lack_of(frames, timing))

    def _on_finished(self, found: list[TimingFound | None]) -> None:
        self._timer.stop()
        self._poll()
        self.found = found[0]
        if self.found is not None:  # its last step may have been over before anybody asked
            self._add(self.found.outcome.frames, self.found.outcome.timing)
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
        self.edges = QCheckBox("Both trigger edges")
        self.bar, self.status, self.note = QProgressBar(), Sentence(), Sentence()
        self.plot, self.table = LackPlot(), NumbersTable("Numbers of the timing")
        self.save, self.apply = QPushButton("Save rig file ..."), QPushButton("Apply to the running camera")
        self._explain()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(5)
        column.addWidget(self.told)
        column.addLayout(FlowLayout([self.where, self.edges, self.start, self.stop]))
        column.addWidget(self.bar)
        column.addWidget(self.status)
        column.addWidget(self.plot, 5)
        column.addWidget(self.table, 3)
        column.addWidget(self.note)
        column.addLayout(FlowLayout([self.save, self.apply]))
        self.start.clicked.connect(self._on_start)
        self.stop.clicked.connect(work.stop)
        self.save.clicked.connect(self.save_wished)
        self.apply.clicked.connect(self.apply_wished)
        work.progressed.connect(self._on_progress)
        work.failed.connect(lambda sentence: self.status.setText(as_sentence(sentence)))
        work.ended.connect(self._on_ended)
        run.changed.connect(self.refresh)
        self.refresh()

    def _explain(self) -> None:
        self.where.addItem("On the chart", ON_CHART)
        self.where.addItem("On any plane, by patterns", ANYWHERE)
        self.where.setAccessibleName("What gates are seen on")
        self.bar.setRange(0, USUAL_FRAMES)
        self.bar.setFormat("%v gates")
        keep_place(self.bar)
        self.status.keep_room_for(_LONG)
        self.note.keep_room_for(ONE_LINE)
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
        missing = "" if self._run.work is None else self._run.work.device.edges_missing
        self.edges.setEnabled(not busy and not missing)
        self.edges.setToolTip(missing or _EDGES)
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

    def forget(self) -> None:
        """Another calibration begins: what was said and shown is not of it."""
        self.table.clear()
        self.status.clear()
        self.refresh()

    def _on_start(self) -> None:
        try:
            self.table.clear()
            self._work.begin(str(self.where.currentData()), self.edges.isEnabled() and self.edges.isChecked())
            self.status.setText("Looking at the plane ...")
        except UserError as error:
            self.status.setText(as_sentence(error))
        self.refresh()

    def _on_progress(self, progress: TimingProgress) -> None:
        self.bar.setValue(progress.frames)
        verdict = None if progress.timing is None else progress.verdict
        lacks = "" if verdict is None else f": {verdict.reason}"
        self.status.setText(as_sentence(_in_window(f"{progress.doing}{lacks}")))
        self.plot.show_lacks(self._work.lacks)

    def _on_ended(self) -> None:
        found = self._work.found
        if found is not None:
            self.status.setText(_told(found))
        self.refresh()


def _in_window(reason: str) -> str:
    """A reason as the terminal prints it, with the sign for microseconds."""
    return re.sub(r"(?<=\d) us\b", " \u00b5s", reason)


def _told(found: TimingFound) -> str:
    """What gates have come to, in sentences."""
    outcome, timing = found.outcome, found.outcome.timing
    reason = _in_window(outcome.verdict.reason)
    said = [
        reason if outcome.verdict.enough else f"not known well enough: {reason}{more_gates(outcome, _COMMAND)}",
        f"{outcome.frames} gates, {timing.edges} edges, jitter {timing.jitter_us:.1f} \u00b5s",
    ]
    known = outcome.rig.calibration
    whole = 0.0 if known is None else known.standard_errors["delay_offset_us"]
    if whole > MUCH_MORE * float(timing.standard_errors[NAMES.index("offset_us")]):
        said.append(
            f"So much by the gates alone: with the geometry's errors, as in the table, the delay offset is known to "
            f"{whole:.2g} \u00b5s"
        )
    turned = [name for name in ("camera", "projector") if getattr(timing, name) == "up"]
    if turned:
        said.append(f"Rows of the {' and the '.join(turned)} count against the scan")
    if outcome.open_numbers:
        said.append(f"These gates hardly tell {', '.join(_OPEN_WORDS[name] for name in outcome.open_numbers)}")
    if found.pulse is not None and found.pulse.width is not None:
        width = found.pulse.width
        level = "high" if width.second == "falling" else "low"
        said.append(f"The trigger's pulse is {level} for {measured(width.width_us, width.error_us)} \u00b5s")
    elif found.pulse is not None:
        said.append(f"The trigger's pulse is not known: {found.pulse.why_not}")
    return " ".join(map(as_sentence, said))
