"""Closes devices in threads of their own, so that one that hangs holds up nobody."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from slopegate.app.session.log import sentence_of
from slopegate.drivers.files.workers import Worker

_log = logging.getLogger(__name__)


class LettingGo:
    """Closes each thing in a daemon thread, which ends with the process."""

    def __init__(self) -> None:
        self._workers: list[Worker] = []

    def begin(self, close: Callable[[], object], name: str) -> None:
        """Call `close` in a thread; what goes wrong there is logged, for nobody waits for it. `name` is for the log."""

        def work() -> None:
            try:
                close()
            except Exception as error:
                _log.warning("%s was not closed: %s", name, sentence_of(error, f"Closing {name}"))

        worker = Worker(work, f"closing {name}")
        self._workers = [other for other in self._workers if other.running] + [worker]
        worker.start()

    def wait(self, timeout_s: float) -> bool:
        """Wait until all that was begun has ended; False after the time-out. From any thread."""
        end_s = time.monotonic() + timeout_s
        workers = list(self._workers)
        for worker in workers:
            worker.finish(max(0.0, end_s - time.monotonic()))
        return not any(worker.running for worker in workers)
