"""The depth sweep, told frames made from known projector rows by the gate's own slow reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigs import WIDE_LIMITS, bent, check_rig, plain_rig, turned
from slopegate.core.exposure.sensor import SensorModel, expose
from slopegate.core.gating.gate import phase_us, row_windows, upright_line_time, weights
from slopegate.core.gating.slices import phase_range
from slopegate.core.measure.sweep import DepthMap, DepthSweep, SweepSettings, depth_error
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, Steps, quantise
from slopegate.core.rig.triangulate import projector_rows, triangulate

HEIGHT, WIDTH = 60, 80
BLACK = 40.0


def make_rig(rotation_deg: float = 0.0, bend: float = 0.0, step_us: float = 1.0) -> Rig:
    """The check rig with 80 x 60 pixels; its projector turned about x and bent as told."""
    delay, exposure = Steps(-16667.0, 33334.0, step_us), Steps(100.0, 50000.0, step_us)
    rig = check_rig(WIDTH, ladder=tuple(map(float, range(10, 129))), delay=delay, exposure=exposure)
    rig = turned(rig, (rotation_deg, 0.0, 0.0), rig.projector_offset_m)
    return bent(rig, camera=(), projector=(bend, 0.0, 0.0, 0.0))


def rows_of(rig: Rig, inverse_depth: NDArray[np.float64]) -> NDArray[np.float32]:
    """The projector rows that light surfaces at these depths (H, W), 0 for none."""
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    depth = 1 / np.where(inverse_depth > 0, inverse_depth, 1.0)
    _, row, _ = rig.to_projector(rig.camera_rays(columns, rows) * depth[..., None] + rig.camera_centre_m)
    lit = (inverse_depth > 0) & (row >= 0) & (row < 720)
    return np.where(lit, row, -1).astype(np.float32)


def some_depths(seed: int) -> NDArray[np.float64]:
    """A wall with tilted cards before it, 0.4 to 2.5 m away, and some holes."""
    rng = np.random.default_rng(seed)
    inverse = np.full((HEIGHT, WIDTH), 0.4)
    for _ in range(5):
        y, x = rng.integers(0, HEIGHT - 20), rng.integers(0, WIDTH - 20)
        patch = (slice(y, y + 20), slice(x, x + rng.integers(8, 20)))
        inverse[patch] = rng.uniform(0.5, 2.4) + rng.uniform(-0.01, 0.01) * np.arange(20)[:, None]
    inverse[rng.random(inverse.shape) < 0.1] = 0
    return inverse


Take = Callable[[GateSettings], NDArray[np.uint16]]


def take_from(
    rig: Rig, row_of: NDArray[np.float32], direct: float = 0.5, ambient: float = 0.05, seed: int | None = None
) -> Take:
    """A camera that sees these projector rows; with a seed its shot and read noise too."""
    rng = None if seed is None else np.random.default_rng(seed)

    def take(applied: GateSettings) -> NDArray[np.uint16]:
        seen = weights(row_windows(rig, applied), row_of) * direct
        light = (seen + ambient * applied.exposure_us / rig.projector.period_us).astype(np.float32)
        if rng is None:
            return np.floor(light * 2000 + BLACK + 0.5).astype(np.uint16)
        return expose(light, SensorModel(), rng)

    return take


def run(rig: Rig, sweep: DepthSweep, take: Take) -> DepthMap:
    for _ in range(2000):
        asked = sweep.ask()
        if asked is None:
            return sweep.result()
        applied = quantise(rig.camera.shutter, asked, rig.projector.period_us)
        sweep.tell(take(applied), applied)
    raise AssertionError("the sweep does not end")


@given(
    seed=st.integers(0, 10_000),
    rotation_deg=st.sampled_from([0.0, 0.0, -3.0, 2.0]),
    bend=st.sampled_from([0.0, 0.08]),
    noise=st.booleans(),
)
@settings(max_examples=25)
def test_every_lit_pixel_is_within_half_a_row(seed: int, rotation_deg: float, bend: float, noise: bool) -> None:
    rig = make_rig(rotation_deg, bend)
    row_of = rows_of(rig, some_depths(seed))
    sweep = DepthSweep(rig, BLACK, SweepSettings(least_share=0.0))
    found = run(rig, sweep, take_from(rig, row_of, seed=seed if noise else None))
    lit = row_of >= 0
    known = found.projector_row >= 0
    assert np.count_nonzero(known & lit) >= 0.999 * np.count_nonzero(lit)
    assert not (known & ~lit).any()
    # half a row, and half a microsecond by which the shutter's steps move an edge
    assert np.abs(found.projector_row - row_of)[known].max() < 0.5 + 0.06
    np.testing.assert_allclose(found.inverse_depth, triangulate(rig, found.projector_row), rtol=1e-5)
    assert found.frames == sweep.frames
    assert sweep.share_done == 1.0


def test_the_error_is_what_half_a_cell_makes() -> None:
    rig = make_rig()
    inverse = np.linspace(0.4, 2.4, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    row_of = rows_of(rig, inverse)
    found = run(rig, DepthSweep(rig, BLACK), take_from(rig, row_of))
    error = depth_error(found, row_of, inverse.astype(np.float32))
    assert error is not None
    # evenly spread within a cell of 0.01 1/m: its width over the root of 12, times z^2
    lit = row_of >= 0
    expected_mm = float(np.sqrt(np.mean((1 / inverse[lit] ** 2 * 0.01 / np.sqrt(12)) ** 2)) * 1000)
    assert error.rms_mm == pytest.approx(expected_mm, rel=0.1)
    assert error.median_mm < error.p95_mm
    assert error.known_share > 0.999
    assert error.wrong_share == 0
    none = run(rig, DepthSweep(rig, BLACK), take_from(rig, np.full_like(row_of, -1)))
    assert depth_error(none, row_of, inverse.astype(np.float32)) is None


def test_it_takes_far_fewer_frames_than_equal_steps() -> None:
    rig = make_rig()
    found = run(rig, DepthSweep(rig, BLACK), take_from(rig, rows_of(rig, some_depths(3))))
    assert found.plain_frames > 300
    assert found.frames < found.plain_frames / 4


def test_a_plain_sweep_of_that_many_steps_is_no_finer() -> None:
    """Windows one after the other, as many as `plain_frames`, tell each pixel's row no better than the sweep."""
    rig = make_rig()
    row_of = rows_of(rig, some_depths(4))
    sweep = DepthSweep(rig, BLACK, SweepSettings(least_share=0.0))
    found = run(rig, sweep, take_from(rig, row_of))
    line_time = upright_line_time(rig)
    start, _ = phase_range(rig, line_time, 0.3)
    rows = (np.arange(HEIGHT) + 0.5)[:, None]
    step = 1 / rig.projector.rows_per_us
    cell = np.floor((row_of * step - rows * line_time - start) / step)
    assert cell[row_of >= 0].max() < sweep.plain_frames
    plain = ((cell + 0.5) * step + start + rows * line_time) / step
    lit = row_of >= 0
    assert np.abs(found.projector_row - row_of)[lit].mean() < np.abs(plain - row_of)[lit].mean() * 1.1


