"""Indirect light as a part of the picture: a bake's tables, smoothed, looked up for a gate and spread over the pixels.

The tables hold light divided by the colour of the surface that the camera sees, at a few thousand cells; each cell is
averaged with neighbours that show the same surface (their normals agree, each lies in the other's plane), pixels take
what lies between the cells about them by the same measure, and are multiplied by their own colour. So textures and the
edges of things stay sharp, but shadows and caustics in indirect light are as soft as two cells.

What this errs by, with noise averaged away: 0.5 % of the fully lit mean, root mean square over 4 x 4 pixels of a
Cornell box of 400 x 300 pixels, half of it where boxes touch the floor; means of gates to 0.3 %. Indirect light through
glass is seen as coarsely as the cells are, and caustics are not seen through glass again.

Under a pattern each part of the projector's raster that the bake tells apart has the pattern's mean over it; caustics,
which a bake with columns lists, have the pattern's very pixels (`baked.for_patterns` says what that errs by).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from slopegate.core.exposure.sensor import REC709
from slopegate.core.gating.gate import RowWindows
from slopegate.core.light.baked import Baked
from slopegate.core.light.caustic_list import ListedCaustics
from slopegate.core.light.cells import Picture, seen_through
from slopegate.core.light.kernels_indirect import CellPass, CellSums, CellWindows, add_light, cell_pass, sum_columns
from slopegate.core.light.part import Filter, PartName
from slopegate.core.light.smoothing import smooth, smoothing_weights
from slopegate.core.light.spreading import Spread, SubPixels, make_spread
from slopegate.core.light.surfaces import Surfaces
from slopegate.core.render.integrate import pixel_positions
from slopegate.core.render.render import Buffers, Cancelled, Progress, Region
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.blocks import part_means
from slopegate.core.rig.rig import Rig

SMOOTHING_RADIUS: Final = 3


class Finer(NamedTuple):
    """What the pixels see: albedo (H, W, 3) float32, means over places in each pixel, and how pixels take the cells'
    light that is multiplied by it (matt) and that is not (plain)."""

    albedo: Singles
    matt: Spread
    plain: Spread


def one_place(rig: Rig, picture: Picture) -> Finer:
    """Pixels as they are at their centres."""
    lens = rig.camera.lens
    all_of_it = SubPixels(picture.view, np.ones((lens.height, lens.width), np.float32))
    spread = make_spread(picture.grid, picture.cells, rig.camera_centre_m, [all_of_it])
    return Finer(picture.guides.albedo, spread, spread)


def more_places(
    rig: Rig, surfaces: Surfaces, picture: Picture, samples: int, progress: Progress | None = None
) -> Finer:
    """Pixels as means over samples x samples places, those of `integrate`. Cancelled when progress returns False."""
    if samples == 1:
        return one_place(rig, picture)
    lens = rig.camera.lens
    albedo = np.zeros((lens.height, lens.width, 3), np.float32)
    matt, plain = [], []
    positions = pixel_positions(samples)
    for number, (column, row) in enumerate(positions):
        if progress is not None and not progress(number / len(positions)):
            raise Cancelled("The preparation of indirect light was stopped")
        guides = surfaces.guides(rig, None, (column, row))
        view = seen_through(rig, guides, (column, row), picture)
        albedo += guides.albedo / np.float32(len(positions))
        matt.append(SubPixels(view, guides.albedo @ np.array(REC709, np.float32)))
        plain.append(SubPixels(view, np.ones((lens.height, lens.width), np.float32)))
    centre = rig.camera_centre_m
    spreads = [make_spread(picture.grid, picture.cells, centre, places) for places in (matt, plain)]
    return Finer(albedo, spreads[0], spreads[1])


class Indirect:
    """The indirect light of a rig and scene, for one filter. It shows nothing until it is given what was baked."""

    def __init__(
        self,
        rig: Rig,
        picture: Picture,
        light_filter: Filter,
        smoothing_radius: int = SMOOTHING_RADIUS,
        finer: Finer | None = None,
    ) -> None:
        """smoothing_radius: how many cells away a cell's neighbours may be that it is averaged with; 0 for none.

        finer: what pixels see at more places than their centres; None for their centres alone.
        """
        self._rig, self._picture, self._filter, self._radius = rig, picture, light_filter, smoothing_radius
        self._finer = finer or one_place(rig, picture)
        grid = picture.grid
        self._weights = np.empty((grid.rows, grid.columns, (2 * smoothing_radius + 1) ** 2), np.float32)
        self._passes: list[CellPass] = []
        self._pattern: Singles | None = None
        self._baked: Baked | None = None
        self._caustics: ListedCaustics | None = None

    @property
    def name(self) -> PartName:
        """Which part it is."""
        return "indirect"

    def show(self, baked: Baked) -> None:
        """Take over what was baked, of both halves together; an `add` of another thread shows the former or this."""
        nearness = baked.nearness.sum(axis=0) / np.maximum(baked.matt_paths.sum(axis=0), 1)
        smoothing_weights(self._picture.grid, self._picture.cells, nearness, self._radius, self._weights)
        listed = bool(len(baked.caustic_light))
        self._caustics = ListedCaustics(self._rig, self._picture.guides, baked) if listed else None
        self._baked = baked
        channels, finer = baked.matt.shape[4], self._finer
        self._tint = tint_of(finer.albedo, channels, self._filter)
        self._white: Singles | None = None
        one_colour = channels > 1 and self._filter == "bayer_rg"
        if baked.plain.size and (one_colour or finer.plain is not finer.matt):
            # What a pixel sees of light that is not multiplied by its colour has weights or a channel of its own.
            self._white = tint_of(np.ones_like(finer.albedo), channels, self._filter)
        self._shine(baked)

    def _shine(self, baked: Baked) -> None:
        """Sum over the projector's columns and rows what the pattern leaves of the tables."""
        channels, finer, grid = baked.matt.shape[4], self._finer, self._picture.grid
        matt, plain = self._summed(baked.matt, baked.matt_paths), self._summed(baked.plain, baked.paths)
        if self._white is not None:
            none = plain[:, :0]
            passes = [
                cell_pass(CellSums(matt, none), self._tint, finer.matt, grid),
                cell_pass(CellSums(plain, none), self._white, finer.plain, grid),
            ]
        else:
            if channels > 1 and self._filter == "mono":
                # Luminance of light that no pixel colours is one channel: a third of the work.
                plain = np.einsum("rbkc,k->rbc", plain, np.array(REC709, np.float32))[:, :, None]
            passes = [cell_pass(CellSums(matt, plain), self._tint, finer.matt, grid)]
        if self._caustics is not None:
            passes.append(self._caustics.lit_with(self._pattern, self._tint))
        self._passes = passes

    def _summed(self, table: Singles, paths: Singles) -> Singles:
        """A table (2, R, B, K, C, W) as a mean over paths under the pattern, smoothed, and summed over bands and
        columns: (R, B + 1, C, W).

        (R, 0, C, W) where it has no bands.
        """
        _, rows, bands, parts, channels, columns = table.shape
        if not table.size:
            return np.zeros((rows, 0, channels, columns), np.float32)
        shares = (
            np.ones((bands, parts), np.float32) if self._pattern is None else part_means(self._pattern, bands, parts)
        )
        light = np.empty((rows, bands, channels, columns), np.float32)
        sum_columns(table, shares, 1 / np.maximum(paths.sum(axis=0), 1), light)
        sums = np.zeros((rows, bands + 1, channels, columns), np.float32)
        smooth(light, self._weights, self._radius, sums[:, 1:])
        np.cumsum(sums, axis=1, out=sums)
        return sums

    def add(self, windows: RowWindows, out: Singles) -> None:
        """Add what these windows record to out, (H, W) or (H, W, 3): see `LightPart`."""
        rows = self._rig.projector.lens.height
        shares = CellWindows(windows.low / rows, windows.high / rows, windows.inside, windows.outside)
        image = out if out.ndim == 3 else out[:, :, None]
        for each in self._passes:
            add_light(each.sums, shares, each.grid, each.spread, each.tint, each.room, image)

    def light_with(self, pattern: Singles | None) -> None:
        """As `LightPart.light_with` says, of the pattern's means over the bands and columns that the bake knows."""
        unchanged = pattern is None and self._pattern is None
        self._pattern = pattern
        if self._baked is not None and not unchanged:
            self._shine(self._baked)

    def follow(self, buffers: Buffers, region: Region, time_s: float) -> None:
        """Nothing: what has moved is lit, and lights others, as it was at time 0, until the scene is baked anew."""


def everything_once(rig: Rig) -> RowWindows:
    """Windows that record every row of the projector once."""
    height = rig.camera.lens.height
    once = np.ones(height, np.int32)
    return RowWindows(np.zeros(height), np.zeros(height), once, once)


def tint_of(albedo: Singles, channels: int, light_filter: Filter) -> Singles:
    """What pixels multiply the cells' light by, (T, H, W) float32, from their albedo (H, W, 3).

    T is the greater of the light's channels and the image's; for `mono` the weights of luminance are in it, for
    `bayer_rg` zeros where a pixel does not see a colour. Grey light has one plane for all filters.
    """
    planes = np.ascontiguousarray(albedo.transpose(2, 0, 1))
    if channels == 1:
        return planes[:1] if light_filter != "rgb" else planes
    if light_filter == "mono":
        planes *= np.array(REC709, np.float32)[:, None, None]
    elif light_filter == "bayer_rg":
        rows, columns = np.indices(planes.shape[1:])
        for k in range(3):
            planes[k] *= (rows & 1) + (columns & 1) == k
    return planes
