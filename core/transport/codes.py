"""Patterns of blocks that are shown to measure light transport: which blocks of a grid each of them lights.

All are 0 or 1, computed one pattern at a time from the bits of two numbers: no matrix of blocks x patterns ever exists.
With H a Hadamard matrix of order M whose first row and column are ones:

- `hadamard`: pattern i lights block j where H[i, first + j] = 1, so pattern 0 is all on. Blocks take the columns from 1
  on where the order leaves room for that: the block in column 0 would take the noise of a whole fully lit frame.
- `sequency`: the same patterns in the order of their sign changes along the columns, coarse ones first.
- `s`: pattern i lights block j where H[i + 1, j + 1] = -1: an S-matrix, half of the light in every pattern.
- `impulse`: pattern i lights block i alone.

Orders are 2^k, 12 x 2^k and 20 x 2^k: the least one that has room for the blocks, so that at most a third of the
patterns is shown for nothing. Sequency needs 2^k.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Bytes, Indices
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.checks import require

CodeKind = Literal["hadamard", "sequency", "s", "impulse"]
CODE_KINDS: Final[tuple[CodeKind, ...]] = ("hadamard", "sequency", "s", "impulse")

_FACTORS: Final = {1: 1, 3: 12, 5: 20}
"""Odd part of an order -> the order of the small matrix that its Hadamard matrix is built on."""


class BlockPatterns(Protocol):
    """Patterns of blocks that are shown one after the other."""

    @property
    def grid(self) -> BlockGrid:
        """What the patterns are made of."""

    @property
    def count(self) -> int:
        """How many patterns there are."""

    def values(self, number: int) -> Bytes:
        """Pattern `number`, from 0: (rows, columns) uint8, 1 where a block is lit."""


class CodedPatterns(BlockPatterns, Protocol):
    """Patterns from which the light of single blocks can be computed."""

    @property
    def kind(self) -> CodeKind | Literal["gray"]:
        """What rule they follow."""


@dataclass(frozen=True)
class Codes:
    """Patterns of one kind that tell the blocks of a grid apart; see `make_codes`."""

    kind: CodeKind
    grid: BlockGrid
    order: int
    """Of the Hadamard matrix behind them; the number of blocks for impulses."""

    @property
    def count(self) -> int:
        """How many patterns there are."""
        return self.order - 1 if self.kind == "s" else self.order

    @property
    def first(self) -> int:
        """The matrix's column that stands for block 0."""
        return 0 if self.order == self.grid.count else 1

    def places(self) -> Indices:
        """The matrix's row of each pattern, (count,) int64."""
        numbers = np.arange(self.count, dtype=np.int64)
        if self.kind == "s":
            return numbers + 1
        return sequency_rows(self.order) if self.kind == "sequency" else numbers

    def values(self, number: int) -> Bytes:
        """Pattern `number`, from 0: (rows, columns) uint8, 1 where a block is lit."""
        if not 0 <= number < self.count:
            raise ValueError(f"there is no pattern {number} among {self.count}")
        blocks = np.arange(self.grid.count, dtype=np.int64)
        if self.kind == "impulse":
            lit = blocks == number
        elif self.kind == "s":
            lit = ~_positive(self.order, number + 1, blocks + self.first)
        else:
            row = int(sequency_rows(self.order)[number]) if self.kind == "sequency" else number
            lit = _positive(self.order, row, blocks + self.first)
        return np.asarray(lit.reshape(self.grid.rows, self.grid.columns), np.uint8)


def make_codes(kind: CodeKind, grid: BlockGrid) -> Codes:
    """The patterns of a kind for a grid. Raises InputError for a kind that does not exist."""
    require(kind in CODE_KINDS, "codes", kind, f"one of {', '.join(CODE_KINDS)}")
    if kind == "impulse":
        return Codes(kind, grid, grid.count)
    needed = grid.count + 1 if kind == "s" else grid.count
    return Codes(kind, grid, _order(needed, _FACTORS if kind != "sequency" else (1,)))


def factor(order: int) -> NDArray[np.int8]:
    """The small matrix F, (m, m) with m 1, 12 or 20: the Hadamard matrix is F x the natural one of order / m.

    After Paley, from the squares modulo m - 1, with rows turned round so that the first row and column are ones.
    """
    size = _FACTORS[_odd_part(order)]
    found = np.ones((size, size), np.int8)
    if size > 1:
        prime = size - 1
        squares = np.isin(np.arange(prime), np.arange(1, prime) ** 2 % prime)
        steps = (np.arange(prime)[:, None] - np.arange(prime)[None, :]) % prime
        found[1:, 1:] = np.where(squares[steps] | (steps == 0), -1, 1)
    return found


def sequency_rows(order: int) -> Indices:
    """Row of the natural matrix of order 2^k that changes its sign s times, for each s: (order,) int64.

    It is the Gray code of s with its bits read backwards.
    """
    numbers = np.arange(order, dtype=np.int64)
    code = numbers ^ (numbers >> 1)
    found = np.zeros_like(numbers)
    for _ in range(order.bit_length() - 1):
        found = found << 1 | code & 1
        code >>= 1
    return found


def _order(needed: int, factors: dict[int, int] | tuple[int, ...]) -> int:
    """The least order that is possible with these odd parts and not below `needed`."""
    orders = []
    for odd in factors:
        order = _FACTORS[odd]
        while order < needed:
            order *= 2
        orders.append(order)
    return min(orders)


def _odd_part(order: int) -> int:
    return order // (order & -order)


def _positive(order: int, row: int, columns: Indices) -> NDArray[np.bool_]:
    """Where the Hadamard matrix of this order is +1 in a row, for these columns."""
    small = factor(order)
    rest = order // small.shape[0]
    odd = np.bitwise_count((row % rest) & (columns % rest)) & 1
    return np.asarray((small[row // rest, columns // rest] > 0) == (odd == 0))
