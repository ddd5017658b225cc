"""The noise of decoded transport: theory against Monte Carlo, as the paper's figure 13 compares codes and impulses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slopegate.core.exposure.sensor import SensorModel
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.codes import CodedPatterns, CodeKind, Codes, make_codes
from slopegate.core.transport.decode import decode
from slopegate.core.transport.gray import gray_patterns
from slopegate.core.transport.noise import FrameNoise, PixelLight, Use, noise_gain, variance

RASTER = Raster(1280, 720)
READ = FrameNoise(read_variance=16.0, variance_per_count=0.0)
SHOT = FrameNoise(read_variance=0.0, variance_per_count=0.5)
BOTH = FrameNoise(read_variance=400.0, variance_per_count=0.5)
NOISES = pytest.mark.parametrize("noise", [READ, SHOT, BOTH], ids=["read", "shot", "both"])
TRIALS = 20_000


def decoded(codes: Codes, light: np.ndarray, noise: FrameNoise, repeats: float = 1.0) -> np.ndarray:
    """Columns (blocks, TRIALS) from noisy frames of one pixel with this light of blocks; repeats: frames a pattern."""
    rng = np.random.default_rng(7)
    patterns = np.stack([codes.values(number).ravel() for number in range(codes.count)]).astype(np.float64)
    clean = np.repeat((patterns @ light)[:, None], TRIALS, axis=1)
    frames = clean + rng.normal(0, math.sqrt(noise.read_variance / repeats), clean.shape)
    if noise.variance_per_count:
        electrons = repeats / noise.variance_per_count
        frames += rng.poisson(clean * electrons) / electrons - clean
    return decode(codes, frames.astype(np.float32)).astype(np.float64)


def lights(blocks: int) -> dict[str, np.ndarray]:
    """A pixel that one block lights, as in direct light, and one that all do."""
    direct = np.zeros(blocks)
    direct[blocks // 3] = 3000.0
    return {"direct": direct, "everywhere": np.random.default_rng(8).uniform(20, 60, blocks)}


def measured(codes: Codes, use: Use, light: np.ndarray, found: np.ndarray) -> float:
    """Variance of what is made of columns (blocks, TRIALS): those of one block without block 0 in the mean."""
    error = found - light[:, None]
    if use == "column":
        return float((error[1:] ** 2).mean())
    if use == "floodlit":
        return float((error.sum(axis=0) ** 2).mean())
    halves = np.random.default_rng(9).integers(0, 2, error.shape)
    return float(((error * halves).sum(axis=0) ** 2).mean())


@NOISES
@pytest.mark.parametrize("use", ["column", "floodlit", "relit"])
@pytest.mark.parametrize(("kind", "grid"), [("hadamard", (8, 8)), ("hadamard", (15, 4)), ("s", (8, 8)), ("s", (9, 7))])
def test_variances_are_those_of_theory(kind: CodeKind, grid: tuple[int, int], use: Use, noise: FrameNoise) -> None:
    codes = make_codes(kind, BlockGrid(RASTER, *grid))
    for name, light in lights(codes.grid.count).items():
        found = measured(codes, use, light, decoded(codes, light, noise))
        expected = variance(codes, use, PixelLight(light.sum(), light[1:].mean()), noise)
        assert found == pytest.approx(expected, rel=0.05), name


@NOISES
@pytest.mark.parametrize("use", ["column", "floodlit", "relit"])
def test_impulses_have_the_variance_of_theory(use: Use, noise: FrameNoise) -> None:
    codes = make_codes("impulse", BlockGrid(RASTER, 8, 8))
    light = lights(64)["everywhere"]
    found = measured(codes, use, light, decoded(codes, light, noise))
    expected = variance(codes, use, PixelLight(light.sum(), light[1:].mean()), noise)
    assert found == pytest.approx(expected, rel=0.05)


@NOISES
@pytest.mark.parametrize("use", ["column", "floodlit"])
@pytest.mark.parametrize("kind", ["hadamard", "s"])
def test_codes_gain_over_impulses_at_equal_frames_what_theory_says(kind: CodeKind, use: Use, noise: FrameNoise) -> None:
    codes, dots = (make_codes(each, BlockGrid(RASTER, 8, 8)) for each in (kind, "impulse"))
    for name, light in lights(64).items():
        gained = measured(codes, use, light, decoded(codes, light, noise))
        lost = measured(dots, use, light, decoded(dots, light, noise, repeats=codes.count / 64))
        expected = noise_gain(codes, use, PixelLight(light.sum(), light[1:].mean()), noise)
        assert math.sqrt(lost / gained) == pytest.approx(expected, rel=0.05), name


def test_the_corner_block_takes_the_noise_of_a_whole_frame_unless_a_column_is_spare() -> None:
    light = lights(64)["everywhere"]
    codes = make_codes("hadamard", BlockGrid(RASTER, 8, 8))
    corner = (decoded(codes, light, BOTH)[0] - light[0]).var()
    assert corner == pytest.approx(400 + 0.5 * light.sum(), rel=0.06)
    spare = make_codes("hadamard", BlockGrid(RASTER, 9, 7))
    corner = (decoded(spare, light[:63], BOTH)[0] - light[0]).var()
    assert corner == pytest.approx(variance(spare, "column", PixelLight(light[:63].sum(), 0), BOTH), rel=0.05)


def test_gains_are_the_square_roots_that_are_told() -> None:
    codes = make_codes("hadamard", BlockGrid(RASTER, 32, 32))
    light = PixelLight(total=1000.0, column=100.0)
    assert noise_gain(codes, "column", light, READ) == pytest.approx(16)
    assert noise_gain(codes, "floodlit", light, READ) == pytest.approx(32)
    assert noise_gain(codes, "column", light, SHOT) == pytest.approx(math.sqrt(1024 * 0.1 / 2))
    assert noise_gain(codes, "floodlit", light, SHOT) == pytest.approx(1)


@pytest.mark.parametrize("use", ["column", "floodlit", "relit"])
def test_impulses_gain_nothing_over_themselves(use: Use) -> None:
    codes: CodedPatterns = make_codes("impulse", BlockGrid(RASTER, 5, 3))
    assert noise_gain(codes, use, PixelLight(50.0, 3.0), BOTH) == 1


def test_gray_code_gains_what_its_frames_are_fewer_and_its_pairs_are_more() -> None:
    codes = gray_patterns(BlockGrid(RASTER, 512, 512))
    light = PixelLight(1000.0, 1000.0)
    assert variance(codes, "column", light, BOTH) == pytest.approx((800 + 500) / 19)
    assert noise_gain(codes, "column", light, READ) == pytest.approx(math.sqrt(512 * 512 / 38 * 19 / 2))


def test_a_sensors_noise_falls_with_the_frames_that_are_averaged() -> None:
    sensor = SensorModel(electrons_per_count=2.0, read_noise_e=8.0)
    assert FrameNoise.of(sensor) == FrameNoise(16.0, 0.5)
    assert FrameNoise.of(sensor, 4) == FrameNoise(4.0, 0.125)
