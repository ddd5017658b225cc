"""Records the slices of a capture from a running stream.

The recorder is a tap: in the stream's thread it asks for gates and adds up the frames that count (`stream.sieve`). A
finished slice goes to a thread that writes it, so that a slow disk does not hold up the camera. Meanwhile the camera
settles to the next gate, but its frames are used only when the slice is on the disk. So at most one slice is ever lost.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from queue import SimpleQueue
from typing import Final, Literal

import numpy as np

from slopegate.core.gating.gate import slab_if_any
from slopegate.core.gating.slices import Probe
from slopegate.core.measure.stack import DARK_SIGMAS, accumulate, count_above
from slopegate.core.rig.arrays import Counts, Singles, Words
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.model import Gate, SlabFacts, SliceRecord
from slopegate.drivers.captures.storage import CaptureFolder, claim
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.library_words import fault_inside
from slopegate.drivers.files.workers import Worker
from slopegate.drivers.stream.sieve import Sieve, Tally
from slopegate.drivers.stream.stream import Stream

State = Literal["running", "paused", "waiting", "done", "cancelled", "failed"]
FINAL: Final = ("done", "cancelled", "failed")
COVER: Final = "Cover the lens or switch the projector off, then continue"
UNCOVER: Final = "Uncover the lens or switch the projector on again, then continue"
MAX_WASTED: Final = 200
"""Frames in a row that do not count before the capture gives up."""
DOUBTFUL_AFTER_PROMPT: Final = 2
"""Frames left out after the user has uncovered the lens: a hand may still be in the first."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class CaptureProgress:
    """How far a capture is."""

    state: State
    doing: str
    """What is under way, or what went wrong, or what the user has to do."""
    kept: int
    total: int
    """Slices on the disk, and planned."""
    frames: int
    """Frames that were used."""
    tally: Tally
    """Frames that were not."""
    seconds_left: float | None

    @property
    def sentence(self) -> str:
        """What is under way, and how long it will still take."""
        return self.doing if self.seconds_left is None else f"{self.doing}, {self.seconds_left:.0f} s left"


@dataclass(frozen=True)
class CaptureTask:
    """One thing to take: the dark frame, a slice, or a look for light through several slices at once."""

    kind: Literal["dark", "probe", "slice"]
    index: int | None
    gate: GateSettings
    frames: int


class Adder:
    """Adds up the frames that count for one task."""

    def __init__(self, task: CaptureTask, total: Words, max_count: int) -> None:
        """`total` (H, W) is filled anew."""
        self._task, self._max_count = task, max_count
        self.total = total
        self._taken = self._saturated = 0
        self._stamps: tuple[FrameStamp, FrameStamp] | None = None
        self._times: tuple[datetime, datetime] | None = None
        self._first_dark: Counts | None = None
        self.noise_counts: float | None = None
        """Of a complete dark frame: standard deviation of a pixel from frame to frame."""

    def add(self, image: Counts, stamp: FrameStamp, now: datetime) -> bool:
        """Add a frame (H, W); True when it was the last one. A camera that changes its mind starts the sum anew."""
        if self._stamps is None or self._times is None or stamp.applied != self._stamps[0].applied:
            self.total.fill(0)
            self._taken = self._saturated = 0
            self._stamps, self._times = (stamp, stamp), (now, now)
            self._first_dark = image.copy() if self._task.kind == "dark" else None
        self._stamps, self._times = (self._stamps[0], stamp), (self._times[0], now)
        self._saturated += accumulate(image, self.total, self._max_count)
        self._taken += 1
        if self._taken < self._task.frames:
            return False
        if self._first_dark is not None:
            self.noise_counts = float(np.std(image.astype(np.float32) - self._first_dark) / np.sqrt(2))
        return True

    def record(self, rig: Rig, tally: Tally) -> SliceRecord:
        """The record of the complete sum."""
        assert self._stamps is not None
        assert self._times is not None
        first, last = self._stamps
        applied = last.applied or self._task.gate
        return SliceRecord(
            index=self._task.index,
            asked=Gate.of(self._task.gate),
            applied=Gate.of(applied),
            slab=SlabFacts.of(slab_if_any(rig, applied).slab),
            frames=self._taken,
            saturated_share=self._saturated / (self._taken * self.total.size),
            noise_counts=self.noise_counts,
            started=_iso(self._times[0]),
            ended=_iso(self._times[1]),
            first_time_s=first.time_s,
            last_time_s=last.time_s,
            first_sequence=first.sequence,
            last_sequence=last.sequence,
            lost=tally.lost,
            duplicated=tally.duplicated,
            discarded=tally.discarded,
        )


