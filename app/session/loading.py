"""Long work in threads of its own, with progress, cancel, and late results thrown away."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from functools import partial
from typing import Generic, TypeVar

from PySide6.QtCore import QObject, QTimer, Signal

from slopegate.app.session.durations import TimeLeft
from slopegate.app.session.holding import Hold
from slopegate.app.session.log import sentence_of
from slopegate.drivers.files.workers import Worker

T = TypeVar("T")
_log = logging.getLogger(__name__)

MOMENT_S = 0.2
"""How long the end of a job is waited for that only computes or reads: its thread ends with the program."""
WRITTEN_S = 20.0
"""The same for a job that writes to the disk."""
_TICK_MS = 1000
"""How often the time left is told anew while a job says nothing."""


class CancelledError(Exception):
    """The user changed their mind."""


class Progress:
    """How a job reports what it is doing, and learns that nobody waits for it any more."""

    def __init__(self, say: Callable[[float, str], None]) -> None:
        self._say = say
        self._cancelled = threading.Event()
        self._lock = threading.RLock()

    def report(self, share: float, text: str) -> bool:
        """Say what is being done and how much of the work is behind (0..1); False when nobody waits for it any more."""
        with self._lock:  # whoever has cancelled hears nothing any more: the widget that listened may be gone
            if self._cancelled.is_set():
                return False
            self._say(share, text)
            return not self._cancelled.is_set()

    def step(self, share: float, text: str) -> None:
        """Like `report`, but raises CancelledError when nobody waits for the job any more."""
        if not self.report(share, text):
            raise CancelledError

    @property
    def cancelled(self) -> bool:
        """Whether nobody waits for the job any more."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """Ask the job to end; from any thread."""
        with self._lock:
            self._cancelled.set()


class Loader(QObject, Generic[T]):
    """Runs one job at a time. Starting another cancels the one before; a job that ends late ends unseen."""

    progressed = Signal(float, str)
    """Share done, 0..1, and what is being done, with the time left as soon as that can be told."""
    finished = Signal(object)
    failed = Signal(str)
    cancelled = Signal()
    _said = Signal(int, float, str)
    _ended = Signal(int, object, str)

    def __init__(self, discard: Callable[[T], None], parent: QObject | None = None, log: bool = True) -> None:
        """`discard` closes a result that came too late; it is called in the worker's thread. `log`: its starts."""
        super().__init__(parent)
        self._discard, self._log = discard, log
        self._generation = 0
        self._left = TimeLeft()
        self._last = 0.0, ""
        self._ticks = QTimer(self)
        self._ticks.timeout.connect(self._on_tick)
        self._progress: Progress | None = None
        self._workers: list[Worker] = []
        self._lock = threading.Lock()
        self._holds: list[Hold] = []
        self._said.connect(self._on_said)
        self._ended.connect(self._on_ended)

    def release(self, hold: Hold) -> None:
        """End this hold, which whoever starts a job has begun, when the job has ended in any way.

        It has ended before `finished`, `failed` or `cancelled` tells, and after `close`.
        """
        self._holds.append(hold)

    @property
    def busy(self) -> bool:
        """Whether a job is under way that somebody waits for."""
        return self._progress is not None

    def start(self, job: Callable[[Progress], T]) -> None:
        """Run the job in a thread of its own; finished, failed or cancelled follows, unless another job is started."""
        self._forget()
        if self._log:
            _log.info("Starting %s", _job_name(job))
        generation, self._left = self._generation, TimeLeft()
        progress = Progress(lambda share, text: self._said.emit(generation, share, text))
        self._progress = progress
        self._workers = [worker for worker in self._workers if worker.running]
        worker = Worker(partial(self._work, generation, progress, job), f"loader-{generation}")
        self._workers.append(worker)
        worker.start()

    def cancel(self) -> None:
        """Stop waiting for the job at once; what it still makes is discarded."""
        if self._progress is not None:
            self._forget()
            self._end_holds()
            self.cancelled.emit()

    def close(self, timeout_s: float = MOMENT_S) -> None:
        """Cancel, and wait so long for every thread: `WRITTEN_S` where the job writes."""
        self._forget()
        for worker in self._workers:
            worker.finish(timeout_s)
        self._end_holds()

    def _end_holds(self) -> None:
        for hold in self._holds:
            hold.end()

    def _forget(self) -> None:
        with self._lock:
            self._generation += 1
            if self._progress is not None:
                self._progress.cancel()
            self._progress = None
        self._ticks.stop()

    def _work(self, generation: int, progress: Progress, job: Callable[[Progress], T]) -> None:
        try:
            result = job(progress)
        except CancelledError:
            return
        except Exception as error:  # a thread ends with its job, the program does not
            self._hand_over(generation, None, sentence_of(error, _job_name(job)))
            return
        if not self._hand_over(generation, result, ""):
            self._discard(result)

    def _hand_over(self, generation: int, result: T | None, error: str) -> bool:
        """Tell how the job ended, unless nobody waits for it: a widget that was closed may be gone when it ends."""
        with self._lock:
            wanted = generation == self._generation
            if wanted:
                self._ended.emit(generation, result, error)
            return wanted

    def _on_said(self, generation: int, share: float, text: str) -> None:
        if generation == self._generation:
            self._last = share, text
            self._tell(self._left.text(share))

    def _on_tick(self) -> None:
        self._tell(self._left.later_text())

    def _tell(self, left: str) -> None:
        if left:
            self._ticks.start(_TICK_MS)
        else:
            self._ticks.stop()
        share, text = self._last
        self.progressed.emit(share, f"{text} ({left})" if left else text)

    def _on_ended(self, generation: int, result: T | None, error: str) -> None:
        if generation != self._generation:
            if result is not None:
                self._discard(result)
            return
        self._progress = None
        self._ticks.stop()
        self._end_holds()
        if result is None:
            self.failed.emit(error)
        else:
            self.finished.emit(result)


class Newest(QObject, Generic[T]):
    """Runs in a thread of its own what was wished for last: a wish that comes meanwhile waits, and replaces another.

    For what follows a slider: every result is shown, and none is begun whose wish is out of date.
    """

    finished = Signal(object)
    failed = Signal(str)
    progressed = Signal(float, str)

    def __init__(self, parent: QObject | None = None, discard: Callable[[T], None] = lambda _: None) -> None:
        """`discard` as for `Loader`."""
        super().__init__(parent)
        self._next: Callable[[Progress], T] | None = None
        self._loader: Loader[T] = Loader(discard, self, log=False)
        self._loader.progressed.connect(self.progressed)
        self._loader.finished.connect(self._on_finished)
        self._loader.failed.connect(self._on_failed)

    @property
    def busy(self) -> bool:
        """Whether anything is under way."""
        return self._loader.busy

    def want(self, job: Callable[[Progress], T]) -> None:
        """Do this next."""
        if self._loader.busy:
            self._next = job
        else:
            self._loader.start(job)

    def cancel(self) -> None:
        """Wish for nothing any more; what still comes is thrown away."""
        self._next = None
        self._loader.cancel()

    def close(self) -> None:
        """Cancel, and wait for the thread."""
        self._next = None
        self._loader.close()

    def _on_finished(self, result: T) -> None:
        self._go_on()
        self.finished.emit(result)

    def _on_failed(self, sentence: str) -> None:
        self._go_on()
        self.failed.emit(sentence)

    def _go_on(self) -> None:
        job, self._next = self._next, None
        if job is not None:
            self._loader.start(job)


def _job_name(job: Callable[[Progress], object]) -> str:
    """Which job it is, for the log."""
    return str(getattr(job, "__qualname__", job))
