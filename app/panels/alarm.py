"""Panel for the proximity alarm: what lights up inside the gate's slab sets it off, and it stays on until reset."""

from __future__ import annotations

import time
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final, Literal

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QColor, QHideEvent, QImage, QPixmap
from PySide6.QtWidgets import (
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QVBoxLayout,
)

from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.describe import frames_text
from slopegate.app.session.loading import WRITTEN_S, Loader
from slopegate.app.session.session import Change
from slopegate.app.session.snapshot import save_snapshot, snapshot_metadata
from slopegate.app.views.draw_tools import RectangleTool
from slopegate.app.views.overlay import RegionLayer
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import CountBox, NumberBox
from slopegate.app.widgets.paint import level_table
from slopegate.core.measure.alarm import Alarm, AlarmZone, Trip, quiet_level
from slopegate.core.rig.arrays import Bools, Bytes, Counts
from slopegate.core.rig.checks import InputError
from slopegate.drivers.contract.frame import Frame
from slopegate.drivers.stream.alarm_watch import AlarmTap

LOOK_MS = 50
_PREVIEW_PX = (200, 150)
_REGION = QColor("#64b5f6")

Box = tuple[int, int, int, int]
State = Literal["ALARM", "Armed", "Waiting", "Not armed"]
_PAPER: Final[dict[State, str]] = {
    "ALARM": "#b3261e",
    "Armed": "#15803d",
    "Waiting": "#8a5a00",
    "Not armed": "#6b7280",
}


class AlarmLight(QLabel):
    """Shows the state of the alarm in large letters."""

    def show_state(self, state: State) -> None:
        """Show this one."""
        self.setText(state)
        self.setStyleSheet(
            f"background: {_PAPER[state]}; color: #ffffff; font-size: 15pt; font-weight: bold; padding: 4px 10px;"
        )


def thumbnail(counts: Counts, table: Bytes, size_px: tuple[int, int]) -> QPixmap:
    """Counts (H, W) through a table of greys (65536,) as a picture that fits into this width and height."""
    grey = np.ascontiguousarray(table[counts])
    height, width = grey.shape
    picture = QImage(grey.data, width, height, width, QImage.Format.Format_Grayscale8).copy()
    keep, smooth = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
    return QPixmap.fromImage(picture).scaled(*size_px, keep, smooth)


