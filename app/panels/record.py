"""Panel that records frames at the live gate: a video, or a time lapse, of raw counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

from PySide6.QtCore import QObject
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QCheckBox, QLabel, QProgressBar, QPushButton, QVBoxLayout, QWidget

from slopegate.app.panels.folder_row import FolderRow
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.recorder_run import RecorderRun
from slopegate.app.session.describe import frames_text
from slopegate.app.session.durations import TimeLeft
from slopegate.app.session.holding import Needs
from slopegate.app.session.session import Change, Session
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import FrameCount, NumberBox
from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.drivers.captures.film import FilmFolder, create_film, make_film_manifest
from slopegate.drivers.captures.film_recorder import FILM_FINAL, FilmLimits, FilmProgress, FilmRecorder

MAX_FRAMES = 10_000_000
MAX_SECONDS = 1e6
Until = Literal["stopped", "frames", "seconds"]
_NAMES: dict[Until, str] = {"stopped": "Until stopped", "frames": "Frames", "seconds": "Seconds"}


class FilmRun(RecorderRun[FilmFolder, FilmRecorder]):
    """Records one film at a time from the session's stream."""

    final = FILM_FINAL
    unit = "frame"

    def __init__(self, session: Session, parent: QObject | None = None) -> None:
        super().__init__(session, "the recording", "What it has recorded is kept.", parent)

    def begin(self, make: Callable[[], FilmFolder], limits: FilmLimits) -> None:
        """Make the folder in a worker, then record with the gate of its manifest."""
        self._start(make, lambda stream, folder: FilmRecorder(stream, folder, limits))

    def _end(self, recorder: FilmRecorder) -> None:
        recorder.stop()

    def _hurry(self, recorder: FilmRecorder) -> None:
        recorder.hurry()  # no preview is waited for

    def _needs(self, state: str) -> Needs:
        return "program" if state == "finishing" else "gate"


