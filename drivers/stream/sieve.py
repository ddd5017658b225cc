"""Which frames count: those of the gate asked for, settled, each once, and none whose change may have been missed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import FrameStamp

RESTART_AFTER: Final = 5
"""So many frames in a row from before the newest one: the camera counts anew (it was plugged in again)."""


@dataclass(frozen=True)
class Tally:
    """Frames that did not count."""

    lost: int = 0
    """Missing from the camera's sequence numbers."""
    duplicated: int = 0
    """Seen before, or older than one seen before."""
    discarded: int = 0
    """Made with another gate, or before the change had settled."""

    def plus(self, other: Tally) -> Tally:
        """Both together."""
        return Tally(self.lost + other.lost, self.duplicated + other.duplicated, self.discarded + other.discarded)


class Sieve:
    """Judges frames by their stamps, in the order in which they come."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._behind = 0
        self._doubtful = 0
        self._fresh = True
        self._lost = self._duplicated = self._discarded = 0

    @property
    def tally(self) -> Tally:
        """What did not count since `begin`."""
        return Tally(self._lost, self._duplicated, self._discarded)

    def begin(self, doubtful: int = 0) -> None:
        """Another gate, or the same one again: count anew, and leave out this many frames whatever they say."""
        self._fresh, self._doubtful = True, doubtful
        self._lost = self._duplicated = self._discarded = 0

    def note(self, stamp: FrameStamp) -> None:
        """A frame that nobody wants; it only keeps the sequence."""
        self._last = stamp.sequence

    def take(self, stamp: FrameStamp, asked: GateSettings) -> bool:
        """Whether this frame counts for the gate asked for."""
        gap = self._gap(stamp.sequence)
        if gap is None:
            self._duplicated += 1
            return False
        self._lost += gap
        if stamp.asked != asked or not stamp.settled:
            self._discarded += 1
            return False
        if self._fresh and gap:
            # the frame flagged as the first after the change may be among the lost ones
            self._doubtful = max(self._doubtful, gap)
        if self._doubtful:
            self._doubtful -= 1
            self._discarded += 1
            self._fresh = False
            return False
        self._fresh = False
        return True

    def _gap(self, sequence: int) -> int | None:
        """How many frames are missing before this one; None for one that is not new."""
        last = self._last
        if last is not None and sequence <= last:
            self._behind += 1
            if sequence == last or self._behind < RESTART_AFTER:
                return None
            last = None
        self._behind = 0
        self._last = sequence
        return 0 if last is None else sequence - last - 1