class AlarmPanel(Panel):
    """Region, level and share to watch for. Once armed it judges every frame of the camera, shown or hidden."""

    tripped = Signal(object)
    """The Trip, once each time the alarm is armed."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._box: Box | None = None
        self._tap: AlarmTap | None = None
        self._trip: Trip | None = None
        self._caught: Frame | None = None
        self._waiting = False
        """The camera is being opened; the alarm is armed when it is there."""
        self._source = desk.session.source
        """The source of the frames that are watched."""
        self._saver: Loader[Path] = Loader(lambda _: None, self)
        self.layer, self.tool = RegionLayer(desk.live.view), RectangleTool(desk.live.view)
        self._make_widgets()
        self._arrange()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._connect()
        self._scale_level()
        self._refresh()

    def _make_widgets(self) -> None:
        self.choose, self.whole = QPushButton("&Choose region"), QPushButton("&Whole image")
        self.choose.setCheckable(True)
        self.choose.setToolTip("Drag a rectangle over the live image")
        self.level, self.share = CountBox(), NumberBox()
        self.level.setRange(0, 4095)
        self.level.setValue(300)
        self.level.setSuffix(" counts")
        self.level.setAccessibleName("Level")
        self.level.setToolTip("A pixel brighter than this has something in it")
        self.share.setRange(0.001, 100.0)
        self.share.setDecimals(3)
        self.share.setValue(0.05)
        self.share.setSuffix(" %")
        self.share.setAccessibleName("Share")
        self.share.setToolTip("Share of the region's pixels that sets the alarm off")
        self.learn = QPushButton("&Learn")
        self.learn.setToolTip("Set the level above everything in the frame on show; do it while nothing is in the slab")
        self.arm, self.reset, self.save = QPushButton("Ar&m"), QPushButton("&Reset"), QPushButton("Sa&ve frame ...")
        self.state, self.detail = AlarmLight(), QLabel()
        self.detail.setWordWrap(True)
        self.preview = QLabel()
        self.preview.setFixedSize(*_PREVIEW_PX)
        self.preview.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.preview.setAccessibleName("The frame that set the alarm off")

    def _arrange(self) -> None:
        form = QFormLayout()
        form.addRow("Region", FlowLayout([self.choose, self.whole]))
        form.addRow("Level", FlowLayout([self.level, self.learn]))
        form.addRow("Share", FlowLayout([self.share]))
        left = QVBoxLayout()
        left.addLayout(form)
        left.addLayout(FlowLayout([self.arm, self.reset]))
        left.addWidget(self.state)
        left.addWidget(self.detail)
        left.addStretch(1)
        right = QVBoxLayout()
        right.addWidget(self.preview)
        right.addLayout(FlowLayout([self.save]))
        right.addStretch(1)
        across = QHBoxLayout(self)
        across.setContentsMargins(6, 6, 6, 6)
        across.addLayout(left, 1)
        across.addLayout(right)

    def _connect(self) -> None:
        self.choose.toggled.connect(lambda on: self.tool.start() if on else self.tool.stop())
        self.tool.ended.connect(lambda: self.choose.setChecked(False))
        self.tool.chosen.connect(lambda *box: self._set_box(box))
        self.whole.clicked.connect(lambda: self._set_box(None))
        self.learn.clicked.connect(self._learn)
        self.arm.clicked.connect(self.start)
        self.reset.clicked.connect(self.stop)
        self.save.clicked.connect(self._ask_where)
        self._saver.finished.connect(lambda path: self.detail.setText(f"Saved {path}"))
        self._saver.failed.connect(self.detail.setText)
        self._session.changed.connect(self._on_source)

    @property
    def alarm(self) -> Alarm | None:
        """What the alarm is watching and whether it has gone off; None while it is not armed."""
        return None if self._tap is None else self._tap.alarm

    def start(self) -> None:
        """Arm: from the next frame on every one is judged."""
        stream, box = self._session.stream, self._wanted_box()
        self._waiting = stream is None
        if stream is None:
            self.detail.setText("The camera is being opened; the alarm is armed as soon as it is there.")
            self._refresh()
        if stream is None or box is None or self._tap is not None:
            return
        tap = AlarmTap(AlarmZone(*box, float(self.level.value()), self.share.value() / 100))
        try:
            stream.attach(tap)
        except InputError:
            self.detail.setText("Something else takes every frame: a capture, search or sweep. Let it end first.")
            return
        self._tap, self._trip, self._caught = tap, None, None
        self._timer.start(LOOK_MS)
        self.preview.clear()
        self._refresh()

    def stop(self) -> None:
        """Disarm, and forget what set it off."""
        self._let_go()
        self._waiting = False
        self._trip = self._caught = None
        self._source = self._session.source
        self.preview.clear()
        self.detail.clear()
        self._refresh()

    def _let_go(self) -> None:
        self._timer.stop()
        tap, self._tap = self._tap, None
        if tap is not None and self._session.stream is not None:
            self._session.stream.detach(tap)

    def _wanted_box(self) -> Box | None:
        source = self._session.source
        whole = None if source is None else (0, 0, source.camera.info.width, source.camera.info.height)
        return self._box or whole

    def _set_box(self, box: Box | None) -> None:
        self._box = box
        self.choose.setChecked(False)
        image = self._live.view.image
        region: Bools | None = None
        if box is not None and image is not None:
            region = np.zeros(image.shape, bool)
            region[box[1] : box[3], box[0] : box[2]] = True
        self.layer.show_region(region, _REGION)

    def _learn(self) -> None:
        if (image := self._live.view.image) is not None and (box := self._wanted_box()) is not None:
            self.level.setValue(round(quiet_level(image, box)))

    def _look(self) -> None:
        tap = self._tap
        if tap is None:
            return
        self._note_trip(tap)
        if tap.failure:
            self._let_go()
        if tap.failure and self._trip is None:
            self._end_watch(tap.failure)
        elif self._trip is None:
            if not self.isVisible():
                return
            bright, watched = f"{100 * tap.alarm.share:.3f} % of the region is bright", frames_text(tap.alarm.frames)
            self.detail.setText(f"{bright}; {watched} watched.")
        self._refresh()

    def _note_trip(self, tap: AlarmTap) -> None:
        trip = tap.alarm.trip
        if trip is not None and self._trip is None:
            self._trip = trip
            self._show_caught(tap, trip)
            if not self.isVisible():
                self._desk.warned.emit(f"ALARM at {self.detail.text()}")
            self.tripped.emit(trip)

    def _end_watch(self, why: str) -> None:
        """Say that nothing is watched; a camera that was let go to be opened anew is watched again after that."""
        if self._session.stream is None:
            self.start()
            return
        self.detail.setText(f"Not watched any more: {why}")
        self._desk.warned.emit(f"The alarm is off, nothing is watched any more: {why.rstrip('.')}.")

    def _show_caught(self, tap: AlarmTap, trip: Trip) -> None:
        when = datetime.now() - timedelta(seconds=time.monotonic() - trip.time_s)
        self.detail.setText(
            f"{when:%Y-%m-%d %H:%M:%S}.{when.microsecond // 1000:03d}, frame {trip.sequence}: "
            f"{100 * trip.share:.3f} % of the region was bright."
        )
        self._caught = caught = tap.caught
        if caught is not None:
            levels = self._live.levels
            table = level_table(levels.black.value(), levels.white.value(), levels.srgb.isChecked())
            self.preview.setPixmap(thumbnail(caught.image, table, _PREVIEW_PX))

    def _refresh(self) -> None:
        armed, gone_off = self._tap is not None or self._waiting, self._trip is not None
        self.arm.setEnabled(not armed and not gone_off and self._session.source is not None)
        self.reset.setEnabled(armed or gone_off)
        self.save.setEnabled(self._caught is not None)
        for widget in (self.choose, self.whole, self.level, self.share, self.learn):
            widget.setEnabled(not armed)
        self.state.show_state(
            "ALARM" if gone_off else "Waiting" if self._waiting else "Armed" if armed else "Not armed"
        )

    def _ask_where(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save the frame of the alarm", "alarm.tif", "TIFF (*.tif)")
        if name:
            self.save_to(Path(name))

    def save_to(self, path: Path) -> None:
        """Write the frame that set the alarm off, with its settings inside, in a thread of its own."""
        caught, source = self._caught, self._source
        if caught is None or source is None:
            return
        facts = snapshot_metadata(source.rig, source.scene, source.place, source.camera.info, caught.stamp)
        if self._trip is not None:
            facts["alarm_share"] = self._trip.share
        self._saver.start(lambda _: save_snapshot(path, caught.image, facts, raw=False))

    def _on_source(self, change: Change) -> None:
        if Change.SOURCE not in change:
            return
        old, new = self._source, self._session.source
        same = old is not None and new is not None and new.shows_the_same(old)
        wanted = self._tap is not None or self._waiting
        if self._tap is not None:
            self._note_trip(self._tap)  # in the last moment
        self._let_go()
        if not same:
            self._set_box(None)
        if self._trip is None:
            self._source = new
            self._waiting = False
        self._scale_level()
        if wanted and self._trip is None:
            if same:
                self.start()
            if self._tap is None:
                self._end_watch(self.detail.text() if same else "another scene or camera is looked at")
        self._refresh()

    def _scale_level(self) -> None:
        """Keep the level at the same share of the camera's largest count."""
        source, top = self._session.source, self.level.maximum()
        if source is not None and source.camera.info.max_count != top:
            level = round(self.level.value() * source.camera.info.max_count / top)
            self.level.setMaximum(source.camera.info.max_count)
            self.level.setValue(level)

    def hideEvent(self, event: QHideEvent) -> None:
        self.choose.setChecked(False)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._let_go()
        self._saver.close(WRITTEN_S)
        event.accept()
