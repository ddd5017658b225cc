from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from slopegate.core.exposure import kernels
from slopegate.core.exposure.sensor import (
    NoisePool,
    Plates,
    SensorModel,
    auto_gain,
    bayer_rg,
    expose,
    expose_fast,
    frames_of_light,
    mono,
    noise_pool,
)

SENSOR = SensorModel(counts_per_unit=1000.0, electrons_per_count=2.0, read_noise_e=8.0, black_count=40.0)
HEIGHT, WIDTH = 64, 512


def everything(height: int = HEIGHT) -> kernels.Windows:
    """Every lit pixel recorded once."""
    zeros, ones = np.zeros(height, np.float32), np.ones(height, np.int32)
    return kernels.Windows(zeros, zeros, ones, ones)


def flat_plates(direct: float, ambient: float = 0.0, sensor: SensorModel = SENSOR, height: int = HEIGHT) -> Plates:
    shape = (height, WIDTH)
    rows = np.full(shape, 100, np.float32)
    return Plates(rows, np.full(shape, direct, np.float32), np.full(shape, ambient, np.float32), sensor)


POOL = noise_pool(np.random.default_rng(11), WIDTH)


def frames(
    plates: Plates, count: int, periods: float = 1.0, seed: int = 4, pool: NoisePool = POOL
) -> NDArray[np.uint16]:
    height = plates.planes.direct.shape[0]
    out = np.empty((count, height, WIDTH), np.uint16)
    for index in range(count):
        expose_fast(plates, everything(height), periods, pool.frame(seed, index), out[index])
    return out


@pytest.mark.parametrize(("direct", "ambient"), [(0.0, 0.0), (0.01, 0.0), (0.2, 0.1), (2.0, 0.5)])
def test_live_noise_has_the_mean_and_variance_of_the_physics(direct: float, ambient: float) -> None:
    made = frames(flat_plates(direct, ambient), 200, periods=0.5).astype(np.float64)
    mean = (direct + 0.5 * ambient) * 1000
    variance = mean / 2.0 + 16.0
    # The noise of 6.5 million pixels, of which about 131072 are independent.
    assert made.mean() - 40 == pytest.approx(mean, abs=5 * np.sqrt(variance / 131072) + 1 / 16)
    assert made.var() == pytest.approx(variance + 1 / 12, rel=0.02)


def test_exact_noise_has_the_mean_and_variance_of_the_physics() -> None:
    made = expose(np.full((400, 500), 0.3, np.float32), SENSOR, np.random.default_rng(5)).astype(np.float64)
    assert made.mean() - 40 == pytest.approx(300, abs=5 * np.sqrt(166 / made.size))
    assert made.var() == pytest.approx(300 / 2 + 16 + 1 / 12, rel=0.02)


def correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


def test_live_noise_is_uncorrelated_between_pixels_rows_and_frames() -> None:
    made = frames(flat_plates(1.0), 60).astype(np.float64)
    for lag in (1, 2, 3, 7, 64):
        assert abs(correlation(made[:, :, lag:], made[:, :, :-lag])) < 5 / np.sqrt(131072)
        assert abs(correlation(made[:, lag % 61 :], made[:, : -(lag % 61)])) < 5 / np.sqrt(131072)
    for lag in (1, 2, 5):
        assert abs(correlation(made[lag:], made[:-lag])) < 5 / np.sqrt(131072)


def test_averaging_live_frames_lowers_the_noise_as_it_should() -> None:
    made = frames(flat_plates(1.0), 400).astype(np.float64)
    assert made.mean(axis=0).std() == pytest.approx(np.sqrt(516 / 400), rel=0.03)


def test_the_pool_is_standard_normal() -> None:
    values = POOL.values[:131072] / 4096.0
    assert abs(values.mean()) < 1e-5
    assert values.var() == pytest.approx(1.0, abs=1e-5)
    assert stats.kstest(values, "norm").pvalue > 1e-3
    np.testing.assert_array_equal(POOL.values[131072:], POOL.values[:WIDTH])


