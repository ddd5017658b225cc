"""Panel that acquires light transport: which slices, blocks and codes, what that costs, and how far it is."""

from __future__ import annotations

import math

import numpy as np
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QCloseEvent, QHideEvent, QShowEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.panels.capture import faults_text
from slopegate.app.panels.capture_plan import ACQUIRED, PlanRow, slices_of, summary
from slopegate.app.panels.folder_row import FolderRow
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.transport_fill import Fill, FillWatch
from slopegate.app.panels.transport_run import NO_PROJECTOR, AcquireWish, TransportRun
from slopegate.app.session.describe import frames_text, number
from slopegate.app.session.durations import time_text
from slopegate.app.session.session import Change
from slopegate.app.session.source import Source
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.light_pictures import grey_picture
from slopegate.app.widgets.number_box import CountBox, FrameCount
from slopegate.app.widgets.picture_view import PictureView
from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.gating.slices import Slices, once_around
from slopegate.core.light.lights import PLAIN, asked_parts
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.blocks import parse_grid
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.transport.plan import TransportPlan, plan_transport
from slopegate.drivers.transports.model import CodeName
from slopegate.drivers.transports.run import AcquireProgress
from slopegate.drivers.transports.storage import TransportFolder, is_transport, open_transport

USUAL_SLICES = 5
USUAL_GRID = "32x32"
GRIDS = ("4x2", "8x8", "16x9", "16x16", "32x32", "64x64", "128x128", "256x256", "512x512")
MAX_FRAMES = 1000
LOOK_MS = 500
"""How often the panel looks whether a screen shows patterns."""
TRANSFER_MS = 50
TOLD_FRAMES = 20
"""So many frames must have been taken before they tell how long others will take."""
USUAL_HZ = 20.0
"""Frames a second of a camera that tells no rate."""
SETTLE_MS = 250
"""The plan is worked out when the gate has rested this long: a slider must not wait for it."""
CODES: dict[CodeName, tuple[str, str]] = {
    "adaptive": (
        "Adaptive",
        "Gray code first, then Hadamard codes only where one block does not explain a pixel's light",
    ),
    "hadamard": ("Hadamard", "Half of the blocks lit in each pattern: the least noise where the camera's own rules"),
    "s": ("S-matrix", "As Hadamard, with patterns that leave no block always lit"),
    "impulse": ("One by one", "A pattern for each block, that block alone: dim, but right where shot noise rules"),
    "gray": ("Gray code", "A few dozen patterns, for pixels that see one block each"),
}


