"""A small scene for captures: 80 x 60 pixels, a card before a wall, no ambient light.

As a script it is the process that gets killed: for every folder named on standard input it forks a child, prints its
number, and the child records into that folder and says how many slices are kept.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kill_server import say, serve
from rigs import FINE_LINES, check_rig
from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.slices import Slices, occupied_times, tile_times
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures.recorder import Recorder
from slopegate.drivers.captures.storage import CaptureFolder, create_capture, is_capture, make_manifest, open_capture
from slopegate.drivers.stream.stream import Stream

COUNT = 9
RIG = check_rig(80, FINE_LINES)
SCENE = Scene(
    "A card before a wall",
    objects=(
        plane("wall", (0.0, 0.0, 2.0), (8.0, 6.0), turn(20.0)),
        plane("card", (0.0, 0.0, 0.7), (0.3, 0.3), turn(-10.0)),
    ),
)
SENSOR = SensorModel(counts_per_unit=900.0)


def camera(noise: bool = False, seed: int = 0, scene: Scene = SCENE, rate_hz: float = math.inf) -> VirtualCamera:
    made = VirtualCamera(RIG, scene, SENSOR, rate_hz=rate_hz, noise=noise, seed=seed)
    made.prepare(lambda _: True)
    return made


def lit_slices(source: VirtualCamera, count: int = COUNT) -> Slices:
    """Slices that tile all that is lit."""
    assert source.buffers is not None
    line = upright_line_time(RIG)
    times = occupied_times(RIG, line, source.buffers.projector_row)
    assert times is not None
    return tile_times(RIG, line, *times, count)


def new_folder(
    path: Path,
    source: VirtualCamera,
    slices: Slices | None = None,
    frames: int = 1,
    dark: bool = False,
    skip_empty: bool = False,
) -> CaptureFolder:
    planned = slices or lit_slices(source)
    return create_capture(path, make_manifest(SCENE.name, RIG, source.info, planned, frames, dark, skip_empty))


def frame_of(source: VirtualCamera, settings: GateSettings) -> NDArray[np.uint16]:
    """One settled frame, by hand."""
    image = np.zeros((60, 80), np.uint16)
    source.start()
    source.configure(settings)
    for _ in range(2):
        assert source.read(image, 1.0) is not None
    source.stop()
    return image


def record(path: Path, noise: bool = False, **options: bool | int) -> tuple[CaptureFolder, Recorder]:
    """A whole capture, or the rest of one."""
    source = camera(noise)
    folder = open_capture(path) if is_capture(path) else new_folder(path, source, **options)  # type: ignore[arg-type]
    with_stream = Stream(source)
    recorder = Recorder(with_stream, folder, source.cover)
    recorder.start()
    with with_stream:
        assert recorder.wait(240)
    return folder, recorder


def _child(path: Path, source: VirtualCamera) -> None:
    folder = open_capture(path) if is_capture(path) else new_folder(path, source, frames=3)
    stream = Stream(source)
    recorder = Recorder(stream, folder, source.cover)
    recorder.start()
    stream.start()
    kept = -1
    while not recorder.wait(0.0005):
        if recorder.progress.kept != kept:
            kept = recorder.progress.kept
            say(f"kept {kept}")
    say(recorder.progress.state)


def _serve() -> None:
    source = camera()
    frame_of(source, lit_slices(source)[0])
    serve(lambda path: _child(path, source))


if __name__ == "__main__":
    _serve()
