"""A camera that films the second virtual screen through a known map, so that light transport can be told in advance.

Every pixel of it sees two pixels of the projector, each with a share of its own; some see none. Grey levels are linear.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import numpy as np

from slopegate.core.rig.arrays import Counts, Doubles, Indices
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.drivers.contract.camera import Camera, check_buffer
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo, FrameStamp
from two_screens import PROJECTOR, screen_pixels

BLACK = 64
FULL = 3600
"""Counts above black of a pixel that sees all of one white projector pixel."""
RATE_HZ = 50.0
NO_GATE = Ability("It looks at a screen: there is no gate.")


@dataclass(frozen=True, eq=False)
class ScreenMap:
    """What each camera pixel (H, W) sees: column and row (2, H, W) of two projector pixels, share (2, H, W) of each."""

    column: Indices
    row: Indices
    share: Doubles

    def counts(self, picture: Doubles) -> Doubles:
        """Counts above black (H, W) while the projector shows a picture (height, width), 0..1."""
        return FULL * (self.share * picture[self.row, self.column]).sum(axis=0)

    def transport(self, grid: BlockGrid) -> Doubles:
        """Counts above black (H, W, blocks) of each block of the projector alone."""
        height, width = self.row.shape[1:]
        found = np.zeros((height, width, grid.count))
        blocks = grid.numbers(self.column.astype(np.float32), self.row.astype(np.float32))
        pixel = np.indices((height, width))
        for block, share in zip(blocks, self.share, strict=True):
            np.add.at(found, (pixel[0], pixel[1], block), FULL * share)
        return found


def turned_map(raster: Raster, height: int = 48, width: int = 64, seed: int = 3) -> ScreenMap:
    """A camera that is turned by some degrees, with a mirror image over it; what lies outside of the raster is dark."""
    random = np.random.default_rng(seed)
    y, x = np.indices((height, width)) - np.array([height, width])[:, None, None] / 2 + 0.5
    cosine, sine, size = np.cos(0.3), np.sin(0.3), 1.15 * raster.width / width
    column = raster.width / 2 + size * np.stack([cosine * x - sine * y, sine * y - cosine * x])
    row = raster.height / 2 + size * np.stack([sine * x + cosine * y, sine * x + cosine * y])
    inside = (column >= 0) & (column < raster.width) & (row >= 0) & (row < raster.height)
    share = np.stack([random.uniform(0.2, 0.8, (height, width)), random.uniform(0.0, 0.2, (height, width))])
    return ScreenMap(
        np.where(inside, column, 0).astype(np.int64),
        np.where(inside, row, 0).astype(np.int64),
        np.where(inside, share, 0.0),
    )


class ScreenCamera(Camera):
    """Sees what is on the projector's screen when a frame begins, in 12 bits and without noise. It has no gate."""

    def __init__(self, sees: ScreenMap) -> None:
        height, width = sees.row.shape[1:]
        can = Abilities(NO_GATE, NO_GATE, NO_GATE, NO_GATE)
        self._info = CameraInfo("Screen camera", width, height, "mono12", 4095, BLACK, None, can)
        self._sees, self._sequence, self._due_s, self._stopped = sees, 0, 0.0, threading.Event()
        self.stop()

    @property
    def info(self) -> CameraInfo:
        return self._info

    def start(self) -> None:
        self._stopped.clear()

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        check_buffer(self._info, buffer)
        wait_s = max(self._due_s - time.monotonic(), 0.0)
        if self._stopped.wait(min(timeout_s, wait_s)) or timeout_s < wait_s:
            return None
        began_s = time.monotonic()
        self._due_s = began_s + 1 / RATE_HZ
        seen = self._sees.counts(screen_pixels(PROJECTOR)[..., 1] / 255)
        buffer[:] = np.minimum(np.rint(BLACK + seen), self._info.max_count)
        stamp = FrameStamp(self._sequence, began_s, None, None)
        self._sequence += 1
        return stamp

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self.stop()
