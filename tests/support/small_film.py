"""The process that gets killed while it records at one gate: frames that hold their number, as fast as they come."""

from __future__ import annotations

from pathlib import Path

from kill_server import say, serve
from scripted_camera import USERS, Scripted
from slopegate.drivers.captures.film import create_film, make_film_manifest
from slopegate.drivers.captures.film_recorder import FilmRecorder
from slopegate.drivers.stream.stream import Stream
from small_capture import RIG


def _child(path: Path) -> None:
    source = Scripted()
    stream = Stream(source)
    folder = create_film(path, make_film_manifest("Killed", RIG, source.info, USERS))  # type: ignore[arg-type]
    recorder = FilmRecorder(stream, folder)
    recorder.start()
    stream.start()
    kept = -1
    while not recorder.wait(0.0005):
        if recorder.progress.frames != kept:
            kept = recorder.progress.frames
            say(f"kept {kept}")


if __name__ == "__main__":
    serve(_child)
