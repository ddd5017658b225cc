"""Indirect light, baked once for all gates: how much arrives at each cell of pixels by each row of the projector.

Paths are traced from the camera. At every surface after the first the projector, which is a point, is asked for its
light, and what it sends is added to the table at (camera row, projector row, camera column). What a gate records is a
sum over projector rows of that table. Left out is what changes its direction once: direct light and airlight.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from slopegate.core.light import kernels_bake as kernels
from slopegate.core.light.baked import MOST_CAUSTICS, Baked, BakeSettings
from slopegate.core.light.caustics import Caustics, Splats
from slopegate.core.light.cells import Picture, make_picture
from slopegate.core.light.indirect import Indirect, everything_once
from slopegate.core.light.kernels_bake import Tables
from slopegate.core.light.points import hashed
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.light.walk import BATCH, Walk
from slopegate.core.render.render import Cancelled, Progress, part_of
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Scene

MOST_PATHS: Final = 2048
"""Paths a cell at which a bake ends that is asked for a noise."""

FIRST_PASS: Final = 8
LARGEST_PASS: Final = 256
"""Paths a cell and half of the first pass and of the largest."""

_ENDLESS = 1 << 10


class Bake:
    """Paths traced so far, in two halves that may be worked on in two threads."""

    def __init__(
        self,
        rig: Rig,
        scene: Scene,
        settings: BakeSettings | None = None,
        begun: Baked | None = None,
        progress: Progress | None = None,
        surfaces: Surfaces | None = None,
    ) -> None:
        """begun: what an earlier bake with equal fingerprint had; paths are added to it. surfaces: the scene's, if they
        are known already.

        Raises UserError where a scene has no surfaces, Cancelled when progress returns False.
        """
        self.rig, self.scene, self.settings = rig, scene, settings or BakeSettings()
        self.surfaces = surfaces or Surfaces(scene)
        guides = self.surfaces.guides(rig, progress)
        self.picture: Picture = make_picture(rig, guides, self.settings.pitch_for(rig))
        grid = self.picture.grid
        channels = 1 if self.surfaces.grey else 3
        plain_bands = self.settings.bands if self.surfaces.has_plain else 0
        self._channels = channels
        columns, cells = self.settings.columns, (2, grid.rows, grid.columns)
        self._held = begun or Baked(
            np.zeros((2, grid.rows, self.settings.bands, columns, channels, grid.columns), np.float32),
            np.zeros((2, grid.rows, plain_bands, columns, channels, grid.columns), np.float32),
            np.zeros(cells, np.float32),
            np.zeros(cells, np.float32),
            np.zeros(cells, np.float32),
            np.zeros(2, np.int64),
            np.zeros((0, 3), np.int32),
            np.zeros((0, channels), np.float32),
            np.zeros(2, np.int64),
        )
        self._caustics = Caustics(rig, scene, self.surfaces, self.picture) if self.surfaces.has_glass else None
        # Of a list of caustics what each half has found since.
        self._found: tuple[list[Splats], list[Splats]] = ([], [])
        self._first_mean: float | None = None

    @property
    def paths(self) -> int:
        """Paths a cell that both halves have together."""
        return round(self._held.paths_per_cell)

    @property
    def next_pass(self) -> int:
        """How many paths a cell the next pass of each half should trace: as many as there are, within bounds."""
        had = max(self.paths // 2, FIRST_PASS)
        return min(1 << (had.bit_length() - 1), LARGEST_PASS)

    def trace(self, half: int, each: int, progress: Progress | None = None) -> None:
        """Trace `each` more paths a cell, a power of 2, for one half (0 or 1).

        Cancelled is raised when progress returns False; the half is then as it was before.
        """
        require(1 <= each <= BATCH and each & (each - 1) == 0, "each", each, f"a power of 2 up to {BATCH}")
        held, picture, walk = self._held, self.picture, self._make_walk()
        fresh = Tables(
            np.zeros_like(held.matt[half]),
            np.zeros_like(held.plain[half]),
            np.zeros_like(held.paths[half]),
            np.zeros_like(held.matt_paths[half]),
            np.zeros_like(held.nearness[half]),
        )
        seed = int(hashed(hashed(self.settings.seed, half + 1), int(held.passes[half])))
        cells, at_once = fresh.paths.size, BATCH // each
        order = self.settings.max_order or _ENDLESS
        materials, centre = self.surfaces.materials, self.rig.camera_centre_m
        for first in range(0, cells, at_once):
            if progress is not None and not progress(first / cells):
                raise Cancelled("The bake was stopped")
            count = min(at_once, cells - first)
            some = first, count, each, seed
            kernels.start(some, picture.grid, picture.view, materials, centre, walk.paths, walk.at, fresh)
            walk.go(count * each, seed, order, fresh)
        if self._caustics is not None and self.settings.columns == 1:
            light = self._caustics.light(walk, cells * each, seed, order, progress)
            fresh.matt[:, :, 0] += light * fresh.matt_paths[:, None, None]
        elif self._caustics is not None:
            # As many as for the finer cells that they are shown in.
            finer = cells * (self.picture.grid.pitch / BakeSettings().pitch_for(self.rig)) ** 2
            count = max(round(finer), 1) * each
            self._list_caustics(self._caustics, walk, half, count, seed, order, progress)
        held.matt[half] += fresh.matt
        held.plain[half] += fresh.plain
        held.paths[half] += fresh.paths
        held.matt_paths[half] += fresh.matt_paths
        held.nearness[half] += fresh.nearness
        held.passes[half] += 1

    def _list_caustics(
        self, caustics: Caustics, walk: Walk, half: int, count: int, seed: int, order: int, progress: Progress | None
    ) -> None:
        """Send `count` particles and keep where they arrive, or fewer where the list would get too long."""
        found, sent = self._found[half], int(self._held.caustic_count[half])
        had = sum(len(each.light) for each in found) + len(self._held.caustic_light) // 2
        if had:
            count = min(count, int((MOST_CAUSTICS // 2 - had) * sent / had))
        if count > 0:
            found.append(caustics.splats(walk, count, seed, order, progress))
            self._held.caustic_count[half] += count

    def _make_walk(self) -> Walk:
        return Walk(self.rig, self.scene, self.surfaces, self._channels, self.settings)

    def snapshot(self) -> Baked:
        """What both halves have so far."""
        held = self._held
        found = [*self._found[0], *self._found[1]]
        return Baked(
            held.matt.copy(),
            held.plain.copy(),
            held.paths.copy(),
            held.matt_paths.copy(),
            held.nearness.copy(),
            held.passes.copy(),
            np.concatenate([held.caustic_places, *(each.places for each in found)]),
            np.concatenate([held.caustic_light, *(each.light for each in found)]),
            held.caustic_count.copy(),
        )

    def error_percent(self) -> float:
        """The noise of indirect light in the worst gate, one that records everything twice.

        Root mean square over 4 x 4 pixels, divided by the mean of the image that records everything once: direct and
        indirect light and airlight, without a list of caustics. From the two halves as they are shown: half the
        difference of their images is as noisy as their mean. Infinite before both halves have a pass. The bias of cells
        comes on top (`indirect`).
        """
        held = self._held
        if not held.passes.all():
            return float("inf")
        part = Indirect(self.rig, self.picture, "mono")
        lens = self.rig.camera.lens
        images = [np.zeros((lens.height, lens.width), np.float32) for _ in range(2)]
        ungated = held.in_one_band()
        for half, image in enumerate(images):
            part.show(ungated.half(half))
            part.add(everything_once(self.rig), image)
        if self._first_mean is None:
            self._first_mean = self._make_walk().first_mean(self.picture)
        mean = self._first_mean + (float(images[0].mean()) + float(images[1].mean())) / 2
        noise = _four_by_four(images[0] - images[1]) / 2
        return 200 * float(np.sqrt((noise**2).mean())) / mean if mean > 0 else 0.0


def _four_by_four(image: Singles) -> Singles:
    """Means over 4 x 4 pixels; what is over at the right and the bottom is left out."""
    height, width = image.shape[0] // 4 * 4, image.shape[1] // 4 * 4
    return np.asarray(image[:height, :width].reshape(height // 4, 4, width // 4, 4).mean((1, 3)), np.float32)


def trace_in_turn(bake: Bake, each: int, progress: Progress | None) -> None:
    """One pass of both halves, one after the other."""
    for half in (0, 1):
        bake.trace(half, each, part_of(progress, half / 2, 0.5))


def bake_until(
    bake: Bake,
    paths: int | None,
    error_percent: float,
    progress: Progress | None = None,
    trace: Callable[[Bake, int, Progress | None], None] = trace_in_turn,
) -> float:
    """Add passes until there are `paths` a cell, or for None until the noise is at most error_percent; returns it.

    Where noise hardly falls, as near a projector in fog that throws forward, it ends at MOST_PATHS with what it has.
    `trace` makes a pass of both halves, perhaps at once. `progress` is told the share done, which for a noise is a
    guess. Cancelled is raised when it returns False: what whole passes had brought stays.
    """
    error = bake.error_percent()
    while bake.paths < paths if paths is not None else error > error_percent and bake.paths < MOST_PATHS:
        needed = paths if paths is not None else bake.paths * min((error / error_percent) ** 2, 4.0)
        more = max(1, math.ceil((needed - bake.paths) / 2)) if bake.paths else bake.next_pass
        each = min(bake.next_pass, 1 << (more - 1).bit_length())
        done = bake.paths / paths if paths is not None else min((error_percent / error) ** 2, 1.0)
        wanted = 2 * each / paths if paths is not None else min(max(done, 0.02), 1 - done)
        trace(bake, each, part_of(progress, done, wanted))
        error = bake.error_percent()
    return error
