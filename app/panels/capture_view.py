"""Panel that shows an open capture: slice by slice, all slices together, by depth, and one pixel in every slice."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np
from PySide6.QtCore import QObject, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.describe import frames_text, gate_text, line_text
from slopegate.app.session.loading import WRITTEN_S, CancelledError, Loader, Progress
from slopegate.app.session.session import Change, Intent, Session
from slopegate.app.widgets.intensity_plot import IntensityPlot
from slopegate.app.widgets.light_pictures import colour_picture, grey_picture, white_level
from slopegate.app.widgets.picture_view import PictureView
from slopegate.app.widgets.steady import ChoiceBox, ValueSlider
from slopegate.core.measure.stack import StackSummary
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.arrays import Bytes
from slopegate.drivers.captures.export import FORMATS, export_capture
from slopegate.drivers.captures.playback import PlaybackCamera
from slopegate.drivers.captures.reading import Capture
from slopegate.drivers.files.durable import StorageError

DEPTH_PERCENTILES = (1.0, 99.0)
UNKNOWN = 24
"""Grey of pixels whose depth no slice tells."""
Mode = Literal["slice", "sum", "overlay", "depth"]
MODES: tuple[Mode, ...] = get_args(Mode)
_NAMES = {"slice": "Slice", "sum": "Sum of all", "overlay": "Coloured overlay", "depth": "Depth"}
PICTURE_WIDTH = 800
NOTHING = "Open the folder of a capture (File > Open scene folder), or record one with Slices, to look at it here."
FILM = "A recording at one gate plays as the live image. What is recorded slice by slice is shown here."


def overlay_picture(summary: StackSummary, white: float, width: int) -> Bytes:
    """Every slice in a colour of its own, blue far and red near, one over the other: RGB (h, w, 3)."""
    return colour_picture(summary.overlay, white, width)


def depth_range(summary: StackSummary) -> tuple[float, float]:
    """Nearest and farthest depth (m) worth a colour; (0, 0) where none is known."""
    known = summary.inverse_depth[summary.inverse_depth > 0]
    if known.size == 0:
        return 0.0, 0.0
    far, near = np.percentile(known, DEPTH_PERCENTILES)
    return float(1 / near), float(1 / far)


def depth_picture(summary: StackSummary, width: int) -> Bytes:
    """Depth from blue (far) to red (near), equal steps of 1/z: RGB (h, w, 3)."""
    near, far = depth_range(summary)
    stride = max(1, -(-summary.inverse_depth.shape[1] // width))
    inverse = summary.inverse_depth[::stride, ::stride]  # neighbours of an edge have no depth in between
    if far <= 0:
        return np.full((*inverse.shape, 3), UNKNOWN, np.uint8)
    span = max(1 / near - 1 / far, 1e-9)
    level = np.clip((inverse - 1 / far) / span, 0, 1)
    steps = np.rint(16 + 223 * level).astype(np.uint8)
    coloured = cv2.applyColorMap(steps, cv2.COLORMAP_TURBO)[..., ::-1]
    return np.where((inverse > 0)[..., None], coloured, UNKNOWN).astype(np.uint8)


class Exporter(QObject):
    """Exports a capture, one format at a time; `said` tells how far it is, and how it ended."""

    said = Signal(str)

    def __init__(self, session: Session, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._loader: Loader[str] = Loader(lambda _: None, self)
        self._hold = session.hold("the export", "What it has written so far is removed.", self._loader.cancel)
        self._loader.release(self._hold)
        self._loader.progressed.connect(lambda share, text: self.said.emit(f"{text}: {100 * share:.0f} %"))
        self._loader.finished.connect(self._on_finished)
        self._loader.failed.connect(self.said)

    @property
    def busy(self) -> bool:
        """Whether an export is under way."""
        return self._loader.busy

    def export(self, folder: Capture, kind: str, out: Path) -> None:
        """Write this format."""

        def job(progress: Progress) -> str:
            try:
                count = export_capture(
                    folder,
                    kind,
                    out,
                    progress=lambda share: progress.report(share, f"Exporting to {out.name}"),
                    overwrite=True,  # the dialog has asked
                )
            except Cancelled:
                raise CancelledError from None
            return f"{count} slices are in {out}"

        self._hold.begin("program")
        self._loader.start(job)

    def _on_finished(self, sentence: str) -> None:
        # a Loader's results are objects, and those do not go straight into a signal of text
        self.said.emit(sentence)

    def close(self) -> None:
        """Stop and wait."""
        self._loader.close(WRITTEN_S)


class CaptureView(Panel):
    """The slices of the capture that is open. Its slider sets the gate of a slice, which the live image then shows."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._camera: PlaybackCamera | None = None
        self._white = 1.0
        self.exporter = Exporter(desk.session, self)
        self.mode, self.format = ChoiceBox(), ChoiceBox()
        self.slider = ValueSlider()
        self.export = QPushButton("Export \u2026")
        self.picture = PictureView("Picture of the capture", "to see its light in every slice")
        self.plot = IntensityPlot()
        self.text, self.note = QLabel(), QLabel(NOTHING)
        self._body = QWidget()
        self._body.hide()
        self._arrange()
        self._connect()

    def closeEvent(self, event: QCloseEvent) -> None:
        self._redraw.stop()
        self.exporter.close()
        event.accept()

    @property
    def place(self) -> int:
        """Which slice is chosen, by rising delay."""
        return self.slider.maximum() - self.slider.value()

    def _arrange(self) -> None:
        for mode in MODES:
            self.mode.addItem(_NAMES[mode], mode)
        self.mode.setAccessibleName("What to look at")
        for kind, item in FORMATS.items():
            self.format.addItem(kind, kind)
            self.format.setItemData(self.format.count() - 1, item.what, Qt.ItemDataRole.ToolTipRole)
        self.format.setAccessibleName("Format to export to")
        self.slider.setAccessibleName("Slice, nearest first")
        self.slider.setToolTip("Slice by slice, the nearest at the left; the live image follows")
        self.slider.setTickPosition(ValueSlider.TickPosition.TicksBelow)
        top, middle = QHBoxLayout(), QHBoxLayout()
        top.addWidget(self.mode)
        top.addWidget(self.slider, 1)
        top.addWidget(self.format)
        top.addWidget(self.export)
        middle.addWidget(self.picture, 1)
        middle.addWidget(self.plot, 1)
        body = QVBoxLayout(self._body)
        body.setContentsMargins(0, 0, 0, 0)
        body.setSpacing(4)
        body.addLayout(top)
        body.addLayout(middle, 1)
        body.addWidget(self.text)
        self.text.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.text.setWordWrap(True)
        self.note.setWordWrap(True)
        self.note.setAlignment(Qt.AlignmentFlag.AlignCenter)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(self.note)
        column.addWidget(self._body, 1)

    def _connect(self) -> None:
        self._redraw = QTimer(self)
        self._redraw.setSingleShot(True)
        self._redraw.timeout.connect(self._draw)
        self.mode.currentIndexChanged.connect(self._on_mode)
        self.slider.valueChanged.connect(self._on_slice)
        self.picture.picked.connect(self._show_pixel)
        self.export.clicked.connect(self._ask_export)
        self.exporter.said.connect(self.text.setText)

    def follow(self, change: Change) -> None:
        if Change.SOURCE not in change:
            return
        self.let_go()
        source = self._session.source
        camera = None if source is None else source.played
        self._camera = None if camera is None or camera.summary is None else camera
        self.note.setText(NOTHING if source is None or source.film is None else FILM)
        self.note.setVisible(self._camera is None)
        self._body.setVisible(self._camera is not None)
        if self._camera is None or self._camera.summary is None:
            return
        self._white = max(white_level(self._camera.summary.total), 1.0)
        self.slider.blockSignals(True)
        self.slider.setRange(0, len(self._camera.settings) - 1)
        resolved = self._session.resolved
        nearest = 0 if resolved is None else self._camera.nearest(resolved.sent)
        self.slider.setValue(self.slider.maximum() - nearest)
        self.slider.blockSignals(False)
        self._draw()

    def let_go(self) -> None:
        self._camera = None
        self.picture.show_picture(None)
        self.plot.show_light((), np.zeros(0))
        self.text.setText("")

    def _on_mode(self) -> None:
        self.slider.setEnabled(self.mode.currentData() == "slice")
        self._draw()

    def _on_slice(self) -> None:
        if self._camera is not None:
            self._session.ask(Intent(self._camera.settings[self.place]))
            self._redraw.start(0)

    def _draw(self) -> None:
        camera = self._camera
        if camera is None or camera.summary is None:
            return
        summary, mode = camera.summary, self.mode.currentData()
        try:
            if mode == "slice":
                light = camera.light(self.place)
                picture = grey_picture(light, self._white, PICTURE_WIDTH)
            elif mode == "sum":
                picture = grey_picture(summary.total, self._white, PICTURE_WIDTH)
            elif mode == "overlay":
                picture = overlay_picture(summary, self._white, PICTURE_WIDTH)
            else:
                picture = depth_picture(summary, PICTURE_WIDTH)
        except StorageError as error:
            self.text.setText(str(error))
            return
        height, width = summary.total.shape
        self.picture.show_picture(picture, (width, height))
        self.plot.show_slice(self.place if mode == "slice" else None)
        self._show_text()

    def _show_pixel(self, column: int, row: int) -> None:
        camera = self._camera
        if camera is None:
            return
        try:
            self.plot.show_light(camera.settings, camera.pixel_light(column, row))
        except StorageError as error:
            self.text.setText(str(error))
            return
        self._show_text()

    def _show_text(self) -> None:
        camera = self._camera
        if camera is None or camera.summary is None:
            return
        mode, words = self.mode.currentData(), []
        if mode == "slice":
            record = camera.records[self.place]
            settings = camera.settings[self.place]
            where = "" if record.distance_m is None else f" at {record.distance_m:.3f} m"
            words.append(f"Slice {(record.index or 0) + 1} of {len(camera.settings)}{where}: ")
            words.append(f"{line_text(camera.folder.rig, settings.line_time_us)}, {gate_text(settings)}")
            words.append(", no light" if record.empty else f", {frames_text(record.frames)}")
        elif mode == "depth":
            near, far = depth_range(camera.summary)
            words.append(f"Red {near:.3f} m to blue {far:.3f} m" if far > 0 else "No depth is known")
        if self.picture.marked is not None:
            column, row = self.picture.marked
            inverse = float(camera.summary.inverse_depth[row, column])
            depth = f"{1 / inverse:.3f} m" if inverse > 0 else "depth unknown"
            words.append(f"{'; ' if words else ''}column {column}, row {row}: {depth}")
        self.text.setText("".join(words))

    def _ask_export(self) -> None:
        if self._camera is None or self.exporter.busy:
            return
        kind: str = self.format.currentData()
        folder = self._camera.folder
        start = str(folder.path.with_name(folder.path.name + FORMATS[kind].ending))
        name, _ = QFileDialog.getSaveFileName(self, f"Export as {kind}", start)
        if name:
            self.exporter.export(folder, kind, Path(name))
