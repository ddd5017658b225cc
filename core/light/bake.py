"""Indirect light, baked once for all gates: how much arrives at each cell of pixels by each row of the projector.

Paths are traced from the camera. At every surface after the first the projector, which is a point, is asked for its
light, and what it sends is added to the table at (camera row, projector row, camera column). What a gate records is a
sum over projector rows of that table. Left out is what changes its direction once: direct light and airlight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopegate.core.light import kernels_bake as kernels
from slopegate.core.light.cells import Picture, make_picture
from slopegate.core.light.points import hashed
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.light.walk import BATCH, Walk
from slopegate.core.render.render import Cancelled, Progress
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene

BAKE_VERSION = 1
"""Rises when the same scene would give other tables."""

_COLUMNS_AT_MOST = 200
_ENDLESS = 1 << 10


@dataclass(frozen=True)
class BakeSettings:
    """How indirect light is baked.

    pitch_px: pixels across a cell, None for a quarter of the pixels each way and at most 200 cells across. bands: parts
    that the projector's rows are kept in. max_order: how often light may change its direction (the surface that the
    camera sees counts), None for as often as matters. seed: of the random numbers.
    """

    pitch_px: int | None = None
    bands: int = 90
    max_order: int | None = None
    seed: int = 1

    def __post_init__(self) -> None:
        require(self.pitch_px is None or 1 <= self.pitch_px <= 64, "pitch_px", self.pitch_px, "from 1 to 64")
        require(1 <= self.bands <= 4096, "bands", self.bands, "from 1 to 4096")
        ok = self.max_order is None or 1 <= self.max_order <= 1000
        require(ok, "max_order", self.max_order, "from 1 to 1000")

    def pitch_for(self, rig: Rig) -> int:
        """Pixels across a cell."""
        return self.pitch_px or max(4, -(-rig.camera.lens.width // _COLUMNS_AT_MOST))


@dataclass(frozen=True, eq=False)
class Baked:
    """What the paths of a bake brought, by two halves that know nothing of each other.

    matt (2, R, B, C, W) float32: sums over the paths of each cell (row R, column W), band of projector rows B, channel
    C (1 where nothing has a colour), to be multiplied by a pixel's albedo; paths (2, R, W): how many there were.
    """

    matt: Singles
    paths: Singles

    def mean(self) -> Singles:
        """Light of both halves together, (R, B, C, W) float32; 0 where no path began."""
        each = 1 / np.maximum(self.paths.sum(axis=0), 1)
        return np.asarray((self.matt[0] + self.matt[1]) * each[:, None, None, :], np.float32)

    def half(self, which: int) -> Baked:
        """One half alone, as if it were both."""
        twice = [which, which]
        return Baked(self.matt[twice], self.paths[twice])


class Bake:
    """Paths traced so far, in two halves that may be worked on in two threads."""

    def __init__(
        self, rig: Rig, scene: Scene, settings: BakeSettings | None = None, progress: Progress | None = None
    ) -> None:
        """Raises UserError where a scene has no surfaces, Cancelled when progress returns False."""
        self.rig, self.scene, self.settings = rig, scene, settings or BakeSettings()
        self.surfaces = Surfaces(scene)
        guides = self.surfaces.guides(rig, progress)
        self.picture: Picture = make_picture(rig, guides, self.settings.pitch_for(rig))
        self._channels = 1 if self.surfaces.grey else 3
        grid = self.picture.grid
        shape = 2, grid.rows, self.settings.bands, self._channels, grid.columns
        self._matt = np.zeros(shape, np.float32)
        self._paths = np.zeros((2, grid.rows * grid.columns), np.float32)
        self._walks = [Walk(rig, self.surfaces, self._channels) for _ in range(2)]
        self._passes = [0, 0]

    @property
    def paths(self) -> int:
        """Paths a cell that both halves have together."""
        return round(float(self._paths.sum()) / self._paths.shape[1])

    def trace(self, half: int, each: int, progress: Progress | None = None) -> None:
        """Trace `each` more paths a cell, a power of 2, for one half (0 or 1).

        Cancelled is raised when progress returns False; the half is then as it was before.
        """
        require(each >= 1 and each & (each - 1) == 0, "each", each, "a power of 2")
        light, begun = np.zeros_like(self._matt[half]), np.zeros_like(self._paths[half])
        seed = hash_seed(self.settings.seed, half, self._passes[half])
        picture, cells = self.picture, len(begun)
        at_once = max(1, BATCH // each)
        for first in range(0, cells, at_once):
            if progress is not None and not progress(first / cells):
                raise Cancelled("The bake was stopped")
            count = min(at_once, cells - first)
            walk = self._walks[half]
            some = first, count, each, seed
            kernels.start(some, picture.grid, picture.view, self.rig.camera_centre_m, walk.paths, walk.at, begun)
            walk.go(count * each, seed, self.settings.max_order or _ENDLESS, light)
        self._matt[half] += light
        self._paths[half] += begun
        self._passes[half] += 1

    def snapshot(self) -> Baked:
        """What both halves have so far."""
        return Baked(
            self._matt.copy(), self._paths.reshape(2, self.picture.grid.rows, self.picture.grid.columns).copy()
        )


def hash_seed(seed: int, half: int, number: int) -> int:
    """One seed of 32 bits for a pass of a half."""
    return int(hashed(int(hashed(seed, half + 1)), number))
