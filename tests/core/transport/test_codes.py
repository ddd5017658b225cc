"""Coded patterns of blocks."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.codes import CODE_KINDS, CodeKind, Codes, factor, make_codes, sequency_rows

RASTER = Raster(1280, 720)


def shown(codes: Codes) -> np.ndarray:
    """All patterns, (count, blocks)."""
    return np.stack([codes.values(number).ravel() for number in range(codes.count)]).astype(np.int64)


@pytest.mark.parametrize(
    ("grid", "hadamard", "sequency", "s"),
    [
        ((4, 2), 8, 8, 11),
        ((3, 3), 12, 16, 11),
        ((16, 9), 160, 256, 159),
        ((32, 32), 1024, 1024, 1279),
        ((512, 512), 262_144, 262_144, 327_679),
    ],
)
def test_the_least_order_with_room_for_the_blocks_is_taken(
    grid: tuple[int, int], hadamard: int, sequency: int, s: int
) -> None:
    blocks = BlockGrid(RASTER, *grid)
    found = [make_codes(kind, blocks).count for kind in CODE_KINDS]
    assert found == [hadamard, sequency, s, blocks.count]


@pytest.mark.parametrize("order", [2, 4, 64, 12, 24, 192, 20, 160])
def test_matrices_are_hadamard_with_ones_first(order: int) -> None:
    # As many blocks as the order: hadamard patterns show the whole matrix.
    matrix = 2 * shown(Codes("hadamard", BlockGrid(RASTER, order, 1), order)) - 1
    assert (matrix @ matrix.T == order * np.eye(order, dtype=np.int64)).all()
    assert (matrix[0] == 1).all()
    assert (matrix[:, 0] == 1).all()


def test_the_small_factors_are_the_matrix_where_nothing_is_left_of_the_order() -> None:
    for order in (12, 20):
        matrix = 2 * shown(Codes("hadamard", BlockGrid(RASTER, order, 1), order)) - 1
        assert (matrix == factor(order)).all()


@pytest.mark.parametrize("order", [2, 16, 256])
def test_sequency_counts_the_changes_of_sign(order: int) -> None:
    patterns = shown(Codes("sequency", BlockGrid(RASTER, order, 1), order))
    assert (np.abs(np.diff(patterns, axis=1)).sum(axis=1) == np.arange(order)).all()
    assert sorted(sequency_rows(order)) == list(range(order))


@pytest.mark.parametrize("kind", ["hadamard", "sequency"])
@pytest.mark.parametrize("grid", [(4, 2), (16, 9)])
def test_the_first_pattern_is_all_on(kind: CodeKind, grid: tuple[int, int]) -> None:
    assert (make_codes(kind, BlockGrid(RASTER, *grid)).values(0) == 1).all()


@pytest.mark.parametrize("grid", [(4, 2), (16, 9), (10, 10)])
def test_s_matrices_light_half_of_the_patterns_for_each_block_and_a_quarter_for_two(grid: tuple[int, int]) -> None:
    codes = make_codes("s", BlockGrid(RASTER, *grid))
    patterns = shown(codes)
    together = patterns.T @ patterns
    assert (np.diag(together) == codes.order // 2).all()
    assert (together[~np.eye(codes.grid.count, dtype=bool)] == codes.order // 4).all()


def test_impulses_light_one_block_each() -> None:
    assert (shown(make_codes("impulse", BlockGrid(RASTER, 4, 3))) == np.eye(12)).all()


@pytest.mark.parametrize("kind", CODE_KINDS)
def test_patterns_have_the_grids_shape_and_are_bytes(kind: CodeKind) -> None:
    pattern = make_codes(kind, BlockGrid(RASTER, 16, 9)).values(3)
    assert (pattern.shape, pattern.dtype) == ((9, 16), np.uint8)
    assert set(np.unique(pattern)) == {0, 1}


@pytest.mark.parametrize("number", [-1, 8])
def test_there_is_no_pattern_beyond_the_count(number: int) -> None:
    with pytest.raises(ValueError, match="no pattern"):
        make_codes("hadamard", BlockGrid(RASTER, 4, 2)).values(number)


def test_unknown_codes_are_refused() -> None:
    with pytest.raises(InputError, match=r"codes is 'dots'.*hadamard"):
        make_codes("dots", BlockGrid(RASTER, 4, 2))  # type: ignore[arg-type]
