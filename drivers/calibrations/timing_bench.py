"""A bench to calibrate a timing on: a scene's camera, told gates by a rig that is only believed, and its projector."""

from __future__ import annotations

import math
from dataclasses import replace

from slopegate.core.render.render import Progress
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.believed import PULSE_US, BelievedCamera, any_gate
from slopegate.drivers.cameras.faults import Faults, FaultyCamera
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.transports.shots import CameraShots

TIMEOUT_S = 60.0


def timed_as(rig: Rig, other: Rig) -> Rig:
    """The rig with the shutter and the projector's timing of another."""
    projector = replace(
        rig.projector, period_us=other.projector.period_us, active_fraction=other.projector.active_fraction
    )
    return replace(rig, camera=replace(rig.camera, shutter=other.camera.shutter), projector=projector)


class TimingBench:
    """A scene that is looked at by a true rig; gates are set by another one, which is believed.

    `camera` is started, `shots` are its frames. Close it at the end.
    """

    def __init__(
        self,
        scene: Scene,
        true: Rig,
        believed: Rig,
        *,
        seed: int = 0,
        noise: bool = True,
        faults: Faults | None = None,
        camera_up: bool = False,
        projector_up: bool = False,
        pulse_us: float = PULSE_US,
        progress: Progress = lambda share: True,
    ) -> None:
        """true: in scan order. camera_up, projector_up: pictures come, or are shown, turned by half a turn, so that
        their rows count against the scan. pulse_us: of the trigger. Raises InputError where the rigs' cameras have
        other pixels, and Cancelled when progress returns False.
        """
        inner = VirtualCamera(any_gate(true), scene, rate_hz=math.inf, seed=seed, noise=noise)
        inner.prepare(progress)
        told = BelievedCamera(inner, true.camera.shutter, believed, camera_up, pulse_us)
        self.camera: Camera = told
        number_from = told.number_frames_from
        if faults is None:
            self.shots = CameraShots(told, 0.0, number_from, timeout_s=TIMEOUT_S)
        else:
            self.camera = FaultyCamera(told, faults, seed=seed, trigger_late=told.trigger_late)
            self.shots = CameraShots(self.camera, timeout_s=TIMEOUT_S)
        self.projector: Projector = VirtualProjector(inner, turned=projector_up)
        self.camera.start()

    def close(self) -> None:
        """Let the scene go."""
        self.camera.close()
