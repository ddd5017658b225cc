"""Waiting for what must come: no longer than it takes, and with a limit for what never does."""

from __future__ import annotations

import time
from collections.abc import Callable

from slopegate.drivers.contract.frame import Frame
from slopegate.drivers.stream.stream import Stream


def until(condition: Callable[[], object], seconds: float = 100.0) -> None:
    """Wait for the condition; fails after so many seconds."""
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, "it did not happen in time"
        time.sleep(0.001)


def next_frame(stream: Stream, seconds: float = 100.0) -> Frame:
    """The next frame that the stream has to show."""
    frames: list[Frame] = []

    def arrived() -> bool:
        frame = stream.newest()
        if frame is not None:
            frames.append(frame)
        return bool(frames)

    until(arrived, seconds)
    return frames[0]
