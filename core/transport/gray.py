"""Gray code: which one block lights each pixel, in as many frames as the block's number has bits, twice.

Enough where a pixel sees one block, as in direct light through a thin slice. Every bit of a block's column and row is
shown as a pattern and as its inverse, so that a bit is the sign of a difference, whatever the pixel's brightness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Bools, Bytes, Ints, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.transport.noise import FrameNoise

WHITE = 0
BLACK = 1
"""The patterns with all and with no blocks lit; pairs of pattern and inverse follow."""


@dataclass(frozen=True)
class GrayCodes:
    """White, black, then a pattern and its inverse for each bit, coarsest first: of columns, then of rows."""

    grid: BlockGrid
    kind: Literal["gray"] = "gray"

    @property
    def column_bits(self) -> int:
        """How many bits tell the columns apart."""
        return (self.grid.columns - 1).bit_length()

    @property
    def row_bits(self) -> int:
        """How many bits tell the rows apart."""
        return (self.grid.rows - 1).bit_length()

    @property
    def count(self) -> int:
        """How many patterns there are: 38 for 512x512."""
        return 2 + 2 * (self.column_bits + self.row_bits)

    def values(self, number: int) -> Bytes:
        """Pattern `number`, from 0: (rows, columns) uint8, 1 where a block is lit."""
        if not 0 <= number < self.count:
            raise ValueError(f"there is no pattern {number} among {self.count}")
        shape = (self.grid.rows, self.grid.columns)
        if number in {WHITE, BLACK}:
            return np.full(shape, number == WHITE, np.uint8)
        bit, inverse = divmod(number - 2, 2)
        across = bit < self.column_bits
        length = self.grid.columns if across else self.grid.rows
        shift = (self.column_bits if across else self.column_bits + self.row_bits) - 1 - bit
        index = np.arange(length)
        line = ((index ^ (index >> 1)) >> shift & 1) ^ inverse
        whole = line[None, :] if across else line[:, None]
        return np.ascontiguousarray(np.broadcast_to(whole, shape), np.uint8)


@dataclass(frozen=True, eq=False)
class GrayImage:
    """What Gray code tells of a camera's pixels.

    block (H, W) int32: the one block that lights a pixel, -1 where there is no light above the noise, or a code that no
    block has. value (H, W) float32: the pixel's light with all on, in counts above the dark. sure (H, W) bool: a block
    was found, and every one of its bits stands out of the noise; not so where two blocks meet in a pixel.
    """

    block: Ints
    value: Singles
    sure: Bools


def gray_patterns(grid: BlockGrid) -> GrayCodes:
    """The Gray code of a grid's blocks."""
    return GrayCodes(grid)


def decode_gray(codes: GrayCodes, frames: Singles, noise: FrameNoise, sigmas: float = 5.0) -> GrayImage:
    """What frames (count, H, W) float32, in counts above the dark, tell of each pixel.

    noise: of one of these frames. sigmas: by how many standard deviations light, and the difference of each pair, has
    to stand out. The light is the mean of white plus black and of all sums of pattern and inverse: with n bits its
    variance is (2 read variance + that of white's shot noise) / (n + 1).
    """
    if frames.ndim != 3 or frames.shape[0] != codes.count:
        raise ValueError(f"frames {frames.shape} do not fit {codes.count} patterns")
    shape = frames.shape[1:]
    found = GrayImage(np.empty(shape, np.int32), np.empty(shape, np.float32), np.empty(shape, np.bool_))
    bits = (codes.column_bits, codes.row_bits)
    size = (codes.grid.columns, codes.grid.rows)
    variances = (noise.read_variance, noise.variance_per_count)
    _decode_gray(frames, bits, size, variances, float(sigmas) ** 2, found.block, found.value, found.sure)
    return found


@njit(cache=True, nogil=True)
def _decode_gray(
    frames: Singles,
    bits: tuple[int, int],
    size: tuple[int, int],
    variances: tuple[float, float],
    squared_sigmas: float,
    block: Ints,
    value: Singles,
    sure: Bools,
) -> None:
    """Fill block, value and sure (H, W) from frames (count, H, W)."""
    pairs = bits[0] + bits[1] + 1
    for y in range(block.shape[0]):
        for x in range(block.shape[1]):
            total = 0.0
            for pair in range(pairs):
                total += frames[2 * pair, y, x] + frames[2 * pair + 1, y, x]
            light = total / pairs
            value[y, x] = light
            variance = 2 * variances[0] + max(light, 0.0) * variances[1]
            column, column_clear = _number(frames, 2, bits[0], y, x, squared_sigmas * variance)
            row, row_clear = _number(frames, 2 + 2 * bits[0], bits[1], y, x, squared_sigmas * variance)
            lit = light > 0 and light * light * pairs > squared_sigmas * variance
            exists = lit and column < size[0] and row < size[1]
            block[y, x] = row * size[0] + column if exists else -1
            sure[y, x] = exists and column_clear and row_clear


@njit(cache=True, nogil=True)
def _number(frames: Singles, first: int, bits: int, y: int, x: int, least: float) -> tuple[int, bool]:
    """A number from its Gray code, and whether the square of each difference is above `least`."""
    number, bit, clear = 0, 0, True
    for i in range(bits):
        gap = frames[first + 2 * i, y, x] - frames[first + 2 * i + 1, y, x]
        bit ^= 1 if gap > 0 else 0
        number = 2 * number + bit
        clear = clear and gap * gap > least
    return number, clear
