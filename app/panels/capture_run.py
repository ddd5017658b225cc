"""A capture under way, for a panel to show: made in a worker, recorded by the stream, polled by a timer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal
from slopegate.app.session.loading import Loader
from slopegate.app.session.session import Session
from slopegate.drivers.captures.recorder import Recorder
from slopegate.drivers.captures.recorder_state import FINAL, Coverable, Progress
from slopegate.drivers.captures.storage import CaptureFolder
from slopegate.drivers.files.durable import StorageError

POLL_MS = 100
CLOSE_S = 10.0


class CaptureRun(QObject):
    """One capture at a time."""

    progressed = Signal(object)
    """A recorder's Progress, several times a second; the last one is final and all of it is written."""
    failed = Signal(str)
    """Why it did not begin, in one sentence."""

    def __init__(self, session: Session, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._session = session
        self._recorder: Recorder | None = None
        self.folder: Path | None = None
        """Where the latest capture is."""
        self._loader: Loader[CaptureFolder] = Loader(lambda _: None, self)
        self._loader.finished.connect(self._record)
        self._loader.failed.connect(self.failed)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._poll)

    @property
    def busy(self) -> bool:
        """Whether a capture is being made or recorded."""
        return self._loader.busy or self._timer.isActive()

    def begin(self, make: Callable[[], CaptureFolder]) -> None:
        """Make the folder in a worker, then record from the session's stream what is missing in it."""
        if not self.busy:
            self._loader.start(lambda _: make())

    def pause(self) -> None:
        """Pause, or go on after a pause or a prompt."""
        if self._recorder is None:
            return
        if self._recorder.progress.state == "running":
            self._recorder.pause()
        else:
            self._recorder.resume()
        self._poll()

    def cancel(self) -> None:
        """Stop and keep what has been taken."""
        if self._recorder is not None:
            self._recorder.cancel()
            self._poll()

    def stop(self) -> None:
        """Cancel, and wait until all is written."""
        self._timer.stop()
        self._loader.close()
        if self._recorder is not None:
            self._recorder.cancel()
            self._recorder.wait(CLOSE_S)

    def _record(self, folder: CaptureFolder) -> None:
        source, stream = self._session.source, self._session.stream
        if source is None or stream is None:
            self.failed.emit("The camera has gone: nothing was recorded.")
            return
        recorder = Recorder(stream, folder, source.camera.cover if isinstance(source.camera, Coverable) else None)
        try:
            recorder.start()
        except (StorageError, ValueError) as error:
            self.failed.emit(str(error))
            return
        self._recorder, self.folder = recorder, folder.path
        self._timer.start(POLL_MS)
        self._poll()

    def _poll(self) -> None:
        if self._recorder is None or not self._timer.isActive():
            return
        progress: Progress = self._recorder.progress
        if progress.state in FINAL:
            if not self._recorder.wait(0.0):
                return
            self._timer.stop()
            progress = self._recorder.progress
        self.progressed.emit(progress)
