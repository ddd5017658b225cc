"""The pixels of a skin cut into tiles, so that a gate looks only at those whose light it can record."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from slopegate.core.light.kernels_subsurface import LONGEST, REACH, TILE, SkinPixels, sum_lobes
from slopegate.core.rig.arrays import Doubles, Indices, Singles


class SkinWays(NamedTuple):
    """How far projector rows are on the skin of P pixels: rows, sharpness and curvature (P,) and drift (P, L), as
    `SkinPixels` has them; sigmas_mm (L,)."""

    rows: Doubles
    sharpness: Doubles
    curvature: Doubles
    sigmas_mm: Doubles
    drift: Doubles


def in_tiles(
    rows: Indices, columns: Indices, height: int, ways: SkinWays, amount: Singles, raster_rows: float
) -> SkinPixels:
    """Pixels (P,) by rising row and column, with the amounts (P, L, C) of their lobes, ready for gates."""
    start = _tile_starts(rows, columns)
    bounds = _bounds(ways, start)
    pixels = SkinPixels(
        first=np.searchsorted(rows[start[:-1]], np.arange(height + 1)).astype(np.int64),
        start=start,
        column=columns[start[:-1]].astype(np.int64),
        low=bounds[0],
        high=bounds[1],
        row=ways.rows,
        sharpness=ways.sharpness.astype(np.float32),
        curvature=ways.curvature.astype(np.float32),
        inverse_mm=(1 / ways.sigmas_mm).astype(np.float32),
        drift=np.ascontiguousarray(ways.drift.T, np.float32),
        amount=np.ascontiguousarray(amount.transpose(1, 2, 0), np.float32),
        full=np.zeros((amount.shape[2], len(rows)), np.float32),
    )
    sum_lobes(pixels, raster_rows)
    return pixels


def _tile_starts(rows: Indices, columns: Indices) -> Indices:
    """Where tiles begin, and at the end where the last one ends: runs of neighbours, cut to TILE pixels."""
    breaks = np.flatnonzero((np.diff(rows) != 0) | (np.diff(columns) != 1)) + 1
    runs = np.concatenate([[0], breaks, [len(rows)]]) if len(rows) else np.zeros(1, np.int64)
    pieces = [np.arange(begin, end, TILE) for begin, end in itertools.pairwise(runs)]
    return np.concatenate([*pieces, [len(rows)]]).astype(np.int64)


def _bounds(ways: SkinWays, start: Indices) -> tuple[Doubles, Doubles]:
    """The rows (T, L) between which each tile's lobes get their light."""
    tiles, lobes = len(start) - 1, len(ways.sigmas_mm)
    if tiles == 0:
        return np.zeros((0, lobes)), np.zeros((0, lobes))
    # Ways may be longer by LONGEST than the rows at hand say: as much farther a row can be.
    per_step = ways.sigmas_mm / (ways.sharpness[:, None] * (1 - LONGEST))
    low = ways.rows[:, None] - np.maximum(REACH - ways.drift, 0) * per_step
    high = ways.rows[:, None] + np.maximum(REACH + ways.drift, 0) * per_step
    return np.minimum.reduceat(low, start[:-1], axis=0), np.maximum.reduceat(high, start[:-1], axis=0)
