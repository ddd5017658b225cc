"""What a stream has counted."""

from __future__ import annotations

from dataclasses import dataclass


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
