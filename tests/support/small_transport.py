"""A small bench for light transport: a card before a wall, 80 x 60 pixels, lit by patterns.

As a script it is the process that gets killed (`kill_server`).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np

from kill_server import say, serve
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.slices import Slices, occupied_times, tile_times
from slopegate.core.rig.blocks import BlockGrid, parse_grid
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.cameras.virtual_projector import VirtualProjector
from slopegate.drivers.captures.capture_run import SceneClock
from slopegate.drivers.transports.model import CodeName
from slopegate.drivers.transports.run import Attendance, run_acquisition
from slopegate.drivers.transports.shots import CameraShots
from slopegate.drivers.transports.storage import (
    TransportFolder,
    create_transport,
    is_transport,
    make_transport,
    open_transport,
)
from small_capture import RIG, SCENE

SEED = 3


class Bench:
    """Virtual camera and projector with a clock that passes only while the camera waits."""

    def __init__(self, noise: bool = True, scene: Scene = SCENE) -> None:
        clock = SceneClock()
        self.camera = VirtualCamera(
            RIG, scene, rate_hz=20.0, seed=SEED, noise=noise, clock=clock.now, sleep=clock.sleep
        )
        self.camera.prepare(lambda share: True)
        self.camera.start()
        self.projector = VirtualProjector(self.camera, clock.now)
        self.shots = CameraShots(self.camera, 0.0, self.camera.number_frames_from)

    def slices(self, count: int) -> Slices:
        """Slices that tile all that is lit."""
        assert self.camera.buffers is not None
        times = occupied_times(RIG, upright_line_time(RIG), self.camera.buffers.projector_row)
        assert times is not None
        return tile_times(RIG, upright_line_time(RIG), *times, count)

    def grid(self, text: str) -> BlockGrid:
        return parse_grid(text, self.projector.info.raster)

    def folder(
        self, path: Path, grid: str = "4x4", codes: CodeName = "hadamard", slices: Slices | None = None, frames: int = 1
    ) -> TransportFolder:
        """A new folder for this bench."""
        sensor = self.camera.sensor
        assert sensor is not None
        manifest = make_transport(
            SCENE.name, RIG, self.camera.info, self.grid(grid), codes, slices or self.slices(2),
            frames=frames, counts_per_unit=sensor.counts_per_unit, seed=SEED,
        )  # fmt: skip
        return create_transport(path, manifest)

    def truth(self, gate: GateSettings, picture: np.ndarray | None) -> np.ndarray:
        """Light (H, W) of the projector alone, in the unit of the folder, while it shows a picture; no noise."""
        self.camera.light_with(picture)
        self.camera.configure(gate)
        buffer = np.zeros((self.camera.info.height, self.camera.info.width), np.uint16)
        assert self.camera.read(buffer, 1.0) is not None
        parts = self.camera.light_by_part(gate)
        return np.sum([image for name, image in parts.items() if name != "ambient"], axis=0)


def _child(path: Path, bench: Bench) -> None:
    """Acquire into the folder, or what is missing of it, and say how many slices are on the disk."""
    folder = open_transport(path) if is_transport(path) else bench.folder(path, "8x8", slices=2 * bench.slices(2))
    run = run_acquisition(
        bench.projector, bench.shots, folder, Attendance(lambda told: say(f"kept {told.slices_done}"))
    )
    say(run.state)


def _serve() -> None:
    import_module("zarr")  # so that no child has to
    bench = Bench()
    serve(lambda path: _child(path, bench))


if __name__ == "__main__":
    _serve()
