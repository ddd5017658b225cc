"""Adaptive patterns: what Gray code leaves is seen by the checks, and told by rows and columns of blocks."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.adaptive import (
    CHECKS,
    CheckPatterns,
    LitBlocks,
    coarse_codes,
    direct_light,
    fine_gaps,
    gap_light,
    gray_reads,
    line_codes,
    most_patterns,
    only_lit,
    own_block,
    predicted_by_gray,
    seen_blocks,
    smooth_rest,
    spread_rest,
    unexplained,
    without_direct,
)
from slopegate.core.transport.decode import decode
from slopegate.core.transport.gray import GrayImage, decode_gray, gray_patterns
from slopegate.core.transport.noise import FrameNoise

GRID = BlockGrid(Raster(64, 64), 16, 8)
SHAPE = 64, 96
NOISE = FrameNoise(16.0, 0.5)


def transport(seed: int = 1, scattered: float = 0.0) -> np.ndarray:
    """(blocks, pixels): each pixel sees one block, and so much of its light comes from that block's column evenly."""
    draw = np.random.default_rng(seed)
    pixels = SHAPE[0] * SHAPE[1]
    found = np.zeros((GRID.count, pixels))
    y, x = np.indices(SHAPE)
    block = (y * GRID.rows // SHAPE[0] * GRID.columns + x * GRID.columns // SHAPE[1]).ravel()
    light = draw.uniform(300, 2000, pixels)
    found[block, np.arange(pixels)] = (1 - scattered) * light
    for pixel in range(pixels):
        found[block[pixel] % GRID.columns :: GRID.columns, pixel] += scattered * light[pixel] / GRID.rows
    return found


def frames(patterns: object, through: np.ndarray) -> np.ndarray:
    shown = np.stack([patterns.values(k).ravel() for k in range(patterns.count)])
    return (shown @ through).astype(np.float32)


def gray_of(through: np.ndarray) -> tuple[GrayImage, np.ndarray]:
    codes = gray_patterns(GRID)
    taken = frames(codes, through)
    return decode_gray(codes, taken.reshape(-1, *SHAPE), NOISE), taken


def test_check_patterns_light_about_half_and_are_always_the_same() -> None:
    first, second = (CheckPatterns(GRID).values(k) for k in range(CHECKS))
    assert 0.3 < first.mean() < 0.7
    assert (first != second).mean() > 0.3
    np.testing.assert_array_equal(first, CheckPatterns(GRID).values(0))


def test_a_check_is_explained_by_direct_light_and_not_when_some_is_scattered() -> None:
    checks, draw = CheckPatterns(GRID), np.random.default_rng(3)
    for scattered, explained in ((0.0, True), (0.05, False)):
        through = transport(scattered=scattered)
        gray, _ = gray_of(through)
        shown = frames(checks, through)[0].reshape(SHAPE)
        noise = draw.normal(0, np.sqrt(16 * gray_reads(gray) + 0.55 * shown)).astype(np.float32)
        error = unexplained(predicted_by_gray(gray, checks.values(0)), shown + noise, gray_reads(gray), NOISE)
        assert (error < 1.1) == explained
        assert explained == (error < 2)


def test_fine_pairs_tell_direct_light_from_what_comes_from_its_column() -> None:
    through = transport(scattered=0.2)
    gray, taken = gray_of(through)
    gaps = fine_gaps(gray_patterns(GRID), taken[2:]).reshape(2, *SHAPE)
    light = through.sum(axis=0).reshape(SHAPE).astype(np.float32)
    np.testing.assert_allclose(gaps[0], light, rtol=1e-5)
    np.testing.assert_allclose(direct_light(gray, gaps, light, NOISE), 0.8 * light, rtol=1e-5)
    noise = np.random.default_rng(4).normal(0, 5, gaps.shape).astype(np.float32)
    gaps[:] = 0.8 * light
    found = direct_light(gray, gaps + noise, light, NOISE)
    np.testing.assert_allclose(found, (gaps + noise).mean(axis=0), rtol=1e-5)


def test_differences_of_pairs_are_the_light_of_pixels_that_see_one_block() -> None:
    gray, taken = gray_of(transport())
    found = gap_light(taken[2:], gray.sure.ravel())
    np.testing.assert_allclose(found, transport().sum(axis=0), rtol=1e-5)
    assert not gap_light(taken[2:], np.zeros(found.shape, np.bool_)).any()


def test_rest_that_differs_by_noise_only_is_the_mean_around() -> None:
    draw = np.random.default_rng(5)
    light = np.full((40, 60), 1000.0, np.float32)
    gray = GrayImage(np.zeros(light.shape, np.int32), light, np.ones(light.shape, np.bool_))
    spread = np.sqrt((2 * 16 + 0.5 * 1000) / 4)
    direct = (950 + draw.normal(0, spread, light.shape)).astype(np.float32)
    direct[20, 30] = 400
    rest = smooth_rest(gray, light, direct, NOISE)
    assert rest[20, 30] == 600
    others = np.delete(rest.ravel(), 20 * 60 + 30)
    assert abs(others.mean() - 50) < 5
    assert others.std() < spread / 5


def test_without_direct_light_all_light_is_the_rest_and_nothing_where_it_is_lost_in_noise() -> None:
    draw = np.random.default_rng(6)
    gray = GrayImage(np.full((40, 60), -1, np.int32), np.zeros((40, 60), np.float32), np.zeros((40, 60), np.bool_))
    nothing = draw.normal(0, 8, (40, 60)).astype(np.float32)
    assert not smooth_rest(gray, nothing, np.zeros_like(nothing), FrameNoise(16.0, 0.0))[4:-4, 4:-4].any()
    faint = smooth_rest(gray, nothing + 40, np.zeros_like(nothing), FrameNoise(16.0, 0.0))
    assert abs(faint.mean() - 40) < 1
    assert faint.std() < 8 / 3


def test_rows_and_columns_say_where_scattered_light_comes_from() -> None:
    through = transport(scattered=0.3)
    gray, _ = gray_of(through)
    lit = np.ones(GRID.count, np.bool_)
    sums = []
    for some in line_codes(GRID, lit):
        shown = np.stack([some.grid.spread(some.values(k)) for k in range(some.count)])
        per_block = GRID.means(shown.transpose(1, 2, 0).astype(np.float32)).reshape(GRID.count, -1)
        sums.append(decode(some.codes, np.ascontiguousarray(per_block.T @ through, np.float32)))
    rows, columns = sums
    light = through.sum(axis=0)
    noise = np.full(light.shape, 0.5, np.float32)
    told = (0.7 * light).astype(np.float32)
    block, direct = own_block(rows, columns, gray.block.ravel(), (0.3 * light).astype(np.float32), told, noise)
    pixels = np.arange(light.size)
    rows[block // GRID.columns, pixels] -= direct
    columns[block % GRID.columns, pixels] -= direct
    out = np.empty(through.shape, np.float32)
    spread_rest(rows, columns, (light - direct).astype(np.float32), noise, out)
    out[block, pixels] += direct
    np.testing.assert_allclose(out, through, atol=1e-3 * light.max())


def test_light_lost_in_noise_is_not_spread() -> None:
    rows, columns = np.full((8, 3), 0.1, np.float32), np.full((16, 3), 0.05, np.float32)
    out = np.empty((GRID.count, 3), np.float32)
    noise = spread_rest(rows, columns, np.float32([0.8, -1.0, 0.0]), np.ones(3, np.float32), out)
    assert not out.any()
    np.testing.assert_array_equal(noise, 1)


def test_a_block_that_cannot_have_its_light_gives_it_to_the_brightest() -> None:
    rows, columns = np.zeros((8, 3), np.float32), np.zeros((16, 3), np.float32)
    rows[3], columns[5] = 100, 90
    told = np.array([3 * 16 + 5, 4 * 16 + 5, 3 * 16 + 5], np.int32)
    rest, noise = np.zeros(3, np.float32), np.full(3, 4, np.float32)
    block, direct = own_block(rows, columns, told, rest, np.float32([93, 95, 0]), noise)
    np.testing.assert_array_equal(block, 3 * 16 + 5)
    np.testing.assert_allclose(direct, [95, 95, 0])


def test_codes_of_what_is_left_light_only_blocks_that_may_light_something() -> None:
    lit = np.zeros((GRID.rows, GRID.columns), np.bool_)
    lit[2:4, 5:8] = True
    rows, columns = line_codes(GRID, lit.ravel())
    assert list(rows.numbers) == [2, 3]
    assert list(columns.numbers) == [5, 6, 7]
    assert (rows.count, columns.count) == (4, 4)
    coarse = coarse_codes(GRID, lit.ravel(), 8)
    assert coarse.grid == GRID
    assert coarse.count == 8
    fewer = coarse_codes(GRID, lit.ravel(), 4)
    assert (fewer.grid.columns, fewer.grid.rows) == (8, 4)
    assert list(fewer.numbers) == [10, 11]
    for some in (rows, columns, coarse):
        dark = np.delete(np.arange(some.grid.count), some.numbers)
        assert all(not some.values(k).ravel()[dark].any() for k in range(some.count))
        assert some.values(0).ravel()[some.numbers].all()


@pytest.mark.parametrize("size", [(512, 512), (100, 60), (7, 5)])
def test_coarse_codes_never_take_more_patterns_than_they_may(size: tuple[int, int]) -> None:
    grid = BlockGrid(Raster(1280, 720), *size)
    for patterns in (2, 30, 1500):
        assert coarse_codes(grid, np.ones(grid.count, np.bool_), patterns).count <= patterns


def test_direct_light_is_taken_off_the_own_block_alone() -> None:
    columns = np.full((2, 3), 10, np.float32)
    without_direct(columns, np.array([4, 9], np.int32), np.array([4, 9, 5], np.int32), np.float32([1, 2, 3]))
    np.testing.assert_array_equal(columns, [[9, 10, 10], [10, 8, 10]])


def test_every_block_lies_in_the_larger_block_that_holds_it() -> None:
    coarse = BlockGrid(GRID.raster, 4, 2)
    spread = coarse.spread(np.arange(8).reshape(2, 4))
    np.testing.assert_array_equal(GRID.parents(coarse), GRID.means(spread).ravel())


def test_seen_blocks_and_the_pattern_of_others() -> None:
    gray, _ = gray_of(transport())
    lit = seen_blocks(gray, GRID)
    others = LitBlocks(GRID, ~lit).values(0).ravel()
    np.testing.assert_array_equal(others == 0, lit)
    assert set(np.flatnonzero(lit)) == set(gray.block.ravel())


def test_only_what_is_sure_or_clearly_lit_has_a_block() -> None:
    block, sure = np.array([[1, 2, 3, -1]], np.int32), np.array([[True, False, False, False]])
    gray = GrayImage(block, np.float32([[1, 6, 7, 50]]), sure)
    np.testing.assert_array_equal(only_lit(gray, FrameNoise(16.0, 0.5), 20).block, [[1, -1, 3, -1]])


def test_a_tenth_of_the_patterns_is_enough_for_1024_blocks_and_2000_for_the_finest_grid() -> None:
    assert most_patterns(BlockGrid(Raster(1280, 720), 32, 32)) <= 1058 / 10
    assert most_patterns(BlockGrid(Raster(1280, 720), 512, 512)) <= 2000
