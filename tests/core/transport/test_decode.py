"""Decoding: single columns against the light they were made of, and against a dense solution."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.codes import CODE_KINDS, CodeKind, Codes, factor, make_codes
from slopegate.core.transport.decode import decode

RASTER = Raster(1280, 720)


def frames_of(codes: Codes, light: np.ndarray) -> np.ndarray:
    """What each pixel shows under each pattern, float32, from light of blocks (blocks, P) float64."""
    patterns = np.stack([codes.values(number).ravel() for number in range(codes.count)])
    return (patterns.astype(np.float64) @ light).astype(np.float32)


@pytest.mark.parametrize("kind", CODE_KINDS)
@pytest.mark.parametrize("grid", [(4, 2), (3, 3), (16, 9), (32, 32), (40, 30)])
def test_single_columns_come_back(kind: CodeKind, grid: tuple[int, int]) -> None:
    codes = make_codes(kind, BlockGrid(RASTER, *grid))
    light = np.random.default_rng(1).random((codes.grid.count, 33)) ** 4 * 1000
    found = decode(codes, frames_of(codes, light))
    assert found.shape == light.shape
    assert (np.abs(found - light) <= 1e-6 * light.sum(axis=0)).all()


@given(
    st.sampled_from(CODE_KINDS), st.integers(1, 12), st.integers(1, 12), st.integers(1, 70), st.integers(0, 2**32 - 1)
)
def test_any_grid_and_any_number_of_pixels(kind: CodeKind, columns: int, rows: int, pixels: int, seed: int) -> None:
    codes = make_codes(kind, BlockGrid(RASTER, columns, rows))
    light = np.random.default_rng(seed).integers(0, 4096, (codes.grid.count, pixels)).astype(np.float64)
    found = decode(codes, frames_of(codes, light))
    assert (np.abs(found - light) <= 1e-6 * light.sum(axis=0)).all()


def test_a_pixel_that_one_block_lights_has_only_that_block() -> None:
    codes = make_codes("hadamard", BlockGrid(RASTER, 8, 8))
    light = np.zeros((64, 64))
    np.fill_diagonal(light, 4000.0)
    # Sums of whole counts below 2^24 are exact.
    assert (decode(codes, frames_of(codes, light)) == light).all()


@pytest.mark.parametrize("kind", ["hadamard", "sequency", "s"])
@pytest.mark.parametrize("grid", [(4, 2), (7, 5), (13, 1), (16, 4)])
def test_noise_is_decoded_as_the_least_squares_solution_would(kind: CodeKind, grid: tuple[int, int]) -> None:
    codes = make_codes(kind, BlockGrid(RASTER, *grid))
    patterns = np.stack([codes.values(number).ravel() for number in range(codes.count)]).astype(np.float64)
    frames = np.random.default_rng(2).normal(100, 10, (codes.count, 5))
    expected = np.linalg.lstsq(patterns, frames)[0]
    assert np.allclose(decode(codes, frames.astype(np.float32)), expected, atol=1e-4)


def test_the_result_is_in_place() -> None:
    codes = make_codes("hadamard", BlockGrid(RASTER, 5, 3))
    frames = np.ones((codes.count, 4), np.float32)
    assert decode(codes, frames).base is frames


def test_frames_of_other_codes_are_a_bug() -> None:
    with pytest.raises(ValueError, match="do not fit 8 patterns"):
        decode(make_codes("hadamard", BlockGrid(RASTER, 4, 2)), np.zeros((9, 4), np.float32))


@pytest.mark.parametrize("frames", [np.zeros((8, 4)), np.zeros((4, 8), np.float32).T])
def test_frames_of_another_type_or_order_are_a_bug(frames: np.ndarray) -> None:
    with pytest.raises(ValueError, match="float32 and C-contiguous"):
        decode(make_codes("hadamard", BlockGrid(RASTER, 4, 2)), frames)


def test_threads_decode_tiles_side_by_side_to_the_same_bits() -> None:
    codes = make_codes("s", BlockGrid(RASTER, 16, 16))
    frames = np.random.default_rng(6).normal(500, 100, (codes.count, 700)).astype(np.float32)
    tiles = [np.ascontiguousarray(frames[:, first : first + 100]) for first in range(0, 700, 100)]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda tile: decode(codes, tile), tiles))
    assert (np.concatenate(found, axis=1) == decode(codes, frames)).all()


def lit(codes: Codes, rows: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """Whether these rows of the matrix (R, 1) light these blocks (B,): bools (R, B)."""
    small = factor(codes.order)
    rest = codes.order // small.shape[0]
    columns = blocks + codes.first
    odd = np.bitwise_count((rows % rest) & (columns % rest)) & 1
    positive = (small[rows // rest, columns // rest] > 0) == (odd == 0)
    return ~positive if codes.kind == "s" else positive


def largest_error(codes: Codes, pixels: int, columns: int) -> float:
    """Worst error of all single columns over the fully lit value of pixels that some random columns light."""
    rng = np.random.default_rng(3)
    for number in rng.integers(0, codes.count, 3):
        every = lit(codes, codes.places()[[number]][:, None], np.arange(codes.grid.count))
        assert (codes.values(int(number)).ravel() == every[0]).all()
    frames, light = np.empty((codes.count, pixels), np.float32), np.zeros((codes.grid.count, pixels))
    for pixel in range(pixels):
        chosen = rng.choice(codes.grid.count, columns, replace=False)
        light[chosen, pixel] = rng.random(columns) ** 3
        for first in range(0, codes.count, 4096):
            rows = codes.places()[first : first + 4096, None]
            frames[first : first + 4096, pixel] = lit(codes, rows, chosen) @ light[chosen, pixel]
    total = light.sum(axis=0)
    light -= decode(codes, frames)
    return float((np.abs(light) / total).max())


@pytest.mark.parametrize("kind", ["hadamard", "s"])
def test_single_columns_of_large_grids(kind: CodeKind) -> None:
    assert largest_error(make_codes(kind, BlockGrid(RASTER, 128, 64)), 4, 200) <= 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hadamard", "sequency", "s"])
def test_single_columns_of_512x512(kind: CodeKind) -> None:
    assert largest_error(make_codes(kind, BlockGrid(RASTER, 512, 512)), 4, 1000) <= 1e-6
