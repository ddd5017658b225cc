"""Test patterns for a projector, to align and check a rig with: (height, width) uint8, 0 dark and 255 fully lit.

Rows count from the top and columns from the left, both from 0, as in the rest of the program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.checks import require

Axis = Literal["rows", "columns"]

LIT = 255


@dataclass(frozen=True)
class Raster:
    """A projector's pixels."""

    width: int
    height: int

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            require(getattr(self, name) >= 1, name, getattr(self, name), "a whole number of at least 1")

    def __str__(self) -> str:
        return f"{self.width} x {self.height}"

    def length(self, axis: Axis) -> int:
        """How many rows or columns there are."""
        return self.height if axis == "rows" else self.width

    def spread(self, values: Bytes, axis: Axis) -> Bytes:
        """One value a row (or column) -> a pattern in which each of them has its value throughout."""
        line = values[:, None] if axis == "rows" else values[None, :]
        return np.ascontiguousarray(np.broadcast_to(line, (self.height, self.width)))


def even(raster: Raster, level: int) -> Bytes:
    """The same everywhere: 0 black, 255 white."""
    require(0 <= level <= LIT, "level", level, f"from 0 to {LIT}")
    return np.full((raster.height, raster.width), level, np.uint8)


def checkerboard(raster: Raster, square_px: int) -> Bytes:
    """Squares of this many pixels, the one in the upper left corner lit."""
    require(square_px >= 1, "square_px", square_px, "at least 1")
    rows, columns = (np.arange(raster.length(axis)) // square_px % 2 for axis in ("rows", "columns"))
    return np.where(rows[:, None] == columns[None, :], LIT, 0).astype(np.uint8)


def one_line(raster: Raster, axis: Axis, index: int) -> Bytes:
    """A single row or column lit."""
    count = raster.length(axis)
    require(0 <= index < count, axis.removesuffix("s"), index, f"from 0 to {count - 1}")
    return raster.spread(np.where(np.arange(count) == index, LIT, 0).astype(np.uint8), axis)


def stripes(raster: Raster, axis: Axis, width_px: int) -> Bytes:
    """Rows or columns in groups of this many, every other group lit, beginning with the first."""
    require(width_px >= 1, "width_px", width_px, "at least 1")
    lit = np.arange(raster.length(axis)) // width_px % 2 == 0
    return raster.spread(np.where(lit, LIT, 0).astype(np.uint8), axis)


def ramp(raster: Raster, axis: Axis) -> Bytes:
    """From 0 in the first row (or column) to 255 in the last, rounded to the nearest level."""
    return raster.spread(np.round(np.linspace(0, LIT, raster.length(axis))).astype(np.uint8), axis)


def focus_grid(raster: Raster, spacing_px: int) -> Bytes:
    """Lines one pixel wide this far apart, the outermost rows and columns, and both diagonals of the raster."""
    require(spacing_px >= 2, "spacing_px", spacing_px, "at least 2")
    rows, columns = np.arange(raster.height), np.arange(raster.width)
    pattern = even(raster, 0)
    pattern[rows % spacing_px == 0] = pattern[:, columns % spacing_px == 0] = LIT
    pattern[[0, -1]] = pattern[:, [0, -1]] = LIT
    across = np.round(np.linspace(0, raster.width - 1, max(raster.width, raster.height))).astype(np.intp)
    down = np.round(np.linspace(0, raster.height - 1, across.size)).astype(np.intp)
    pattern[down, across] = pattern[down, across[::-1]] = LIT
    return pattern


def gray_bits(raster: Raster, axis: Axis) -> int:
    """How many Gray-code patterns tell all rows or columns apart."""
    return max(1, (raster.length(axis) - 1).bit_length())


def gray_code(raster: Raster, axis: Axis, bit: int) -> Bytes:
    """One bit of every row's (or column's) number in binary-reflected Gray code; bit 0 is the coarsest."""
    bits = gray_bits(raster, axis)
    require(0 <= bit < bits, "bit", bit, f"from 0 to {bits - 1}")
    index = np.arange(raster.length(axis))
    code = index ^ (index >> 1)
    return raster.spread((code >> (bits - 1 - bit) & 1).astype(np.uint8) * np.uint8(LIT), axis)


@dataclass(frozen=True)
class Number:
    """The one number that a kind of pattern has, with its range on a raster."""

    name: str
    low: int
    high: Callable[[Raster], int]
    usual: Callable[[Raster], int]


@dataclass(frozen=True)
class PatternKind:
    """A pattern that people can choose."""

    key: str
    title: str
    draw: Callable[[Raster, int], Bytes]
    number: Number | None = None
    """None: `draw` does not look at its number."""


def _line(axis: Axis) -> Number:
    name = "Row" if axis == "rows" else "Column"
    return Number(name, 0, lambda raster: raster.length(axis) - 1, lambda raster: raster.length(axis) // 2)


def _bit(axis: Axis) -> Number:
    return Number("Bit", 0, lambda raster: gray_bits(raster, axis) - 1, lambda raster: 0)


def _pixels(name: str, low: int, usual: int) -> Number:
    return Number(name, low, lambda raster: max(raster.width, raster.height, low), lambda raster: usual)


KINDS: tuple[PatternKind, ...] = (
    PatternKind("white", "All on", lambda raster, _: even(raster, LIT)),
    PatternKind("black", "All off", lambda raster, _: even(raster, 0)),
    PatternKind("grid", "Grid for focus", focus_grid, _pixels("Spacing, pixels", 2, 40)),
    PatternKind("checkerboard", "Checkerboard", checkerboard, _pixels("Square, pixels", 1, 40)),
    PatternKind("row", "One row", lambda raster, index: one_line(raster, "rows", index), _line("rows")),
    PatternKind("column", "One column", lambda raster, index: one_line(raster, "columns", index), _line("columns")),
    PatternKind(
        "row-stripes",
        "Stripes of rows",
        lambda raster, width: stripes(raster, "rows", width),
        _pixels("Width, pixels", 1, 20),
    ),
    PatternKind(
        "column-stripes",
        "Stripes of columns",
        lambda raster, width: stripes(raster, "columns", width),
        _pixels("Width, pixels", 1, 20),
    ),
    PatternKind("row-ramp", "Ramp, dark at the top", lambda raster, _: ramp(raster, "rows")),
    PatternKind("column-ramp", "Ramp, dark at the left", lambda raster, _: ramp(raster, "columns")),
    PatternKind("gray-rows", "Gray code of rows", lambda raster, bit: gray_code(raster, "rows", bit), _bit("rows")),
    PatternKind(
        "gray-columns", "Gray code of columns", lambda raster, bit: gray_code(raster, "columns", bit), _bit("columns")
    ),
)
