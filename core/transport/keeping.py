"""What of a decoded transport is kept: entries that stand out of the noise, singly or as sums over larger blocks.

Decoded columns are full of noise, and of light too faint to matter. An entry is kept where it is some standard
deviations of its noise above zero. What is left is summed over larger blocks, in which light grows faster than noise,
and kept there by the same rule: so light that is spread smoothly over the projector stays, coarsely. The last rest is
held by `SliceTransport.total`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Bytes, Doubles, Indices, Ints, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.transport.sliced import Entries

_LANES = 64
"""Pixels that are looked at side by side: a line of them fits the cache for every block."""


@dataclass(frozen=True)
class KeepRule:
    """When an entry is kept."""

    sigmas: float = 4.0
    """At this many standard deviations of its noise above zero, ..."""
    least_share: float = 1e-5
    """... and at this share of the pixel's whole light."""
    most: int = 32
    """Entries of a pixel and grid: where there are more, the largest. Of equal ones that are too many none is kept."""


@dataclass(frozen=True)
class LeftOut:
    """How much of a transport the kept entries, with the rest spread evenly, do not reproduce: sums of squares.

    In the square of the light's unit, over all pixels and blocks.
    """

    energy: float
    """Of all decoded entries, noise included."""
    left: float
    """Of the differences between decoded and kept."""
    noise: float
    """What noise alone is expected to have of `left`."""

    @property
    def share(self) -> float:
        """Share of the energy, 0..1, that was left out and is not explained by noise."""
        return max(self.left - self.noise, 0.0) / self.energy if self.energy > 0 else 0.0


@dataclass(frozen=True, eq=False)
class KeptTile:
    """What was kept of a run of pixels: entries of each grid, and what they leave out."""

    layers: tuple[Entries, ...]
    left_out: LeftOut


