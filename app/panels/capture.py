"""Panel that records slices: which ones, how often, where to, and how far it is."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer
from PySide6.QtGui import QCloseEvent, QHideEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QLabel,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.panels.capture_plan import PlanRow, slices_of, summary
from slopegate.app.panels.folder_row import FolderRow
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.recorder_run import RecorderRun
from slopegate.app.session.describe import frames_text, line_text
from slopegate.app.session.durations import time_text
from slopegate.app.session.holding import Needs
from slopegate.app.session.session import Change, Session
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import FrameCount
from slopegate.app.widgets.sentence import Sentence
from slopegate.core.gating.slices import Slices
from slopegate.core.rig.checks import InputError
from slopegate.drivers.captures.recorder import FINAL, CaptureProgress, Recorder
from slopegate.drivers.captures.storage import CaptureFolder, create_capture, is_capture, make_manifest, open_capture
from slopegate.drivers.stream.sieve import Tally
from slopegate.drivers.stream.stream import Stream

SETTLE_MS = 250
"""The plan is worked out when the gate has rested this long: a slider must not wait for it."""
MAX_FRAMES = 1000


class CaptureRun(RecorderRun[CaptureFolder, Recorder]):
    """Runs one capture at a time."""

    final = FINAL
    unit = "slice"

    def __init__(self, session: Session, parent: QObject | None = None) -> None:
        super().__init__(session, "the capture", "What it has taken is kept and can be resumed.", parent)

    def begin(self, make: Callable[[], CaptureFolder]) -> None:
        """Make the folder in a worker, then record from the session's stream what is missing in it."""
        self._start(make, self._recorder_for)

    def pause(self) -> None:
        """Pause, or go on after a pause or a prompt."""
        if self._recorder is None:
            return
        if self._recorder.progress.state == "running":
            self._recorder.pause()
        else:
            self._recorder.resume()
        self._poll()

    def _recorder_for(self, stream: Stream, folder: CaptureFolder) -> Recorder:
        source = self._session.source
        assert source is not None
        return Recorder(stream, folder, source.camera.cover if source.camera.info.can.cover else None)

    def _end(self, recorder: Recorder) -> None:
        recorder.cancel()

    def _needs(self, state: str) -> Needs:
        return "source" if state in ("paused", "waiting") else "gate"


