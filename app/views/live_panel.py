"""The live view with its levels, its pixel read-out and the settings that travelled with the frame."""

from __future__ import annotations

import time

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from slopegate.app.session.describe import gate_text, line_text
from slopegate.app.session.session import Change, Session
from slopegate.app.session.source import Source, known_buffers
from slopegate.app.views.histogram import LevelsBar
from slopegate.app.views.live_view import LiveView
from slopegate.app.widgets.elided import ElidedLabel
from slopegate.core.rig.arrays import Counts
from slopegate.drivers.contract.frame import Frame, filters

PULL_MS = 8
HISTOGRAM_S = 0.1


class LivePanel(QWidget):
    """Pulls the newest frame by a timer: a queued signal per frame would starve the event loop."""

    first_image = Signal()
    """The first frame of a source is on the screen."""

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._session = session
        self._frame: Frame | None = None
        self._histogram_due_s = 0.0
        self._hover = (-1, -1)
        self._waiting = True
        self.view = LiveView()
        self.levels = LevelsBar()
        self.pixel = ElidedLabel()
        self.travelled = QLabel()
        self.travelled.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.travelled.setToolTip("The settings that made the frame on show")
        read_outs = QHBoxLayout()
        read_outs.addWidget(self.pixel, 1)
        read_outs.addWidget(self.travelled)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(4)
        column.addWidget(self.view, 1)
        column.addLayout(read_outs)
        column.addWidget(self.levels)
        self.view.hovered.connect(self._on_hover)
        self.view.painted.connect(self._on_painted)
        self.view.zoomed.connect(lambda _: self._show_pixel())
        self.levels.changed.connect(self.view.set_levels)
        session.changed.connect(self._on_changed)
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._pull)
        self._timer.start(PULL_MS)
        self.view.set_levels(self.levels.black.value(), self.levels.white.value(), self.levels.srgb.isChecked())
        self._show_pixel()

    @property
    def frame(self) -> Frame | None:
        """The frame on show."""
        return self._frame

    def copy_frame(self) -> Frame | None:
        """The frame on show, with pixels of its own."""
        return None if self._frame is None else Frame(self._frame.image.copy(), self._frame.stamp)

    def stop(self) -> None:
        """Take no more frames."""
        self._timer.stop()

    def _on_changed(self, change: Change) -> None:
        source = self._session.source
        if Change.SOURCE in change and source is not None:
            self._waiting = True
            self._histogram_due_s = 0.0
            self._frame = None
            self.travelled.clear()
            if source.is_device:  # it may send nothing for long, under which no other picture must stand
                self.view.clear()
            if source.camera.info.max_count != self.levels.white.maximum():
                self.levels.set_range(source.camera.info.max_count)

    def _pull(self) -> None:
        frame, source = self._session.newest(), self._session.source
        if frame is None or source is None:
            return
        self._frame = frame
        self.view.set_stale("")
        self.view.show_frame(frame.image, source.camera.info.pixel_format)
        now = time.monotonic()
        if now >= self._histogram_due_s:
            self._histogram_due_s = now + HISTOGRAM_S
            self.levels.show_counts(frame.image)
            self._show_travelled(frame, source)

    def _on_painted(self) -> None:
        if self._frame is None:  # the picture is still one of the source before
            return
        self._session.meter.painted(self._frame.stamp, time.monotonic())
        if self._waiting:
            self._waiting = False
            self.first_image.emit()

    def _show_travelled(self, frame: Frame, source: Source) -> None:
        stamp = frame.stamp
        if stamp.applied is None:
            why = "no gate" if source.camera.info.limits is None else "gate not confirmed yet"
            self.travelled.setText(f"frame {stamp.sequence}: {why}")
            return
        line = line_text(source.rig, stamp.applied.line_time_us)
        mark = "" if stamp.settled else " (settling)"
        self.travelled.setText(f"frame {stamp.sequence}: {line}, {gate_text(stamp.applied)}{mark}")

    def _on_hover(self, column: int, row: int) -> None:
        self._hover = (column, row)
        self._show_pixel()

    def _show_pixel(self) -> None:
        column, row = self._hover
        image, source = self.view.image, self._session.source
        if image is None or source is None or not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]):
            self.pixel.set_full_text(f"zoom {100 * self.view.scale:.0f} %")
            return
        self.pixel.set_full_text(pixel_text(source, image, column, row))


def pixel_text(source: Source, image: Counts, column: int, row: int) -> str:
    """Column, row, counts and depth of one pixel."""
    pattern = filters(source.camera.info.pixel_format)
    filtered = f" ({pattern[2 * (row % 2) + column % 2]})" if pattern else ""
    text = f"column {column}  row {row}  {int(image[row, column])} counts{filtered}"
    buffers = known_buffers(source)
    if buffers is None or buffers.inverse_depth.shape != image.shape:
        return text
    inverse = float(np.float64(buffers.inverse_depth[row, column]))
    nothing = "  depth not known" if source.is_device else "  no surface"
    depth = f"  depth {1 / inverse:.4g} m" if inverse > 0 else nothing
    shadow = "" if inverse <= 0 or buffers.projector_row[row, column] >= 0 else ", not lit"
    return text + depth + shadow