def test_noise_is_fixed_by_seed_and_frame() -> None:
    plates = flat_plates(0.5)
    np.testing.assert_array_equal(frames(plates, 3), frames(plates, 3))
    again = noise_pool(np.random.default_rng(11), WIDTH)
    np.testing.assert_array_equal(frames(plates, 3, pool=again), frames(plates, 3))
    first, second, third = frames(plates, 3).astype(int)
    assert (first != second).mean() > 0.9
    assert (second != third).mean() > 0.9
    assert (frames(plates, 1, seed=5)[0] != first).mean() > 0.9


def true_probabilities(mean_e: float, sensor: SensorModel) -> NDArray[np.float64]:
    """Cumulative probability of count <= k of Poisson electrons plus normal read noise, by summing over electrons."""
    electrons = np.arange(int(mean_e + 12 * np.sqrt(mean_e) + 20))
    weights = stats.poisson.pmf(electrons, mean_e)
    edges_e = (np.arange(sensor.max_count) + 0.5 - sensor.black_count) * sensor.electrons_per_count
    return np.array([weights @ stats.norm.cdf((edge - electrons) / sensor.read_noise_e) for edge in edges_e[:400]])


@pytest.mark.parametrize("read_noise_e", [2.0, 8.0])
@pytest.mark.parametrize("mean_e", [0.5, 3.0, 20.0, 128.0, 300.0])
def test_the_normal_stays_within_its_stated_distance_of_poisson(mean_e: float, read_noise_e: float) -> None:
    sensor = replace(SENSOR, read_noise_e=read_noise_e, electrons_per_count=1.0)
    edges_e = np.arange(400) + 0.5 - sensor.black_count
    normal = stats.norm.cdf((edges_e - mean_e) / np.sqrt(mean_e + read_noise_e**2))
    bound = 0.0665 * mean_e / (mean_e + read_noise_e**2) ** 1.5
    truth = true_probabilities(mean_e, sensor)
    assert np.abs(normal - truth).max() <= 1.05 * bound + 1e-4
    # And the frames that are really made follow that normal.
    made = frames(flat_plates(mean_e / 1000, sensor=sensor), 16)
    found = np.searchsorted(np.sort(made.ravel()), np.arange(400), side="right") / made.size
    assert np.abs(found - truth).max() <= 1.05 * bound + 0.006


def test_light_beyond_full_scale_saturates_and_darkness_stays_at_black() -> None:
    assert (frames(flat_plates(1e6), 2) == 4095).all()
    assert (frames(flat_plates(9.0), 2) == 4095).all()
    deep = replace(SENSOR, black_count=0.0)
    dark = frames(flat_plates(0.0, sensor=deep), 4)
    assert dark.min() == 0
    assert (dark == 0).mean() == pytest.approx(stats.norm.cdf(0.5 / 4), abs=0.01)
    assert (expose(np.full((4, 4), 1e30), SENSOR, np.random.default_rng(0)) == 4095).all()


def test_fixed_point_is_off_by_at_most_half_a_step() -> None:
    rng = np.random.default_rng(8)
    radiance = rng.random((HEIGHT, WIDTH)).astype(np.float32) * 3.9
    ambient = rng.random((HEIGHT, WIDTH)).astype(np.float32) * 20
    plates = Plates(np.full_like(radiance, 5), radiance, ambient, SENSOR)
    direct_counts = plates.planes.direct * plates.direct_step
    assert plates.direct_step == 0.125
    assert np.abs(direct_counts - radiance * 1000.0).max() <= 0.0635
    ambient_counts = plates.planes.ambient * plates.ambient_step
    assert np.abs(ambient_counts - ambient * 1000.0).max() <= 20000 / 65535 / 2 + 0.003


