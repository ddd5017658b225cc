"""Likeness to the fog-free scene against exposure: what is predicted is what frames show, on average."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import check_rig
from slopegate.core.exposure.sensor import SensorModel, expose
from slopegate.core.measure.exposure_sweep import (
    Likeness,
    best_exposure_us,
    expected_likeness,
    exposures_us,
    fog_target,
    measured_likeness,
    sweep_gates,
)
from slopegate.core.measure.quality import contrast, ncc
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import Steps

SENSOR = SensorModel()
PERIOD_US = 16666.7


def sign(height: int = 80, width: int = 100) -> np.ndarray:
    """Linear light of a bright figure on a darker ground."""
    y, x = np.mgrid[:height, :width]
    return np.where(np.hypot(x - width / 2, y - height / 2) < 25, 0.9, 0.2).astype(np.float32)


@given(
    signal=st.floats(0.001, 1.5),
    veil=st.floats(0, 1),
    electrons=st.floats(0.5, 20),
    read_noise_e=st.floats(0, 30),
    seed=st.integers(0, 1000),
)
def test_what_is_expected_is_what_frames_show_on_average(
    signal: float, veil: float, electrons: float, read_noise_e: float, seed: int
) -> None:
    """Saturation included. Whole counts hide a signal below one where there is no noise: that is left out."""
    sensor = SensorModel(electrons_per_count=electrons, read_noise_e=max(read_noise_e, electrons))
    y = np.mgrid[:80, :100][0]
    light = (signal * sign() + veil * y / 80).astype(np.float32)
    target = fog_target(sign())
    rng = np.random.default_rng(seed)
    frames = [expose(light, sensor, rng) for _ in range(12)]
    seen, told = measured_likeness(frames, target, sensor.black_count), expected_likeness(light, target, sensor)
    # Of 8000 pixels a frame's NCC scatters by less than 1 / sqrt(8000), the mean of 12 by less than a third of that.
    assert seen.ncc == pytest.approx(told.ncc, abs=4 / math.sqrt(8000 * 12) + 0.002)
    lit = float(light.max()) * sensor.counts_per_unit < sensor.max_count - 400
    if lit:
        assert seen.cnr == pytest.approx(told.cnr, rel=0.03, abs=0.1)
    if lit and signal > 0.05:
        assert seen.contrast == pytest.approx(told.contrast, rel=0.02, abs=0.02)


def test_without_noise_it_is_the_ncc_itself() -> None:
    rng = np.random.default_rng(0)
    light = (sign() + rng.uniform(0, 0.3, sign().shape)).astype(np.float32)
    quiet = SensorModel(counts_per_unit=1e6, electrons_per_count=1e6, read_noise_e=0, max_count=65535, black_count=0)
    quiet = replace(quiet, counts_per_unit=40000.0)
    told = expected_likeness(light, fog_target(sign()), quiet)
    assert told.ncc == pytest.approx(ncc(light, sign()), abs=1e-6)
    bright = sign() > 0.5
    assert told.contrast == pytest.approx(contrast(light, bright, ~bright), abs=1e-9)


def test_darkness_and_saturation_show_nothing() -> None:
    target = fog_target(sign())
    assert expected_likeness(np.zeros_like(sign()), target, SENSOR) == Likeness(0.0, 0.0, 0.0)
    full = expected_likeness(np.full_like(sign(), 10), target, SENSOR)
    assert (full.ncc, full.contrast) == (0.0, 0.0)
    white = np.full((80, 100), 4095, np.uint16)
    assert measured_likeness([white, white], target, SENSOR.black_count) == Likeness(0.0, 0.0, 0.0)


def test_only_the_region_is_looked_at() -> None:
    image = np.zeros((100, 140), np.float32)
    image[10:90, 20:120] = sign()
    target = fog_target(image, (20, 10, 120, 90))
    np.testing.assert_array_equal(target.reference, sign())
    np.testing.assert_array_equal(target.cut(image), sign())
    np.testing.assert_array_equal(target.bright, sign() > 0.5)
    assert not (target.bright & target.dark).any()


@pytest.mark.parametrize(
    ("region", "said"),
    [((0, 0, 101, 80), "region is"), ((5, 5, 5, 9), "x0 < x1"), ((0, 0, 5, 5), "reference is 'constant'")],
)
def test_a_region_that_shows_nothing_is_refused(region: tuple[int, int, int, int], said: str) -> None:
    with pytest.raises(InputError, match=said):
        fog_target(sign(), region)


def test_one_frame_is_not_enough() -> None:
    with pytest.raises(InputError, match="frames is 1: it must be at least 2"):
        measured_likeness([np.zeros((80, 100), np.uint16)], fog_target(sign()), 0.0)


def test_exposures_run_from_the_least_to_a_whole_period_at_equal_ratios() -> None:
    shutter = check_rig(320).camera.shutter
    found = exposures_us(shutter, PERIOD_US, 40)
    assert len(found) == 40
    assert found[0] == 100
    assert found[-1] == 16667
    ratios = np.diff(np.log(found))
    np.testing.assert_allclose(ratios, math.log(PERIOD_US / 100) / 39, atol=0.006)
    gates = sweep_gates(shutter, PERIOD_US, 13.0, 2028.5, 40)
    assert [one.exposure_us for one in gates] == list(found)
    assert {(one.line_time_us, one.delay_us) for one in gates} == {(13.0, 2028.5)}


def test_coarse_and_short_shutters_give_fewer_but_distinct_ones() -> None:
    shutter = check_rig(320).camera.shutter
    coarse = exposures_us(replace(shutter, exposure_us=Steps(0.0, 50000.0, 500.0)), PERIOD_US, 40)
    assert coarse[0] == 500
    assert coarse[-1] == 16500
    assert len(coarse) < 40
    assert list(coarse) == sorted(set(coarse))
    assert all(one % 500 == 0 for one in coarse)
    short = exposures_us(replace(shutter, exposure_us=Steps(100.0, 9000.0, 1.0)), PERIOD_US, 40)
    assert short[-1] == 9000
    assert exposures_us(replace(shutter, exposure_us=Steps(40000.0, 50000.0, 1.0)), PERIOD_US, 40) == (40000.0,)
    with pytest.raises(InputError, match="count is 1"):
        exposures_us(shutter, PERIOD_US, 1)


def test_the_best_is_the_most_like_the_reference() -> None:
    seen = [Likeness(value, 0.0, 0.0) for value in (0.1, 0.7, 0.7, 0.3)]
    assert best_exposure_us((1.0, 2.0, 3.0, 4.0), seen) == 2.0