@pytest.mark.parametrize("nearest_m", [0.05, 0.3])
@pytest.mark.parametrize(("pitch_deg", "least"), [(-25.0, 1.9), (0.0, 1.9), (10.0, 0.6), (30.0, 0.9), (36.0, 1.9)])
def test_the_range_of_phases_is_what_the_projectors_frame_lets_be_lit(
    pitch_deg: float, least: float, nearest_m: float
) -> None:
    """Two projector rows wider at either end; against points all along many rays, those beside the frame left out."""
    rig = turned(plain_rig(WIDTH, HEIGHT, 125.0, WIDE_LIMITS), (pitch_deg, 0.0, 0.0), (0.0, -0.1, 0.0))
    line_time, speed = upright_line_time(rig), rig.projector.rows_per_us
    columns, rows = np.meshgrid(np.linspace(0, WIDTH, 33), np.linspace(0.5, HEIGHT - 0.5, 33))
    at = projector_rows(rig, rig.camera_rays(columns, rows)[..., None, :], np.linspace(0, 1 / nearest_m, 2001))
    phases = phase_us(rig, line_time, rows[..., None], at)[(at >= 0) & (at <= 720)]
    start, end = phase_range(rig, line_time, nearest_m)
    wider = np.array([phases.min() - start, end - phases.max()]) * speed
    # less where a turned projector's rows bend between the rays that were tried; points of one ray are a row apart
    assert least < wider.min() <= wider.max() < 3.2


