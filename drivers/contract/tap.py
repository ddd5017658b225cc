"""The contract of whatever sees every frame of a stream, and the stream's counters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import FrameStamp


@dataclass(frozen=True)
class Counters:
    """What has come of a stream's frames since it was made; kept by `FrameWatch` and by nobody else."""

    made: int = 0
    """Frames received from the camera."""
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


class Watcher(Protocol):
    """Sees every frame of a stream, whatever its gate. The stream's thread calls it, so every method must be brief.

    What takes long, such as writing to the disk, belongs in a thread of its own. A watcher that cannot keep up leaves
    frames out; the stream never waits for it.
    """

    def see(self, image: Counts, stamp: FrameStamp) -> None:
        """A frame, before it is shown; its pixels are valid during the call only."""
        ...

    def fail(self, sentence: str) -> None:
        """The stream has ended, or `see` failed; a `Tap` is told, too, that the gate it wants was refused."""
        ...


class Tap(Watcher, Protocol):
    """A watcher that sets the gate, as a recorder does: a stream has one at a time."""

    def wants(self) -> GateSettings | None:
        """The gate for the next frame, in place of the one submitted to the stream; None leaves it as submitted."""
        ...
