"""Gray code: patterns, and the block of each pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.gray import GrayCodes, decode_gray, gray_patterns
from slopegate.core.transport.noise import FrameNoise

RASTER = Raster(1280, 720)
CLEAN = FrameNoise(1e-6, 0.0)


def frames_of(codes: GrayCodes, block: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Frames (count, H, W) of pixels (H, W) that see one block each; -1 sees none."""
    patterns = np.stack([codes.values(number).ravel() for number in range(codes.count)])
    return (np.where(block < 0, 0, patterns[:, block]) * light).astype(np.float32)


def test_512x512_takes_38_frames() -> None:
    assert gray_patterns(BlockGrid(RASTER, 512, 512)).count == 38


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_every_pixel_has_its_block(columns: int, rows: int, seed: int) -> None:
    codes = gray_patterns(BlockGrid(RASTER, columns, rows))
    rng = np.random.default_rng(seed)
    block = rng.integers(-1, codes.grid.count, (5, 7))
    light = rng.uniform(1, 4000, (5, 7))
    found = decode_gray(codes, frames_of(codes, block, light), CLEAN)
    assert (found.block == block).all()
    assert (found.sure == (block >= 0)).all()
    assert np.allclose(found.value, np.where(block < 0, 0, light), rtol=1e-6)


def test_pairs_are_inverse_and_neighbours_differ_in_one_bit() -> None:
    codes = gray_patterns(BlockGrid(RASTER, 10, 6))
    patterns = np.stack([codes.values(number) for number in range(codes.count)]).astype(int)
    assert (patterns[0::2] + patterns[1::2] == 1).all()
    bits = patterns[2::2]
    assert (np.abs(np.diff(bits, axis=1)).sum(axis=0) == 1).all()
    assert (np.abs(np.diff(bits, axis=2)).sum(axis=0) == 1).all()


def test_the_light_has_the_noise_that_is_told() -> None:
    codes = gray_patterns(BlockGrid(RASTER, 16, 16))
    noise = FrameNoise(16.0, 0.5)
    rng = np.random.default_rng(4)
    clean = frames_of(codes, np.full((100, 100), 77), np.full((100, 100), 800.0))
    frames = clean + rng.normal(0, 1, clean.shape) * np.sqrt(noise.read_variance + noise.variance_per_count * clean)
    found = decode_gray(codes, frames.astype(np.float32), noise)
    assert (found.block == 77).all()
    assert found.value.mean() == pytest.approx(800, abs=1)
    expected = (2 * noise.read_variance + noise.variance_per_count * 800) / 9
    assert found.value.var() == pytest.approx(expected, rel=0.05)


def test_dark_pixels_have_no_block_and_dim_ones_are_not_sure() -> None:
    codes = gray_patterns(BlockGrid(RASTER, 16, 16))
    rng = np.random.default_rng(5)
    light = np.repeat([[0.0, 8.0, 400.0]], 2000, axis=0)
    clean = frames_of(codes, np.full(light.shape, 100), light)
    found = decode_gray(codes, (clean + rng.normal(0, 4, clean.shape)).astype(np.float32), FrameNoise(16.0, 0.0))
    assert (found.block[:, 0] == -1).mean() > 0.999
    assert not found.sure[:, :2].any()
    assert found.sure[:, 2].all()
    assert (found.block[:, 2] == 100).all()


def test_a_pixel_on_the_border_of_two_blocks_is_not_sure() -> None:
    codes = gray_patterns(BlockGrid(RASTER, 8, 8))
    light = np.full((1, 1), 500.0)
    both = [frames_of(codes, np.full((1, 1), block), light) for block in (10, 11)]
    found = decode_gray(codes, both[0] + both[1], FrameNoise(16.0, 0.5))
    assert not found.sure.any()
    assert found.value[0, 0] == pytest.approx(1000)


def test_a_code_that_no_block_has_is_no_block() -> None:
    large, small = (gray_patterns(BlockGrid(RASTER, columns, 4)) for columns in (8, 5))
    assert large.count == small.count
    found = decode_gray(small, frames_of(large, np.array([[6, 4]]), np.full((1, 2), 9.0)), CLEAN)
    assert found.block.tolist() == [[-1, 4]]
    assert found.sure.tolist() == [[False, True]]


def test_frames_of_other_codes_are_a_bug() -> None:
    with pytest.raises(ValueError, match="do not fit 8 patterns"):
        decode_gray(gray_patterns(BlockGrid(RASTER, 4, 2)), np.zeros((7, 4, 4), np.float32), CLEAN)
