"""Light transport in as few patterns as a slice needs.

Where a pixel sees one block, as in direct light, Gray code gives its transport: 18 to 36 patterns. Random check
patterns tell whether that explains the slice (`unexplained`). If it does, what is left of the frames that codes of all
blocks would need is better spent on black and all on again, until noise is no worse than theirs (EVEN_AGAIN).

If not, Hadamard codes tell where the rest comes from, for those blocks only that light something. Of grids up to
MOST_DENSE blocks they light whole rows, then whole columns (`line_codes`), and the rest of a pixel is taken to be
spread over rows alike in every column. That is exact for light that air scatters, which comes from the pixel's own
column, and close for light that is smooth both ways. For finer grids they light larger blocks (`coarse_codes`).

Blocks that no pixel sees may still light something by way of others. One pattern with all of them lit tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bools, Bytes, Ints, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.codes import Codes, make_codes
from slopegate.core.transport.even import ROUNDING_VARIANCE
from slopegate.core.transport.gray import GrayCodes, GrayImage, gray_patterns
from slopegate.core.transport.noise import FrameNoise

CHECKS: Final = 2
"""Random patterns that are shown to see whether something is left."""
MOST_PATTERNS: Final = 2000
"""Of a slice."""
MOST_DENSE: Final = 4096
"""Blocks of a grid of which a tile of pixels can hold each."""
EXCESS: Final = 0.1
"""Share of the noise's variance that an error may have: 0.4 dB in all."""
EVEN_AGAIN: Final = 28
"""Times that black and all on are shown once more where Gray code explains all. The noise of a relit picture is then no
more than that of full codes: with n pairs of frames 1 / (2 n) of a pair's in lit pixels, against 1 / 64, since there
black and all on, 16 of each, count half in every picture and entries have hardly any."""
FINE: Final = 2
"""Pairs of Gray code, the finest of columns and as many of rows, that tell direct light."""
_SMOOTH: Final = 9
"""Pixels along a side over which light that is not direct is taken to be even, where it is within the noise."""
_SIGMAS: Final = 4.0


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


def most_patterns(grid: BlockGrid) -> int:
    """Patterns that a slice may take in all."""
    spent = gray_patterns(grid).count + CHECKS + 1
    if grid.count > MOST_DENSE:
        return MOST_PATTERNS
    return spent + max(sum(_spare_order(count) for count in (grid.columns, grid.rows)), 2 * EVEN_AGAIN)


def seen_blocks(gray: GrayImage, grid: BlockGrid) -> Bools:
    """Which blocks some pixel sees, (blocks,) bool."""
    found = np.zeros(grid.count, np.bool_)
    found[gray.block[gray.block >= 0]] = True
    return found


def line_codes(grid: BlockGrid, lit: Bools) -> tuple[SomeBlocks, SomeBlocks]:
    """Hadamard codes of the rows of blocks, and of the columns, that may light something: lit (blocks,) bool."""
    whole = lit.reshape(grid.rows, grid.columns)
    rows, columns = BlockGrid(grid.raster, 1, grid.rows), BlockGrid(grid.raster, grid.columns, 1)
    return _some(rows, np.any(whole, axis=1)), _some(columns, np.any(whole, axis=0))


def only_lit(gray: GrayImage, noise: FrameNoise, pairs: int) -> GrayImage:
    """Gray code's image without the blocks of pixels that are neither sure nor clearly lit.

    noise: of a frame; pairs: of black and all on, whose mean difference is the light of pixels that are not sure.
    """
    floor = 5 * math.sqrt(2 * noise.read_variance / pairs)
    return replace(gray, block=np.where(gray.sure | (gray.value > floor), gray.block, -1).astype(np.int32))


