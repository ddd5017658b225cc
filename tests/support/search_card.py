"""A card with many corners before a wall, seen by the check rig with fewer pixels, for tests of the search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rigs import check_rig
from slopegate.core.exposure.edges import kernel_windows
from slopegate.core.exposure.sensor import Plates, SensorModel, auto_gain, expose_fast, mono, noise_pool
from slopegate.core.gating.gate import row_windows, weights
from slopegate.core.render.render import Buffers, render
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, quantise
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import Finish, plane, turn
from slopegate.core.search.keypoints import Rectangle
from slopegate.core.search.search import ask, tell
from slopegate.core.search.state import State


def speckle(seed: int, size: int = 256) -> NDArray[np.float32]:
    """Blobs of many sizes, (size, size, 3), linear."""
    rng = np.random.default_rng(seed)
    grey = np.zeros((size, size))
    for scale in (2, 4, 8, 16):
        noise = rng.normal(size=(size // scale, size // scale)).astype(np.float32)
        grey += cv2.resize(noise, (size, size), interpolation=cv2.INTER_NEAREST)
    return np.repeat((0.1 + 0.8 / (1 + np.exp(-2 * grey)))[:, :, None], 3, axis=2).astype(np.float32)


@dataclass(frozen=True, eq=False)
class SearchCard:
    """What is seen, and where the card is."""

    rig: Rig
    scene: Scene
    buffers: Buffers
    truth: NDArray[np.bool_]
    target: Rectangle

    def camera(self, seed: int = 0, noise: bool = True) -> Callable[[GateSettings, int], NDArray[np.uint16]]:
        """A frame of these settings and number, in counts; black is 40."""
        direct, ambient = mono(self.buffers.direct), mono(self.buffers.ambient)
        plates = Plates(self.buffers.projector_row, direct, ambient, auto_gain(direct + ambient, SensorModel()))
        pool = noise_pool(np.random.default_rng(seed), self.rig.camera.lens.width)

        def frame(settings: GateSettings, number: int) -> NDArray[np.uint16]:
            image = np.empty(direct.shape, np.uint16)
            windows = kernel_windows(row_windows(self.rig, settings))
            periods = settings.exposure_us / self.rig.projector.period_us
            expose_fast(plates, windows, periods, pool.frame(seed, number, noise), image)
            return image

        return frame

    def overlap(self, settings: GateSettings) -> float:
        """Intersection over union of what the gate records with the card's lit pixels."""
        recorded = weights(row_windows(self.rig, settings), self.buffers.projector_row) > 0
        lit = self.truth & (self.buffers.projector_row >= 0)
        return float((recorded & lit).sum() / (recorded | lit).sum())


def search_card(
    tilt_deg: float, distance_m: float, ambient: float = 0.0, rig: Rig | None = None, **more: float
) -> SearchCard:
    """A card that fills a third of the image's width, leaning and turned, with a wall behind it."""
    rig = rig or check_rig(640)
    size = 0.3 * distance_m
    rotation = turn(tilt_deg, more.get("yaw_deg", 8.0), more.get("roll_deg", 3.0))
    y = -0.06 * distance_m
    card = plane("card", (0.02, y, distance_m), (size, size), rotation, Finish(texture=speckle(1)))
    wall_z = distance_m + 0.5 + size
    wall = plane("wall", (0.0, 0.0, wall_z), (3 * wall_z, 2 * wall_z), turn(), Finish(texture=speckle(2)))
    scene = Scene("card", objects=(card, wall), ambient=ambient)
    buffers = render(rig, scene)
    truth = render(rig, Scene("alone", objects=(card,))).inverse_depth == buffers.inverse_depth
    rows, columns = np.nonzero(truth)
    target = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
    return SearchCard(rig, scene, buffers, truth, target)


def finish(state: State, frame: Callable[[GateSettings, int], NDArray[np.uint16]]) -> State:
    """Run to the end, and see on the way that only what the hardware has is asked for."""
    rig = state.task.rig
    while (settings := ask(state)) is not None:
        assert settings == quantise(rig.camera.shutter, settings, rig.projector.period_us)
        before = state.frames
        state = tell(state, frame(settings, before), settings)
        assert state.frames == before + 1 <= state.task.max_frames
    return state