def test_an_empty_scene_costs_two_frames() -> None:
    rig = make_rig()
    found = run(rig, DepthSweep(rig, BLACK), take_from(rig, np.full((HEIGHT, WIDTH), -1, np.float32), seed=1))
    assert found.frames == 2
    assert not (found.inverse_depth > 0).any()


def test_one_plane_costs_little_more_than_its_halvings() -> None:
    rig = make_rig()
    found = run(rig, DepthSweep(rig, BLACK), take_from(rig, rows_of(rig, np.full((HEIGHT, WIDTH), 0.7))))
    assert found.frames <= 2 + np.ceil(np.log2(found.plain_frames)) + 1 + 1
    assert found.disparity_rows[30, 40] == pytest.approx(70, abs=0.6)
    assert found.depth_m[30, 40] == pytest.approx(1 / 0.7, rel=0.01)


def test_a_frame_cuts_wide_intervals_that_lie_near_together() -> None:
    """Short exposures record little ambient light. A partner anywhere makes them 1.7 times as long; cutting the first
    intervals before the wide ones takes more frames."""
    rig = make_rig()
    row_of = rows_of(rig, np.repeat(np.linspace(0.5, 2.46, 8), WIDTH // 8)[None, :].repeat(HEIGHT, axis=0))
    sweep, take, exposures_us = DepthSweep(rig, BLACK), take_from(rig, row_of), []
    while (asked := sweep.ask()) is not None:
        applied = quantise(rig.camera.shutter, asked, rig.projector.period_us)
        exposures_us.append(applied.exposure_us)
        sweep.tell(take(applied), applied)
    assert len(exposures_us) <= 30
    assert np.mean(exposures_us[2:]) < 1250


def test_finer_cells_give_finer_depth() -> None:
    rig = make_rig()
    row_of = rows_of(rig, np.linspace(0.4, 2.4, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH))
    lit = row_of >= 0
    errors = []
    for finest in (4.0, 1.0, 0.25):
        found = run(rig, DepthSweep(rig, BLACK, SweepSettings(finest_rows=finest)), take_from(rig, row_of))
        errors.append(float(np.abs(found.projector_row - row_of)[lit & (found.projector_row >= 0)].mean()))
        assert found.resolution_rows == finest
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


def test_a_pixel_that_contradicts_itself_is_unknown() -> None:
    """A patch that flickers: what is not lost is at least not far off."""
    rig = make_rig()
    row_of = rows_of(rig, some_depths(8))
    steady, flicker = take_from(rig, row_of), np.random.default_rng(0)
    frames = 0

    def take(applied: GateSettings) -> NDArray[np.uint16]:
        nonlocal frames
        image = steady(applied)
        frames += 1
        if frames > 2:
            patch = image[10:20, 10:20]
            patch[flicker.random(patch.shape) < 0.5] = BLACK
        return image

    found = run(rig, DepthSweep(rig, BLACK, SweepSettings(least_share=0.0)), take)
    rest = np.ones(row_of.shape, bool)
    rest[10:20, 10:20] = False
    good = np.abs(found.projector_row - row_of) < 0.6
    assert np.all(good[rest & (row_of >= 0)])
    inside = ~rest & (row_of >= 0)
    assert np.count_nonzero((found.projector_row >= 0) & ~good & inside) < 0.2 * inside.sum()


def test_what_moved_during_the_sweep_is_unknown() -> None:
    rig = make_rig()
    inverse = np.full((HEIGHT, WIDTH), 0.5)
    before, after = inverse.copy(), inverse.copy()
    before[20:40, 5:25] = after[20:40, 45:65] = 2.0
    takes = [take_from(rig, rows_of(rig, depths)) for depths in (before, after)]
    frames = 0

    def take(applied: GateSettings) -> NDArray[np.uint16]:
        nonlocal frames
        frames += 1
        return takes[frames > 7](applied)

    found = run(rig, DepthSweep(rig, BLACK, SweepSettings(least_share=0.0)), take)
    moved = before != after
    known = found.inverse_depth > 0
    wrong = known & (np.abs(found.inverse_depth - before) > 0.02) & (np.abs(found.inverse_depth - after) > 0.02)
    assert np.count_nonzero(known & ~moved & (rows_of(rig, before) >= 0)) > 0.99 * np.count_nonzero(
        ~moved & (rows_of(rig, before) >= 0)
    )
    assert not wrong.any()


def test_a_few_stray_pixels_are_not_followed() -> None:
    rig = make_rig()
    inverse = np.full((HEIGHT, WIDTH), 0.5)
    row_of = rows_of(rig, inverse)
    alone = run(rig, DepthSweep(rig, BLACK, SweepSettings(least_share=0.001)), take_from(rig, row_of)).frames
    inverse[30, 40] = inverse[31, 3] = 2.0
    row_of = rows_of(rig, inverse)
    found = run(rig, DepthSweep(rig, BLACK, SweepSettings(least_share=0.001)), take_from(rig, row_of))
    assert found.frames == alone
    assert found.projector_row[30, 40] == -1


def test_a_sweep_stopped_early_says_nothing_wrong() -> None:
    rig = make_rig()
    row_of = rows_of(rig, some_depths(9))
    take, sweep = take_from(rig, row_of), DepthSweep(rig, BLACK)
    assert sweep.share_done == 0.0
    done = []
    for _ in range(9):
        asked = sweep.ask()
        assert asked is not None
        applied = quantise(rig.camera.shutter, asked, rig.projector.period_us)
        sweep.tell(take(applied), applied)
        done.append(sweep.share_done)
        known = sweep.result().projector_row >= 0
        assert np.abs(sweep.result().projector_row - row_of)[known].max(initial=0) < 0.6
    assert done == sorted(done)
    assert 0 < done[-1] < 1


def test_refusals_name_the_field() -> None:
    rig = make_rig()
    with pytest.raises(ValueError, match="nearest_m"):
        SweepSettings(nearest_m=0.0)
    never_dark = replace(rig, projector=replace(rig.projector, active_fraction=1.0))
    with pytest.raises(ValueError, match=r"nearest_m is 0\.05"):
        DepthSweep(never_dark, BLACK, SweepSettings(nearest_m=0.05))
    with pytest.raises(ValueError, match=r"finest_rows is 0\.01"):
        DepthSweep(rig, BLACK, SweepSettings(finest_rows=0.01))
    sweep = DepthSweep(rig, BLACK)
    asked = sweep.ask()
    assert asked is not None
    with pytest.raises(ValueError, match="counts"):
        sweep.tell(np.zeros((3, 3), np.uint16), asked)
    take = take_from(rig, rows_of(rig, some_depths(1)))
    for _ in range(2):
        asked = sweep.ask()
        assert asked is not None
        sweep.tell(take(asked), asked)
    asked = sweep.ask()
    assert asked is not None
    moved = GateSettings(asked.line_time_us, type(asked.delay_us)(asked.delay_us + 300), asked.exposure_us)
    with pytest.raises(ValueError, match=r"the camera made delay .* were asked for"):
        sweep.tell(take(moved), moved)
