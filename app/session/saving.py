"""Saves files one after the other, so that none that was asked for is forgotten."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from slopegate.app.session.loading import WRITTEN_S, Loader, Progress
from slopegate.app.session.log import TOLD, sentence_of

MOST_WAITING = 16
"""Frames that wait for the disk hold memory."""


class Saver(QObject):
    """Writes files in a thread of its own, in the order in which they were asked for."""

    finished = Signal(object)
    """The Path of a file that has been written."""
    failed = Signal(str)
    """Why one was not, in one sentence."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._waiting: deque[Callable[[Progress], Path]] = deque()
        self._loader: Loader[Path] = Loader(lambda _: None, self)
        self._loader.finished.connect(self._on_finished)
        self._loader.failed.connect(self._on_failed)

    @property
    def busy(self) -> bool:
        """Whether a file is being written or waits for it."""
        return self._loader.busy or bool(self._waiting)

    def start(self, job: Callable[[Progress], Path]) -> None:
        """Do this after what was asked for before; `job` writes a file and returns its path."""
        if len(self._waiting) >= MOST_WAITING:
            self.failed.emit(f"The disk is too slow: {MOST_WAITING} frames wait to be saved, so this one was not.")
            return
        self._waiting.append(job)
        if not self._loader.busy:
            self._next()

    def close(self) -> None:
        """Write all that waits, and wait for it."""
        self._loader.close(WRITTEN_S)
        while self._waiting:
            try:
                self._waiting.popleft()(Progress(lambda share, text: None))
            except Exception as error:
                logging.getLogger(TOLD).warning(sentence_of(error, "Saving a frame"))

    def _next(self) -> None:
        if self._waiting:
            self._loader.start(self._waiting.popleft())

    def _on_finished(self, path: Path) -> None:
        self.finished.emit(path)
        self._next()

    def _on_failed(self, sentence: str) -> None:
        self.failed.emit(sentence)
        self._next()
