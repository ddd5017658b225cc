"""Acquisitions on the bench: a camera of one's own that renders frames as fast as it can, and its rig's projector."""

from __future__ import annotations

from collections.abc import Collection

from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.light.baked import for_patterns
from slopegate.core.light.indirect import Indirect
from slopegate.core.light.lens import behind_lens
from slopegate.core.light.lights import PLAIN, holds
from slopegate.core.light.part import LightPart, PartName
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.render.render import Progress, Renderer, part_of
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.virtual import FILTERS, VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.captures.capture_run import SceneClock
from slopegate.drivers.contract.frame import PixelFormat
from slopegate.drivers.scenes.bakes import BakeGoal, bake_to, begin_bake
from slopegate.drivers.transports.run import AcquireProgress, Attendance, run_acquisition
from slopegate.drivers.transports.shots import CameraShots
from slopegate.drivers.transports.storage import TransportFolder


class SceneBench:
    """A scene's camera, ready to make frames as fast as it can, with the projector that lights the scene."""

    def __init__(
        self,
        rig: Rig,
        scene: Scene,
        parts: Collection[PartName],
        seed: int | None,
        pixel_format: PixelFormat = "mono12",
        counts_per_unit: float | None = None,
        progress: Progress | None = None,
    ) -> None:
        """parts: of the light, that its frames show. seed: of its noise, None for none. counts_per_unit: the sensor's
        gain; None for one that suits the scene when all of it is lit.

        Indirect light is baked to the usual noise first. Raises what a bake raises, and Cancelled when progress returns
        False.
        """
        renderer = Renderer(rig, scene)
        buffers, _ = renderer.at(0.0, part_of(progress, 0.0, 0.3))
        view = SeenScene(rig, scene, buffers, FILTERS[pixel_format])
        lights = prepare_parts(view, frozenset(parts) - PLAIN, part_of(progress, 0.3, 0.3))
        if "indirect" in parts and holds(scene, "indirect"):
            lights.append(_baked(view, part_of(progress, 0.6, 0.3)))
        # time passes only while the camera waits, so that each frame certainly saw what was shown before it
        self._clock = SceneClock()
        self.camera = VirtualCamera(
            rig,
            scene,
            None if counts_per_unit is None else SensorModel(counts_per_unit=counts_per_unit),
            pixel_format=pixel_format,
            seed=seed or 0,
            clock=self._clock.now,
            sleep=self._clock.sleep,
            noise=seed is not None,
            renderer=renderer,
            parts=lights,
            shown=parts,
        )
        told = part_of(progress, 0.9, 0.1)
        self.camera.prepare(lambda share: told is None or told(share))
        assert self.camera.sensor is not None
        self.counts_per_unit = self.camera.sensor.counts_per_unit
        """The sensor's gain."""

    def acquire(
        self,
        folder: TransportFolder,
        attendance: Attendance | None = None,
        keep_raw: bool = False,
    ) -> AcquireProgress:
        """See `acquire_on_bench`."""
        return acquire_on_bench(self.camera, self._clock, folder, attendance, keep_raw)


def acquire_on_bench(
    camera: VirtualCamera,
    clock: SceneClock,
    folder: TransportFolder,
    attendance: Attendance | None = None,
    keep_raw: bool = False,
) -> AcquireProgress:
    """Take what is missing from the folder with a prepared camera whose clock this is, as `run_acquisition`; then close
    the camera.

    Noise follows the frames' numbers, so that a resumed acquisition equals an uninterrupted one to the byte.
    """
    camera.start()
    try:
        shots = CameraShots(camera, 0.0, camera.number_frames_from)
        return run_acquisition(VirtualProjector(camera, clock.now), shots, folder, attendance, keep_raw)
    finally:
        camera.close()


def _baked(view: SeenScene, progress: Progress | None) -> LightPart:
    bake = begin_bake(view.rig, view.scene, for_patterns(), progress)
    bake_to(bake, BakeGoal(), progress)
    indirect = Indirect(view.rig, bake.picture, view.light_filter)
    indirect.show(bake.snapshot())
    return behind_lens(view.rig, indirect)
