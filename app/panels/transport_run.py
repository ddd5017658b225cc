"""Runs acquisitions of light transport beside the window: of scenes on the bench, of cameras with the screen."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from slopegate.app.panels.panel import Desk
from slopegate.app.session.loading import WRITTEN_S, CancelledError, Loader, Progress
from slopegate.app.session.source import Source
from slopegate.core.light.part import PARTS, PartName
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.blocks import parse_grid
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.transports.bench import SceneBench
from slopegate.drivers.transports.model import CodeName, TransportManifest
from slopegate.drivers.transports.run import AcquireProgress, Attendance, run_acquisition
from slopegate.drivers.transports.shots import shots_behind
from slopegate.drivers.transports.storage import (
    check_new_transport,
    create_transport,
    make_transport,
    open_transport,
)

Job = Callable[[Progress], AcquireProgress]
POLL_MS = 100
FRAME_PX = 400
"""Width, at least, of the frames that are shown."""
SEED = 0
"""Of the bench's noise."""
NO_PROJECTOR = "This was recorded earlier: no pattern can be shown in it. Open a scene or a camera."


@dataclass(frozen=True)
class AcquireWish:
    """What is to be acquired."""

    path: Path
    gates: tuple[GateSettings | None, ...]
    """None for a camera without a gate."""
    grid: str
    """Columns x rows."""
    codes: CodeName
    frames: int
    keep_raw: bool
    transfer_us: float
    """How long a camera's frame may be on its way."""


