"""Records frames at one gate from a running stream, as they come or one every so many seconds.

The recorder is a tap: in the stream's thread it copies each frame that counts (`stream.sieve`) into one of a fixed
number of buffers; another thread writes them. So memory does not grow with the recording, and a slow disk does not hold
up the camera: where no buffer is free the frame is left out, counted, and noted with the next one.
"""

from __future__ import annotations

import logging
import math
import shutil
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from queue import SimpleQueue
from typing import Final, Literal

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import require
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.film import END, FilmFolder, FilmWriter
from slopegate.drivers.captures.film_preview import write_preview
from slopegate.drivers.captures.model import FilmEnd, FilmFrame, Gate
from slopegate.drivers.captures.recorder import MAX_WASTED
from slopegate.drivers.captures.storage import claim
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.files.durable import StorageError, write_durably
from slopegate.drivers.files.library_words import fault_inside
from slopegate.drivers.files.workers import Worker
from slopegate.drivers.stream.sieve import Sieve, Tally
from slopegate.drivers.stream.stream import Stream

FilmState = Literal["waiting", "recording", "finishing", "done", "stopped", "failed"]
FILM_FINAL: Final = ("done", "stopped", "failed")
BUFFER_BYTES: Final = 1 << 26
"""Of all frames that wait for the disk."""
_FEWEST, _MOST = 4, 256
RESERVE: Final = (1_000_000_000, 0.05)
"""Bytes and share of the disk, whichever is less, that a recording leaves free for other programs."""
SYNC_S: Final = 2.0
"""How often what is written is forced to the disk: a power failure costs no more than this."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FilmLimits:
    """When a recording ends by itself, and its pace. None: it goes on, and keeps every frame."""

    frames: int | None = None
    seconds: float | None = None
    every_s: float | None = None

    def __post_init__(self) -> None:
        require(self.frames is None or self.frames >= 1, "frames", self.frames, "a whole number of at least 1")
        require(self.seconds is None or self.seconds > 0, "seconds", self.seconds, "above 0")
        require(self.every_s is None or self.every_s > 0, "every_s", self.every_s, "above 0")


@dataclass(frozen=True)
class FilmProgress:
    """How far a recording is."""

    state: FilmState
    doing: str
    """What is under way, or why it ended."""
    frames: int
    """On the disk: they are kept, whatever happens."""
    lost_by_camera: int
    lost_by_disk: int
    seconds: float
    """From the first frame to the newest, by the frames' own times."""
    bytes: int
    share: float | None
    """Of what was asked for; None where it goes on until it is stopped."""
    remark: str = ""
    """Of the preview, if it was not made."""

    @property
    def lost(self) -> int:
        """Frames that should be there and are not."""
        return self.lost_by_camera + self.lost_by_disk


