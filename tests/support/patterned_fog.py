"""Airlight under a pattern, exactly: short pieces of each ray, each times the pattern where the projector sees it."""

from __future__ import annotations

import numpy as np

from slopegate.core.gating.gate import RowWindows
from slopegate.core.light import airlight_kernels as kernels
from slopegate.core.light.airlight_exact import make_optics
from slopegate.core.render.fog import medium_of
from slopegate.core.rig.arrays import Doubles, Indices, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.rig import Rig, to_pixels
from slopegate.core.rig.triangulate import to_projector_axes
from slopegate.core.scene.media import Fog


def random_blocks(rig: Rig, columns: int, rows: int, seed: int = 0) -> Singles:
    """A pattern of blocks that are lit or dark by chance."""
    values = np.random.default_rng(seed).integers(0, 2, (rows, columns)).astype(np.float32)
    return BlockGrid(rig.projector.raster, columns, rows).spread(values)


def patterned_airlight(
    rig: Rig, fog: Fog, places: tuple[Indices, Indices], depths: Doubles, pattern: Singles, windows: RowWindows
) -> Doubles:
    """What windows record of the light that fog scatters once into the rays of pixels: rows and columns (R,), (R,)
    float64. They end at depths (R,); nothing casts a shadow in the fog."""
    pieces, (rows, columns) = 1500, places
    optics, medium = make_optics(rig), medium_of(fog)
    assert medium is not None
    rays = rig.camera_rays(columns + 0.5, rows + 0.5)
    spans = np.empty((len(rays), 2))
    kernels.lit_spans(optics, medium, rays, spans)
    first = np.maximum(spans[:, 0], 1 / (1 + optics.kappa * depths))
    last = np.maximum(spans[:, 1], first)
    edges = first[:, None] + (last - first)[:, None] * np.linspace(0, 1, pieces + 1)
    starts, ends, along = edges[:, :-1].ravel(), edges[:, 1:].ravel(), np.repeat(rays, pieces, axis=0)
    light = np.zeros(len(along))
    kernels.integrals(optics, medium, along, starts, ends, light)
    middle = 0.5 * (starts + ends)[:, None]
    turned, change = to_projector_axes(rig, along)
    column, row = to_pixels(rig.projector.lens, (1 - middle) * turned - optics.kappa * middle * change)[:2]
    height, width = pattern.shape
    lit = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    share = pattern[np.clip(row.astype(int), 0, height - 1), np.clip(column.astype(int), 0, width - 1)] * lit
    line = np.repeat(rows, pieces)
    held = (row >= windows.low[line]) & (row < windows.high[line])
    counted = light * share * np.where(held, windows.inside[line], windows.outside[line])
    return np.asarray(counted.reshape(len(rays), pieces).sum(axis=1))