def empty_record(rig: Rig, index: int, asked: GateSettings, now: datetime) -> SliceRecord:
    """The record of a slice in which no light was seen."""
    return SliceRecord(
        index=index,
        asked=Gate.of(asked),
        applied=Gate.of(asked),
        slab=SlabFacts.of(slab_if_any(rig, asked).slab),
        frames=0,
        empty=True,
        saturated_share=0.0,
        started=_iso(now),
        ended=_iso(now),
    )


def _iso(time: datetime) -> str:
    return time.astimezone(UTC).isoformat(timespec="milliseconds")


class LightFinder:
    """Finds the slices without light, by looking through several at once, so that no frames are spent on them.

    Look through the gate `asked`, `tell` it the frame, and repeat until `asked` is None.
    """

    def __init__(self, rig: Rig, gates: Mapping[int, GateSettings], dark: Singles, noise_counts: float) -> None:
        """`dark` (H, W): counts without light; `noise_counts`: standard deviation of a pixel in the dark."""
        self._indices = tuple(gates)
        self._probe = Probe.over(rig, tuple(gates.values()))
        self._floor = dark + np.float32(DARK_SIGMAS * noise_counts + 0.5)

    @property
    def asked(self) -> GateSettings | None:
        """The gate to look through next; None when all is known."""
        return self._probe.asked

    def tell(self, image: Counts) -> None:
        """One frame (H, W) through the gate asked for."""
        self._probe = self._probe.tell(count_above(image, self._floor) > 0)

    @property
    def dark(self) -> tuple[int, ...]:
        """Indices of the gates without light, once all is known."""
        lit = {self._indices[place] for place in self._probe.lit}
        return tuple(index for index in self._indices if index not in lit)