class TransportRun(QObject):
    """One acquisition at a time, in a thread of its own."""

    progressed = Signal(object)
    """An AcquireProgress, several times a second."""
    seen = Signal(object)
    """A frame that was taken, (h, w) uint16, every few pixels of it; several times a second."""
    said = Signal(str)
    """What goes on before the first frame."""
    ended = Signal(str)
    """How it ended, in a sentence; finished slices are on the disk."""

    def __init__(self, desk: Desk, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._desk = desk
        self.folder: Path | None = None
        """Where the latest acquisition is."""
        self.complete = False
        """Whether it has all of its slices."""
        self._stop, self._pause = threading.Event(), threading.Event()
        self._newest: AcquireProgress | None = None
        self._frame: Counts | None = None
        self._loader: Loader[AcquireProgress] = Loader(lambda _: None, self)
        self._loader.progressed.connect(lambda share, text: self.said.emit(text))
        self._loader.finished.connect(self._on_finished)
        self._loader.failed.connect(self._on_failed)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._poll)
        fate = "Finished slices are kept, and the rest can be resumed."
        self._hold = desk.session.hold("the acquisition of light transport", fate, self.cancel)
        self._loader.release(self._hold)

    @property
    def busy(self) -> bool:
        """Whether an acquisition is under way."""
        return self._loader.busy

    @property
    def paused(self) -> bool:
        """Whether it waits."""
        return self._pause.is_set()

    def begin(self, wish: AcquireWish, resumed: TransportManifest | None) -> None:
        """Acquire in a new folder, or go on with the unfinished one whose manifest this is. Raises UserError."""
        source = self._desk.session.source
        if source is None or self.busy:
            return
        if source.replayed:
            raise InputError(NO_PROJECTOR)
        self._stop, self._pause, self._newest = threading.Event(), threading.Event(), None
        attendance = Attendance(self._keep, self._pause.is_set, self._stop.is_set, self._see)
        if source.rendered is not None:
            job = scene_job(source, wish, resumed, attendance)
        else:
            job = self._camera_job(source, wish, resumed, attendance)
        self.folder, self.complete = wish.path, False
        # the bench has a camera of its own, so that another scene may be looked at meanwhile
        self._hold.begin("program" if source.rendered is not None else "gate")
        self._timer.start(POLL_MS)
        self._loader.start(job)

    def pause(self) -> None:
        """Wait, or go on."""
        if self.paused:
            self._pause.clear()
        else:
            self._pause.set()

    def cancel(self) -> None:
        """Stop; what is finished stays."""
        self._pause.clear()
        self._stop.set()

    def stop(self) -> None:
        """Cancel, and wait until all is written."""
        self.cancel()
        self._timer.stop()
        self._loader.close(WRITTEN_S)

    def _camera_job(
        self, source: Source, wish: AcquireWish, resumed: TransportManifest | None, attendance: Attendance
    ) -> Job:
        """With the camera that runs and the screen that shows patterns. Raises UserError where there is none."""
        stream = self._desk.session.stream
        if stream is None:
            raise CameraError("the camera has gone")
        projector, settle_frames = self._desk.screen()
        info, rig, name = source.camera.info, source.rig, source.scene.name

        def job(progress: Progress) -> AcquireProgress:
            if resumed is None:
                grid = parse_grid(wish.grid, projector.info.raster)
                manifest = make_transport(
                    name,
                    rig,
                    info,
                    grid,
                    wish.codes,
                    wish.gates,
                    frames=wish.frames,
                    settle_frames=settle_frames,
                )
                folder = create_transport(wish.path, manifest)
            else:
                folder = open_transport(wish.path)
            with shots_behind(stream, info, wish.transfer_us) as shots:
                made = run_acquisition(projector, shots, folder, attendance, wish.keep_raw)
            projector.white()
            return made

        return job

    def _keep(self, progress: AcquireProgress) -> None:
        self._newest = progress

    def _see(self, image: Counts) -> None:
        if self._frame is None:
            step = max(1, image.shape[1] // FRAME_PX)
            self._frame = image[::step, ::step].copy()

    def _poll(self) -> None:
        newest, self._newest = self._newest, None
        frame, self._frame = self._frame, None
        if newest is not None:
            self.progressed.emit(newest)
        if frame is not None:
            self.seen.emit(frame)

    def _on_finished(self, progress: AcquireProgress) -> None:
        self._timer.stop()
        self.complete = progress.state == "done"
        self.progressed.emit(progress)
        self.ended.emit(ending_text(progress))

    def _on_failed(self, sentence: str) -> None:
        self._timer.stop()
        self.ended.emit(sentence)


def scene_job(
    source: Source,
    wish: AcquireWish,
    resumed: TransportManifest | None,
    attendance: Attendance,
) -> Job:
    """On the bench: with the light that the live image shows now, but what no pattern changes."""
    shown = source.rendered
    assert shown is not None
    rig, scene = source.rig, source.scene
    if resumed is None:
        pixel_format, parts = source.options.pixel_format, _named(shown.smooth.shown - {"ambient"})
        seed = SEED if source.options.noise else None
        gain = None if shown.sensor is None else shown.sensor.counts_per_unit
    else:
        pixel_format, parts = resumed.camera.pixel_format, _named(resumed.parts)
        seed, gain = resumed.seed, resumed.counts_per_unit

    def job(progress: Progress) -> AcquireProgress:
        if resumed is None:
            check_new_transport(wish.path)
        doing = f"Preparing the light of {scene.name} ..."
        try:
            bench = SceneBench(rig, scene, parts, seed, pixel_format, gain, lambda share: progress.report(share, doing))
        except Cancelled:
            raise CancelledError from None
        if resumed is not None:
            return bench.acquire(open_transport(wish.path), attendance, wish.keep_raw)
        grid = parse_grid(wish.grid, rig.projector.raster)
        folder = bench.begin(wish.path, grid, wish.codes, wish.gates, wish.frames)
        return bench.acquire(folder, attendance, wish.keep_raw)

    return job


def _named(parts: Collection[str]) -> tuple[PartName, ...]:
    return tuple(name for name in PARTS if name in parts)


def ending_text(progress: AcquireProgress) -> str:
    """How an acquisition ended, and what is doubtful about it."""
    kept = f"; {progress.slices_done} of {progress.slices} slices are kept" if progress.state == "cancelled" else ""
    return " ".join([f"{progress.doing}{kept}.", *progress.remarks])
