from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigs import WIDE_LIMITS, plain_rig
from slopegate.core.exposure import kernels
from slopegate.core.exposure.edges import kernel_windows, make_planes
from slopegate.core.exposure.sensor import noise_pool
from slopegate.core.gating.gate import RowWindows, complement, row_windows, weights
from slopegate.core.rig.settings import GateSettings, gate

HEIGHT, WIDTH = 48, 200
RIG = plain_rig(WIDTH, HEIGHT, 1000 / 15, WIDE_LIMITS)
PERIOD_US = RIG.projector.period_us


def test_edges_that_a_float32_holds_stay_and_others_go_to_the_next_above() -> None:
    held = np.array([0.0, 3.5, 719.99993896484375, -1.25])
    above = np.nextafter(held.astype(np.float32), np.float32(np.inf))
    between = held + np.array([1e-50, 1e-12, 1e-9, 1e-12])
    counts = np.zeros(4, np.int32)
    windows = kernel_windows(RowWindows(held, between, counts, counts))
    np.testing.assert_array_equal(windows.low, held.astype(np.float32))
    np.testing.assert_array_equal(windows.high, above)


def some_rows(seed: int = 1) -> NDArray[np.float32]:
    """Projector rows that vary slowly, jump at edges, and are missing in patches and for one whole tile."""
    rng = np.random.default_rng(seed)
    k, j = np.mgrid[0:HEIGHT, 0:WIDTH]
    rows = 15.0 * k + 8 * np.sin(j / 30) + 60 * (j > 90) + rng.random((HEIGHT, WIDTH))
    rows = np.clip(rows, 0, 719.999).astype(np.float32)
    rows[10:20, 30:70] = -1
    rows[:, 64:128][5:8] = -1
    return rows


def unculled(planes: kernels.Planes) -> kernels.Planes:
    low, high = np.full_like(planes.tile_low, -np.inf), np.full_like(planes.tile_high, np.inf)
    return planes._replace(tile_low=low, tile_high=high)


def run_gate(planes: kernels.Planes, settings: GateSettings) -> tuple[NDArray[np.float32], int]:
    out = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    periods = np.float32(settings.exposure_us / PERIOD_US)
    skipped = kernels.gate(planes, kernel_windows(row_windows(RIG, settings)), periods, out)
    return out, skipped


def linear_planes() -> kernels.Planes:
    rng = np.random.default_rng(2)
    rows = some_rows()
    direct = rng.integers(1, 4000, rows.shape).astype(np.float32) * (rows >= 0)
    ambient = rng.integers(1, 500, rows.shape).astype(np.float32)
    return make_planes(rows, direct, ambient)


any_gate = st.builds(
    gate,
    line_time_us=st.floats(50, 800),
    delay_us=st.floats(-20000, 40000),
    exposure_us=st.floats(1, 60000),
)


def slow_reference(rows: NDArray[np.float32], settings: GateSettings) -> NDArray[np.float32]:
    """Light up one projector row after the other, frame after frame, and see which camera rows are exposed."""
    out = np.zeros_like(rows)
    speed = RIG.projector.rows_per_us
    for frame in range(-8, 9):
        for j in range(720):
            lit_us = frame * PERIOD_US + (j + 0.5) / speed
            for k in range(HEIGHT):
                centre_us = settings.delay_us + (k + 0.5) * settings.line_time_us
                if centre_us - settings.exposure_us / 2 <= lit_us < centre_us + settings.exposure_us / 2:
                    lit = np.floor(rows[k]) == j
                    out[k, lit] += 1
    return out


@pytest.mark.parametrize(
    "settings",
    [gate(319.4, 150.0, 400.0), gate(400.0, -900.0, 3000.0), gate(300.0, 9000.0, 16000.0), gate(347.2, 500.0, 40000.0)],
    ids=["thin", "thick", "nearly a period", "beyond two periods"],
)
def test_agrees_with_lighting_one_row_after_the_other(settings: GateSettings) -> None:
    rows = some_rows()
    lit = (rows >= 0).astype(np.float32)
    fast, _ = run_gate(make_planes(rows, lit, np.zeros_like(rows)), settings)
    slow = slow_reference(rows, settings)
    windows = row_windows(RIG, settings)
    edge = np.minimum(np.abs(rows - windows.low[:, None]), np.abs(rows - windows.high[:, None]))
    away = edge > 0.5
    assert away.mean() > 0.9
    assert slow.any()
    np.testing.assert_array_equal(fast[away], slow[away])
    # The reference lights a whole row at once, so within half a row of an edge it may count one time more or less.
    assert np.abs(fast - slow)[~away].max(initial=0.0) <= 1