class RecordPanel(Panel):
    """Start and stop a recording at the live gate; the window stays live all along."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self.run = FilmRun(desk.session, self)
        self._left = TimeLeft()
        self.until = ChoiceBox()
        for key in get_args(Until):
            self.until.addItem(_NAMES[key], key)
        self.frames, self.seconds = FrameCount(MAX_FRAMES), _seconds_box(10.0)
        self.lapse, self.every = QCheckBox("Time lapse, one every"), _seconds_box(10.0)
        self.place = FolderRow("the recording", "The recording's own folder", "-recording")
        self.start, self.stop, self.open = QPushButton("Record"), QPushButton("Stop"), QPushButton("Look at it")
        self.bar, self.status = QProgressBar(), Sentence()
        self._explain()
        self._arrange()
        self._connect()
        self._name_folder()
        self._show_choice()

    def closeEvent(self, event: QCloseEvent) -> None:
        self.run.stop()
        event.accept()

    def follow(self, change: Change) -> None:
        if Change.SOURCE in change:
            self._name_folder()
            self._show_choice()

    def _explain(self) -> None:
        self.frames.setValue(100)
        self.until.setAccessibleName("When the recording ends")
        self.frames.setAccessibleName("Frames of the recording")
        self.seconds.setAccessibleName("Seconds of the recording")
        self.every.setAccessibleName("Seconds from frame to frame")
        tips: list[tuple[QWidget, str]] = [
            (self.until, "When it ends by itself; Stop ends it at any time, and keeps what there is"),
            (self.lapse, "Keep one frame every so many seconds instead of all of them"),
            (self.start, "Record raw frames at the live gate, which stays as it is until the recording has ended"),
            (self.stop, "End the recording; all of its frames are kept"),
            (self.open, "Open this recording in the window, which plays it"),
        ]
        for widget, tip in tips:
            widget.setToolTip(tip)
        self.bar.setRange(0, 1000)
        self.bar.hide()

    def _arrange(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.setSpacing(6)
        label = QLabel("Ends")
        label.setBuddy(self.until)
        column.addLayout(FlowLayout([label, self.until, self.frames, self.seconds, self.lapse, self.every]))
        column.addWidget(self.place)
        column.addLayout(FlowLayout([self.start, self.stop, self.open]))
        column.addWidget(self.bar)
        column.addWidget(self.status)
        column.addStretch()

    def _connect(self) -> None:
        self.until.currentIndexChanged.connect(self._show_choice)
        self.lapse.toggled.connect(self._show_choice)
        self.place.changed.connect(self._show_choice)
        self.start.clicked.connect(self._on_start)
        self.stop.clicked.connect(self.run.cancel)
        self.open.clicked.connect(lambda: self._desk.open_wished.emit(self.run.folder))
        self.run.progressed.connect(self._on_progress)
        self.run.failed.connect(self._on_failed)

    def _name_folder(self) -> None:
        source = self._session.source
        if source is not None and not self.run.busy:
            self.place.suggest(source.scene)

    def _show_choice(self) -> None:
        busy, until = self.run.busy, self.until.currentData()
        self.frames.setVisible(until == "frames")
        self.seconds.setVisible(until == "seconds")
        choices: list[QWidget] = [self.until, self.frames, self.seconds, self.lapse, self.place]
        for widget in choices:
            widget.setEnabled(not busy)
        self.every.setEnabled(not busy and self.lapse.isChecked())
        self.start.setEnabled(not busy and self.place.named and self._session.source is not None)
        self.stop.setEnabled(busy)
        self.open.setEnabled(not busy and self.run.folder is not None)
        if not busy and self.run.folder is None:
            self.status.setText(self._free())

    def _free(self) -> str:
        """What the disk still takes, and for how long that is at every frame of the camera."""
        free, source = self.place.free_bytes, self._session.source
        if free is None or source is None:
            return ""
        info = source.camera.info
        frame = info.width * info.height * (1 if info.max_count <= 255 else 2)
        return f"{free / 1e9:.0f} GB free on this disk: {free // frame} frames of {frame / 1e6:.1f} MB"

    def _limits(self) -> FilmLimits:
        until = self.until.currentData()
        return FilmLimits(
            self.frames.value() if until == "frames" else None,
            self.seconds.value() if until == "seconds" else None,
            self.every.value() if self.lapse.isChecked() else None,
        )

    def _on_start(self) -> None:
        source, resolved, path = self._session.source, self._session.resolved, self.place.path
        if source is None or resolved is None or self.run.busy:
            return
        info, limits = source.camera.info, self._limits()
        gate = None if info.limits is None else resolved.sent
        manifest = make_film_manifest(source.scene.name, source.rig, info, gate, limits.every_s)
        self.status.setText("Making the folder \u2026")
        self._left = TimeLeft()
        self.run.begin(lambda: create_film(path, manifest), limits)
        self._show_choice()

    def _on_progress(self, progress: FilmProgress) -> None:
        self.bar.setVisible(progress.share is not None)
        self.bar.setValue(round(1000 * (progress.share or 0.0)))
        self.status.setText(self._told(progress))
        if progress.state in FILM_FINAL:
            self.place.used()
            self._name_folder()
        self._show_choice()

    def _told(self, progress: FilmProgress) -> str:
        done = f"{frames_text(progress.frames)}, {progress.lost} lost, {progress.seconds:.1f} s"
        size = f"{progress.bytes / 1e6:.0f} MB"
        if progress.state in FILM_FINAL:
            remark = f". {progress.remark[:1].upper()}{progress.remark[1:]}" if progress.remark else ""
            return f"{progress.doing}: {done}, {size} are in {self.run.folder}{remark}"
        free = self.place.free_bytes
        room = "" if free is None else f", {free / 1e9:.0f} GB free"
        left = "" if progress.share is None else self._left.text(progress.share)
        return f"{progress.doing} \u2013 {done}, {size}{room}{', ' if left else ''}{left}"

    def _on_failed(self, sentence: str) -> None:
        self._show_choice()
        self.status.setText(sentence)


def _seconds_box(value: float) -> NumberBox:
    box = NumberBox()
    box.setDecimals(2)
    box.setRange(0.05, MAX_SECONDS)
    box.setSuffix(" s")
    box.setValue(value)
    return box
