"""Lens blur against sums written out, and against what a blurred lens does to a fine grating."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from rigs import check_rig
from slopegate.core.exposure.blur import BlurredDirect, blurred, gaussian_taps
from slopegate.core.exposure.gated import gated
from slopegate.core.gating.gate import RowWindows, recorded_times, row_windows
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate

HEIGHT, WIDTH = 33, 70


def blurred_rig(camera_px: float, projector_px: float) -> Rig:
    rig = check_rig(WIDTH, height=HEIGHT)
    camera, projector = (replace(rig.camera, blur_px=camera_px), replace(rig.projector, blur_px=projector_px))
    return replace(rig, camera=camera, projector=projector)


def views(seed: int = 3) -> tuple[Singles, Singles]:
    """Projector rows that rise downwards with steps in them, a few of them unlit, and light."""
    rng = np.random.default_rng(seed)
    row = np.linspace(100, 500, HEIGHT)[:, None] + 60 * (np.arange(WIDTH) > 40) + rng.normal(0, 2, (HEIGHT, WIDTH))
    row[rng.random(row.shape) < 0.1] = -1
    direct = rng.random((HEIGHT, WIDTH)) * (row >= 0)
    return row.astype(np.float32), direct.astype(np.float32)


def windows_of(low: float, width: float, inside: int, outside: int) -> RowWindows:
    lows = low + 10 * np.arange(HEIGHT)
    ones = np.ones(HEIGHT, np.int32)
    return RowWindows(lows, lows + width, inside * ones, outside * ones)


def written_out(rig: Rig, row: Singles, direct: Singles, windows: RowWindows) -> Doubles:
    """The double sum of the module's head, pixel by pixel."""
    taps, sigma = gaussian_taps(rig.camera.blur_px).astype(np.float64), rig.projector.blur_px
    reach = len(taps) // 2
    out, share = np.zeros(row.shape), np.zeros(row.shape)
    for k in range(HEIGHT):
        for m in range(max(k - reach, 0), min(k + reach + 1, HEIGHT)):
            weight: Doubles = recorded_times(windows, np.full(WIDTH, k), row[m]).astype(np.float64)
            if sigma > 0:
                cut = [0.0, rig.projector.lens.height, windows.low[k], windows.high[k]]
                edges = norm.cdf((np.clip(cut, 0, cut[1])[:, None] - row[m].astype(np.float64)) / sigma)
                held, all_of_it = edges[3] - edges[2], edges[1] - edges[0]
                weight = windows.outside[k] * (all_of_it - held) + windows.inside[k] * held
            for i in range(-reach, reach + 1):
                columns = np.arange(max(-i, 0), min(WIDTH - i, WIDTH))
                out[k, columns + i] += taps[reach + k - m] * taps[reach + i] * (weight * direct[m])[columns]
                share[k, columns + i] += taps[reach + k - m] * taps[reach + i]
    return out / share


@pytest.mark.parametrize("camera_px", [0.0, 0.3, 0.8, 2.5])
@pytest.mark.parametrize("projector_px", [0.0, 0.7, 4.0])
@pytest.mark.parametrize("counts", [(1, 0), (2, 1), (0, 1)])
def test_direct_light_is_the_sum_written_out(camera_px: float, projector_px: float, counts: tuple[int, int]) -> None:
    rig, (row, direct), windows = blurred_rig(camera_px, projector_px), views(), windows_of(90, 70, *counts)
    found = np.zeros_like(direct)
    BlurredDirect(rig, row, direct).add(windows, found)
    np.testing.assert_allclose(found, written_out(rig, row, direct, windows), rtol=2e-5, atol=2e-6)


def test_colours_are_blurred_one_by_one() -> None:
    rig, (row, direct), windows = blurred_rig(1.0, 0.5), views(), windows_of(90, 70, 1, 0)
    colour = np.stack([direct, 2 * direct, 0 * direct], axis=2)
    found = np.ones_like(colour)
    BlurredDirect(rig, row, colour).add(windows, found)
    grey = np.zeros_like(direct)
    BlurredDirect(rig, row, direct).add(windows, grey)
    np.testing.assert_allclose(found, 1 + np.stack([grey, 2 * grey, 0 * grey], axis=2), rtol=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.floats(-50, 800), st.floats(0, 900), st.integers(0, 2), st.integers(0, 2))
def test_without_blur_it_is_the_gate_itself(low: float, width: float, inside: int, outside: int) -> None:
    (row, direct), windows = views(), windows_of(low, width, inside, outside)
    found = np.zeros_like(direct)
    BlurredDirect(blurred_rig(0.0, 0.0), row, direct).add(windows, found)
    np.testing.assert_array_equal(found, gated(row, direct, 0 * direct, windows, 0.0))


def test_a_gate_of_one_period_blurs_as_any_lens() -> None:
    rig, (_, direct) = blurred_rig(1.2, 0.0), views()
    row = np.full_like(direct, 300)
    found = np.zeros_like(direct)
    BlurredDirect(rig, row, direct).add(row_windows(rig, gate(1.0, 0.0, rig.projector.period_us)), found)
    np.testing.assert_allclose(found, blurred(direct, 1.2), rtol=1e-5)
    assert blurred(np.ones((9, 9, 3), np.float32), 1.2) == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize(("sigma", "slack"), [(0.3, 0.02), (0.6, 0.02), (0.66, 0.02), (0.815, 1e-3), (3.0, 1e-4)])
def test_the_taps_transfer_as_their_gaussian_does(sigma: float, slack: float) -> None:
    taps = gaussian_taps(sigma).astype(np.float64)
    for frequency in (0.05, 0.14, 0.25):
        phases = 2 * np.pi * frequency * (np.arange(len(taps)) - len(taps) // 2)
        assert (taps * np.cos(phases)).sum() == pytest.approx(np.exp(-2 * (np.pi * frequency * sigma) ** 2), abs=slack)


@pytest.mark.parametrize("blur", [-0.1, np.inf, np.nan, 21.0])
def test_absurd_blur_is_refused(blur: float) -> None:
    with pytest.raises(InputError, match="blur_px"):
        blurred_rig(blur, 0.0)
    with pytest.raises(InputError, match="blur_px"):
        blurred_rig(0.0, blur)
