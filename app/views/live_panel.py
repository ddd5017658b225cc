"""The live view with its levels, its pixel read-out and the settings that travelled with the frame."""

from __future__ import annotations

import time

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from slopegate.app.session.describe import gate_text, line_text
from slopegate.app.session.display import Display
from slopegate.app.session.session import Change, Session
from slopegate.app.session.source import Source, known_buffers
from slopegate.app.views.histogram import LevelsBar
from slopegate.app.views.live_view import LiveView
from slopegate.app.views.overlay import ScaleBar
from slopegate.app.widgets.elided import ElidedLabel
from slopegate.core.gating.gate import slab_if_any
from slopegate.core.measure.lengths import metres_per_pixel
from slopegate.core.rig.arrays import Counts
from slopegate.drivers.contract.frame import Frame, filters

PULL_MS = 8
ENOUGH_S = 0.012
"""Between frames that a camera makes on demand: every second pull, about as many as a screen shows."""
UNSEEN_S = 0.25
"""Between them while none is painted, for the window is hidden."""
HISTOGRAM_S = 0.1
MOST_COPIED = 500_000
"""Counts that are put on the clipboard as text at once."""


class LivePanel(QWidget):
    """Pulls the newest frame by a timer: a queued signal per frame would starve the event loop."""

    first_image = Signal()
    """The first frame of a source is on the screen."""
    display_changed = Signal()
    """`display` is another."""

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._session = session
        self._frame: Frame | None = None
        self._histogram_due_s = 0.0
        self._taken_s, self._wait_s = 0.0, 0.0
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
        self.levels.changed.connect(self._on_levels)
        self.display = Display()
        """How the image is shown; another by `show_as`."""
        self.region: tuple[int, int, int, int] | None = None
        """The columns x0 .. x1 - 1 and rows y0 .. y1 - 1 that the user has marked to be measured."""
        self.scale_bar = ScaleBar(self.view)
        self._scaled: tuple[object, ...] = ()
        session.changed.connect(self._on_changed)
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._pull)
        self._timer.start(PULL_MS)
        self._on_levels(self.levels.black.value(), self.levels.white.value(), self.levels.srgb.isChecked())
        self._show_pixel()

    @property
    def frame(self) -> Frame | None:
        """The frame on show."""
        return self._frame

    def copy_frame(self) -> Frame | None:
        """The frame on show, with pixels of its own."""
        return None if self._frame is None else Frame(self._frame.image.copy(), self._frame.stamp)

    def show_as(self, display: Display) -> None:
        """Show the image like this from now on."""
        if display == self.display:
            return
        self.display = display
        self.view.set_colour_map(display.colour_map)
        self.levels.set_percents(display.auto_dark_percent, display.auto_bright_percent)
        self._show_colours()
        self._mark()
        self._show_scale()
        self.display_changed.emit()

    def _on_levels(self, black: int, white: int, srgb: bool) -> None:
        self.view.set_levels(black, white, srgb)
        self._show_colours()

    def _show_colours(self) -> None:
        table = self.view.table
        self.levels.histogram.show_colours(None if table.dtype == np.uint8 else table.astype(np.uint32, copy=False))

    def _mark(self) -> None:
        source, wanted = self._session.source, self.display
        if source is None or not (wanted.mark_saturated or wanted.mark_dark):
            self.view.set_marks(None)
            return
        info = source.camera.info
        dark = wanted.dark_count(info) if wanted.mark_dark else -1
        self.view.set_marks((dark, info.max_count if wanted.mark_saturated else info.max_count + 1))

    def _show_scale(self) -> None:
        """The bar belongs to the frame on show, at the distance of the slab that this frame was taken with."""
        source, frame = self._session.source, self._frame
        self.scale_bar.setVisible(self.display.scale_bar)
        if not self.display.scale_bar:
            return
        applied = None if frame is None else frame.stamp.applied
        key = (None if source is None else source.rig, applied)
        if self._scaled == key:
            return
        self._scaled = key
        slab = None if source is None or applied is None else slab_if_any(source.rig, applied).slab
        if source is None or slab is None or slab.distance_m is None or slab.thickness_m is None:
            self.scale_bar.show_scale(None)
        else:
            self.scale_bar.show_scale(metres_per_pixel(source.rig, slab.distance_m), slab.distance_m)

    def copy_shown(self) -> str:
        """Put what is seen of the image on the clipboard, marks and all; returns what to say of it."""
        seen = self.view.seen()
        if seen.isEmpty():
            return "There is no image to copy yet."
        picture = self.view.grab(seen).toImage()
        QGuiApplication.clipboard().setImage(picture)
        return f"Copied the image as shown, {picture.width()} x {picture.height()} pixels."

    def copy_counts(self) -> str:
        """Put the counts of the marked region, or of what is seen, on the clipboard as a table; says what it did."""
        image = self.view.image
        if image is None:
            return "There is no image to copy yet."
        x0, y0, x1, y1 = self.region or self.view.seen_pixels()
        part = image[y0:y1, x0:x1]
        if part.size > MOST_COPIED:
            return (
                f"These are {part.shape[1]} x {part.shape[0]} counts, and at most {MOST_COPIED} are copied as a table: "
                "mark a region in Measure, or zoom in. Snapshot saves all of them."
            )
        text = "\n".join("\t".join(map(str, row)) for row in part.tolist())
        QGuiApplication.clipboard().setText(text)
        return f"Copied the counts of columns {x0} to {x1 - 1}, rows {y0} to {y1 - 1}, as a table."

    def stop(self) -> None:
        """Take no more frames."""
        self._timer.stop()

    def _on_changed(self, change: Change) -> None:
        source = self._session.source
        if change & (Change.SOURCE | Change.GATE):
            self._wait_s = 0.0
        if Change.SOURCE in change and source is not None:
            self._waiting = True
            self._histogram_due_s = 0.0
            self._frame = None
            self.travelled.clear()
            if source.is_device:  # it may send nothing for long, under which no other picture must stand
                self.view.clear()
            if source.camera.info.max_count != self.levels.white.maximum():
                self.levels.set_range(source.camera.info.max_count)
            self._mark()
            self._show_scale()

    def _pull(self) -> None:
        source, now = self._session.source, time.monotonic()
        if source is None or now < self._taken_s + self._wait_s:
            return
        frame = self._session.newest()
        if frame is None:
            return
        if source.camera.info.modes.on_demand:
            self._taken_s, self._wait_s = now, UNSEEN_S
        self._frame = frame
        self._session.show_applied(frame.stamp.applied)
        self.view.set_stale("")
        self.view.show_frame(frame.image, source.camera.info.pixel_format)
        if now >= self._histogram_due_s:
            self._histogram_due_s = now + HISTOGRAM_S
            self.levels.show_counts(frame.image)
            self._show_travelled(frame, source)
            self._show_scale()

    def _on_painted(self) -> None:
        if self._frame is None:  # the picture is still one of the source before
            return
        self._wait_s = min(self._wait_s, ENOUGH_S)
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
