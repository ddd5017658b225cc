"""Threads whose end can be waited for, also where the waiting is interrupted."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Worker:
    """Work in a daemon thread, which runs until it has ended: an interrupted `Thread.join` of Python 3.11 (Ctrl+C)
    takes a running thread for ended, and what it still uses would be closed or read beside it."""

    def __init__(self, work: Callable[[], object], name: str) -> None:
        self._ended = threading.Event()
        # The thread forgets its arguments at its end, so a worker and whoever's method it runs are no ring for ever.
        self._thread = threading.Thread(target=self._run, args=(work,), name=name, daemon=True)

    def start(self) -> None:
        """Begin; once."""
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether it has begun and not ended."""
        return self._thread.ident is not None and not self._ended.is_set()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the end; False after the time-out."""
        return self._ended.wait(timeout_s)

    def finish(self, timeout_s: float | None = None) -> bool:
        """Like `wait`, for work that has been told to end: a first Ctrl+C takes effect only behind it, a second at
        once. What closes a device or writes a file then comes to its end."""
        try:
            return self._ended.wait(timeout_s)
        except KeyboardInterrupt:
            self._ended.wait(timeout_s)
            raise

    def _run(self, work: Callable[[], object]) -> None:
        try:
            work()
        finally:
            self._ended.set()
