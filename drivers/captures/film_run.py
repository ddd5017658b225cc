"""Runs a recording at one gate from its first frame to its last on a camera that nobody else uses."""

from __future__ import annotations

from collections.abc import Callable

from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.capture_run import POLL_S
from slopegate.drivers.captures.film import FilmFolder
from slopegate.drivers.captures.film_recorder import FilmLimits, FilmProgress, FilmRecorder
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.stream.stream import Stream

AttendFilm = Callable[[Stream, FilmRecorder], Callable[[], object]]
"""Called before the recording begins; what it returns is called a few times a second while it goes on."""


def run_film(
    camera: Camera,
    folder: FilmFolder,
    gate: GateSettings | None,
    limits: FilmLimits,
    attend: AttendFilm,
    complain: Callable[[str], object],
) -> FilmProgress:
    """Record into the folder, and close the camera; how it ended.

    Interrupted by an exception, what has been taken is written down first, and it goes on. `complain` is told in a
    sentence when the camera does not close properly.
    """
    stream = Stream(camera)
    recorder = FilmRecorder(stream, folder, gate, limits)
    look = attend(stream, recorder)
    recorder.start()
    try:
        stream.start()
        while not recorder.wait(POLL_S):
            look()
    finally:
        recorder.stop()
        _finish(recorder)
        try:
            stream.close()
        except CameraError as error:
            complain(str(error))
    return recorder.progress


def _finish(recorder: FilmRecorder) -> None:
    """Wait for the disk; who is interrupted here, too, does not wait for the preview."""
    try:
        recorder.wait()
    except KeyboardInterrupt:
        recorder.hurry()
        recorder.wait()
