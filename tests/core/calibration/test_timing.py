"""The timing of a rig from gated pictures of a flat target: directions, numbers and their standard errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slopegate.core.calibration.informative import FIRST, GOAL, enough, gates_needed, lacking, next_gates, nominal_of
from slopegate.core.calibration.target import FlatTarget
from slopegate.core.calibration.timing import GateTiming, fit_timing, shot_noise
from slopegate.core.calibration.timing_errors import pulse_width
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import quantise
from tests.support.gated_target import (
    GatedTarget,
    HiddenTiming,
    drawn_rig,
    drawn_target,
    drawn_timing,
    measured,
    off_us,
    small_rig,
)


def drawn_camera(seed: int, scale: float = 1.0) -> GatedTarget:
    """A rig whose file is wrong in all that the timing tells, with faults of its trigger, and fog in every third."""
    random = np.random.default_rng(seed)
    rig, target = drawn_rig(random, scale), drawn_target(random)
    fog = 0.3 if seed % 3 == 0 else 0.0
    hidden = drawn_timing(random, jitter_us=float(random.uniform(0, 5)), missed=0.05, fog=fog)
    believed = replace(rig, projector=replace(rig.projector, active_fraction=0.92))
    return GatedTarget(rig, target, hidden, random, believed)


def sigmas(timing: GateTiming, camera: GatedTarget) -> list[float]:
    """By how many of their standard errors row time, line time, offset and excess of the exposure are off."""
    errors = timing.standard_errors
    return [
        (timing.values[0] - 1 / camera.rig.projector.rows_per_us) / errors[0],
        (timing.stretch - camera.hidden.stretch) / errors[1],
        off_us(timing, camera.hidden) / errors[2],
        timing.values[3] / errors[3],
    ]


def directions_right(timing: GateTiming, camera: GatedTarget) -> bool:
    return (timing.projector, timing.camera) == (camera.hidden.projector, camera.hidden.camera)


@pytest.mark.parametrize("seed", [0, 1, 201])
def test_missed_triggers_jitter_and_fog_leave_the_timing_right(seed: int) -> None:
    camera = drawn_camera(seed)
    timing, _ = measured(camera, most=60, every=24)
    assert timing is not None
    assert directions_right(timing, camera)
    assert np.abs(sigmas(timing, camera)).max() < 4


@pytest.mark.slow
def test_every_number_is_within_three_standard_errors_in_98_percent() -> None:
    off: list[list[float]] = []
    for seed in range(200):
        camera = drawn_camera(1000 + seed)
        timing, _ = measured(camera, most=84, every=24)
        assert timing is not None, seed
        assert directions_right(timing, camera), seed
        off.append(sigmas(timing, camera))
    within = (np.abs(off) <= 3).mean(axis=0)
    print("within three standard errors:", within, "rms:", np.sqrt(np.mean(np.square(off), axis=0)))
    assert (within >= 0.98).all()


def test_the_offset_is_known_to_a_microsecond_where_the_geometry_is_true() -> None:
    rig = small_rig(0.9)
    target = drawn_target(np.random.default_rng(1))
    camera = GatedTarget(rig, target, HiddenTiming(1234.5, 0.99, jitter_us=5.0, missed=0.05), np.random.default_rng(2))
    timing, shots = measured(camera)
    verdict = enough(timing)
    assert timing is not None
    assert verdict.enough, verdict.reason
    assert "the delay offset to 0.3" in verdict.reason
    assert len(shots) <= 400
    assert abs(off_us(timing, camera.hidden)) < 1.0
    assert timing.stretch == pytest.approx(0.99, rel=1e-3)
    assert timing.active_fraction == pytest.approx(0.9, rel=1e-3)
    assert timing.jitter_us == pytest.approx(5.0, rel=0.2)


def test_light_that_bends_alike_beside_all_edges_counts_however_many_there_are() -> None:
    camera = drawn_camera(4)
    _, shots = measured(camera, most=48, every=18)
    nominal = nominal_of(camera.believed or camera.rig, 0.05)

    def told(bent_rows: float, alike: bool) -> GateTiming:
        draw = np.random.default_rng(1)
        moved = []
        for shot in shots:
            sign = 1.0 if alike else float(draw.choice([-1.0, 1.0]))
            edges = tuple(
                # towards the side that is lit
                replace(edge, bent_rows=sign * bent_rows * (1 if edge.rising else -1))
                for edge in shot.edges
            )
            moved.append(replace(shot, edges=edges))
        return fit_timing(moved, nominal)

    clear, noise, fog = told(0.0, True), told(0.3, False), told(0.3, True)
    assert np.array_equal(noise.values, clear.values)
    assert np.array_equal(fog.values, clear.values)
    assert noise.standard_errors == pytest.approx(clear.standard_errors, rel=1e-6)
    assert (fog.standard_errors[:4] > 1.5 * clear.standard_errors[:4]).any()


def test_proposed_gates_need_fewer_frames_than_random_ones() -> None:
    believed, errors = small_rig(), {}
    for way in ("proposed", "random"):
        random = np.random.default_rng(5)
        target = drawn_target(np.random.default_rng(5))
        camera = GatedTarget(believed, target, HiddenTiming(-3210.0, 1.01, jitter_us=1.0), random)
        if way == "proposed":
            timing, _ = measured(camera, most=48)
        else:
            shutter, period = believed.camera.shutter, believed.projector.period_us
            nominal, shots = nominal_of(believed, 0.05), []
            for settings in next_gates(believed, camera.sight, [], None, 3 * FIRST):
                delay, exposure = random.uniform(-0.5, 0.5) * period, random.uniform(0.1, 0.9) * period
                anything = replace(settings, delay_us=delay, exposure_us=exposure)
                shots.append(camera.shot(quantise(shutter, anything, period)))
            shots += [camera.shot(replace(shot.settings, delay_us=shot.settings.delay_us + 700)) for shot in shots * 3]
            timing = fit_timing(shots, nominal)
        assert timing is not None
        errors[way] = timing.standard_errors[2]
    assert errors["proposed"] < errors["random"]


def test_first_gates_have_two_line_times_where_there_are() -> None:
    """One alone tells no active fraction, so that nothing believable would ever be fitted."""
    target = FlatTarget((-0.053, -0.282, 1.212))
    camera = GatedTarget(small_rig(), target, HiddenTiming(0.0), np.random.default_rng(1))
    first = next_gates(camera.rig, camera.sight, [], None, FIRST)
    assert len({one.line_time_us for one in first}) >= 2


def test_too_few_edges_are_named() -> None:
    with pytest.raises(InputError, match="number of edges that the gates show on the plane is 0"):
        fit_timing([], nominal_of(small_rig(), 0.05))


def test_what_lacks_is_said() -> None:
    assert "do not tell a timing yet" in enough(None).reason
    camera = GatedTarget(
        small_rig(), drawn_target(np.random.default_rng(1)), HiddenTiming(50.0, jitter_us=5.0), np.random.default_rng(1)
    )
    timing, shots = measured(camera, most=20)
    verdict = enough(timing, GOAL)
    assert not verdict.enough
    assert "the delay offset is known to" in verdict.reason
    assert "should be to 0.33 us" in verdict.reason
    assert timing is not None
    worst = max(lacking(timing, GOAL))
    needed = gates_needed(timing, len(shots), GOAL)
    assert worst > 1
    assert len(shots) * worst**2 <= needed < 1.1 * len(shots) * worst**2 + 1


def test_two_trigger_edges_tell_the_pulse() -> None:
    rig, target = small_rig(), drawn_target(np.random.default_rng(3))
    timings = []
    for offset in (400.0, 2400.0):
        camera = GatedTarget(rig, target, HiddenTiming(offset, jitter_us=2.0), np.random.default_rng(int(offset)))
        timing, _ = measured(camera, most=60, every=24)
        assert timing is not None
        timings.append(timing)
    pulse = pulse_width(*timings)
    assert pulse.second == "falling"
    assert abs(pulse.width_us - 2000.0) < 3 * pulse.error_us
    assert pulse.error_us < 5.0
    assert pulse_width(*timings[::-1]).second == "rising"


@pytest.mark.parametrize("seed", range(5))
def test_a_shot_of_one_poor_edge_hides_no_jitter(seed: int) -> None:
    random = np.random.default_rng(seed)
    shot = np.append(np.repeat(np.arange(30), 20), 30)
    errors = np.append(np.full(600, 2.0), 60.0)
    missed = random.normal(0, 5.0, 31)[shot] + random.normal(0, 1, 601) * np.append(np.full(600, 2.0), 1.0)
    jitter, scale = shot_noise(missed, shot, errors)
    assert jitter == pytest.approx(5.0, rel=0.4)
    assert scale == pytest.approx(1.0, abs=0.1)
