"""Acquisitions on the bench: a camera of one's own that renders frames as fast as it can, and its rig's projector."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.light.bake import Bake, bake_until
from slopegate.core.light.baked import for_patterns
from slopegate.core.light.indirect import Indirect
from slopegate.core.light.lens import behind_lens
from slopegate.core.light.lights import holds
from slopegate.core.light.part import PARTS, LightPart, PartName
from slopegate.core.light.prepare import SeenScene, prepare_parts
from slopegate.core.render.render import Progress, Renderer, part_of
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import LIT
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.virtual import FILTERS, VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.captures.capture_run import SceneClock
from slopegate.drivers.contract.frame import PixelFormat
from slopegate.drivers.scenes.bakes import USUAL_ERROR_PERCENT, BakeGoal, bake_to, begin_bake, trace_both
from slopegate.drivers.transports.model import CodeName
from slopegate.drivers.transports.run import AcquireProgress, Attendance, run_acquisition
from slopegate.drivers.transports.shots import CameraShots
from slopegate.drivers.transports.storage import TransportFolder, create_transport, make_transport

_TIMED_FRAMES: Final = 4


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
        *,
        renderer: Renderer | None = None,
        lights: Sequence[LightPart] | None = None,
        skip: bool = True,
    ) -> None:
        """parts: of the light, that its frames show. seed: of its noise, None for none. counts_per_unit: the sensor's
        gain; None for one that suits the scene when all of it is lit. renderer, skip: as of `VirtualCamera`.

        lights: these parts, ready for patterns and this pixel format; None: they are prepared here, with indirect light
        baked to the usual noise. Raises what a bake raises, and Cancelled when progress returns False.
        """
        told = progress
        if lights is None:
            renderer = renderer or Renderer(rig, scene, skip)
            buffers, _ = renderer.at(0.0, part_of(progress, 0.0, 0.3))
            view = SeenScene(rig, scene, buffers, FILTERS[pixel_format])
            lights = prepared_lights(view, parts, progress)
            told = part_of(progress, 0.9, 0.1)
        self._rig, self._scene, self._parts, self._seed = rig, scene, parts, seed
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
            skip=skip,
            renderer=renderer,
            parts=lights,
            shown=parts,
        )
        self.camera.prepare(lambda share: told is None or told(share))
        assert self.camera.sensor is not None
        self.sensor = self.camera.sensor
        """The camera's."""

    def begin(
        self, path: Path, grid: BlockGrid, codes: CodeName, gates: Sequence[GateSettings | None], frames: int = 1
    ) -> TransportFolder:
        """A new folder for what is acquired here through these gates. Raises StorageError."""
        manifest = make_transport(
            self._scene.name,
            self._rig,
            self.camera.info,
            grid,
            codes,
            gates,
            frames=frames,
            counts_per_unit=self.sensor.counts_per_unit,
            seed=self._seed,
            parts=[name for name in PARTS if name in self._parts],
        )
        return create_transport(path, manifest)

    def acquire(
        self,
        folder: TransportFolder,
        attendance: Attendance | None = None,
        keep_raw: bool = False,
    ) -> AcquireProgress:
        """Take what is missing from the folder, as `run_acquisition`; then close the camera.

        Noise follows the frames' numbers, so that a resumed acquisition equals an uninterrupted one to the byte.
        """
        self.camera.start()
        try:
            shots = CameraShots(self.camera, 0.0, self.camera.number_frames_from)
            return run_acquisition(self._projector(), shots, folder, attendance, keep_raw)
        finally:
            self.camera.close()

    def seconds_a_frame(self) -> float:
        """How long one frame takes on this computer, under a pattern that is new to the camera; then close it."""
        projector = self._projector()
        raster = projector.info.raster
        draw = np.random.default_rng(0)
        size = (_TIMED_FRAMES + 1, raster.height, raster.width)
        projector.load(list(draw.integers(0, 2, size, np.uint8) * np.uint8(LIT)))
        buffer = np.zeros((self.camera.info.height, self.camera.info.width), np.uint16)
        self.camera.start()
        times = []
        for number in range(_TIMED_FRAMES + 1):  # the first one makes what the others need
            begun_s = time.perf_counter()
            projector.show(number)
            self.camera.read(buffer, math.inf)
            times.append(time.perf_counter() - begun_s)
        self.camera.close()
        return float(np.median(times[1:]))

    def _projector(self) -> VirtualProjector:
        return VirtualProjector(self.camera, self._clock.now)


def prepared_lights(
    view: SeenScene, parts: Collection[PartName], progress: Progress | None, keep: bool = True
) -> list[LightPart]:
    """These parts of the light that the gate itself does not have, ready for patterns.

    keep: a bake on the disk, for the next time. Raises what a bake raises.
    """
    # direct light is one of them where a lens is blurred
    lights = prepare_parts(view, parts, part_of(progress, 0.3, 0.3))
    if "indirect" in parts and holds(view.scene, "indirect"):
        lights.append(_baked(view, part_of(progress, 0.6, 0.3), keep))
    return lights


def _baked(view: SeenScene, progress: Progress | None, keep: bool) -> LightPart:
    if keep:
        bake = begin_bake(view.rig, view.scene, for_patterns(), progress)
        bake_to(bake, BakeGoal(), progress)
    else:
        bake = Bake(view.rig, view.scene, for_patterns(), progress=progress)
        bake_until(bake, None, USUAL_ERROR_PERCENT, progress, trace_both)
    indirect = Indirect(view.rig, bake.picture, view.light_filter)
    indirect.show(bake.snapshot())
    return behind_lens(view.rig, indirect)
