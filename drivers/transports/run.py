"""Acquires light transport: shows patterns, takes frames through every slice's gate, and decodes slice by slice.

One loop for every projector and camera, virtual or real, in the thread of whoever calls it. A slice that is on the disk
stays there whatever happens; what is missing is taken by calling `run_acquisition` again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

import numpy as np

from slopegate.core.gating.plan import whole_period
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.settings import GateSettings, quantise
from slopegate.core.transport.even import even_light, measured_noise
from slopegate.core.transport.noise import FrameNoise
from slopegate.core.transport.plan import EVEN_REPEATS, even_repeats, slice_frames
from slopegate.drivers.captures.model import Gate
from slopegate.drivers.captures.storage import claim
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.stream.sieve import Tally
from slopegate.drivers.transports.decoding import SliceView
from slopegate.drivers.transports.model import MOST_SATURATED, TransportRecord
from slopegate.drivers.transports.shots import Shots
from slopegate.drivers.transports.stages import GivenUpError, Heed, Stages
from slopegate.drivers.transports.storage import TransportFolder
from slopegate.drivers.transports.taking import take_slice

AcquireState = Literal["running", "paused", "done", "cancelled"]


class AcquisitionError(UserError):
    """What camera and projector give cannot become a transport; the message is one sentence."""


@dataclass(frozen=True)
class AcquireProgress:
    """How far an acquisition is."""

    state: AcquireState
    doing: str
    slices_done: int
    slices: int
    frames: int
    """Used so far, by this run."""
    frames_left: int
    """At most."""
    seconds_left: float | None
    """From what this run's frames and slices took; None until some have come."""
    tally: Tally
    """Frames that were not used."""
    remarks: tuple[str, ...]
    """What is doubtful about slices taken by this run, a sentence each."""

    @property
    def sentence(self) -> str:
        """What is under way, and how long it will still take."""
        return self.doing if self.seconds_left is None else f"{self.doing}, {self.seconds_left:.0f} s left"


@dataclass(frozen=True)
class Attendance:
    """Whoever attends a run. Its functions are called for every frame, in the run's thread, and must be brief."""

    told: Callable[[AcquireProgress], object] = lambda progress: None
    paused: Callable[[], bool] = lambda: False
    """While this is so, no frame is taken."""
    given_up: Callable[[], bool] = lambda: False
    frame_taken: Callable[[Counts], object] = lambda image: None
    """Sees each frame (H, W), valid during the call only."""


def run_acquisition(
    projector: Projector,
    shots: Shots,
    folder: TransportFolder,
    attendance: Attendance | None = None,
    keep_raw: bool = False,
) -> AcquireProgress:
    """Take what is missing from the folder; how it ended. Neither projector nor camera is stopped.

    Raises StorageError, CameraError, ProjectorError or AcquisitionError, each with one
    sentence; the slices that are on the disk stay, and another run takes the others.
    """
    with claim(folder.path):
        folder.require_begun_with(folder.rig, shots.info, projector.info.raster)
        folder.clean()
        run = _Run(projector, shots, folder, attendance or Attendance(), keep_raw)
        try:
            run.take_all()
        except GivenUpError:
            run.clean()
            return run.progress("cancelled", "Cancelled")
        return run.progress("done", f"All {len(folder.manifest.slices)} slices are in {folder.path}")