def test_a_noiseless_frame_is_the_rounded_signal() -> None:
    radiance = np.linspace(0, 4, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    plates = Plates(np.full_like(radiance, 5), radiance, np.zeros_like(radiance), SENSOR)
    out = np.empty((HEIGHT, WIDTH), np.uint16)
    expose_fast(plates, everything(), 1.0, POOL.frame(0, 0, noisy=False), out)
    exact = np.minimum(radiance.astype(np.float64) * 1000 + 40, 4095)
    assert np.abs(out - exact).max() <= 0.5 + 0.0635


def test_refreshed_plates_equal_new_ones() -> None:
    rng = np.random.default_rng(9)
    rows, direct, ambient = (rng.random((HEIGHT, WIDTH)).astype(np.float32) for _ in range(3))
    old = Plates(rows, direct, ambient, SENSOR)
    where = (slice(11, 30), slice(100, 301))
    rows[where], direct[where], ambient[where] = rows[where] * 500 - 20, direct[where] * 2, ambient[where] / 2
    assert old.refresh(*where, direct[where], ambient[where])
    new = Plates(rows, direct, ambient, SENSOR)
    assert old.ambient_step == new.ambient_step
    for name in ("projector_row", "direct", "ambient", "tile_low", "tile_high"):
        np.testing.assert_array_equal(getattr(old.planes, name), getattr(new.planes, name))
    before = old.planes.direct.copy()
    assert not old.refresh(*where, direct[where] + 1, ambient[where] + 2)
    np.testing.assert_array_equal(old.planes.direct, before)


def test_auto_gain_puts_the_bright_end_at_eighty_percent() -> None:
    rng = np.random.default_rng(1)
    scene = rng.random((200, 300)).astype(np.float32)
    scene[:150] = 0
    sensor = auto_gain(scene, SENSOR)
    counts = np.percentile(scene[150:], 99.5) * sensor.counts_per_unit + sensor.black_count
    assert counts == pytest.approx(0.8 * 4095, rel=1e-3)
    assert auto_gain(np.zeros((5, 5), np.float32), SENSOR) == SENSOR


def test_colour_filters() -> None:
    rgb = np.zeros((4, 6, 3), np.float32)
    rgb[..., 0], rgb[..., 1], rgb[..., 2] = 1, 2, 3
    np.testing.assert_array_equal(bayer_rg(rgb)[:2, :2], [[1, 2], [2, 3]])
    full = np.random.default_rng(0).random((10, 12, 3)).astype(np.float32)
    np.testing.assert_array_equal(bayer_rg(full)[3:9, 5:10], bayer_rg(full[3:9, 5:10], 3, 5))
    assert mono(rgb)[0, 0] == pytest.approx(0.2126 + 2 * 0.7152 + 3 * 0.0722)
    assert mono(np.ones((2, 2, 3), np.float32)).dtype == np.float32


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("counts_per_unit", 0.0),
        ("electrons_per_count", np.nan),
        ("read_noise_e", -1.0),
        ("black_count", 4095.0),
        ("max_count", 0),
    ],
)
def test_an_impossible_sensor_is_refused_by_name(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        replace(SENSOR, **{field: value})


@pytest.mark.parametrize("bad", [np.nan, -0.1, np.inf])
def test_impossible_radiance_is_refused(bad: float) -> None:
    image = np.ones((3, 3), np.float32)
    image[1, 1] = bad
    with pytest.raises(ValueError, match="radiance"):
        expose(image, SENSOR, np.random.default_rng(0))


def test_frames_of_light_have_the_sensor_s_noise_and_share_it() -> None:
    """Two lights under one seed differ by their light, so that a difference below the noise is seen."""
    light = np.linspace(0.05, 1.2, 120 * 160, dtype=np.float32).reshape(120, 160)
    frames = np.stack(frames_of_light(light, SENSOR, 3, 40)).astype(np.float64)
    mean = light * SENSOR.counts_per_unit + SENSOR.black_count
    electrons = SENSOR.electrons_per_count
    variance = (mean - SENSOR.black_count) / electrons + (SENSOR.read_noise_e / electrons) ** 2 + 1 / 12
    assert abs((frames.mean(axis=0) - mean).mean()) < 0.3
    assert (frames.var(axis=0, ddof=1) / variance).mean() == pytest.approx(1, abs=0.01)
    np.testing.assert_array_equal(frames, frames_of_light(light, SENSOR, 3, 40))
    brighter = np.stack(frames_of_light(light * np.float32(1.001), SENSOR, 3, 40))
    gained = (brighter - frames).mean(axis=0)
    assert np.corrcoef(gained.ravel(), mean.ravel())[0, 1] > 0.9
    assert (np.stack(frames_of_light(light, SENSOR, 4, 1)) != frames[:1]).any()
