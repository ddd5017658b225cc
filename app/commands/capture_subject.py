"""What `slopegate capture` records: a scene on the virtual bench, rendered first."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass

from slopegate.app.commands.scene import opened
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.captures.recorder import Recorder
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.stream.stream import Stream

RATE_HZ = 20.0


@dataclass(frozen=True, eq=False)
class OpenCamera:
    """An open camera, and what is known of it."""

    name: str
    """Of the scene; of the camera, where the scene is not known."""
    rig: Rig
    camera: Camera
    clock: Callable[[], float]
    attend: Callable[[Stream, Recorder], Callable[[], None]]
    """Called before the recording begins; what it returns is called again and again while it goes on."""
    projector_row: Singles | None = None
    """`Buffers.projector_row` of a scene that is known."""


class _SceneClock:
    """Time that passes only while the camera waits for its next frame: a capture takes no longer than computing it.

    It stands still while a slice is being written, so that no frame goes by and equal seeds make equal captures.
    """

    def __init__(self) -> None:
        self._now_s = 0.0
        self._recorder: Recorder | None = None

    def now(self) -> float:
        return self._now_s

    def sleep(self, seconds: float) -> None:
        while self._recorder is not None and self._recorder.writing:
            time.sleep(0.0005)
        self._now_s += seconds

    def attend(self, stream: Stream, recorder: Recorder) -> Callable[[], None]:
        self._recorder = recorder
        return lambda: None


def scene_subject(options: Namespace) -> OpenCamera:
    """The scene named, seen by the virtual camera. Raises SceneError and RigError."""
    rig, scene = opened(options)
    clock = _SceneClock()
    camera = VirtualCamera(
        rig, scene, rate_hz=RATE_HZ, noise=options.noise, seed=options.seed or 0, clock=clock.now, sleep=clock.sleep
    )
    camera.prepare(lambda _: True)
    assert camera.buffers is not None
    return OpenCamera(scene.name, rig, camera, clock.now, clock.attend, camera.buffers.projector_row)