@given(any_gate)
def test_culling_changes_nothing(settings: GateSettings) -> None:
    planes = linear_planes()
    culled, _ = run_gate(planes, settings)
    compared, _ = run_gate(unculled(planes), settings)
    np.testing.assert_array_equal(culled, compared)


@given(any_gate)
def test_float32_kernel_decides_as_float64_does(settings: GateSettings) -> None:
    planes = linear_planes()
    windows = row_windows(RIG, settings)
    # Rows exactly at, just below and just above the rounded edges are the hard ones.
    for k, edge in enumerate(windows.low if settings.delay_us > 0 else windows.high):
        near = np.float32(edge)
        planes.projector_row[k, :3] = np.clip(
            [np.nextafter(near, np.float32(-1)), near, np.nextafter(near, np.float32(1e4))], 0, 719
        )
    planes = make_planes(planes.projector_row, planes.direct, np.zeros_like(planes.ambient))
    out, _ = run_gate(planes, settings)
    np.testing.assert_array_equal(out, weights(windows, planes.projector_row) * planes.direct)


@pytest.mark.parametrize("count", [2, 7, 30])
def test_slices_that_tile_the_delays_add_up_exactly(count: int) -> None:
    planes = linear_planes()
    dark = planes._replace(ambient=np.zeros_like(planes.ambient))
    edges_us = np.round(np.linspace(0, PERIOD_US, count + 1) * 1000) / 1000
    edges_us[-1] = PERIOD_US
    total = np.zeros((HEIGHT, WIDTH), np.float32)
    for start, end in pairwise(edges_us):
        total += run_gate(dark, gate(347.2, (start + end) / 2, end - start))[0]
    np.testing.assert_array_equal(total, planes.direct)


@given(any_gate)
def test_gate_and_complement_add_up_exactly(settings: GateSettings) -> None:
    periods = int(np.ceil(settings.exposure_us / PERIOD_US))
    if periods * PERIOD_US <= settings.exposure_us:
        return
    planes = linear_planes()
    dark = planes._replace(ambient=np.zeros_like(planes.ambient))
    total = run_gate(dark, settings)[0] + run_gate(dark, complement(settings, PERIOD_US))[0]
    np.testing.assert_array_equal(total, periods * planes.direct)


def test_tiles_without_light_are_not_read() -> None:
    planes = linear_planes()
    poisoned = planes._replace(direct=np.full_like(planes.direct, 1e9))
    behind_everything = gate(319.4, 5000.0, 100.0)
    out, skipped = run_gate(poisoned, behind_everything)
    assert skipped == out.size
    np.testing.assert_array_equal(out, np.float32(100.0 / PERIOD_US) * planes.ambient)
    _, skipped = run_gate(planes, gate(319.4, 150.0, 400.0))
    assert 0.2 < skipped / out.size < 0.9
    unlit = np.full((HEIGHT, WIDTH), -1, np.float32)
    _, skipped = run_gate(make_planes(unlit, np.zeros_like(unlit), planes.ambient), gate(319.4, 0.0, 50000.0))
    assert skipped == out.size


@given(any_gate, st.integers(0, 2**63))
def test_noisy_frame_is_the_same_without_culling(settings: GateSettings, seed: int) -> None:
    linear = linear_planes()
    planes = make_planes(linear.projector_row, linear.direct.astype(np.uint16), linear.ambient.astype(np.uint16))
    response = kernels.Response(*map(np.float32, (0.125, 0.5, 0.5, 16.0, 40.5, 4095)))
    noise = noise_pool(np.random.default_rng(3), WIDTH).frame(seed, 5)
    windows = kernel_windows(row_windows(RIG, settings))
    frames = [np.zeros((HEIGHT, WIDTH), np.uint16) for _ in range(2)]
    for frame, view in zip(frames, (planes, unculled(planes)), strict=True):
        kernels.expose(view, windows, response, noise, frame)
    np.testing.assert_array_equal(frames[0], frames[1])