def coarse_codes(grid: BlockGrid, lit: Bools, patterns: int) -> SomeBlocks:
    """Hadamard codes of at most so many patterns, for the blocks that may light something, (blocks,) bool.

    On the finest grid with 1/1, 1/2, 1/4, ... of this one's blocks along each side, rounded down.
    """
    step = 1
    while True:
        coarse = BlockGrid(grid.raster, max(grid.columns // step, 1), max(grid.rows // step, 1))
        may = np.zeros(coarse.count, np.bool_)
        may[grid.parents(coarse)[lit]] = True
        if _spare_order(max(int(may.sum()), 1)) <= patterns:
            return _some(coarse, may)
        step *= 2


def _some(grid: BlockGrid, lit: Bools) -> SomeBlocks:
    numbers = np.flatnonzero(lit).astype(np.int32)
    row = BlockGrid(Raster(max(len(numbers), 1), 1), max(len(numbers), 1), 1)
    return SomeBlocks(grid, Codes("hadamard", row, _spare_order(row.count)), numbers)


def _spare_order(count: int) -> int:
    """Of a matrix with a spare column, as S-matrices have it: errors of black and of all on are then no block's."""
    return make_codes("s", BlockGrid(Raster(count, 1), count, 1)).order


def gap_light(pairs: Singles, sure: Bools) -> Singles:
    """Light of each pixel (P,) that sees one block, counts, free of errors of the black frame; 0 where not sure (P,).

    pairs (2 bits, P) float32: frames of Gray code, pattern and inverse in turns. Their mean difference.
    """
    gaps = np.abs(pairs[::2] - pairs[1::2]).mean(axis=0)
    return np.where(sure, gaps, 0).astype(np.float32)


def fine_gaps(codes: GrayCodes, pairs: Singles) -> Singles:
    """Mean difference of the finest FINE pairs of columns, and of rows, (2, P) float32 counts.

    Light that is smooth over some blocks brings the same to both of such a pair, so they tell direct light from it; if
    it comes from the pixel's own column or row alone, only those of the other kind do.
    """
    bits, first = codes.column_bits + codes.row_bits, codes.column_bits
    gaps = np.abs(pairs[::2] - pairs[1::2])
    return np.stack([gaps[max(first - FINE, 0) : first].mean(axis=0), gaps[max(bits - FINE, first) :].mean(axis=0)])


def direct_light(gray: GrayImage, gaps: Singles, light: Singles, noise: FrameNoise) -> Singles:
    """What pixels (H, W) have from their own block beyond their neighbours' share, counts; 0 where not sure.

    gaps (2, H, W): `fine_gaps`. light (H, W): all light; noise: of a frame. The mean of both gaps; where they differ
    around a pixel by more than noise, the smaller one.
    """
    spread = _pair_noise(light, noise) * np.float32(np.sqrt(2 / FINE))
    around = _mean_around(gaps[0] - gaps[1], gray.sure)
    apart = np.abs(around) > _SIGMAS / _SMOOTH * spread
    found = np.where(apart, np.where(around > 0, gaps[1], gaps[0]), gaps.mean(axis=0))
    return np.where(gray.sure, found, 0).astype(np.float32)


def smooth_rest(gray: GrayImage, light: Singles, direct: Singles, noise: FrameNoise) -> Singles:
    """What pixels (H, W) have beside their direct light, counts.

    light (H, W): all light, as one frame with all on tells it. direct (H, W): `direct_light`, 0 where there is none
    that is sure. noise: of a frame. Both are noisy, but what is beside direct light is smooth: where that differs from
    the mean around, among pixels with or among pixels without direct light, by no more than noise, it is that mean.
    """
    rest, lit = light - direct, np.maximum(light, 0)
    pair = 2 * noise.read_variance + noise.variance_per_count * lit
    frame = 4 * (noise.read_variance + noise.variance_per_count * lit)
    spread = np.sqrt(np.where(gray.sure, pair * np.float32(0.5 / FINE), 0) + frame)
    around = np.where(gray.sure, _mean_around(rest, gray.sure), _mean_around(rest, ~gray.sure))
    mean = np.where(around > _SIGMAS / _SMOOTH * spread, around, 0)
    return np.where(np.abs(rest - around) <= _SIGMAS * spread, mean, rest).astype(np.float32)


def _mean_around(image: Singles, sure: Bools) -> Singles:
    """Mean of the sure pixels in the square around each (H, W); 0 where there is none."""
    weight, side = sure.astype(np.float32), (_SMOOTH, _SMOOTH)
    around = cv2.blur(image * weight, side) / np.maximum(cv2.blur(weight, side), np.float32(1e-6))
    return np.asarray(around, np.float32)


def _pair_noise(light: Singles, noise: FrameNoise) -> Singles:
    """Standard deviation (H, W) of the difference of a pair of frames, one of which has the light (H, W)."""
    variance = 2 * noise.read_variance + noise.variance_per_count * np.maximum(light, 0)
    return np.asarray(np.sqrt(variance), np.float32)


def without_direct(columns: Singles, numbers: Ints, parent: Ints, direct: Singles) -> None:
    """Take direct light (P,) off the decoded columns (blocks, P) of the pixels' own coarse blocks, parent (P,).

    numbers (blocks,) rising: the blocks of the columns. Pixels whose own block has no column keep their columns.
    """
    place = np.searchsorted(numbers, parent)
    found = (direct > 0) & (place < len(numbers))
    found[found] = numbers[place[found]] == parent[found]
    pixels = np.flatnonzero(found)
    columns[place[pixels], pixels] -= direct[pixels]


def own_block(
    rows: Singles, columns: Singles, block: Ints, rest: Singles, direct: Singles, noise: Singles
) -> tuple[Ints, Singles]:
    """The block of each pixel (P,), -1 for none, and its direct light, by sums over rows and over columns.

    rows (rows, P), columns (columns, P): light of whole rows and columns; noise (P,) of each. block, direct (P,): as
    told by Gray code; rest (P,): `smooth_rest`. A pixel's own row and column have its direct light and their share of
    the rest; the mean of both says it, or the row alone, where the column has more. Where they have less than was told,
    the block is wrong: it is the brightest row and column, and its light no more than theirs.
    """
    pixels = np.arange(len(block))
    row, column = np.divmod(np.maximum(block, 0), len(columns))
    most = np.minimum(rows[row, pixels], columns[column, pixels])
    wrong = (direct > 0) & (direct > most + 2 * _SIGMAS * noise)
    row, column = (np.where(wrong, part.argmax(axis=0), old) for part, old in ((rows, row), (columns, column)))
    of_row = rows[row, pixels] - rest / len(rows)
    of_column = columns[column, pixels] - rest / len(columns)
    alike = np.abs(of_row - of_column) <= _SIGMAS * noise
    known = np.where(alike, (of_row + of_column) / 2, np.minimum(of_row, of_column))
    far = ~wrong & (np.abs(known - direct) > 2 * _SIGMAS * noise) & (known > direct)
    light = np.where(direct > 0, np.maximum(np.where(far, direct, known), 0), 0)
    return np.where(block >= 0, row * len(columns) + column, -1).astype(np.int32), light.astype(np.float32)


def spread_rest(rows: Singles, columns: Singles, rest: Singles, noise: Singles, out: Singles) -> Singles:
    """Spread light (P,) over blocks as sums over rows (rows, P) and columns (columns, P) say; noise (P,) of a block.

    out (rows x columns, P) is set to rows x columns / rest. Nothing, where the rest is lost in the noise (P,) of a sum.
    """
    known = rest > _SIGMAS * noise
    share = np.where(known, 1 / np.where(known, rest, 1), 0).astype(np.float32)
    whole = out.reshape(len(rows), len(columns), -1)
    np.multiply(rows[:, None, :], (columns * share)[None, :, :], out=whole)
    largest = np.maximum(rows.max(axis=0), columns.max(axis=0))
    return np.where(known, noise * np.clip(1.5 * largest * share, 0.05, 2), noise).astype(np.float32)


def unexplained(predicted: Singles, frame: Singles, reads: float, noise: FrameNoise) -> float:
    """Error of a prediction (H, W) of a check frame (H, W), counts above black: mean of squares, over what noise has.

    1 where all is explained. noise: of a frame. reads: times its read variance that frame, black and prediction have in
    sum. Where there is noise beyond rounding, small squares of pixels are looked at, in which it averages out.
    """
    small = noise.read_variance <= ROUNDING_VARIANCE or min(frame.shape) < 4 * _SMOOTH
    side = 1 if small else _SMOOTH
    edge = side // 2
    off = cv2.blur(frame - predicted, (side, side))[edge : frame.shape[0] - edge, edge : frame.shape[1] - edge]
    squares = float((off.astype(np.float64) ** 2).mean()) * side**2
    shot = noise.variance_per_count * max(float(predicted.mean(dtype=np.float64)), 0.0)
    return squares / (reads * noise.read_variance + 1.1 * shot)


def gray_reads(gray: GrayImage) -> float:
    """`unexplained`'s reads of predictions by Gray code: frame, black and ten pairs, or black and all on once."""
    share = float(gray.sure.mean())
    return 2.1 * share + 1.5 * (1 - share)


def predicted_by_gray(gray: GrayImage, values: Bytes) -> Singles:
    """What Gray code says of a pattern (rows, columns): counts above black (H, W)."""
    shown = values.ravel().astype(np.float32)
    return np.asarray(gray.value * np.where(gray.block >= 0, shown[gray.block], shown.mean()), np.float32)
