"""Grids of blocks over a projector's raster."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.rig.blocks import BlockGrid, parse_grid
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster


@given(st.integers(1, 300), st.integers(1, 300), st.data())
def test_blocks_cover_the_raster_and_are_even(width: int, height: int, data: st.DataObject) -> None:
    grid = BlockGrid(Raster(width, height), data.draw(st.integers(1, width)), data.draw(st.integers(1, height)))
    for edges, length in ((grid.column_edges, width), (grid.row_edges, height)):
        sizes = np.diff(edges)
        assert edges[0] == 0
        assert edges[-1] == length
        assert sizes.min() >= 1
        assert sizes.max() - sizes.min() <= 1


def test_32_rows_of_blocks_on_720_pixels_are_22_or_23_high() -> None:
    assert set(np.diff(BlockGrid(Raster(1280, 720), 32, 32).row_edges)) == {22, 23}


@given(st.integers(1, 40), st.integers(1, 40), st.data())
def test_a_position_has_the_number_of_the_block_that_is_spread_there(
    width: int, height: int, data: st.DataObject
) -> None:
    grid = BlockGrid(Raster(width, height), data.draw(st.integers(1, width)), data.draw(st.integers(1, height)))
    picture = grid.spread(np.arange(grid.count).reshape(grid.rows, grid.columns))
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    for part in (0.0, 0.5, 0.99):
        found = grid.numbers((columns + part).astype(np.float32), (rows + part).astype(np.float32))
        assert (found == picture).all()


def test_unlit_positions_have_no_block() -> None:
    grid = BlockGrid(Raster(8, 8), 2, 2)
    position = np.array([-1.0, 3.0], np.float32)
    assert grid.numbers(position, np.array([-1.0, -1.0], np.float32)).tolist() == [-1, -1]


def test_means_undo_spreading() -> None:
    grid = BlockGrid(Raster(13, 7), 5, 3)
    values = np.arange(45, dtype=np.float32).reshape(3, 5, 3)
    assert np.allclose(grid.means(grid.spread(values)), values)


def test_a_grid_is_read_as_columns_x_rows() -> None:
    grid = parse_grid("4x2", Raster(8, 8))
    assert (grid.columns, grid.rows, str(grid)) == (4, 2, "4x2")


@pytest.mark.parametrize("text", ["", "4", "4*2", "0x2", "9x2", "2x9", "-1x2", "1.5x2"])
def test_a_grid_that_does_not_fit_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="grid"):
        parse_grid(text, Raster(8, 8))
