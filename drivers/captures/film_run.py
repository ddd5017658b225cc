"""Runs a recording at one gate from its first frame to its last on a camera that nobody else uses."""

from __future__ import annotations

from collections.abc import Callable

from slopegate.drivers.captures.capture_run import run_recorder
from slopegate.drivers.captures.film import FilmFolder
from slopegate.drivers.captures.film_recorder import FilmLimits, FilmProgress, FilmRecorder
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.stream.stream import Stream

AttendFilm = Callable[[Stream, FilmRecorder], Callable[[], object]]
"""Called before the recording begins; what it returns is called a few times a second while it goes on."""


def run_film(
    camera: Camera,
    folder: FilmFolder,
    limits: FilmLimits,
    attend: AttendFilm,
    complain: Callable[[str], object],
) -> FilmProgress:
    """Record into the folder with the gate of its manifest, and close the camera; how it ended.

    Interrupted by an exception, what has been taken is written down first, and it goes on. `complain` is told in a
    sentence when the camera does not close properly.
    """
    stream = Stream(camera)
    recorder = FilmRecorder(stream, folder, limits)

    def end() -> None:
        recorder.stop()
        try:
            recorder.wait()
        except KeyboardInterrupt:  # who is interrupted here, too, does not wait for the preview
            recorder.hurry()
            recorder.wait()

    run_recorder(stream, recorder, attend(stream, recorder), end, complain)
    return recorder.progress