class TransportPanel(Panel):
    """Plan, start, pause, cancel and resume an acquisition, and watch the transport fill; the window stays live."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._unfinished: TransportFolder | None = None
        self._pace: tuple[object, float] | None = None
        """What was acquired on the bench last, and the seconds that each of its frames took, decoding included."""
        self._acquired: object = None
        """What is acquired, as far as the time of a frame depends on it."""
        self.run = TransportRun(desk, self)
        self.fill = FillWatch(self)
        self.plan = PlanRow(desk.session, ACQUIRED, USUAL_SLICES)
        self.grid, self.codes, self.frames = ChoiceBox(), ChoiceBox(), FrameCount(MAX_FRAMES)
        self.keep_raw = QCheckBox("Keep raw frames")
        self.transfer = CountBox()
        self._filled = -1
        self.place = FolderRow("the light transport", "A folder of its own; an unfinished one is resumed", "-transport")
        self.note, self.status = Sentence(), Sentence()
        self.bar = QProgressBar()
        self.start, self.pause, self.cancel = QPushButton("Acquire"), QPushButton("Pause"), QPushButton("Cancel")
        self.open = QPushButton("Relight it")
        self.camera = PictureView("The slices that are there, each in a colour of its own")
        self.projector = PictureView("The scene as the projector sees it through these slices")
        self._explain()
        self._arrange()
        self._connect()

    def _explain(self) -> None:
        self.grid.addItems(GRIDS)
        self.grid.setEditable(True)
        self.grid.setCurrentText(USUAL_GRID)
        self.grid.setAccessibleName("Blocks of the projector, columns x rows")
        for name, (text, hint) in CODES.items():
            self.codes.addItem(text, name)
            self.codes.setItemData(self.codes.count() - 1, hint, Qt.ItemDataRole.ToolTipRole)
        self.codes.setAccessibleName("Codes of the patterns")
        self.frames.setAccessibleName("Frames per pattern")
        self.transfer.setRange(0, 1000)
        self.transfer.setValue(TRANSFER_MS)
        self.transfer.setPrefix("frames arrive within ")
        self.transfer.setSuffix(" ms")
        self.transfer.setAccessibleName("Transfer time of frames")
        tips: list[tuple[QWidget, str]] = [
            (self.transfer, "How long a frame may be on its way from the camera to this program"),
            (self.grid, "Blocks of the projector whose light is told apart: columns x rows, from 4x2 to 512x512"),
            (self.codes, "Which patterns the projector shows"),
            (self.frames, "Frames that are summed for each pattern"),
            (self.keep_raw, "Keep every frame beside the transport: 2 bytes a pixel and pattern (Zarr)"),
            (self.pause, "Wait; the slice under way is kept and goes on"),
            (self.cancel, "Stop; finished slices are kept, and the rest can be resumed"),
            (self.open, "Use this light transport in Relight and Composite"),
            (
                self.camera,
                "Every finished slice in a colour of its own, the first red; before that, what the camera sees",
            ),
            (self.projector, "Which part of the projector reaches the camera through the finished slices"),
        ]
        for widget, tip in tips:
            widget.setToolTip(tip)
        self.bar.hide()

    def _arrange(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.setSpacing(6)
        names = {"Blocks": self.grid, "Codes": self.codes, "Sum": self.frames}
        options: list[QWidget] = []
        for text, widget in names.items():
            label = QLabel(text)
            label.setBuddy(widget)
            options += [label, widget]
        pictures = QHBoxLayout()
        pictures.addWidget(self.camera, 1)
        pictures.addWidget(self.projector, 1)
        column.addWidget(self.plan)
        column.addLayout(FlowLayout([*options, self.keep_raw, self.transfer]))
        column.addWidget(self.note)
        column.addWidget(self.place)
        column.addLayout(FlowLayout([self.start, self.pause, self.cancel, self.open]))
        column.addWidget(self.bar)
        column.addWidget(self.status)
        column.addLayout(pictures, 1)

    def _connect(self) -> None:
        self._settle = QTimer(self)
        self._settle.setSingleShot(True)
        self._settle.timeout.connect(self._show_plan)
        self._watch = QTimer(self)
        self._watch.timeout.connect(self._look_at_screen)
        self.plan.changed.connect(self._show_plan)
        self.grid.currentTextChanged.connect(self._show_plan)
        self.codes.currentIndexChanged.connect(self._show_plan)
        for spin in (self.frames, self.transfer):
            spin.valueChanged.connect(self._show_plan)
        self.place.changed.connect(self._look_at_folder)
        self.start.clicked.connect(self._on_start)
        self.pause.clicked.connect(self._on_pause)
        self.cancel.clicked.connect(self.run.cancel)
        self.open.clicked.connect(lambda: self._desk.open_wished.emit(self.run.folder))
        self.run.said.connect(self.status.setText)
        self.run.progressed.connect(self._on_progress)
        self.run.seen.connect(self._show_frame)
        self.run.ended.connect(self._on_ended)
        self.fill.changed.connect(self._show_fill)
        self.fill.failed.connect(self.status.setText)
        self._desk.found_gate.connect(self._on_found)

    def follow(self, change: Change) -> None:
        source = self._session.source
        if source is not None and Change.SOURCE in change:
            if not self.run.busy:
                self.place.suggest(source.scene)
            self.plan.setVisible(not source.no_gate)
            self.transfer.setVisible(source.rendered is None)
        if change & (Change.SOURCE | Change.GATE | Change.DEPTH):
            self._settle.start(SETTLE_MS)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._watch.start(LOOK_MS)

    def hideEvent(self, event: QHideEvent) -> None:
        self._watch.stop()
        if self._settle.isActive():
            self._settle.stop()
            self._missed |= Change.GATE

    def closeEvent(self, event: QCloseEvent) -> None:
        self._settle.stop()
        self._watch.stop()
        self.run.stop()
        self.fill.close()
        event.accept()

    def _look_at_screen(self) -> None:
        """A camera's plan depends on whether a screen shows patterns, which the projector's dialog decides."""
        source = self._session.source
        if source is not None and source.rendered is None:
            self._show_plan()

    def _on_found(self) -> None:
        self.plan.keep_found(self._desk.found)

    def _look_at_folder(self) -> None:
        """Whether the folder named holds an unfinished acquisition."""
        self._unfinished = self.place.unfinished(is_transport, open_transport)
        self._show_plan()

    # What it will be

    def _wish(self) -> AcquireWish:
        """What is chosen. Raises InputError, a sentence."""
        source = self._session.source
        if source is None:
            raise InputError("there is no picture yet")
        if source.replayed:
            raise InputError(NO_PROJECTOR)
        gates = (None,) if source.no_gate else self._slices(source)
        grid, codes = self.grid.currentText(), self.codes.currentData()
        frames, transfer_us = self.frames.value(), 1000.0 * self.transfer.value()
        return AcquireWish(self.place.path, gates, grid, codes, frames, self.keep_raw.isChecked(), transfer_us)

    def _slices(self, source: Source) -> Slices:
        """The slices; those of all that is lit hold the light that fog and surfaces scatter, too."""
        wish = self.plan.wish()
        slices = slices_of(self._session, wish)
        return once_around(source.rig, slices) if wish.kind == "lit" and asked_parts(source.scene) - PLAIN else slices

    def _rest_of(self, folder: TransportFolder) -> AcquireWish:
        """What a folder was begun with, whatever is chosen now."""
        planned, transfer_us = folder.manifest, 1000.0 * self.transfer.value()
        gates = tuple(None if gate is None else gate.settings() for gate in planned.slices)
        keep_raw = self.keep_raw.isChecked()
        return AcquireWish(folder.path, gates, str(folder.grid), planned.codes, planned.frames, keep_raw, transfer_us)

    def _show_plan(self) -> None:
        if self.run.busy:
            return
        unfinished, able = self._unfinished, self.place.named
        if unfinished is not None:
            text = f"An unfinished acquisition: {len(unfinished.missing())} of {len(unfinished.manifest.slices)} slices"
            text = f"{text} are missing."
        else:
            try:
                text = self._plan_text(self._wish())
            except UserError as error:
                text, able = f"Nothing to acquire: {error}", False
        self.note.setText(text)
        self.start.setText("Acquire" if unfinished is None else "Resume")
        self._show_buttons(able)

    def _plan_text(self, wish: AcquireWish) -> str:
        source = self._session.source
        assert source is not None
        gates = tuple(gate for gate in wish.gates if gate is not None)
        what = summary(gates, self.plan.wish()) if gates else "1 slice of all light, for this camera has no gate"
        timed = source.rendered is None or self._measured_s(source, wish) > 0
        return f"{what}. {costs_text(self._costs(source, wish), timed)}"

    def _measured_s(self, source: Source, wish: AcquireWish) -> float:
        """Seconds from frame to frame of the last acquisition like this; 0 where there was none in this window."""
        return self._pace[1] if self._pace is not None and self._pace[0] == _like(source, wish) else 0.0

    def _costs(self, source: Source, wish: AcquireWish) -> TransportPlan:
        info, raster = source.camera.info, source.rig.projector.raster
        frame_s, wait_s = self._measured_s(source, wish), 0.0
        if source.rendered is None:
            projector, settle_frames = self._desk.screen()
            raster = projector.info.raster
            rate_hz = info.modes.rate_hz if math.isfinite(info.modes.rate_hz) else USUAL_HZ
            frame_s, wait_s = 1 / rate_hz, settle_frames * projector.info.period_us * 1e-6 + wish.transfer_us * 1e-6
        grid = parse_grid(wish.grid, raster)
        shape = (info.height, info.width)
        sensor = None if source.rendered is None else source.rendered.sensor
        return plan_transport(wish.codes, grid, shape, len(wish.gates), wish.frames, frame_s, wait_s, sensor)

    # What it is

    def _on_start(self) -> None:
        try:
            unfinished = self._unfinished
            wish = self._wish() if unfinished is None else self._rest_of(unfinished)
            self.run.begin(wish, None if unfinished is None else unfinished.manifest)
            source = self._session.source
            self._acquired = None if source is None else _like(source, wish)
        except UserError as error:
            self._on_ended(f"{error}.")
            return
        self._filled = -1
        self.camera.show_picture(None)
        self.projector.show_picture(None)
        self._show_buttons(False)

    def _on_pause(self) -> None:
        self.run.pause()
        self.pause.setText("Continue" if self.run.paused else "Pause")

    def _on_progress(self, progress: AcquireProgress) -> None:
        self.bar.show()
        most = progress.frames + progress.frames_left
        self.bar.setRange(0, max(most, 1))
        self.bar.setValue(progress.frames)
        self.bar.setFormat(f"{progress.slices_done} of {progress.slices} slices, %p %")
        self.status.setText(progress_text(progress))
        if progress.frames >= TOLD_FRAMES and progress.frames_left and progress.seconds_left is not None:
            self._pace = self._acquired, progress.seconds_left / progress.frames_left
        if progress.slices_done not in (0, self._filled) and self.run.folder is not None:
            self._filled = progress.slices_done
            self.fill.look_at(self.run.folder)

    def _on_ended(self, sentence: str) -> None:
        self.pause.setText("Pause")
        source = self._session.source
        if source is not None and self.run.complete:
            self.place.used()
            self.place.suggest(source.scene)
        self._look_at_folder()
        self.status.setText(sentence)

    def _show_frame(self, frame: Counts) -> None:
        """Until a slice is finished, show what the camera sees of the patterns."""
        source = self._session.source
        if self._filled <= 0 and source is not None:
            info = source.camera.info
            light = np.maximum(frame.astype(np.float32) - np.float32(info.black_count), 0)
            picture = grey_picture(light, info.max_count - info.black_count, frame.shape[1])
            self.camera.show_picture(picture, (frame.shape[1], frame.shape[0]))

    def _show_fill(self, fill: Fill) -> None:
        self.camera.show_picture(fill.camera, fill.sizes[0])
        self.projector.show_picture(fill.projector, fill.sizes[1])

    def _show_buttons(self, able: bool) -> None:
        busy, resuming = self.run.busy, self._unfinished is not None
        press = "" if busy else f" Press {self.start.text()} to begin."
        self.camera.say_empty(f"What the camera sees of the patterns, then the finished slices, come here.{press}")
        self.projector.say_empty(f"The scene as the projector sees it comes here with the first slice.{press}")
        self.start.setEnabled(able and not busy)
        self.pause.setEnabled(busy)
        self.cancel.setEnabled(busy)
        self.open.setEnabled(self.run.folder is not None and not busy)
        planning: list[QWidget] = [self.plan, self.grid, self.codes, self.frames]
        for widget in planning:
            widget.setEnabled(not busy and not resuming)
        for widget in (self.place, self.keep_raw, self.transfer):
            widget.setEnabled(not busy)


def _like(source: Source, wish: AcquireWish) -> object:
    """What the time of a frame depends on."""
    shown = frozenset() if source.rendered is None else frozenset(source.rendered.smooth.shown)
    return source.rig, source.scene, source.options.pixel_format, shown, wish.codes


def costs_text(plan: TransportPlan, timed: bool = True) -> str:
    """What an acquisition is to cost at most, beside what the paper's took. `timed`: whether its seconds are known."""
    paper = "" if plan.paper_seconds is None else f" (the paper: {time_text(plan.paper_seconds)})"
    takes = time_text(plan.seconds) if timed else "in a time that the first of them will tell"
    cost = f"At most {plan.frames} frames, {takes}{paper}, {plan.bytes / 1e9:.2g} GB at a time"
    return f"{cost}; {number(plan.noise_gain, 1)} times less noise than with one block after the other."


def progress_text(progress: AcquireProgress) -> str:
    """What an acquisition is doing, how long it will take, and what it used."""
    left = "" if progress.seconds_left is None else f", {time_text(progress.seconds_left)} left"
    state = "Paused" if progress.state == "paused" else progress.doing
    return f"{state}{left} \u2013 {frames_text(progress.frames)} used{faults_text(progress.tally)}"
