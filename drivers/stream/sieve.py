"""Picks the frames that count: made with the gate asked for, settled, and each only once."""

from __future__ import annotations

from dataclasses import dataclass

from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import FrameStamp


@dataclass(frozen=True)
class Tally:
    """Frames that did not count."""

    lost: int = 0
    """Missing from the camera's sequence numbers (`FrameStamp.lost`)."""
    duplicated: int = 0
    """Seen before, or older than one seen before (`FrameStamp.repeated`)."""
    discarded: int = 0
    """Made with another gate, or before the change had settled."""

    def plus(self, other: Tally) -> Tally:
        """The sum of both."""
        return Tally(self.lost + other.lost, self.duplicated + other.duplicated, self.discarded + other.discarded)


class Sieve:
    """Judges frames by the stamps that the stream gives them, in the order in which they come."""

    def __init__(self) -> None:
        self._doubtful = 0
        self._fresh = True
        self._tally = Tally()

    @property
    def tally(self) -> Tally:
        """What did not count since `begin`."""
        return self._tally

    def begin(self, doubtful: int = 0) -> None:
        """Another gate, or the same one again: count anew, and leave out this many frames whatever they say."""
        self._fresh, self._doubtful, self._tally = True, doubtful, Tally()

    def take(self, stamp: FrameStamp, asked: GateSettings | None) -> bool:
        """Whether this frame counts for the gate asked for; None: the camera has none."""
        counts = self._counts(stamp, asked)
        discarded = not counts and not stamp.repeated
        self._tally = self._tally.plus(Tally(stamp.lost, int(stamp.repeated), int(discarded)))
        return counts

    def _counts(self, stamp: FrameStamp, asked: GateSettings | None) -> bool:
        if stamp.repeated or stamp.asked != asked or not stamp.settled:
            return False
        if self._fresh:
            # the frame flagged as the first after the change may be among the lost ones
            self._fresh, self._doubtful = False, max(self._doubtful, stamp.lost)
        if self._doubtful:
            self._doubtful -= 1
            return False
        return True
