"""Searches for garbage when nobody waits for a picture, and gives the memory of former scenes back to the computer."""

from __future__ import annotations

import ctypes
import gc
import sys
import threading
from typing import ClassVar, Final

from PySide6.QtCore import QObject, QTimer

from slopegate.app.session.session import Change, Session

AFTER_MS: Final = 2000
"""How long after another scene has come: the old one is closed by then, and nobody waits for a picture."""


ARENAS: Final = 2
"""How many heaps the C library keeps for all threads."""
_M_ARENA_MAX: Final = -8
"""Of `mallopt`, in malloc.h."""


class Unsearched:
    """Until its end nothing is searched for garbage: among modules that are being imported, by whatever thread, a
    search finds little and stops all threads for 0.1 s."""

    _lasting: ClassVar[int] = 0

    def __init__(self) -> None:
        self._ended = False
        Unsearched._lasting += 1
        gc.disable()

    def end(self) -> None:
        """Search again, once every other one has ended too."""
        if not self._ended:
            self._ended = True
            Unsearched._lasting -= 1
            if not Unsearched._lasting:
                gc.enable()

    def end_of_start(self) -> None:
        """End, and never search what the program has made so far: it stays. Only the first window's start counts."""
        if not self._ended and not gc.get_freeze_count():
            gc.freeze()
        self.end()


class Tidying(QObject):
    """Tidies up some time after a scene or camera has taken the place of another."""

    def __init__(self, session: Session, parent: QObject | None = None) -> None:
        super().__init__(parent)
        keep_few_heaps()
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(tidy)
        self._any = False
        session.changed.connect(self._on_changed)

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE in change:
            if self._any:
                self._timer.start(AFTER_MS)
            self._any = True


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


def keep_few_heaps() -> None:
    """Let threads share heaps: glibc makes up to eight for each core, and as the threads of each scene used others, the
    gaps between what is in use grew by 6 MB with every scene that was shown."""
    if sys.platform == "linux":
        set_option = getattr(ctypes.CDLL(None), "mallopt", None)  # other C libraries have none
        if set_option is not None:
            set_option(_M_ARENA_MAX, ARENAS)
