"""Opening scenes beside the one that runs, which is replaced only when the new one is complete."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, Signal
from slopegate.app.loading import Loader, Progress
from slopegate.app.session import Intent, Session
from slopegate.app.source import Options, Source, build_source, open_source
from slopegate.core.rig import Rig
from slopegate.drivers.camera import CameraError
from slopegate.drivers.scene_error import SceneError
from slopegate.drivers.scene_files import scene_path, shipped_scenes


@dataclass(frozen=True, eq=False)
class Opened:
    """A source ready to run, and the gate to run it with; None for its first named gate."""

    source: Source
    intent: Intent | None
    keep_gate: bool = False
    """Run it with the gate that is wanted when it is ready, whatever `intent` is."""

    def close(self) -> None:
        """Nobody wants it any more."""
        self.source.close()


class Opener(QObject):
    """Loads in a worker thread; on failure or cancel what runs goes on as it is."""

    progressed = Signal(float, str)
    opened = Signal()
    failed = Signal(str)
    """One sentence."""
    cancelled = Signal()

    def __init__(self, session: Session, rig: Rig, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._session, self._rig = session, rig
        self._fallback: tuple[Path, Options] | None = None
        self._loader: Loader[Opened] = Loader(Opened.close, self)
        self._loader.progressed.connect(self.progressed)
        self._loader.finished.connect(self._adopt)
        self._loader.failed.connect(self._fail)
        self._loader.cancelled.connect(self.cancelled)

    @property
    def busy(self) -> bool:
        """Whether something is being loaded."""
        return self._loader.busy

    def open_first(self, wanted: str | None, options: Options, intent: Intent | None) -> None:
        """Open a shipped scene's key or a path; the first shipped scene where that is None or does not open."""
        first = shipped_scenes()[0].path
        where = first
        if wanted is not None:
            try:
                where = scene_path(wanted)
            except SceneError as error:
                self.failed.emit(str(error))
                intent = None
        self._fallback = None if where == first else (first, options)
        self._start(where, options, intent)

    def open(self, where: Path, options: Options) -> None:
        """Open a scene file or folder."""
        self._fallback = None
        self._start(where, options, None)

    def reopen(self, options: Options) -> None:
        """The scene that runs, through another sensor; the gate stays."""
        source = self._session.source
        if source is None or source.options == options:
            return
        self._fallback = None

        def job(progress: Progress) -> Opened:
            rebuilt = build_source(source.where, source.rig, source.scene, options, progress)
            return Opened(rebuilt, None, keep_gate=True)

        self._loader.start(job)

    def cancel(self) -> None:
        """Stop loading."""
        self._loader.cancel()

    def close(self) -> None:
        """Stop loading and wait for the worker."""
        self._loader.close()

    def _start(self, where: Path, options: Options, intent: Intent | None) -> None:
        rig = self._rig

        def job(progress: Progress) -> Opened:
            return Opened(open_source(where, rig, options, progress), intent)

        self._loader.start(job)

    def _adopt(self, opened: Opened) -> None:
        try:
            self._session.adopt(opened.source, self._session.intent if opened.keep_gate else opened.intent)
        except CameraError as error:
            opened.close()
            self._fail(str(error))
            return
        self._fallback = None
        self.opened.emit()

    def _fail(self, sentence: str) -> None:
        self.failed.emit(sentence)
        fallback, self._fallback = self._fallback, None
        if fallback is not None:
            self._start(*fallback, None)
