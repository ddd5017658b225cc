"""A batch of paths, step by step: where they land, and what the projector sends there."""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.light import kernels_bake as kernels
from slopegate.core.light.kernels_bake import Paths, Vertices
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.render.tracing import ProjectorFrame
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig

BATCH: Final = 1 << 15
"""Paths that take their steps together: what they need fits the processor's cache."""


class Walk:
    """Room for a batch of paths, and the steps that they take. One thread at a time."""

    def __init__(self, rig: Rig, surfaces: Surfaces, channels: int) -> None:
        self._rig, self._surfaces = rig, surfaces
        self._frame = ProjectorFrame(rig.projector)
        self.paths = Paths(
            np.empty((BATCH, 3), np.float32),
            np.empty((BATCH, 3), np.float32),
            np.empty((BATCH, channels), np.float32),
            np.empty(BATCH, np.int32),
            np.empty(BATCH, np.uint8),
            np.empty(BATCH, np.uint32),
        )
        self.at = Vertices(
            np.empty((BATCH, 3), np.float32),
            np.empty((BATCH, 3), np.float32),
            np.empty((BATCH, channels), np.float32),
            np.empty(BATCH, np.int32),
        )
        self._q = np.empty((BATCH, 3))
        self._rays = np.empty((BATCH, 3), np.float32)
        self._value = np.empty((BATCH, channels), np.float32)
        self._asked = np.empty(BATCH, np.int64)
        self._starts, self._ways = np.empty((BATCH, 3), np.float32), np.empty((BATCH, 3), np.float32)

    def go(self, count: int, seed: int, max_order: int, light: Singles) -> None:
        """Take the paths that stand at their first vertices to their ends; add what they bring to light (R, B, C, W).

        Light counts that has changed its direction from 2 to max_order times.
        """
        for order in range(2, max_order + 1):
            count = kernels.turn(count, order - 1, seed, self.paths, self.at)
            if not count:
                return
            met = self._surfaces.meet(self.paths.origin[:count], self.paths.direction[:count])
            kernels.arrive(count, self.paths, met, self.at)
            self._connect(count, light)

    def _connect(self, count: int, light: Singles) -> None:
        """Ask the projector for its light on the surfaces where the paths are."""
        rig = self._rig
        q = self._q[:count]
        kernels.face(count, self.at, rig.projector_centre_m, rig.rotation, q, self._rays, self._value)
        row = self._frame.rows(q)
        self._send(count, row, light)

    def _send(self, count: int, row: Singles, light: Singles) -> None:
        """Add the value of what row (N,) of the projector, below 0 for none, sends unless something is in the way."""
        centre = self._rig.projector_centre_m
        sent = kernels.gather(count, row, self._rays, centre, self._asked, self._starts, self._ways)
        shaded = self._surfaces.blocked(self._starts[:sent], self._ways[:sent])
        band_rows = self._rig.projector.lens.height / light.shape[1]
        kernels.deposit(self._asked[:sent], shaded, row, band_rows, self._value, self.paths, light)
