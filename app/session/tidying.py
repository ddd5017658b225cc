"""Gives the memory of scenes that were looked at before back to the computer."""

from __future__ import annotations

import ctypes
import gc
import sys
import threading
from typing import Final

from PySide6.QtCore import QObject, QTimer

from slopegate.app.session.session import Change, Session

AFTER_MS: Final = 2000
"""How long after another scene has come: the old one is closed by then, and nobody waits for a picture."""


class Tidying(QObject):
    """Tidies up some time after each change of the scene or camera."""

    def __init__(self, session: Session, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(tidy)
        session.changed.connect(self._on_changed)

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE in change:
            self._timer.start(AFTER_MS)


def tidy() -> threading.Thread:
    """Free what only holds itself, and give back memory that is free; the latter in the thread that is returned."""
    gc.collect()
    thread = threading.Thread(target=give_back, name="tidying", daemon=True)
    thread.start()
    return thread


def give_back() -> None:
    """Give free memory back: glibc keeps hundreds of megabytes of freed arrays, between others that are in use."""
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # other C libraries have none
        if trim is not None:
            trim(0)