class Recorder:
    """Records the missing slices of a capture folder. Methods may be called from any thread."""

    def __init__(
        self,
        stream: Stream,
        folder: CaptureFolder,
        cap: Callable[[bool], None] | None = None,
        number_from: Callable[[int], None] | None = None,
    ) -> None:
        """`cap` covers the lens for dark frames; None: the capture waits while the user does it.

        `number_from`: of a virtual camera, which it makes the next frame the one of this number. The frames of a slice
        then are the same whenever it is taken.
        """
        self._stream, self._folder, self._cap = stream, folder, cap
        manifest = folder.manifest
        self._number_from = number_from
        self._gates = tuple(item.settings() for item in manifest.slices)
        self._todo = deque(folder.missing())
        self._kept = len(self._gates) - len(self._todo)
        self._wants_dark = (manifest.dark or manifest.skip_empty) and folder.dark_record() is None
        self._wants_search = manifest.skip_empty
        self._finder: LightFinder | None = None
        self._dark: tuple[Singles, float] | None = None
        self._prompted = ""
        self._lock = threading.RLock()
        self._state: State = "running"
        self._all_taken = False
        self._sentence = ""
        self._sieve, self._tally, self._frames = Sieve(), Tally(), 0
        self._task: CaptureTask | None = None
        self._wanted: GateSettings | None = None
        self._free_sum: Words | None = np.zeros(folder.shape, np.uint32)
        self._adder: Adder | None = None
        self._wasted = 0
        self._begun_s = time.monotonic()
        self._slice_s: deque[float] = deque(maxlen=20)
        self._outbox: SimpleQueue[tuple[SliceRecord, Words | None] | None] = SimpleQueue()
        self._held = ExitStack()
        self._writer = Worker(self._write_all, "slopegate-recorder")

    def start(self) -> None:
        """Claim the folder and the gate, and begin.

        Raises StorageError while another process records there, InputError while something else holds the gate.
        """
        with ExitStack() as held:
            held.enter_context(claim(self._folder.path))
            self._folder.clean()
            self._stream.attach(self)
            self._held = held.pop_all()
        self._writer.start()

    def pause(self) -> None:
        """Give the gate back; what is under way is begun anew after `resume`."""
        with self._lock:
            if self._state == "running" and not self._all_taken:
                self._state = "paused"
                self._finish_task()
                self._let_go()

    def resume(self) -> None:
        """Go on after a pause, or after the user has done what was asked for."""
        with self._lock:
            if self._state == "waiting":
                self._sieve.begin(DOUBTFUL_AFTER_PROMPT)
            if self._state in ("paused", "waiting"):
                self._state = "running"
                self._begun_s = time.monotonic()

    def cancel(self) -> None:
        """Stop, and keep what has been taken."""
        with self._lock:
            if not self._all_taken:
                self._end("cancelled", "The capture was cancelled")

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until all is written or the capture has stopped; False after the time-out."""
        return self._writer.wait(timeout_s)

    @property
    def progress(self) -> CaptureProgress:
        """A consistent snapshot."""
        with self._lock:
            tally = self._tally.plus(self._sieve.tally) if self._task is not None else self._tally
            left = None
            if self._state not in FINAL and self._slice_s:
                left = sum(self._slice_s) / len(self._slice_s) * len(self._todo)
            return CaptureProgress(self._state, self._doing(), self._kept, len(self._gates), self._frames, tally, left)

    @property
    def writing(self) -> bool:
        """Whether frames go by unused because the disk is waited for."""
        with self._lock:
            return self._state == "running" and self._free_sum is None and self._adder is None

    def wants(self) -> GateSettings | None:
        """See `Tap`."""
        with self._lock:
            if self._state == "running" and self._task is None and not self._all_taken:
                self._begin()
            return self._wanted if self._state == "running" else None

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """See `Tap`."""
        with self._lock:
            task = self._task
            if self._state != "running" or task is None:
                return
            if self._sieve.take(stamp, task.gate):
                self._wasted = 0
                self._use(task, image, stamp)
            else:
                self._number_frames(task)
                self._wasted += 1
                if self._wasted > MAX_WASTED:
                    self.fail(f"The camera made {MAX_WASTED} frames and none of them with the gate asked for")

    def fail(self, sentence: str) -> None:
        """See `Tap`."""
        self._end("failed", sentence.removesuffix("."))

    def _begin(self) -> None:
        """The next thing to take; after the last one, only the disk is waited for."""
        try:
            task = self._next_task()
        except StorageError as error:  # a dark frame that was damaged after the capture had been begun
            self.fail(str(error))
            return
        if task is None:
            self._all_taken = True
            self._let_go()
            self._stream.detach(self)
            self._outbox.put(None)
            return
        self._task, self._wanted = task, task.gate
        if self._waits_for_user(task):
            return
        if self._cap is not None:
            self._cap(task.kind == "dark")
        self._sieve.begin()
        self._number_frames(task)
        self._begun_s = time.monotonic()

    def _number_frames(self, task: CaptureTask) -> None:
        """Let the first frame that counts have a number of this task's own: dark, slices, then looks for light."""
        if self._number_from is not None:
            place = 0 if task.kind == "dark" else len(self._gates) + 1 if task.index is None else task.index + 1
            self._number_from(place * self._folder.manifest.dark_frames)

    def _waits_for_user(self, task: CaptureTask) -> bool:
        prompt = COVER if task.kind == "dark" else UNCOVER if self._prompted == COVER else ""
        if self._cap is not None or prompt in ("", self._prompted):
            return False
        self._prompted = self._sentence = prompt
        self._state = "waiting"
        return True

    def _next_task(self) -> CaptureTask | None:
        frames = self._folder.manifest.frames
        if self._wants_dark:
            return CaptureTask("dark", None, self._gates[0], self._folder.manifest.dark_frames)
        if self._wants_search and self._todo:
            asked = self._look_for_light()
            if asked is not None:
                return CaptureTask("probe", None, asked, 1)
        if not self._todo:
            return None
        return CaptureTask("slice", self._todo[0], self._gates[self._todo[0]], frames)

    def _look_for_light(self) -> GateSettings | None:
        """The next gate to look through; None when only slices with light are left to do."""
        if self._finder is None:
            record = self._folder.dark_record() if self._dark is None else None
            dark, noise = self._dark or (self._folder.dark_mean(), (record and record.noise_counts) or 0.0)
            self._finder = LightFinder(
                self._folder.rig, {index: self._gates[index] for index in self._todo}, dark, noise
            )
        asked = self._finder.asked
        if asked is None:
            self._wants_search = False
            for index in self._finder.dark:
                self._todo.remove(index)
                record = empty_record(self._folder.rig, index, self._gates[index], datetime.now(UTC))
                self._outbox.put((record, None))
        return asked

    def _use(self, task: CaptureTask, image: Counts, stamp: FrameStamp) -> None:
        if self._adder is None and task.kind != "probe":
            if self._free_sum is None:
                return
            self._adder = Adder(task, self._free_sum, self._folder.manifest.camera.max_count)
            self._free_sum = None
        self._frames += 1
        if task.kind == "probe":
            assert self._finder is not None
            self._finder.tell(image)
            self._finish_task()
            self._begin()
            return
        assert self._adder is not None
        if self._adder.add(image, stamp, datetime.now(UTC)):
            self._hand_over(task, self._adder)

    def _hand_over(self, task: CaptureTask, adder: Adder) -> None:
        """A slice or the dark frame is complete: to the writer with it."""
        if task.kind == "dark":
            self._wants_dark = False
            self._dark = (adder.total / task.frames).astype(np.float32), adder.noise_counts or 0.0
        else:
            self._todo.popleft()
            self._slice_s.append(time.monotonic() - self._begun_s)
        self._outbox.put((adder.record(self._folder.rig, self._sieve.tally), adder.total))
        self._adder = None
        self._finish_task()
        self._begin()

    def _finish_task(self) -> None:
        if self._task is not None:
            self._tally = self._tally.plus(self._sieve.tally)
        self._task = None

    def _write_all(self) -> None:
        with self._held:
            while (item := self._outbox.get()) is not None:
                if not self._write(*item):
                    return
        with self._lock:
            if self._state == "running":
                self._state = "done"
                self._sentence = f"All {len(self._gates)} slices are in {self._folder.path}"

    def _write(self, record: SliceRecord, total: Words | None) -> bool:
        try:
            self._folder.write(record, total)
        except StorageError as error:
            self.fail(str(error))
            return False
        except Exception as error:
            _log.exception("Writing a slice failed")
            self.fail(f"Writing a slice {fault_inside(error)}")
            return False
        with self._lock:
            self._kept += record.index is not None
            if total is not None:
                self._free_sum = total
        return True

    def _end(self, state: State, sentence: str) -> None:
        with self._lock:
            if self._state in FINAL:
                return
            self._state, self._sentence = state, sentence
            self._finish_task()
            self._let_go()
            self._stream.detach(self)
            self._outbox.put(None)

    def _let_go(self) -> None:
        if self._adder is not None:
            self._free_sum = self._adder.total
            self._adder = None
        if self._cap is not None:
            self._cap(False)

    def _doing(self) -> str:
        if self._state in ("cancelled", "failed"):
            return f"{self._sentence}; {self._kept} of {len(self._gates)} slices are kept"
        if self._state in ("waiting", "done"):
            return self._sentence
        if self._state == "paused":
            return "Paused"
        if self._task is None:
            return "Waiting for the disk"
        if self._task.kind == "slice":
            return f"Slice {(self._task.index or 0) + 1} of {len(self._gates)}"
        return "Dark frame" if self._task.kind == "dark" else "Looking for slices with light"
