"""Panel for depth: sweep the gate, look at the depth map as a picture or as points, and save it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import (
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.panels.depth_picture import CloudPicture, DepthPicture
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.loading import WRITTEN_S, CancelledError, Loader, Progress
from slopegate.app.session.session import Change
from slopegate.app.session.source import known_buffers
from slopegate.app.session.twin import keep_twin
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import FrameCount, NumberBox
from slopegate.core.measure.depth_errors import DepthErrors, depth_errors
from slopegate.core.measure.sweep import DepthError, DepthMap, DepthSweep, SweepSettings, depth_error, points_m
from slopegate.core.render.render import Buffers
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.depth_files import save_depth
from slopegate.drivers.stream.depth_run import frames_behind, run_sweep
from slopegate.drivers.stream.stream import Stream

_WIDTH_PX = 200
"""Of the controls beside the picture."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A finished sweep: the map, its rig, and its error where the true depth is known."""

    rig: Rig
    found: DepthMap
    points: Singles
    settings: SweepSettings
    error: DepthError | None
    errors: DepthErrors | None
    """How well each depth is known, where the rig was calibrated."""
    scene: str


def sweep_job(
    stream: Stream,
    rig: Rig,
    black_count: float,
    settings: SweepSettings,
    truth: Buffers | None,
    scene: str,
    progress: Progress,
) -> Measured:
    """Run the sweep behind the live stream. Raises CameraError, InputError or CancelledError."""
    sweep = DepthSweep(rig, black_count, settings)

    def given_up() -> bool:
        return not progress.report(sweep.share_done, f"{sweep.frames} settings")

    with frames_behind(stream, given_up) as take:
        found = run_sweep(take, sweep)
    if found is None:
        raise CancelledError
    error = None if truth is None else depth_error(found, truth.projector_row, truth.inverse_depth)
    return Measured(rig, found, points_m(rig, found), settings, error, depth_errors(rig, found), scene)


def report_text(result: Measured) -> str:
    """How many settings the sweep took, how many equal steps take, and how well it is known, or met the true depth."""
    found, error = result.found, result.error
    text = f"{found.frames} settings; equal steps take {found.plain_frames}."
    if not found.known.any():
        return text + " Nothing was lit within this range."
    if error is None:
        text += f" Depth for {found.known.mean():.0%} of the pixels."
    else:
        text += (
            f" Depth for {error.known_share:.1%} of the lit pixels. Error: median {error.median_mm:.1f}, rms "
            f"{error.rms_mm:.1f}, 95 % below {error.p95_mm:.1f} mm."
        )
    medians = None if result.errors is None else result.errors.medians_m
    if medians is None:
        return text
    total, rig, sweep = (1000 * one for one in medians)
    return text + f" Standard error: median {total:.2g} mm, {rig:.2g} by the rig and {sweep:.2g} by the sweep's steps."


def as_buffers(found: DepthMap) -> Buffers:
    """The measured map in the form in which the program keeps what it knows of a scene; without light."""
    dark = np.zeros((*found.inverse_depth.shape, 3), np.float32)
    unknown = np.full_like(found.projector_row, -1)
    return Buffers(found.projector_row, unknown, found.inverse_depth, dark, dark)


def facts_of(result: Measured) -> dict[str, Any]:
    """The facts that are saved with a map, fit for JSON."""
    return {
        "scene": result.scene,
        "rig": result.rig.name,
        "settings": asdict(result.settings),
        "frames": result.found.frames,
        "plain_frames": result.found.plain_frames,
        "error": None if result.error is None else asdict(result.error),
    }


def write(path: Path, result: Measured) -> Path:
    """Save and return the path."""
    errors_m = None if result.errors is None else result.errors.total_m
    save_depth(path, result.rig, result.found, facts_of(result), errors_m=errors_m)
    return path


