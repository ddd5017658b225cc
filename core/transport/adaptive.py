"""Light transport in as few patterns as a slice needs.

Where a pixel sees one block, as in direct light, Gray code gives its transport: 18 to 36 patterns. Random check
patterns tell whether that explains the slice (`unexplained`). If not, Hadamard codes are shown for the rest: on the
finest grid whose blocks the budget allows, and for those blocks only that light something (`coarse_codes`). What a
pixel has from its own block stays on the fine grid, all other light is kept on the coarse one (`direct_light`).

Blocks that no pixel sees may still light something by way of others. One pattern with all of them lit tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from slopegate.core.rig.arrays import Bools, Bytes, Ints, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.codes import Codes, make_codes
from slopegate.core.transport.even import EvenLight
from slopegate.core.transport.gray import GrayCodes, GrayImage, gray_patterns
from slopegate.core.transport.noise import FrameNoise

CHECKS: Final = 2
"""Random patterns that are shown to see whether something is left."""
MOST_PATTERNS: Final = 2000
"""Of a slice, for the finest grids."""
FEWER: Final = 10
"""Times fewer patterns than full codes have, where Gray code allows it."""
EXCESS: Final = 0.1
"""Share of the noise's variance that an error may have: 0.4 dB in all."""


@dataclass(frozen=True)
class CheckPatterns:
    """Half of the blocks lit, at random, always the same."""

    grid: BlockGrid
    count: int = CHECKS

    def values(self, number: int) -> Bytes:
        """Pattern `number`, from 0: (rows, columns) uint8, 1 where a block is lit."""
        draw = np.random.default_rng((20, number))
        return draw.integers(0, 2, (self.grid.rows, self.grid.columns), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class LitBlocks:
    """A single pattern: these blocks lit."""

    grid: BlockGrid
    lit: Bools
    """(blocks,)."""
    count: int = 1

    def values(self, number: int) -> Bytes:
        """The pattern (rows, columns) uint8, 1 where a block is lit."""
        return self.lit.reshape(self.grid.rows, self.grid.columns).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class SomeBlocks:
    """Codes for some blocks of a grid; the others stay dark."""

    grid: BlockGrid
    codes: Codes
    """As if the blocks stood in one row."""
    numbers: Ints
    """The blocks, (blocks,) int32, rising."""

    @property
    def count(self) -> int:
        """How many patterns there are."""
        return self.codes.count

    def values(self, number: int) -> Bytes:
        """Pattern `number`, from 0: (rows, columns) uint8, 1 where a block is lit."""
        out = np.zeros(self.grid.count, np.uint8)
        out[self.numbers] = self.codes.values(number).ravel()
        return out.reshape(self.grid.rows, self.grid.columns)


def budget(grid: BlockGrid) -> int:
    """Patterns that a slice may take in all."""
    full = make_codes("hadamard", grid).count
    return min(max(full // FEWER, gray_patterns(grid).count + CHECKS), MOST_PATTERNS, full)


def is_worth_it(grid: BlockGrid) -> bool:
    """Whether Gray code and checks are fewer patterns than full codes; else those are shown."""
    return gray_patterns(grid).count + CHECKS < make_codes("hadamard", grid).count


def seen_blocks(gray: GrayImage, grid: BlockGrid) -> Bools:
    """Which blocks some pixel sees, (blocks,) bool."""
    found = np.zeros(grid.count, np.bool_)
    found[gray.block[gray.block >= 0]] = True
    return found


def coarse_codes(grid: BlockGrid, lit: Bools, patterns: int) -> SomeBlocks | None:
    """Hadamard codes of at most so many patterns, for the blocks that may light something, (blocks,) bool.

    On the finest grid made of 1, 2, 4, ... blocks of this one along each side; None where none is coarse enough.
    """
    step = 1
    while grid.columns % step == 0 and grid.rows % step == 0:
        coarse = BlockGrid(grid.raster, grid.columns // step, grid.rows // step)
        numbers = np.unique(parents(grid, coarse)[lit]).astype(np.int32)
        if len(numbers):
            codes = make_codes("hadamard", _in_one_row(len(numbers)))
            if codes.count <= patterns:
                return SomeBlocks(coarse, codes, numbers)
        step *= 2
    return None


def parents(grid: BlockGrid, coarse: BlockGrid) -> Ints:
    """The block of the coarser grid that holds each block, (blocks,) int32."""
    row, column = np.divmod(np.arange(grid.count), grid.columns)
    holding = row * coarse.rows // grid.rows * coarse.columns + column * coarse.columns // grid.columns
    return np.asarray(holding, np.int32)


def direct_light(codes: GrayCodes, coarse: BlockGrid, pairs: Singles, gray: GrayImage) -> Singles:
    """What each pixel (P,) has from its own block beyond what it has from neighbours, counts; 0 where not sure.

    pairs (2 bits, P) float32: frames of Gray code, pattern and inverse in turns. Light that is smooth over a coarse
    block brings the same to both of a pair whose stripes are finer than that, so their difference is the direct
    light's alone; the mean over all such pairs.
    """
    columns, rows = (
        (whole // part - 1).bit_length()
        for whole, part in ((codes.grid.columns, coarse.columns), (codes.grid.rows, coarse.rows))
    )
    first_row = codes.column_bits + codes.row_bits - rows
    inner = [*range(codes.column_bits - columns, codes.column_bits), *range(first_row, first_row + rows)]
    if not inner:
        return np.zeros(pairs.shape[1], np.float32)
    gaps = [np.abs(pairs[2 * bit] - pairs[2 * bit + 1]) for bit in inner]
    return np.where(gray.sure.ravel(), np.mean(gaps, axis=0), 0).astype(np.float32)


def without_direct(columns: Singles, numbers: Ints, parent: Ints, direct: Singles) -> None:
    """Take direct light (P,) off the decoded columns (blocks, P) of the pixels' own coarse blocks, parent (P,).

    numbers (blocks,) rising: the blocks of the columns. Pixels whose own block has no column keep their columns.
    """
    place = np.searchsorted(numbers, parent)
    found = (direct > 0) & (place < len(numbers))
    found[found] = numbers[place[found]] == parent[found]
    pixels = np.flatnonzero(found)
    columns[place[pixels], pixels] -= direct[pixels]


def unexplained(predicted: Singles, frame: Singles, even: EvenLight, noise: FrameNoise) -> float:
    """Error of a prediction (H, W) of a check frame (H, W), counts above black: mean of squares, over what noise has.

    1 where all is explained. noise: of the check frame. The prediction is taken to be as noisy as a mean of four
    frames, which is what Gray code makes of a grid of 4x4 or more.
    """
    squares = float(((frame - predicted).astype(np.float64) ** 2).mean())
    read = noise.read_variance * 1.5 + even.noise.read_variance / even.frames
    return squares / (read + noise.variance_per_count * 1.25 * max(float(predicted.mean(dtype=np.float64)), 0.0))


def predicted_by_gray(gray: GrayImage, light: Singles, values: Bytes) -> Singles:
    """What Gray code says of a pattern (rows, columns), and light (H, W) of all on: counts above black (H, W)."""
    out = np.empty(light.shape, np.float32)
    shown = values.ravel().astype(np.float32)
    _predict(gray.block, gray.value, light, shown, np.float32(shown.mean()), out)
    return out


def _in_one_row(count: int) -> BlockGrid:
    return BlockGrid(Raster(count, 1), count, 1)


@njit(cache=True, nogil=True)
def _predict(block: Ints, value: Singles, light: Singles, shown: Singles, mean: np.float32, out: Singles) -> None:
    for y in range(block.shape[0]):
        for x in range(block.shape[1]):
            own = block[y, x]
            out[y, x] = light[y, x] * mean
            if own >= 0:
                out[y, x] += value[y, x] * (shown[own] - mean)
