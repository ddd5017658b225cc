"""A projector's raster cut into blocks: what coded patterns are made of, and what light transport is kept for."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Indices, Ints, Singles
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.patterns import Raster

MOST_BLOCKS: Final = 1024
"""Along either side of a grid that is asked for."""


@dataclass(frozen=True)
class BlockGrid:
    """Blocks of whole pixels that cover a raster, as even as they can be.

    Block column j covers pixels floor(j W / columns) to floor((j + 1) W / columns), rows likewise, so the sizes of any
    two blocks differ by at most a pixel. Blocks are numbered row by row from the upper left one, from 0.
    """

    raster: Raster
    columns: int
    rows: int

    def __post_init__(self) -> None:
        for name, most in (("columns", self.raster.width), ("rows", self.raster.height)):
            allowed = f"a whole number from 1 to {most}, for the projector has {self.raster} pixels"
            require(1 <= getattr(self, name) <= most, f"grid {name}", getattr(self, name), allowed)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"

    @property
    def count(self) -> int:
        """How many blocks there are."""
        return self.columns * self.rows

    @property
    def column_edges(self) -> Indices:
        """First pixel column of each block column, and the raster's width, (columns + 1,) int64."""
        return np.arange(self.columns + 1, dtype=np.int64) * self.raster.width // self.columns

    @property
    def row_edges(self) -> Indices:
        """First pixel row of each block row, and the raster's height, (rows + 1,) int64."""
        return np.arange(self.rows + 1, dtype=np.int64) * self.raster.height // self.rows

    def numbers(self, column: Singles, row: Singles) -> Ints:
        """The block of projector positions (column, row), any shape, int32; -1 where either is negative (unlit)."""
        lit = (column >= 0) & (row >= 0)
        j = _places(self.column_edges, column, self.columns)
        i = _places(self.row_edges, row, self.rows)
        return np.where(lit, i * self.columns + j, -1).astype(np.int32)

    def spread(self, values: NDArray[Any]) -> NDArray[Any]:
        """One value a block, (rows, columns) or (rows, columns, 3), -> a picture (height, width, ...)."""
        if values.shape[:2] != (self.rows, self.columns):
            raise ValueError(f"values {values.shape} do not fit a grid of {self.rows} rows and {self.columns} columns")
        tall = np.repeat(values, np.diff(self.row_edges), axis=0)
        return np.ascontiguousarray(np.repeat(tall, np.diff(self.column_edges), axis=1))

    @property
    def areas(self) -> Indices:
        """Pixels of each block, (rows, columns) int64."""
        return np.asarray(np.diff(self.row_edges)[:, None] * np.diff(self.column_edges)[None, :])

    def parents(self, coarse: BlockGrid) -> Ints:
        """The block of a coarser grid that holds each block, (blocks,) int32."""
        row, column = np.divmod(np.arange(self.count), self.columns)
        holding = row * coarse.rows // self.rows * coarse.columns + column * coarse.columns // self.columns
        return np.asarray(holding, np.int32)

    def means(self, picture: NDArray[Any]) -> Singles:
        """Mean of each block of a raster's picture (height, width, ...), float32 (rows, columns, ...)."""
        if picture.shape[:2] != (self.raster.height, self.raster.width):
            raise ValueError(f"a picture {picture.shape} does not fit a projector of {self.raster} pixels")
        planes = picture.reshape(self.raster.height, self.raster.width, -1)
        found = [part_means(planes[..., k], self.rows, self.columns) for k in range(planes.shape[2])]
        return np.stack(found, axis=2).reshape(self.rows, self.columns, *picture.shape[2:])


def parse_grid(text: str, raster: Raster) -> BlockGrid:
    """A grid from text such as 32x32 or 4x2: columns, then rows. Raises InputError."""
    found = re.fullmatch(r"(\d{1,4})x(\d{1,4})", text.strip().lower())
    if found is None:
        raise InputError(f"grid is {text!r}: it must be columns x rows, such as 32x32")
    for name, count in (("columns", int(found[1])), ("rows", int(found[2]))):
        require(count <= MOST_BLOCKS, f"grid {name}", count, f"a whole number from 1 to {MOST_BLOCKS}")
    return BlockGrid(raster, int(found[1]), int(found[2]))


def on_raster(picture: Singles, raster: Raster) -> Singles:
    """A picture (height, width[, 3]) of the raster's size or of any grid up to it, spread over its pixels, float32.

    Raises InputError for a larger one.
    """
    rows, columns = picture.shape[:2]
    return np.asarray(BlockGrid(raster, columns, rows).spread(picture), np.float32)


def part_means(picture: NDArray[Any], rows: int, columns: int) -> Singles:
    """Means (rows, columns) float32 of a picture (h, w) over such blocks as `BlockGrid` has; 0 where one has no pixel,
    for there may be more of them than pixels."""
    out = np.empty((rows, columns), np.float32)
    _fill_means(np.ascontiguousarray(picture, np.float32), out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_means(picture: Singles, out: Singles) -> None:
    height, width = picture.shape
    rows, columns = out.shape
    line = np.empty(width, np.float64)
    for i in range(rows):
        top, bottom = i * height // rows, (i + 1) * height // rows
        line[:] = 0
        for y in range(top, bottom):
            for x in range(width):
                line[x] += picture[y, x]
        for j in range(columns):
            left, right = j * width // columns, (j + 1) * width // columns
            out[i, j] = line[left:right].sum() / max((bottom - top) * (right - left), 1)


def _places(edges: Indices, position: Singles, count: int) -> Indices:
    return np.clip(np.searchsorted(edges, np.floor(position), side="right") - 1, 0, count - 1)
