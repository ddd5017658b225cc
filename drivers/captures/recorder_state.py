"""What a recorder says of itself and asks of others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, Protocol, runtime_checkable

from slopegate.drivers.stream.sieve import Tally

State = Literal["running", "paused", "waiting", "done", "cancelled", "failed"]
FINAL: Final = ("done", "cancelled", "failed")


COVER: Final = "Cover the lens or switch the projector off, then continue"
UNCOVER: Final = "Uncover the lens or switch the projector on again, then continue"


@runtime_checkable
class Coverable(Protocol):
    """A camera whose lens the program can cover for dark frames."""

    def cover(self, covered: bool) -> None:
        """Cover or uncover the lens, from any thread; the first frame after it is flagged as not settled."""
        ...


@dataclass(frozen=True)
class Progress:
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