class CapturePanel(Panel):
    """Plan, start, pause, cancel and resume a capture; the window stays live all along."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._unfinished: CaptureFolder | None = None
        self.run = CaptureRun(desk.session, self)
        self.plan = PlanRow(desk.session)
        self.frames = FrameCount(MAX_FRAMES)
        self.dark, self.skip = QCheckBox("Dark frame"), QCheckBox("Skip empty slices")
        self.place = FolderRow("the capture", "The capture's own folder; an unfinished one is resumed")
        self.where = self.place.where
        self.note, self.status = Sentence(), Sentence()
        self.bar = QProgressBar()
        self.start, self.pause, self.cancel = QPushButton("Start"), QPushButton("Pause"), QPushButton("Cancel")
        self.open = QPushButton("Look at it")
        self._explain()
        self._arrange()
        self._connect()
        self._name_folder()
        self._show_plan()

    def hideEvent(self, event: QHideEvent) -> None:
        if self._settle.isActive():
            self._settle.stop()
            self._missed |= Change.GATE

    def closeEvent(self, event: QCloseEvent) -> None:
        self._settle.stop()
        self.run.stop()
        event.accept()

    def _explain(self) -> None:
        self.frames.setAccessibleName("Frames per slice")
        tips: list[tuple[QWidget, str]] = [
            (self.frames, "Frames that are averaged for each slice"),
            (self.dark, "Take one first, with the lens covered, to subtract what is counted in the dark"),
            (self.skip, "Look through several slices at once first and leave out those without light"),
            (self.pause, "Give the gate back for a while; the slice under way is begun anew"),
            (self.cancel, "Stop; what has been taken is kept and can be resumed"),
            (self.open, "Open this capture in the window"),
        ]
        for widget, tip in tips:
            widget.setToolTip(tip)
        self.bar.setFormat("%v of %m slices")
        self.bar.hide()

    def _arrange(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.setSpacing(6)
        label = QLabel("Average")
        label.setBuddy(self.frames)
        options: list[QWidget] = [label, self.frames, self.dark, self.skip]
        buttons: list[QWidget] = [self.start, self.pause, self.cancel, self.open]
        column.addWidget(self.plan)
        column.addLayout(FlowLayout(options))
        column.addWidget(self.note)
        column.addWidget(self.place)
        column.addLayout(FlowLayout(buttons))
        column.addWidget(self.bar)
        column.addWidget(self.status)
        column.addStretch()

    def _connect(self) -> None:
        self._settle = QTimer(self)
        self._settle.setSingleShot(True)
        self._settle.timeout.connect(self._show_plan)
        self.plan.changed.connect(self._show_plan)
        self.frames.valueChanged.connect(self._show_plan)
        self.place.changed.connect(self._look_at_folder)
        self.start.clicked.connect(self._on_start)
        self.pause.clicked.connect(self.run.pause)
        self.cancel.clicked.connect(self.run.cancel)
        self.open.clicked.connect(lambda: self._desk.open_wished.emit(self.run.folder))
        self.run.progressed.connect(self._on_progress)
        self.run.failed.connect(self._on_failed)

    def follow(self, change: Change) -> None:
        if Change.SOURCE in change:
            self._name_folder()
        if change & (Change.SOURCE | Change.GATE | Change.DEPTH):
            self._settle.start(SETTLE_MS)

    def _name_folder(self) -> None:
        source = self._session.source
        if source is not None and not self.run.busy:
            self.place.suggest(source.scene)

    def _look_at_folder(self) -> None:
        """Whether the folder named holds an unfinished capture."""
        self._unfinished = self.place.unfinished(is_capture, open_capture)
        self._show_plan()

    def _show_plan(self) -> None:
        if self.run.busy:
            return
        unfinished, able = self._unfinished, self.place.named
        if unfinished is not None:
            total = len(unfinished.manifest.slices)
            text = f"An unfinished capture: {len(unfinished.missing())} of {total} slices are missing"
        else:
            try:
                wish = self.plan.wish()
                slices = slices_of(self._session, wish)
                text = f"{summary(slices, wish)}{self._clock(slices)}{self._costs(len(slices))}"
            except InputError as error:
                text, able = f"No slices: {error}", False
        self.note.setText(text)
        self.start.setText("Start" if unfinished is None else "Resume")
        self._show_buttons(able)

    def _clock(self, slices: Slices) -> str:
        """The pixel clock that all slices share, by which they lean as the live gate does; nothing of gates by hand."""
        source, lines = self._session.source, {item.line_time_us for item in slices}
        return f", all at {line_text(source.rig, lines.pop())}" if source is not None and len(lines) == 1 else ""

    def _costs(self, count: int) -> str:
        source = self._session.source
        assert source is not None
        info = source.camera.info
        wide = 2 if self.frames.value() * info.max_count <= 65535 else 4
        needed = f", {count * info.width * info.height * wide / 1e6:.0f} MB"
        free = self.place.free_bytes
        return needed if free is None else f"{needed} of {free / 1e9:.0f} GB free"

    def _on_start(self) -> None:
        source, unfinished, path = self._session.source, self._unfinished, self.place.path
        if source is None or self.run.busy:
            return
        if unfinished is not None:
            if unfinished.rig != source.rig or not unfinished.manifest.same_camera(source.camera.info):
                self._on_failed("That capture was begun with another scene or rig: open that one first.")
                return
            self._begin(unfinished.set_damaged_aside)
            return
        try:
            slices = slices_of(self._session, self.plan.wish())
            manifest = make_manifest(
                source.scene.name,
                source.rig,
                source.camera.info,
                slices,
                self.frames.value(),
                self.dark.isChecked(),
                self.skip.isChecked(),
            )
        except InputError as error:
            self._on_failed(f"No slices: {error}.")
            return
        self._begin(lambda: create_capture(path, manifest))

    def _begin(self, make: Callable[[], CaptureFolder]) -> None:
        self.status.setText("Making the folder \u2026")
        self.run.begin(make)
        self._show_buttons(False)

    def _on_progress(self, progress: CaptureProgress) -> None:
        self.bar.show()
        self.bar.setRange(0, progress.total)
        self.bar.setValue(progress.kept)
        self.status.setText(progress_text(progress))
        self.pause.setText("Continue" if progress.state in ("paused", "waiting") else "Pause")
        if progress.state in FINAL:
            if progress.state == "done":
                self.place.used()
            self._name_folder()
            self._look_at_folder()
        else:
            self._show_buttons(False)

    def _on_failed(self, sentence: str) -> None:
        self.status.setText(sentence)
        self._show_plan()

    def _show_buttons(self, able: bool) -> None:
        busy, resuming = self.run.busy, self._unfinished is not None
        self.start.setEnabled(able and not busy)
        self.pause.setEnabled(busy)
        self.cancel.setEnabled(busy)
        self.open.setEnabled(self.run.folder is not None and not busy)
        planning: list[QWidget] = [self.plan, self.frames, self.dark, self.skip]
        for widget in planning:
            widget.setEnabled(not busy and not resuming)
        self.place.setEnabled(not busy)


def progress_text(progress: CaptureProgress) -> str:
    """What a capture is doing, how long it will take, and what it used."""
    left = "" if progress.seconds_left is None else f", {time_text(progress.seconds_left)} left"
    return f"{progress.doing}{left} \u2013 {frames_text(progress.frames)} used{faults_text(progress.tally)}"


def faults_text(tally: Tally) -> str:
    """Frames that went wrong, to stand behind those that were used; empty where none did."""
    kinds = ((tally.lost, "lost"), (tally.duplicated, "doubled"))
    return "".join(f", {count} {what} and retaken" for count, what in kinds if count)
