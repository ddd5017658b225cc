"""Ctrl+C while the main thread waits for another thread."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import waiting
from slopegate.drivers.files import workers


class Interrupt:
    """What `caught` gives: `strike` is called in the thread that is waited for."""

    def __init__(self) -> None:
        self._heard, self._raised = threading.Event(), threading.Event()
        self._striking = self.early = False
        """Whether the waiting had ended while the thread was still at work."""

    def hear(self, *_: object) -> None:
        """As Python's own handler does."""
        self._heard.set()
        raise KeyboardInterrupt

    def end(self) -> None:
        """The main thread goes on."""
        self.early = self._striking
        self._raised.set()

    def strike(self) -> None:
        """Interrupt the main thread, and look whether it goes on although this thread is at work."""
        main = threading.main_thread().ident
        assert main is not None
        self._heard.clear()
        self._striking = True
        waiting.until(lambda: _waits(main), 30.0)
        signal.pthread_kill(main, signal.SIGINT)
        assert self._heard.wait(30)
        self._raised.wait(0.3)
        self._striking = False


def _waits(thread: int) -> bool:
    """Whether this thread waits for a worker."""
    frame = sys._current_frames().get(thread)
    while frame is not None:
        if frame.f_code.co_filename == workers.__file__ and frame.f_code.co_name in ("wait", "finish"):
            return True
        frame = frame.f_back
    return False


@contextmanager
def caught() -> Iterator[Interrupt]:
    """The main thread is interrupted within, or it fails."""
    made = Interrupt()
    before = signal.signal(signal.SIGINT, made.hear)
    try:
        yield made
    except KeyboardInterrupt:
        made.end()
    else:
        raise AssertionError("nothing was interrupted")
    finally:
        signal.signal(signal.SIGINT, before)
