"""Frames of black and of all on: their noise, and whether there is any light."""

from __future__ import annotations

import numpy as np
import pytest

from slopegate.core.transport.even import (
    ROUNDING_VARIANCE,
    EvenLight,
    RepeatedFrames,
    even_light,
    measured_noise,
    nonlinear_share,
)
from slopegate.core.transport.noise import FrameNoise

SHAPE = 60, 80


def repeated(mean: np.ndarray, read: float, per_count: float, count: int = 16, seed: int = 0) -> RepeatedFrames:
    draw, found = np.random.default_rng(seed), RepeatedFrames(SHAPE, 4095)
    for _ in range(count):
        noisy = draw.normal(mean, np.sqrt(read + per_count * (mean - 40)))
        found.add(np.clip(np.rint(noisy), 0, 4095).astype(np.uint16))
    return found


def test_noise_is_measured_from_frames() -> None:
    light = np.random.default_rng(1).uniform(0, 3000, SHAPE)
    black, white = repeated(np.full(SHAPE, 40.0), 16.0, 0.5), repeated(40 + light, 16.0, 0.5, seed=2)
    noise = measured_noise(black, white)
    assert noise.read_variance == pytest.approx(16 + 1 / 12, rel=0.02)
    assert noise.variance_per_count == pytest.approx(0.5, rel=0.02)
    np.testing.assert_allclose(white.mean - black.mean, light, atol=6 * np.sqrt(1520 / 16))


def test_without_noise_there_is_still_rounding() -> None:
    black, white = repeated(np.full(SHAPE, 40.0), 0.0, 0.0), repeated(np.full(SHAPE, 1040.0), 0.0, 0.0)
    assert measured_noise(black, white) == FrameNoise(ROUNDING_VARIANCE, 0.0)


def test_saturated_pixels_are_counted() -> None:
    image = np.full(SHAPE, 40.0)
    image[:6] = 5000
    assert repeated(image, 0.0, 0.0).saturated_share == pytest.approx(0.1)


@pytest.mark.parametrize("count", [1, 16])
def test_light_is_told_from_noise_in_a_pixel_and_in_a_square(count: int) -> None:
    noise, nothing = FrameNoise(16.0, 0.5), np.full(SHAPE, 40.0)

    def is_dark(white: np.ndarray, seed: int) -> bool:
        black = repeated(nothing, 16.0, 0.5, count, seed)
        return even_light(black, repeated(white, 16.0, 0.5, count, seed + 100), noise).is_dark

    assert all(is_dark(nothing, seed) for seed in range(20))
    single, faint = nothing.copy(), nothing.copy()
    single[30, 40] += 80
    faint[20:40, 20:40] += 14 / np.sqrt(count)
    assert not any(is_dark(single, seed) for seed in range(20))
    assert not any(is_dark(faint, seed) for seed in range(20))


def test_what_a_pattern_and_its_inverse_miss() -> None:
    black, light = np.full(SHAPE, 40, np.float32), np.full(SHAPE, 1000, np.float32)
    even = EvenLight(black, light, 1, FrameNoise(16.0, 0.5))
    assert nonlinear_share(2 * black + light, even) == 0
    assert nonlinear_share(2 * black + np.float32(1.1) * light, even) == pytest.approx(0.1, rel=0.05)


def test_light_that_is_lost_in_noise_is_not_said_to_miss_anything() -> None:
    draw, noise = np.random.default_rng(7), FrameNoise(16.0, 0.5)
    for _ in range(50):
        white, black, first, second = (draw.normal(40, 4, SHAPE).astype(np.float32) for _ in range(4))
        even = EvenLight(black, white - black + np.float32(0.1), 1, noise)
        assert nonlinear_share(first + second, even) == 0
