"""What looks at every frame of a stream, as a recorder and a search do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import FrameStamp


@dataclass(frozen=True)
class Counters:
    """What happened since the stream was made."""

    made: int = 0
    """Frames received from the camera."""
    shown: int = 0
    """Frames handed out by `newest`."""
    dropped: int = 0
    """Frames replaced by a newer one before anybody asked."""
    lost: int = 0
    """Frames missing from the camera's sequence numbers."""
    errors: int = 0
    """Failures of the camera."""
    missed: int = 0
    """Triggers that made no frame, told from the time stamps."""
    late: int = 0
    """Frames that came off the beat."""
    repeated: int = 0
    """Frames that came again, or after a newer one."""


class Tap(Protocol):
    """Somebody who sees every frame, as a recorder does. All of it is called in the stream's thread and must be brief.

    What takes long, writing above all, belongs in a thread of the tap's own: a frame that it cannot take in time is its
    own to let go, never the stream's to wait for.
    """

    def wants(self) -> GateSettings | None:
        """The gate for the next frame, in place of what was submitted; None leaves that to others."""
        ...

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """A frame, before it is shown; its pixels are valid during the call only."""
        ...

    def fail(self, sentence: str) -> None:
        """The gate wanted was refused, or the stream has ended."""
        ...
