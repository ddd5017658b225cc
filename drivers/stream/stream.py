"""Reads a camera in a thread: the newest frame for whoever asks, every frame for taps and watchers."""

from __future__ import annotations

import logging
import threading
from types import TracebackType
from typing import Final, Self

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.cadence import Cadence
from slopegate.core.rig.checks import InputError, UserError, require
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.camera import Camera, CameraError, CameraGoneError
from slopegate.drivers.contract.frame import Frame, FrameStamp
from slopegate.drivers.contract.tap import Counters, Tap, Watcher
from slopegate.drivers.files.library_words import fault_inside
from slopegate.drivers.files.workers import Worker
from slopegate.drivers.stream.frame_watch import FrameWatch

POLL_S: Final = 0.002
"""Longest that new settings wait while the camera has no frame ready."""

RETRY_S: Final = (0.1, 0.2, 0.5, 1.0, 2.0)
"""Pauses after one, two, ... failures in a row; one failure more ends the stream, unless the device may come back."""

JOIN_S: Final = 30.0
"""A first rendering can keep the thread busy for seconds."""

_log = logging.getLogger(__name__)


class Stream:
    """Reads a camera in a thread of its own. Every method may be called from any thread, `newest` from one.

    Of the three buffers one is being filled, one holds the newest frame, and one is lent to the caller of `newest`;
    its pixels stay as they are until the next frame is handed out.

    A camera that makes frames on demand would keep a processor busy with frames that nobody sees. It rests while the
    newest frame has not been taken, until another gate is asked for; taps and watchers see as many as can be made.
    """

    def __init__(self, camera: Camera) -> None:
        """The stream owns the camera from here on: `close` closes it."""
        self._camera = camera
        shape = (camera.info.height, camera.info.width)
        self._free: list[Counts] = [np.zeros(shape, np.uint16) for _ in range(3)]
        self._slot: tuple[Counts, FrameStamp] | None = None
        self._lent: Counts | None = None
        self._seen: FrameStamp | None = None
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._on_demand = camera.info.modes.on_demand
        self._pending: GateSettings | None = None
        self._submitted: GateSettings | None = None
        self._wanted_rows: tuple[int, int] | None = None
        self._cropped: tuple[int, int] | None = None
        self._tap: Tap | None = None
        self._watchers: tuple[Watcher, ...] = ()
        self._wished: GateSettings | None = None
        self._ending = threading.Event()
        self._worker: Worker | None = None
        self._watch = FrameWatch(self._on_demand, camera.info.modes.replayed)
        self._error: str | None = None
        self._refused: str | None = None

    @property
    def running(self) -> bool:
        """Whether the thread is alive: False before `start`, after `stop`, and when the camera failed for good."""
        return self._worker is not None and self._worker.running

    @property
    def error(self) -> str | None:
        """What is wrong, in one sentence: the camera, or else the settings that it refused. None when all is well."""
        return self._error or self._refused

    @property
    def counters(self) -> Counters:
        """What has come so far; a consistent snapshot."""
        return self._watch.counters

    @property
    def beat(self) -> Cadence | None:
        """How regularly frames have come lately; None while too few of them say anything."""
        return self._watch.beat

    def start(self) -> None:
        """Start the camera and the thread; raises CameraError when the camera will not. Harmless when running."""
        if self.running:
            return
        self._ending.clear()
        self._error = None
        self._camera.start()
        self._worker = Worker(self._run, "slopegate-stream")
        self._worker.start()

    def submit(self, settings: GateSettings, rows: tuple[int, int] | None = None) -> None:
        """Ask for a gate from the next frame on; the latest one asked for wins.

        rows: first and one past the last that need to be read, None for all, for a camera that can (`info.can.rows`).
        """
        with self._lock:
            self._pending = self._submitted = settings
            self._wanted_rows = rows
            if self._slot is not None and self._is_old(self._slot[1]):
                self._free.append(self._slot[0])
                self._slot = None
            self._changed.notify()

    def attach(self, tap: Tap) -> None:
        """Let the tap set the gate and see every frame from the next one on. Raises InputError while another does."""
        with self._lock:
            require(self._tap is None, "tap", "a second one", "the only one: something else sets the gate")
            self._tap = tap
            self._changed.notify()

    def watch(self, watcher: Watcher) -> None:
        """Let the watcher see every frame from the next one on, beside others and beside a tap."""
        with self._lock:
            self._watchers = (*self._watchers, watcher)
            self._changed.notify()

    @property
    def tapped(self) -> Tap | None:
        """The tap that sets the gate; None while there is none."""
        return self._tap

    def detach(self, watcher: Watcher) -> None:
        """Show it no more frames; after a tap the gate submitted last comes back. Harmless where it is not attached."""
        with self._lock:
            if self._tap is watcher:
                self._tap = None
            self._watchers = tuple(other for other in self._watchers if other is not watcher)

    @property
    def _seers(self) -> tuple[Watcher, ...]:
        """Everything that sees every frame: the tap first."""
        return self._watchers if self._tap is None else (self._tap, *self._watchers)

    def newest(self) -> Frame | None:
        """The newest frame not handed out yet, or None. It ends the loan of the frame handed out before it."""
        with self._lock:
            if self._slot is None:
                return None
            image, stamp = self._slot
            self._slot = None
            if self._lent is not None:
                self._free.append(self._lent)
            self._lent, self._seen = image, stamp
            self._changed.notify()
        shown = image.view()
        shown.flags.writeable = False
        return Frame(shown, stamp)

    def stop(self) -> None:
        """Stop the camera and wait for the thread to end. A frame that is lent stays lent."""
        with self._lock:
            self._ending.set()
            self._changed.notify()
        self._camera.stop()
        if self._worker is not None:
            if not self._worker.finish(JOIN_S):
                raise CameraError(f"{self._camera.info.name} did not stop within {JOIN_S:g} seconds.")
            self._worker = None

    def close(self) -> None:
        """Stop, then close the camera."""
        try:
            self.stop()
        finally:
            if not self.running:  # where that was interrupted, too; no camera is closed under a thread that reads it
                self._camera.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _run(self) -> None:
        self._read_on()
        for seer in self._seers:
            self.detach(seer)
            seer.fail(self._error or f"{self._camera.info.name} was stopped")

    def _read_on(self) -> None:
        failures = 0
        while not self._ending.is_set():
            self._rest()
            try:
                self._configure()
                self._crop()
                if self._read():
                    failures, self._error = 0, None
            except Exception as error:
                failures += 1
                self._fail(self._sentence(error))
                if failures > len(RETRY_S) and not isinstance(error, CameraGoneError):
                    return
                self._ending.wait(RETRY_S[min(failures, len(RETRY_S)) - 1])

    def _rest(self) -> None:
        """Wait until another frame of a camera that makes them on demand is of use to anybody."""
        with self._lock:
            while self._on_demand and self._slot is not None and not self._ending.is_set():
                if self._seers or self._wished is not None or self._pending is not None:
                    return
                self._changed.wait()

    def _is_old(self, stamp: FrameStamp) -> bool:
        """Whether a frame made on demand need not be shown: its gate has been seen, and another one is asked for."""
        another = self._pending is not None and self._wished is None
        return self._on_demand and another and self._seen is not None and self._seen.asked == stamp.asked

    def _sentence(self, error: Exception) -> str:
        if isinstance(error, UserError):
            return str(error)
        _log.exception("A frame failed")
        return f"{self._camera.info.name} {fault_inside(error)}"

    def _fail(self, sentence: str) -> None:
        self._error = sentence
        self._watch.count_error()

    def _configure(self) -> None:
        tap = self._tap
        settings = self._next_settings(None if tap is None else tap.wants())
        if settings is None:
            return
        try:
            self._camera.configure(settings)
            self._refused = None
        except InputError as error:
            # The camera keeps the settings it had, so frames go on, with all of their rows.
            with self._lock:
                self._wanted_rows = None
            if tap is not None and self._wished is not None:
                tap.fail(str(error))
            else:
                self._refused = str(error)
        except CameraError:
            with self._lock:
                if self._wished is None:
                    self._pending = self._pending or settings
                self._wished = None
            raise

    def _crop(self) -> None:
        """Read the rows submitted with the gate; all of them while anything looks at every frame."""
        with self._lock:
            rows = None if self._seers else self._wanted_rows
        if rows == self._cropped:
            return
        info = self._camera.info
        if info.can.rows:
            everything = (0, info.height)
            try:
                self._camera.set_rows(*(rows or everything))
            except InputError:  # the trigger delay does not reach that far down
                self._camera.set_rows(*everything)
        self._cropped = rows

    def _next_settings(self, wished: GateSettings | None) -> GateSettings | None:
        """What the camera is to be told now, if anything. A tap's wish holds back what is submitted meanwhile."""
        with self._lock:
            held, self._wished = self._wished, wished
            if wished is not None:
                return None if wished == held else wished
            if held is not None:
                self._pending = self._submitted
            settings, self._pending = self._pending, None
            return settings

    def _read(self) -> bool:
        """Read one frame into the slot; False when none came in time."""
        with self._lock:
            image = self._free.pop()
        stamp = None
        try:
            stamp = self._camera.read(image, POLL_S)
        finally:
            if stamp is None:
                with self._lock:
                    self._free.append(image)
        if stamp is None:
            return False
        stamp = self._watch.judge(stamp)
        self._show_all(image, stamp)
        with self._lock:
            if self._is_old(stamp):
                self._free.append(image)
                return True
            if self._slot is not None:
                self._free.append(self._slot[0])
            self._slot = (image, stamp)
        return True

    def _show_all(self, image: Counts, stamp: FrameStamp) -> None:
        if stamp.rows is not None:
            return
        for seer in self._seers:
            try:
                seer.see(image, stamp)
            except Exception as error:
                _log.exception("What looks at every frame failed")
                self.detach(seer)
                seer.fail(f"Taking the frames {fault_inside(error)}")
