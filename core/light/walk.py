"""A batch of paths, step by step: where they land, and what the projector sends there."""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.exposure.sensor import REC709
from slopegate.core.light import kernels_bake as kernels
from slopegate.core.light import kernels_foggy as foggy
from slopegate.core.light.baked import BakeSettings
from slopegate.core.light.cells import Picture
from slopegate.core.light.halo import MOST_TURNS
from slopegate.core.light.kernels_bake import Paths, Tables, Vertices
from slopegate.core.light.kernels_surfaces import Met
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.render.fog import medium_of
from slopegate.core.render.tracing import ProjectorFrame, point
from slopegate.core.rig.arrays import Bools, Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene

BATCH: Final = 1 << 15
"""Paths that take their steps together: what they need fits the processor's cache."""


class Walk:
    """Room for a batch of paths, and the steps that they take. One thread at a time."""

    def __init__(self, rig: Rig, scene: Scene, surfaces: Surfaces, channels: int, settings: BakeSettings) -> None:
        self._rig, self._surfaces = rig, surfaces
        self._medium, self._with_halo = medium_of(scene.fog), settings.with_halo
        self.bands = settings.bands
        self._g = self._medium.g if self._medium is not None else 0.0
        self._frame = ProjectorFrame(rig.projector)
        lens = rig.camera.lens
        x, y = lens.normalise([0, lens.width, 0, lens.width], [0, lens.height, lens.height, 0])
        self._field = float(x.min()), float(y.min()), float(x.max()), float(y.max())
        self.paths = Paths(
            np.empty((BATCH, 3), np.float32),
            np.empty((BATCH, 3), np.float32),
            np.empty((BATCH, channels), np.float32),
            np.empty(BATCH, np.int32),
            np.empty(BATCH, np.uint8),
            np.empty(BATCH, np.uint32),
            np.zeros(BATCH, np.uint8),
            np.empty((BATCH, 2), np.float32),
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
        self._share = np.empty(BATCH, np.float32)
        self._asked = np.empty(BATCH, np.int64)
        self._starts, self._ways = np.empty((BATCH, 3), np.float32), np.empty((BATCH, 3), np.float32)

    def go(self, count: int, seed: int, max_order: int, tables: Tables) -> None:
        """Take the paths that stand at their first vertices to their ends; add what they bring to the tables.

        Light counts that has changed its direction from 2 to max_order times.
        """
        if self._medium is not None:
            foggy.fly(count, 1, seed, self._medium, True, self.paths, self.at)
        for order in range(2, max_order + 1):
            count = kernels.turn(count, order - 1, seed, self._g, self._surfaces.materials, self.paths, self.at)
            if not count:
                return
            met = self._surfaces.meet(self.paths.origin[:count], self.paths.direction[:count])
            if order == 2:
                kernels.note_nearness(count, self.paths, met, tables.nearness)
            kernels.arrive(count, self.paths, met, self.at)
            if self._medium is not None:
                if self._medium.scattering > 0:
                    self._send(count, self._lit_leg(count, order, seed, met), tables)
                foggy.fly(count, order, seed, self._medium, False, self.paths, self.at)
            place = self._lit(count)
            if order <= MOST_TURNS + 1 and self._medium is not None and not self._with_halo:
                self._leave_halo(count, place[0])
            self._send(count, place, tables)

    def first_mean(self, picture: Picture) -> float:
        """Mean luminance that the camera sees of light that changed direction once, by one ray a pixel."""
        rig, view, at = self._rig, picture.view, self.at
        albedo = picture.guides.albedo.reshape(-1, 3)
        weights = np.array(REC709, np.float32) if at.albedo.shape[1] == 3 else np.ones(1, np.float32)
        centre, total = rig.camera_centre_m, 0.0
        for first in range(0, len(view.depth), BATCH):
            part = slice(first, min(first + BATCH, len(view.depth)))
            count = part.stop - first
            away = np.column_stack([view.rays[part], np.ones(count, np.float32)])
            length = np.sqrt((away**2).sum(axis=1, keepdims=True))
            depth = np.where(view.kind[part] >= 0, view.depth[part], np.float32(1.0))
            self.paths.origin[:count], self.paths.direction[:count] = centre, away / length
            self.paths.plain[:count], self.paths.number[:count] = kernels.BY_COLOUR, np.arange(first, part.stop)
            if self._medium is not None and self._medium.scattering > 0:
                reach = Met((view.depth[part] * length[:, 0]).astype(np.float32), at.normal, at.normal, at.kind)
                total += self._sum_lit(count, self._lit_leg(count, 1, 0, reach)[0], weights)
            at.point[:count] = centre + depth[:, None] * away
            at.normal[:count], at.kind[:count] = view.normal[part], view.kind[part]
            at.albedo[:count] = albedo[part, : at.albedo.shape[1]]
            row, _ = self._lit(count)
            if self._medium is not None:
                self._rays[:count] = at.point[:count] - centre
                foggy.dim_rays(count, self._medium, point(centre), self._q, self._rays, self._value)
                self._rays[:count] = at.point[:count] - rig.projector_centre_m
            total += self._sum_lit(count, row, weights)
        return total / len(view.depth)

    def _sum_lit(self, count: int, row: Singles, weights: Singles) -> float:
        """Sum of the luminance of what is lit and seen by the projector."""
        shaded = self._gathered(count, row)
        return float((self._value[self._asked[: len(shaded)][~shaded]] @ weights).sum())

    def _lit_leg(self, count: int, order: int, seed: int, met: Met) -> tuple[Singles, Singles]:
        """How the projector lights the fog along the legs: its row and column (N,) at one place of each, and room."""
        medium, rig = self._medium, self._rig
        assert medium is not None
        room = self._q, self._rays, self._value
        light = point(rig.projector_centre_m)
        foggy.light_leg(count, order, seed, medium, light, rig.rotation, self.paths, met, *room)
        return self._frame.places(self._q[:count])

    def _lit(self, count: int) -> tuple[Singles, Singles]:
        """How the projector lights the surfaces where the paths are: its row and column (N,), -1 for none; and room."""
        rig, q = self._rig, self._q[:count]
        materials, room = self._surfaces.materials, (q, self._rays, self._value)
        kernels.face(count, materials, self.paths, self.at, rig.projector_centre_m, rig.rotation, *room)
        if self._medium is not None:
            foggy.dim_rays(count, self._medium, point(rig.projector_centre_m), q, self._rays, self._value)
        return self._frame.places(q)

    def _leave_halo(self, count: int, row: Singles) -> None:
        """Take from the light of surfaces what `scatter` draws: a near halo about what the camera sees."""
        camera = point(self._rig.camera_centre_m)
        room = self._asked, self._share, self._starts, self._ways
        near = foggy.near_halo(count, camera, self._field, row, self.paths, self.at, *room)
        hidden = self._surfaces.blocked(self._starts[:near], self._ways[:near])
        self._value[self._asked[:near][~hidden]] *= (1 - self._share[:near][~hidden])[:, None]

    def _gathered(self, count: int, row: Singles) -> Bools:
        """Whether something stands before the projector, for each of the points that its rows (N,) light."""
        centre = self._rig.projector_centre_m
        sent = kernels.gather(count, row, self._rays, centre, self._asked, self._starts, self._ways)
        return self._surfaces.blocked(self._starts[:sent], self._ways[:sent])

    def _send(self, count: int, place: tuple[Singles, Singles], tables: Tables) -> None:
        """Add the value of what the projector sends from rows and columns (N,), below 0 for none, unless something is
        in the way."""
        shaded = self._gathered(count, place[0])
        lens = self._rig.projector.lens
        made = self._value, self.paths, tables
        kernels.deposit(self._asked[: len(shaded)], shaded, place, (lens.height, lens.width), *made)
