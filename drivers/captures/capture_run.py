"""Runs a capture from its first slice to its last on a camera that nobody else uses, in the caller's thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from slopegate.drivers.captures.recorder import CaptureProgress, Recorder
from slopegate.drivers.captures.storage import CaptureFolder
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.stream.stream import Stream

POLL_S = 0.2

Attend = Callable[[Stream, Recorder], Callable[[], object]]
"""Called before the recording begins; what it returns is called a few times a second while it goes on."""


def run_capture(
    camera: Camera,
    folder: CaptureFolder,
    attend: Attend,
    complain: Callable[[str], object],
    number_from: Callable[[int], None] | None = None,
) -> CaptureProgress:
    """Take what is missing from the folder, and close the camera; how it ended.

    Interrupted by an exception, what has been taken is written down first. `complain` is told in a sentence when the
    camera does not close properly: what there is to say of the capture matters more. `number_from`: see `Recorder`.
    """
    stream = Stream(camera)
    recorder = Recorder(stream, folder, camera.cover if camera.info.can.cover else None, number_from=number_from)

    def end() -> None:
        recorder.cancel()
        recorder.wait()

    run_recorder(stream, recorder, attend(stream, recorder), end, complain)
    return recorder.progress


def run_recorder(
    stream: Stream,
    recorder: StartedRecorder,
    look: Callable[[], object],
    end: Callable[[], object],
    complain: Callable[[str], object],
) -> None:
    """Let a recorder work on its stream to the end, and close the stream. `end` comes first, however that ends.

    `look` is called a few times a second; `complain`: see `run_capture`.
    """
    recorder.start()
    try:
        stream.start()
        while not recorder.wait(POLL_S):
            look()
    finally:
        try:
            end()
        finally:  # for who is interrupted again there
            try:
                stream.close()
            except CameraError as error:
                complain(str(error))


class StartedRecorder(Protocol):
    """What records from a stream."""

    def start(self) -> None:
        """Begin."""

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until all is written; False after the time-out."""
        ...


class WritingRecorder(Protocol):
    """What may have to wait for the disk."""

    @property
    def writing(self) -> bool:
        """Whether frames go by unused because the disk is waited for."""
        ...


class SceneClock:
    """Time that passes only while the camera waits for its next frame: a capture takes no longer than computing it.

    It stands still while a slice is being written, so that no frame goes by and equal seeds make equal captures.
    """

    def __init__(self) -> None:
        self._now_s = 0.0
        self._recorder: WritingRecorder | None = None

    def now(self) -> float:
        """Seconds since the beginning."""
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        while self._recorder is not None and self._recorder.writing:
            time.sleep(0.0005)
        self._now_s += seconds

    def watch(self, recorder: WritingRecorder) -> None:
        """Stand still while this recorder writes."""
        self._recorder = recorder