def coarse_grid(grid: BlockGrid) -> BlockGrid | None:
    """The grid whose blocks hold 4 x 4 of this grid's (or 3 or 2 along a side, where 4 does not divide it).

    None where nothing can be taken together.
    """
    columns, rows = (
        next(count // step for step in (4, 3, 2, 1) if count % step == 0) for count in (grid.columns, grid.rows)
    )
    return None if (columns, rows) == (grid.columns, grid.rows) else BlockGrid(grid.raster, columns, rows)


def keep(
    columns: Singles, grid: BlockGrid, noise: Singles, numbers: Ints | None = None, rule: KeepRule | None = None
) -> KeptTile:
    """What is kept of decoded columns (blocks, P) float32, in which kept entries are then 0.

    noise (P,) float32: standard deviation of a decoded entry of each pixel. numbers (blocks,) int32, rising: which
    blocks the columns are of; None: all of the grid. Raises ValueError for columns that do not fit.
    """
    rule = rule or KeepRule()
    numbers = np.arange(grid.count, dtype=np.int32) if numbers is None else numbers
    if len(numbers) != len(columns) or noise.shape != columns.shape[1:]:
        raise ValueError(f"{columns.shape} columns do not fit {len(numbers)} blocks and {noise.shape} noise")
    light, energy = np.zeros(len(noise), np.float32), np.zeros(len(noise), np.float32)
    _sums(columns, light, energy)
    threshold = np.maximum(np.float32(rule.sigmas) * noise, np.float32(rule.least_share) * light)
    layers = [_kept(columns, grid, numbers, threshold, rule.most)]
    left = energy - _pixel_sums(layers[0], layers[0].value.astype(np.float64) ** 2)
    rest = light - _pixel_sums(layers[0], layers[0].value)
    coarse = coarse_grid(grid)
    if coarse is not None:
        members = grid.count // coarse.count
        sums = _pooled(columns, grid, coarse, numbers)
        raised = threshold * np.float32(math.sqrt(members))
        layers.append(_kept(sums, coarse, np.arange(coarse.count, dtype=np.int32), raised, rule.most))
        value = layers[1].value.astype(np.float64)
        left -= _pixel_sums(layers[1], value**2) / members
        rest -= _pixel_sums(layers[1], value)
    left -= rest**2 / grid.count
    kept = np.diff(layers[0].starts)
    drawn = float(((len(numbers) - kept) * noise.astype(np.float64) ** 2).sum())
    return KeptTile(tuple(layers), LeftOut(float(energy.sum(dtype=np.float64)), max(float(left.sum()), 0.0), drawn))


def joined(tiles: Sequence[KeptTile]) -> KeptTile:
    """The tiles of pixels that follow each other as one. Grids without any entry are left out."""
    layers = []
    for pieces in zip(*(tile.layers for tile in tiles), strict=True):
        ends = np.cumsum([0, *(len(piece.value) for piece in pieces)])
        if ends[-1]:
            starts = [piece.starts[:-1] + end for piece, end in zip(pieces, ends[:-1], strict=True)]
            block, value = (np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("block", "value"))
            layers.append(Entries(pieces[0].grid, np.concatenate([*starts, ends[-1:]]), block, value))
    sums = [sum(getattr(tile.left_out, name) for tile in tiles) for name in ("energy", "left", "noise")]
    return KeptTile(tuple(layers), LeftOut(*sums))


def _kept(columns: Singles, grid: BlockGrid, numbers: Ints, threshold: Singles, most: int) -> Entries:
    """Entries above the threshold (P,), taken out of the columns."""
    pixels = len(threshold)
    counts = np.zeros(pixels, np.int64)
    groups = -(-pixels // _LANES)
    hits = np.zeros((groups, len(numbers)), np.uint8)
    raised = threshold.copy()
    _count(columns, raised, most, counts, hits)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    block, value = np.empty(starts[-1], np.int32), np.empty(starts[-1], np.float32)
    _take(columns, numbers, raised, hits, starts[:-1].copy(), block, value)
    return Entries(grid, starts, block, value)


def _pooled(columns: Singles, grid: BlockGrid, coarse: BlockGrid, numbers: Ints) -> Singles:
    """Sums of the columns over the blocks of a coarser grid, (coarse blocks, P)."""
    sums = np.zeros((coarse.count, columns.shape[1]), np.float32)
    _add_rows(columns, grid.parents(coarse)[numbers], sums)
    return sums


def _pixel_sums(entries: Entries, value: Singles | Doubles) -> Doubles:
    """Sum of values, one an entry, for every pixel."""
    sums = np.concatenate([[0.0], np.cumsum(value, dtype=np.float64)])
    return np.asarray(np.diff(sums[entries.starts]), np.float64)


@njit(cache=True, nogil=True)
def _sums(columns: Singles, light: Singles, energy: Singles) -> None:
    """Add up the columns (blocks, P) and their squares."""
    for first in range(0, columns.shape[1], 4096):
        last = min(first + 4096, columns.shape[1])
        for row in range(columns.shape[0]):
            for pixel in range(first, last):
                value = columns[row, pixel]
                light[pixel] += value
                energy[pixel] += value * value


@njit(cache=True, nogil=True)
def _count(columns: Singles, threshold: Singles, most: int, counts: Indices, hits: Bytes) -> None:
    """Count the values above each pixel's threshold and mark in hits (groups of pixels, blocks) where there are any.

    The threshold of a pixel with more than `most` of them is raised to the largest value that is too many.
    """
    for group in range(hits.shape[0]):
        first, last = group * _LANES, min((group + 1) * _LANES, columns.shape[1])
        for row in range(columns.shape[0]):
            found = 0
            for pixel in range(first, last):
                lit = columns[row, pixel] > threshold[pixel]
                counts[pixel] += lit
                found += lit
            hits[group, row] = found > 0
        for pixel in range(first, last):
            if counts[pixel] > most:
                above = columns[:, pixel][columns[:, pixel] > threshold[pixel]]
                threshold[pixel] = np.partition(above, len(above) - most - 1)[len(above) - most - 1]
                counts[pixel] = (above > threshold[pixel]).sum()


@njit(cache=True, nogil=True)
def _take(
    columns: Singles, numbers: Ints, threshold: Singles, hits: Bytes, at: Indices, block: Ints, value: Singles
) -> None:
    """Move the values above the threshold into the entries, of each pixel from at (P,) on."""
    for group in range(hits.shape[0]):
        first, last = group * _LANES, min((group + 1) * _LANES, columns.shape[1])
        for row in range(columns.shape[0]):
            if hits[group, row]:
                for pixel in range(first, last):
                    if columns[row, pixel] > threshold[pixel]:
                        block[at[pixel]] = numbers[row]
                        value[at[pixel]] = columns[row, pixel]
                        columns[row, pixel] = 0
                        at[pixel] += 1


@njit(cache=True, nogil=True)
def _add_rows(columns: Singles, parent: Ints, sums: Singles) -> None:
    """Add every row of the columns (blocks, P) to the row of its parent."""
    for row in range(columns.shape[0]):
        for pixel in range(columns.shape[1]):
            sums[parent[row], pixel] += columns[row, pixel]