class FilmRecorder:
    """Records into a folder. Methods may be called from any thread."""

    def __init__(
        self,
        stream: Stream,
        folder: FilmFolder,
        limits: FilmLimits = FilmLimits(),
    ) -> None:
        """The gate of the folder's manifest is held while it records."""
        gate = folder.manifest.gate
        self._gate = None if gate is None else gate.settings()
        self._stream, self._folder, self._limits = stream, folder, limits
        self._lock = threading.RLock()
        self._state: FilmState = "waiting"
        self._final: FilmState = "done"
        self._sentence = ""
        self._sieve = Sieve()
        self._before: Tally | None = None
        self._wasted = 0
        self._pace = Pace(limits)
        self._taken = self._kept = self._bytes = 0
        self._lost_by_disk = self._unwritten = 0
        self._noted = (0, 0)
        self._remark = ""
        size = max(folder.shape[0] * folder.shape[1] * 2, 1)
        count = min(max(BUFFER_BYTES // size, _FEWEST), _MOST)
        self._free: list[Counts] = [np.empty(folder.shape, np.uint16) for _ in range(count)]
        self._outbox: SimpleQueue[tuple[Counts, FilmFrame] | None] = SimpleQueue()
        self._hurry = threading.Event()
        self._held = ExitStack()
        self._writer = Worker(self._write_all, "slopegate-film")

    def start(self) -> None:
        """Claim the folder and the gate, and begin.

        Raises StorageError while another process records there, InputError while something else holds the gate.
        """
        with ExitStack() as held:
            held.enter_context(claim(self._folder.path))
            self._stream.attach(self)
            self._held = held.pop_all()
        self._writer.start()

    def stop(self) -> None:
        """End it; what has been recorded is kept. Harmless when it has ended."""
        self._end("stopped", "It was stopped")

    def hurry(self) -> None:
        """Stop, and make no preview."""
        self._hurry.set()
        self.stop()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until all is written; False after the time-out."""
        return self._writer.wait(timeout_s)

    @property
    def writing(self) -> bool:
        """Whether the next frame would be lost, because the disk is waited for."""
        with self._lock:
            return self._state == "recording" and not self._free

    @property
    def progress(self) -> FilmProgress:
        """A consistent snapshot."""
        with self._lock:
            return FilmProgress(
                state=self._state,
                doing=self._doing(),
                frames=self._kept,
                lost_by_camera=self._lost_by_camera,
                lost_by_disk=self._lost_by_disk,
                seconds=self._pace.seconds,
                bytes=self._bytes,
                share=self._share(),
                remark=self._remark,
            )

    def wants(self) -> GateSettings | None:
        """See `Tap`."""
        return self._gate if self._state in ("waiting", "recording") else None

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """See `Tap`."""
        with self._lock:
            if self._state not in ("waiting", "recording"):
                return
            counts = self._sieve.take(stamp, stamp.asked if self._gate is None else self._gate)
            if (self._state == "waiting" and not self._begins(counts)) or not counts:
                return
            if self._pace.over(stamp):
                self._end("done", "The time that was asked for is recorded")
                return
            if self._pace.due(stamp):
                self._keep(image, stamp)

    def fail(self, sentence: str) -> None:
        """See `Tap`."""
        self._end("failed", sentence.removesuffix("."))

    def _begins(self, counts: bool) -> bool:
        """Whether this is the first frame that counts; those before it are not missed."""
        if counts:
            self._state, self._before = "recording", self._sieve.tally
            return True
        self._wasted += 1
        if self._wasted > MAX_WASTED:
            self.fail(f"The camera made {MAX_WASTED} frames and none of them with the gate asked for")
        return False

    def _keep(self, image: Counts, stamp: FrameStamp) -> None:
        if not self._free:
            self._lost_by_disk += 1
            return
        buffer = self._free.pop()
        np.copyto(buffer, image)
        lost = (self._lost_by_camera, self._lost_by_disk)
        record = FilmFrame(
            number=self._taken,
            sequence=stamp.sequence,
            time_s=stamp.time_s,
            taken=datetime.now(UTC).isoformat(timespec="milliseconds"),
            asked=None if stamp.asked is None else Gate.of(stamp.asked),
            applied=None if stamp.applied is None else Gate.of(stamp.applied),
            lost_by_camera=lost[0] - self._noted[0],
            lost_by_disk=lost[1] - self._noted[1],
        )
        self._noted = lost
        self._taken += 1
        self._unwritten += 1
        self._outbox.put((buffer, record))
        if self._taken == self._limits.frames:
            self._end("done", "All frames that were asked for are recorded")

    @property
    def _lost_by_camera(self) -> int:
        """Missing from the camera's count, or sent with another gate; of a time lapse, moments without a frame."""
        if self._limits.every_s is not None:
            return self._pace.missed
        tally, before = self._sieve.tally, self._before
        if before is None:
            return 0
        return tally.lost + tally.discarded - before.lost - before.discarded

    def _end(self, final: FilmState, sentence: str) -> None:
        with self._lock:
            if self._state not in ("waiting", "recording"):
                return
            self._final, self._sentence = final, sentence
            self._state = "finishing"
            self._stream.detach(self)
            self._outbox.put(None)

    def _write_all(self) -> None:
        with self._held:
            writer = FilmWriter(self._folder)
            try:
                self._write_frames(writer)
            except StorageError as error:
                self._give_up(str(error))
            except Exception as error:
                _log.exception("Recording failed")
                self._give_up(f"Recording {fault_inside(error)}")
            finally:
                writer.let_go()
            remark = self._finish(writer)
        with self._lock:
            self._remark, self._state = remark, self._final

    def _write_frames(self, writer: FilmWriter) -> None:
        synced_s = time.monotonic()
        while (item := self._outbox.get()) is not None:
            buffer, record = item
            self._leave_room()
            writer.add(buffer, record)
            with self._lock:
                self._free.append(buffer)
                self._kept += 1
                self._unwritten -= 1
                self._bytes = writer.bytes
            if time.monotonic() - synced_s > SYNC_S:
                writer.sync()
                synced_s = time.monotonic()
        writer.close()

    def _leave_room(self) -> None:
        """Raise StorageError where the disk is nearly full."""
        disk = shutil.disk_usage(self._folder.path)
        reserve = min(RESERVE[0], RESERVE[1] * disk.total)
        if disk.free < reserve:
            raise StorageError(
                f"{disk.free / 1e9:.1f} GB are left on the disk of {self._folder.path}: a recording leaves "
                f"{reserve / 1e9:.1f} GB free"
            )

    def _give_up(self, sentence: str) -> None:
        """The disk takes no more: what still waits for it is lost."""
        self._end("failed", sentence)
        with self._lock:
            self._final, self._sentence = "failed", sentence.removesuffix(".")
            self._lost_by_disk += self._unwritten
            self._unwritten = 0

    def _finish(self, writer: FilmWriter) -> str:
        """Write how it ended, and the preview; why there is none."""
        try:
            with self._lock:
                end = FilmEnd(
                    frames=self._kept,
                    lost_by_camera=self._lost_by_camera,
                    lost_by_disk=self._lost_by_disk,
                    repeated=0 if self._before is None else self._sieve.tally.duplicated - self._before.duplicated,
                    seconds=self._pace.seconds,
                    bytes=self._bytes,
                    ended=self._sentence,
                )
            write_durably(self._folder.path / END, end.model_dump_json(indent=1).encode())
            self._folder.look_again()
            return write_preview(self._folder, lambda: not self._hurry.is_set())
        except StorageError as error:
            return f"no preview: {error}"
        except Exception as error:
            _log.exception("Ending a recording failed")
            return f"no preview: making it {fault_inside(error)}"

    def _share(self) -> float | None:
        """Of a time lapse it is one of time: its frames come in jumps, and would tell nothing between two of them."""
        frames, seconds, every = self._limits.frames, self._limits.seconds, self._limits.every_s
        if frames is None:
            return None if seconds is None else min(self._pace.elapsed_s / seconds, 1.0)
        if every is None or self._taken >= frames:
            return self._taken / frames
        return min(self._pace.elapsed_s / (every * (frames - 1)), 1.0)

    def _doing(self) -> str:
        if self._state == "waiting":
            return "Waiting for the first frame with this gate"
        if self._state == "recording":
            return "Recording"
        return "Writing what is left, and the preview" if self._state == "finishing" else self._sentence


class Pace:
    """Which of the frames that count are due, and when time is over, by the frames' own times."""

    def __init__(self, limits: FilmLimits) -> None:
        self._limits = limits
        self._first: FrameStamp | None = None
        self._last: FrameStamp | None = None
        self._half_s = 0.0
        self._next = 0
        self.missed = 0
        """Moments of a time lapse that no frame came near to."""
        self.seconds = 0.0
        """From the first frame that was due to the newest that was."""
        self.elapsed_s = 0.0
        """From the first frame that counts to the newest, due or not."""

    def over(self, stamp: FrameStamp) -> bool:
        """Whether this frame comes after the end."""
        self._note(stamp)
        seconds = self._limits.seconds
        return seconds is not None and self._since(stamp) + self._half_s >= seconds

    def due(self, stamp: FrameStamp) -> bool:
        """Whether this frame is to be kept: every one, or that which is nearest to the next moment of a time lapse."""
        every = self._limits.every_s
        if every is not None:
            moment = math.floor((self._since(stamp) + min(self._half_s, every / 2)) / every)
            if moment < self._next:
                return False
            self.missed += moment - self._next
            self._next = moment + 1
        self.seconds = self._since(stamp)
        return True

    def _since(self, stamp: FrameStamp) -> float:
        assert self._first is not None
        return stamp.time_s - self._first.time_s

    def _note(self, stamp: FrameStamp) -> None:
        """Half of the time from frame to frame: how far off a moment the nearest frame may be."""
        if self._first is None:
            self._first = stamp
        last, self._last = self._last, stamp
        self.elapsed_s = self._since(stamp)
        if last is not None and stamp.sequence > last.sequence:
            self._half_s = max(stamp.time_s - last.time_s, 0.0) / (stamp.sequence - last.sequence) / 2
