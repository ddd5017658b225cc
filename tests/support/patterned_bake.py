"""Indirect light under a pattern without a table of columns: every path asks the pattern for its own pixel."""

from __future__ import annotations

import numpy as np

from slopegate.core.light.bake import Bake
from slopegate.core.light.baked import BakeSettings
from slopegate.core.light.kernels_bake import Tables
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.light.walk import Walk
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene


class PatternedWalk(Walk):
    """Paths to which the projector sends a pattern's light."""

    def __init__(
        self, rig: Rig, scene: Scene, surfaces: Surfaces, channels: int, settings: BakeSettings, pattern: Singles
    ) -> None:
        super().__init__(rig, scene, surfaces, channels, settings)
        self._pattern = pattern

    def _send(self, count: int, place: tuple[Singles, Singles], tables: Tables) -> None:
        lit = np.flatnonzero(place[0] >= 0)
        row, column = (each[lit].astype(np.int64) for each in place)
        self._value[lit] *= self._pattern[row, column][:, None]
        super()._send(count, place, tables)


class PatternedBake(Bake):
    """A bake of a pattern's light alone."""

    def __init__(self, rig: Rig, scene: Scene, settings: BakeSettings, pattern: Singles) -> None:
        super().__init__(rig, scene, settings)
        self._pattern = pattern

    def _make_walk(self) -> Walk:
        return PatternedWalk(self.rig, self.scene, self.surfaces, self._channels, self.settings, self._pattern)
