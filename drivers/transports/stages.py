"""Shows patterns and takes the frames that surely saw them: one stage of a slice after the other."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Counts, Words
from slopegate.core.rig.patterns import LIT
from slopegate.core.rig.settings import GateSettings
from slopegate.core.transport.codes import BlockPatterns
from slopegate.core.transport.even import RepeatedFrames
from slopegate.drivers.contract.frame import CameraInfo
from slopegate.drivers.contract.projector import Projector, Showing
from slopegate.drivers.stream.sieve import Tally
from slopegate.drivers.transports.model import StageFacts, StageName
from slopegate.drivers.transports.raw_frames import RawFrames
from slopegate.drivers.transports.shots import Order, Shots
from slopegate.drivers.transports.storage import TransportFolder

NUMBERS_PER_SLICE: Final = 10_000_000_000
"""Numbers of frames that a slice has to itself, so that its noise does not depend on the slices before."""
_LOADED: Final = 32
"""Patterns that the projector is given at a time."""
_PAUSE_S: Final = 0.05


class GivenUpError(Exception):
    """Whoever attends wants no more; it never leaves this room."""


@dataclass(frozen=True)
class Heed:
    """What is asked and told between frames."""

    frame_taken: Callable[[Counts], object] = lambda image: None
    """Sees the frame (H, W), valid during the call only."""
    paused: Callable[[], bool] = lambda: False
    """While this is so, no frame is taken."""
    given_up: Callable[[], bool] = lambda: False


class Stages:
    """Takes stages of one slice after the other, and counts what they cost."""

    def __init__(self, projector: Projector, shots: Shots, folder: TransportFolder, heed: Heed) -> None:
        self._projector, self._shots, self._folder, self._heed = projector, shots, folder, heed
        self._buffer = np.empty(folder.shape, np.uint16)
        self._per_pattern = folder.manifest.frames
        self._most = folder.manifest.camera.max_count * self._per_pattern
        self._gate: GateSettings | None = None
        self._index, self._number = -1, 0
        self.applied: GateSettings | None = None
        """Of the last frame."""
        self.frames, self.seconds = 0, 0.0
        """Frames that were used, and the time that they took."""
        self.facts: list[StageFacts] = []
        """What was shown since `begin`."""

    @property
    def info(self) -> CameraInfo:
        """Facts of the camera."""
        return self._shots.info

    @property
    def tally(self) -> Tally:
        """Frames that were not used."""
        return self._shots.tally

    def begin(self, index: int, gate: GateSettings | None) -> None:
        """Another slice, or the images of black and white, whose index is -1."""
        self._index, self._gate, self._number = index, gate, (index + 1) * NUMBERS_PER_SLICE
        self.facts = []

    def even(self, repeats: int) -> tuple[RepeatedFrames, RepeatedFrames]:
        """Frames with the projector black, and with all lit, each `repeats` times as many as a pattern gets."""
        black, white = (
            self._repeated(showing, repeats * self._per_pattern)
            for showing in (self._projector.black, self._projector.white)
        )
        self.facts.append(StageFacts(name="even", patterns=2, frames=black.count + white.count, grid=(1, 1)))
        return black, white

    def stack(self, name: StageName, patterns: BlockPatterns, first: int = 0) -> RawFrames:
        """Sums of the frames of each pattern from number `first` on, on the disk."""
        grid, count = patterns.grid, patterns.count - first
        shape = self._folder.shape
        raw = RawFrames(self._folder.raw_path(self._index), name, count, shape, self._most)
        try:
            for number in range(count):
                if number % _LOADED == 0:
                    some = range(first + number, first + min(number + _LOADED, count))
                    self._projector.load([grid.spread(patterns.values(item)) * np.uint8(LIT) for item in some])
                self._add_up(self._projector.show(number % _LOADED), raw.slot)
                raw.kept()
        finally:
            raw.close()
        frames = count * self._per_pattern
        self.facts.append(StageFacts(name=name, patterns=count, frames=frames, grid=(grid.columns, grid.rows)))
        return raw

    def _repeated(self, show: Callable[[], Showing], count: int) -> RepeatedFrames:
        found, showing = RepeatedFrames(self._folder.shape, self._folder.manifest.camera.max_count), show()
        for _ in range(count):
            self._take(showing, self._buffer)
            found.add(self._buffer)
        return found

    def _add_up(self, showing: Showing, total: Counts | Words) -> None:
        """Set the total (H, W) to the sum of a pattern's frames."""
        if self._per_pattern == 1 and total.dtype == np.uint16:
            self._take(showing, total.view(np.uint16))
            return
        total[:] = 0
        for _ in range(self._per_pattern):
            self._take(showing, self._buffer)
            total += self._buffer

    def _take(self, showing: Showing, buffer: Counts) -> None:
        """One frame that surely saw this."""
        heed = self._heed
        while heed.paused() and not heed.given_up():
            time.sleep(_PAUSE_S)
        begun = time.monotonic()
        stamp = self._shots.take(Order(self._gate, showing, self._number), buffer, heed.given_up)
        if stamp is None:
            raise GivenUpError
        self._number += 1
        self.applied = stamp.applied
        self.frames += 1
        self.seconds += time.monotonic() - begun
        heed.frame_taken(buffer)