class _Run:
    """The state of one run."""

    def __init__(
        self,
        projector: Projector,
        shots: Shots,
        folder: TransportFolder,
        attendance: Attendance,
        keep_raw: bool,
    ) -> None:
        self._folder, self._manifest, self._keep_raw = folder, folder.manifest, keep_raw
        self._attendance = attendance
        heed = Heed(self._hear, self._is_paused, attendance.given_up)
        self._stages = Stages(projector, shots, folder, heed)
        self._todo = folder.missing()
        self._before = 0
        """Frames used when what is under way was begun."""
        self._white_frames = 0
        """That the images of black and all on take, while they are under way."""
        self._decoding_s: list[float] = []
        self._remarks: list[str] = []
        self._repeats = even_repeats(self._manifest.codes, folder.grid)

    def progress(self, state: AcquireState, doing: str) -> AcquireProgress:
        """How far it is."""
        stages, slices = self._stages, len(self._manifest.slices)
        one = slice_frames(self._manifest.codes, self._folder.grid, self._manifest.frames)
        left = max(self._white_frames + len(self._todo) * one - (stages.frames - self._before), 0)
        seconds = None
        if stages.frames and state == "running":
            decoding = float(np.mean(self._decoding_s)) if self._decoding_s else 0.0
            seconds = left * stages.seconds / stages.frames + len(self._todo) * decoding
        done = slices - len(self._todo)
        return AcquireProgress(
            state, doing, done, slices, stages.frames, left, seconds, stages.tally, tuple(self._remarks)
        )

    def take_all(self) -> None:
        """Black and all on, then every slice that is missing."""
        noise = self._folder.noise()
        if self._todo and noise is None:
            self._white_frames = 2 * EVEN_REPEATS * self._manifest.frames
            noise = self._take_white()
            self._white_frames = 0
        while self._todo and noise is not None:
            self._before = self._stages.frames
            self._take_slice(self._todo[0], noise)
            self._before, self._todo = self._stages.frames, self._todo[1:]

    def clean(self) -> None:
        """Remove the frames of the slice under way."""
        self._folder.clean()

    def _take_white(self) -> FrameNoise:
        """The images of black and all on through a whole period, and the noise of a frame."""
        self._stages.begin(-1, self._whole_gate())
        black, white = self._stages.even(EVEN_REPEATS)
        noise = measured_noise(black, white)
        even = even_light(black, white, noise)
        if even.is_dark:
            raise AcquisitionError(
                f"{self._stages.info.name} sees no light of the projector with all of it lit: see that the projector "
                "shows its picture, and that both look at the same scene"
            )
        if white.saturated_share > MOST_SATURATED:
            raise AcquisitionError(
                f"{white.saturated_share:.0%} of the pixels are saturated with the projector all lit, and at most "
                f"{MOST_SATURATED:.0%} may be: lower the camera's gain or close its iris"
            )
        self._folder.write_even(even.light / np.float32(self._unit), even.black, noise)
        return noise

    def _take_slice(self, index: int, noise: FrameNoise) -> None:
        stages, begun, started, tally = self._stages, time.monotonic(), _now(), self._stages.tally
        asked, seconds = self._manifest.slices[index], stages.seconds
        stages.begin(index, None if asked is None else asked.settings())
        black, white = stages.even(self._repeats)
        even, taken = even_light(black, white, noise), None
        if not even.is_dark:
            view = SliceView(even, self._manifest.frames, self._unit)
            taken = take_slice(stages, self._manifest.codes, self._folder.grid, view)
        took_s = time.monotonic() - begun
        self._decoding_s.append(took_s - (stages.seconds - seconds))
        record = TransportRecord(
            index=index,
            asked=asked,
            applied=None if stages.applied is None else Gate.of(stages.applied),
            empty=taken is None,
            stages=list(stages.facts),
            entries=0 if taken is None else sum(len(layer.value) for layer in taken.transport.layers),
            left_out=0.0 if taken is None else taken.left_out,
            unexplained=None if taken is None else taken.unexplained,
            noise_counts=float(np.sqrt(noise.read_variance)),
            saturated_share=white.saturated_share,
            nonlinear_share=0.0 if taken is None else taken.nonlinear,
            started=started,
            ended=_now(),
            seconds=took_s,
            lost=stages.tally.lost - tally.lost,
            duplicated=stages.tally.duplicated - tally.duplicated,
            discarded=stages.tally.discarded - tally.discarded,
        )
        self._remarks += [f"Slice {index + 1}: {doubt}" for doubt in record.doubts]
        if not self._keep_raw:
            # First: killed in between, the slice is taken again, and no frames are left over.
            self._folder.drop_raw(index)
        self._folder.write_slice(record, None if taken is None else taken.transport)

    def _whole_gate(self) -> GateSettings | None:
        """The gate of one period; None for a camera without one."""
        first = self._manifest.slices[0]
        if first is None:
            return None
        rig = self._folder.rig
        return quantise(rig.camera.shutter, whole_period(rig, first.line_time_us), rig.projector.period_us)

    @property
    def _unit(self) -> float:
        """Counts that make one of light."""
        return self._manifest.counts_per_unit or 1.0

    def _hear(self, image: Counts) -> None:
        self._attendance.frame_taken(image)
        self._attendance.told(self.progress("running", self._doing()))

    def _is_paused(self) -> bool:
        paused = self._attendance.paused()
        if paused:
            self._attendance.told(self.progress("paused", "Paused"))
        return paused

    def _doing(self) -> str:
        slices = len(self._manifest.slices)
        return "Black and all on" if self._white_frames else f"Slice {self._todo[0] + 1} of {slices}"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
