"""Closes devices in threads of their own, so that one that hangs holds up nobody."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from slopegate.app.session.log import sentence_of

_log = logging.getLogger(__name__)


class LettingGo:
    """Closes each thing in a daemon thread, which ends with the process."""

    def __init__(self) -> None:
        self._threads: list[threading.Thread] = []

    def begin(self, close: Callable[[], object], name: str) -> None:
        """Call `close` in a thread; what goes wrong there is logged, for nobody waits for it. `name` is for the log."""

        def work() -> None:
            try:
                close()
            except Exception as error:
                _log.warning("%s was not closed: %s", name, sentence_of(error, f"Closing {name}"))

        thread = threading.Thread(target=work, name=f"closing {name}", daemon=True)
        self._threads = [other for other in self._threads if other.is_alive()] + [thread]
        thread.start()

    def wait(self, timeout_s: float) -> bool:
        """Wait until all that was begun has ended; False after the time-out. From any thread."""
        end_s = time.monotonic() + timeout_s
        threads = list(self._threads)
        for thread in threads:
            thread.join(max(0.0, end_s - time.monotonic()))
        return not any(thread.is_alive() for thread in threads)
