"""A recorder at work on the session's stream: makes its folder, records, and tells how far it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from PySide6.QtCore import QObject, QTimer, Signal

from slopegate.app.session.holding import Needs
from slopegate.app.session.loading import WRITTEN_S, Loader
from slopegate.app.session.session import Session
from slopegate.core.rig.checks import UserError
from slopegate.drivers.captures.capture_run import StartedRecorder
from slopegate.drivers.stream.stream import Stream

POLL_MS = 100
CLOSE_S = 10.0


class MadeFolder(Protocol):
    """A folder that is recorded into."""

    path: Path


class LiveRecorder(StartedRecorder, Protocol):
    """What records from a stream, and tells how far it is."""

    @property
    def progress(self) -> Any:
        """How far it is; its `state` is a word."""


Folder = TypeVar("Folder", bound=MadeFolder)
Kind = TypeVar("Kind", bound=LiveRecorder)


class RecorderRun(QObject, Generic[Folder, Kind]):
    """Runs one recorder at a time, and holds the gate or the source while it does."""

    progressed = Signal(object)
    """The recorder's progress, several times a second; the last one is final and all of it is written."""
    failed = Signal(str)
    """Why it did not begin, in one sentence."""
    final: tuple[str, ...] = ()
    """The states in which it has ended."""
    unit = ""
    """What it is made of, such as "slice"."""

    def __init__(self, session: Session, by: str, fate: str, parent: QObject | None = None) -> None:
        """`by` and `fate`: see `Session.hold`."""
        super().__init__(parent)
        self._session = session
        self._recorder: Kind | None = None
        self._make: Callable[[Stream, Folder], Kind] | None = None
        self.folder: Path | None = None
        """Where the latest recording is."""
        self._loader: Loader[Folder] = Loader(lambda _: None, self)
        self._loader.finished.connect(self._record)
        self._loader.failed.connect(self.failed)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._poll)
        self._hold = session.hold(by, fate, self.cancel)
        self._loader.failed.connect(self._hold.end)

    @property
    def busy(self) -> bool:
        """Whether it is being begun or at work."""
        return self._loader.busy or self._timer.isActive()

    def cancel(self) -> None:
        """Stop, and keep what has been taken."""
        if self._loader.busy:
            self._loader.cancel()
            self._fail(f"Cancelled before the first {self.unit}.")
        elif self._recorder is not None:
            self._end(self._recorder)
            self._poll()

    def stop(self) -> None:
        """Cancel, and wait until all is written."""
        self._timer.stop()
        self._loader.close(WRITTEN_S)
        if self._recorder is not None:
            self._hurry(self._recorder)
            self._recorder.wait(CLOSE_S)
        self._hold.end()

    def _start(self, folder: Callable[[], Folder], recorder: Callable[[Stream, Folder], Kind]) -> None:
        """Make the folder in a worker, then the recorder for it, and record."""
        if not self.busy:
            self._make = recorder
            self._hold.begin("source")
            self._loader.start(lambda _: folder())

    def _end(self, recorder: Kind) -> None:
        """Let the recorder stop."""
        raise NotImplementedError

    def _hurry(self, recorder: Kind) -> None:
        """Let it stop as soon as can be: the window closes."""
        self._end(recorder)

    def _needs(self, state: str) -> Needs:
        """What must stay in this state."""
        raise NotImplementedError

    def _fail(self, sentence: str) -> None:
        self._hold.end()
        self.failed.emit(sentence)

    def _record(self, folder: Folder) -> None:
        stream = self._session.stream
        if self._session.source is None or stream is None or self._make is None:
            self._fail("The camera has gone: nothing was recorded.")
            return
        recorder = self._make(stream, folder)
        try:
            recorder.start()
        except UserError as error:
            self._fail(str(error))
            return
        self._recorder, self.folder = recorder, folder.path
        self._timer.start(POLL_MS)
        self._poll()

    def _poll(self) -> None:
        if self._recorder is None or not self._timer.isActive():
            return
        progress = self._recorder.progress
        if progress.state in self.final:
            if not self._recorder.wait(0.0):
                return
            self._timer.stop()
            progress = self._recorder.progress
            self._hold.end()
        else:
            self._hold.begin(self._needs(progress.state))
        self.progressed.emit(progress)