class DepthPanel(Panel):
    """Measures depth with the camera that runs; the live image goes on and shows every step."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self.result: Measured | None = None
        """The last finished sweep of this source."""
        self._runner: Loader[Measured] = Loader(lambda _: None, self)
        self._saver: Loader[Path] = Loader(lambda _: None, self)
        fate = "What it has measured so far is not kept."
        self._hold = desk.session.hold("the depth sweep", fate, self._runner.cancel)
        self._runner.release(self._hold)
        self._make_widgets()
        self._arrange()
        self._connect()
        self._refresh()

    def _make_widgets(self) -> None:
        self.nearest, self.finest, self.repeats = NumberBox(), NumberBox(), FrameCount(64)
        self.nearest.setRange(0.1, 10.0)
        self.nearest.setSingleStep(0.05)
        self.nearest.setValue(SweepSettings().nearest_m)
        self.nearest.setSuffix(" m")
        self.nearest.setToolTip("Nothing nearer than this is looked for")
        self.finest.setRange(0.25, 16.0)
        self.finest.setSingleStep(0.25)
        self.finest.setValue(SweepSettings().finest_rows)
        self.finest.setSuffix(" rows")
        self.finest.setToolTip("Smallest step of the sweep in projector rows: fewer are finer and take more frames")
        self.repeats.setToolTip("Frames averaged for each setting, for dark scenes")
        self.start, self.cancel = QPushButton("Measure depth"), QPushButton("Cancel")
        self.save = QPushButton("Save ...")
        self.save.setToolTip(
            "Metres (.npy .exr .tif), millimetres (.png) or points (.ply); with a rig that was calibrated their "
            "standard errors, too: in a file of their own, whose name ends in _error"
        )
        self.keep = QPushButton("As scene ...")
        self.keep.setToolTip(
            "A folder with photo, depth and this rig, which opens as a scene: try, search and mask gates there without "
            "the rig, and use them here"
        )
        self.flat, self.solid, self.by_error = QPushButton("Picture"), QPushButton("3D"), QPushButton("Errors")
        self.by_error.setToolTip("One standard error of each depth, by the rig's calibration and the sweep's steps")
        for button in (self.flat, self.solid, self.by_error):
            button.setCheckable(True)
            button.setAutoExclusive(True)
        self.flat.setChecked(True)
        self.bar = QProgressBar()
        self.bar.setTextVisible(True)
        self.report, self.pointer = QLabel(), QLabel()
        self.report.setWordWrap(True)
        self.picture, self.cloud = DepthPicture(), CloudPicture()
        self.stack = QStackedWidget()
        self.stack.addWidget(self.picture)
        self.stack.addWidget(self.cloud)

    def _arrange(self) -> None:
        form = QFormLayout()
        form.setContentsMargins(0, 0, 0, 0)
        for name, widget in (("Nearest", self.nearest), ("Resolution", self.finest), ("Average", self.repeats)):
            widget.setAccessibleName(name)
            form.addRow(name, widget)
        side = QWidget()
        side.setFixedWidth(_WIDTH_PX)
        left = QVBoxLayout(side)
        left.setContentsMargins(0, 0, 0, 0)
        left.setSpacing(4)
        left.addLayout(form)
        for row in ((self.start, self.cancel), (self.flat, self.solid, self.by_error, self.save, self.keep)):
            left.addLayout(FlowLayout(row))
        left.addWidget(self.bar)
        left.addWidget(self.report)
        left.addStretch(1)
        right = QVBoxLayout()
        right.setSpacing(2)
        right.addWidget(self.stack, 1)
        right.addWidget(self.pointer)
        across = QHBoxLayout(self)
        across.setContentsMargins(6, 6, 6, 6)
        across.addWidget(side)
        across.addLayout(right, 1)

    def _connect(self) -> None:
        self.start.clicked.connect(self.measure)
        self.cancel.clicked.connect(self._runner.cancel)
        self.save.clicked.connect(self._ask_where)
        self.keep.clicked.connect(self._ask_scene)
        self.solid.toggled.connect(lambda on: self.stack.setCurrentIndex(1 if on else 0))
        self.by_error.toggled.connect(self.picture.show_errors)
        self.picture.hovered.connect(self.pointer.setText)
        self._runner.progressed.connect(self._on_progress)
        self._runner.finished.connect(self._on_measured)
        self._runner.failed.connect(self._on_failed)
        self._runner.cancelled.connect(lambda: self._end("Cancelled; the gate is as it was."))
        self._saver.finished.connect(lambda path: self._desk.noted.emit(f"Saved {path}"))
        self._saver.failed.connect(self._desk.warned)
        self._session.changed.connect(self._on_source)

    @property
    def busy(self) -> bool:
        """Whether a sweep runs."""
        return self._runner.busy

    def measure(self) -> None:
        """Start the sweep."""
        source, stream = self._session.source, self._session.stream
        if source is None or stream is None:
            return
        settings = SweepSettings(
            nearest_m=self.nearest.value(), finest_rows=self.finest.value(), repeats=self.repeats.value()
        )
        truth = None if source.is_device or source.scene.moving else known_buffers(source)
        rig, black, name = source.rig, source.camera.info.black_count, source.scene.name
        self.report.setText(
            "Something moves in this scene: what moves during the sweep gets no depth." if source.scene.moving else ""
        )
        self._hold.begin("gate")
        self._runner.start(lambda progress: sweep_job(stream, rig, black, settings, truth, name, progress))
        self._refresh()

    def save_to(self, path: Path) -> None:
        """Write the last map to this file, in a thread of its own."""
        result = self.result
        if result is not None:
            self._save(path, lambda: write(path, result))

    def keep_as(self, folder: Path) -> None:
        """Keep the last sweep as a scene folder, in a thread of its own."""
        result, source = self.result, self._session.source
        if result is not None and source is not None:
            form, gates = source.camera.info.pixel_format, source.presets
            self._save(folder, lambda: keep_twin(folder, result.rig, result.found, form, result.scene, gates, True))

    def _save(self, path: Path, job: Callable[[], Path]) -> None:
        self._desk.noted.emit(f"Saving {path.name} ...")
        self._saver.start(lambda _: job())

    def _ask_scene(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Keep the sweep as a scene in a new folder", "swept-scene")
        if name:
            self.keep_as(Path(name))

    def _ask_where(self) -> None:
        kinds = "Metres (*.npy *.exr *.tif);;Millimetres (*.png);;Points (*.ply)"
        name, kind = QFileDialog.getSaveFileName(self, "Save the depth map", "depth.npy", kinds)
        if name:
            path = Path(name)
            default = {"Mi": ".png", "Po": ".ply"}.get(kind[:2], ".npy")
            self.save_to(path if path.suffix else path.with_suffix(default))

    def _on_progress(self, share: float, text: str) -> None:
        self.bar.setValue(round(100 * share))
        self.bar.setFormat(text)

    def _on_measured(self, result: Measured) -> None:
        self.result = result
        inverse = result.found.inverse_depth
        self.picture.show_depth(inverse, None if result.errors is None else result.errors.total_m)
        self.cloud.show_points(result.points, inverse[result.found.known])
        self._end(report_text(result))
        source = self._session.source
        if source is not None and source.is_device:
            self._session.learn(as_buffers(result.found))
        self._desk.keep_sweep(result.found.projector_row)

    def _on_failed(self, sentence: str) -> None:
        self._end(sentence)

    def _end(self, text: str) -> None:
        self.bar.reset()
        self.picture.say("No depth yet")
        self.report.setText(text)
        self._refresh()

    def _on_source(self, change: Change) -> None:
        if Change.SOURCE in change:
            self._runner.cancel()
            self.result = None
            self.picture.show_depth(None)
            self.cloud.show_points(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
            self._end("")

    def _refresh(self) -> None:
        busy = self._runner.busy
        self.start.setEnabled(self._session.source is not None and not busy)
        self.cancel.setEnabled(busy)
        self.bar.setVisible(busy)
        for button in (self.save, self.keep):
            button.setEnabled(self.result is not None)
        known = self.result is not None and self.result.errors is not None
        self.by_error.setVisible(known)
        if not known and self.by_error.isChecked():
            self.flat.setChecked(True)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._runner.close()
        self._saver.close(WRITTEN_S)
        event.accept()
