"""Opens scenes and cameras while another one runs, which is replaced only when the new one is ready."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from slopegate.app.session.device_source import Delayed, open_device, open_pictures
from slopegate.app.session.loading import MOMENT_S, Loader, Progress
from slopegate.app.session.session import Change, Intent, Session
from slopegate.app.session.source import Options, Source, build_source, open_source
from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.video import is_pictures
from slopegate.drivers.captures.film import is_film
from slopegate.drivers.captures.storage import is_capture
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.families import Address
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.scenes.rgbd_files import CALIBRATION
from slopegate.drivers.scenes.scene_files import scene_path, shipped_scenes
from slopegate.drivers.stream.stream import Stream

LET_GO_S = 10.0
"""How long to wait for a camera to close before it is opened again."""

CLOSE_S = (MOMENT_S, 0.6)
"""How long the end of the program waits for a scene that is being opened, and for a device."""


@dataclass(frozen=True, eq=False)
class OpenedSource:
    """A source that is ready to run, and the gate to run it with; None for its first named gate."""

    source: Source
    intent: Intent | None
    keep_gate: bool = False
    """Run it with the gate that is wanted when it is ready, whatever `intent` is."""
    stream: Stream | None = None
    """The stream of a device, already started."""

    def close(self) -> None:
        """Close it, when it is not wanted any more."""
        if self.stream is None:
            self.source.close()
        else:
            self.stream.close()


_Attempt = tuple[Path, Options, Intent | None]


class Opener(QObject):
    """Opens in a worker thread. On failure or cancel, what runs goes on."""

    progressed = Signal(float, str)
    opened = Signal()
    failed = Signal(str)
    """One sentence."""
    cancelled = Signal()
    settled = Signal()
    """After any of these three, when nothing else is tried."""

    def __init__(self, session: Session, rig: Rig, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._session = session
        self.rig = rig
        """What is opened from now on is looked at with it."""
        self._first: _Attempt | None = None
        """What is being opened for the first picture, as nothing else was asked for."""
        self._fallbacks: list[_Attempt] = []
        """What is opened instead when that fails which is being opened, the first one first."""
        self._device = False
        self._loader: Loader[OpenedSource] = Loader(OpenedSource.close, self)
        self._loader.progressed.connect(self.progressed)
        self._loader.finished.connect(self._adopt)
        self._loader.failed.connect(self._fail)
        self._loader.cancelled.connect(self._on_cancelled)
        self._ready: OpenedSource | None = None
        """What is loaded and waits for something to let the source go."""
        session.changed.connect(self._on_changed)

    @property
    def busy(self) -> bool:
        """Whether something is being loaded, or waits to be shown."""
        return self._loader.busy or self._ready is not None

    def open_first(self, wanted: str | None, options: Options, intent: Intent | None) -> None:
        """Open a shipped scene's key or a path; the first shipped scene where that is None or does not open, and a
        capture, which needs nothing to cast rays with, where not even that opens."""
        paths = [entry.path for entry in shipped_scenes()]
        spare = [paths[0], *[path for path in paths if path.is_dir()][:1]]
        where = spare[0]
        if wanted is not None:
            try:
                where = scene_path(wanted)
            except SceneError as error:
                self.failed.emit(str(error))
                intent = None
        self._fallbacks = [(where, options, intent), *((path, options, None) for path in spare if path != where)]
        self._start_next()

    def open_first_again(self) -> None:
        """Begin anew with what is being opened for the first picture, as with another rig."""
        if self._first is not None:
            self._start(*self._first)

    def open(self, where: Path, options: Options, keep_gate: bool = False) -> None:
        """Open a scene file or folder; `keep_gate`: with the gate that is set."""
        self._put_off_first()
        self._start(where, options, None, keep_gate)

    def open_camera(
        self, address: Address, options: Options, ways: list[OpenOptions], delayed: Delayed, keep_gate: bool = False
    ) -> None:
        """Open a device beside what runs; the same device is let go first. `keep_gate`: with the gate that is set.

        `ways`: how, and how instead where the camera refuses that.
        """
        rig, closing, session = self.rig, self._session.closing, self._session
        if session.source is not None and session.source.where == address:
            session.release()

        def job(progress: Progress) -> OpenedSource:
            progress.step(0.0, f"Opening {address} ...")
            closing.wait(LET_GO_S)
            refusal = ""
            for way in dict.fromkeys(ways):
                try:
                    source = open_device(address, rig, options, way, delayed, progress)
                    return _running(OpenedSource(_after(refusal, source), None, keep_gate))
                except CameraError as error:
                    refusal = refusal or str(error)
            raise CameraError(f"{address} did not open: {refusal}")

        self._put_off_first()
        self._load(job, device=True)

    def reopen(self, options: Options) -> None:
        """Open the scene that runs with other options of the camera; the gate stays."""
        source = self._session.source
        if source is None or source.options == options or not isinstance(source.where, Path) or source.is_device:
            return
        where = source.where

        def job(progress: Progress) -> OpenedSource:
            rebuilt = build_source(where, source.rig, source.scene, options, progress)
            return OpenedSource(rebuilt, None, keep_gate=True)

        self._load(job)

    def cancel(self) -> None:
        """Stop loading."""
        if self._ready is not None:
            self._discard_ready()
            self._on_cancelled()
        self._loader.cancel()

    def close(self) -> None:
        """Stop loading. What is still read, rendered or opened then is left behind."""
        self._discard_ready()
        self._loader.close(CLOSE_S[self._device])

    def _start(self, where: Path, options: Options, intent: Intent | None, keep_gate: bool = False) -> None:
        rig, plays = self.rig, _plays(where)

        def job(progress: Progress) -> OpenedSource:
            if plays:
                return _running(OpenedSource(open_pictures(where, rig, options, progress), intent, keep_gate))
            return OpenedSource(open_source(where, rig, options, progress), intent, keep_gate)

        self._load(job, device=plays)

    def _load(self, job: Callable[[Progress], OpenedSource], device: bool = False) -> None:
        self._device = device
        self._discard_ready()
        self._loader.start(job)

    def _discard_ready(self) -> None:
        ready, self._ready = self._ready, None
        if ready is not None:
            ready.close()

    def _on_changed(self, change: Change) -> None:
        if Change.HOLD in change and self._ready is not None:
            # later: whoever has just let the source go is still in the middle of its work
            QTimer.singleShot(0, self, self._adopt_ready)

    def _adopt_ready(self) -> None:
        ready, self._ready = self._ready, None
        if ready is not None:
            self._adopt(ready)

    def _adopt(self, opened: OpenedSource) -> None:
        held = self._session.held("source")
        if held is not None:
            self._ready = opened
            self.progressed.emit(1.0, f"{opened.source.scene.name} is ready and comes when {held.by} has ended")
            return
        intent = self._session.intent if opened.keep_gate else opened.intent
        try:
            self._session.adopt(opened.source, intent, opened.stream)
        except CameraError as error:
            opened.close()
            self._fail(str(error))
            return
        self._first, self._fallbacks = None, []
        self.opened.emit()
        self.settled.emit()

    def _put_off_first(self) -> None:
        """Something is opened before there was a picture: what was to come first comes when that fails."""
        if self._first is not None:
            self._fallbacks.insert(0, self._first)
            self._first = None

    def _on_cancelled(self) -> None:
        of_first = self._first is not None
        self._put_off_first()
        self.cancelled.emit()
        if of_first or not self._start_next():
            self.settled.emit()

    def _fail(self, sentence: str) -> None:
        self.failed.emit(sentence)
        if not self._start_next():
            self.settled.emit()

    def _start_next(self) -> bool:
        """Open what is next in place of what did not open; False when there is nothing, as once there is a picture."""
        self._first = self._fallbacks.pop(0) if self._fallbacks else None
        if self._first is not None:
            self._start(*self._first)
        return self._first is not None


def _plays(where: Path) -> bool:
    """Whether it is a video, a recording at one gate, or a folder that holds only pictures."""
    if is_film(where):
        return True
    if os.path.isdir(where) and ((where / CALIBRATION).exists() or is_capture(where) or any(where.glob("color.*"))):
        return False
    return is_pictures(where)


def _after(refusal: str, source: Source) -> Source:
    """The source, with a remark where the camera refused what was asked for first."""
    if not refusal:
        return source
    modes = source.camera.info.modes
    return replace(source, remark=f"The camera goes on with {modes.format}, for the other choice failed: {refusal}")


def _running(opened: OpenedSource) -> OpenedSource:
    """A device's stream is started where it was opened, for that may block. Raises CameraError, with it closed."""
    stream = Stream(opened.source.camera)
    try:
        stream.start()
    except BaseException:
        stream.close()
        raise
    return replace(opened, stream=stream)
