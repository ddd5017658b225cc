"""The beat of a camera, from stamps with everything in them that happens to stamps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.rig.cadence import MIN_INTERVALS, cadence, missed_triggers


@given(
    period_us=st.floats(2000, 200_000),
    jitter_share=st.floats(0, 0.02),
    seed=st.integers(0, 999),
    spoiled=st.floats(0, 0.15),
)
def test_period_and_jitter_come_back_whatever_else_happens(
    period_us: float, jitter_share: float, seed: int, spoiled: float
) -> None:
    """A share of the triggers is missed, one of the frames lost, one late by half a period: none moves the figures."""
    random, count = np.random.default_rng(seed), 400
    jitter_us = jitter_share * period_us
    trigger = np.arange(count)
    times_us = trigger * period_us + jitter_us * random.standard_normal(count)
    fate = random.random(count)
    heard = trigger[fate > spoiled]
    times_us = np.where((fate > spoiled) & (fate < 1.5 * spoiled), times_us + period_us / 2, times_us)[heard]
    sequences = np.arange(heard.size)
    arrived = random.random(heard.size) > spoiled
    got = cadence(times_us[arrived] * 1e-6, sequences[arrived], np.ones(int(arrived.sum()), np.bool_))
    assert got is not None
    # over all seeds medians of some 300 intervals are off by 0.27 of the jitter at most, and by 0.65 of it
    assert got.period_us == pytest.approx(period_us, rel=1e-9 + 0.35 * jitter_share)
    assert got.jitter_us == pytest.approx(jitter_us, rel=0.75, abs=1e-6 * period_us)
    assert got.steady == (4 * got.jitter_us < got.period_us / 4)


def test_figures_of_a_known_series() -> None:
    """Every other frame 10 us late: intervals of 50 ms +- 10 us."""
    times_s = np.arange(20) * 0.05 + (np.arange(20) % 2) * 1e-5
    got = cadence(times_s, np.arange(20), np.ones(20, np.bool_))
    assert got is not None
    assert got.frames == 20
    assert got.worst_us == pytest.approx(20.0, abs=0.01)
    assert got.period_us == pytest.approx(50_010.0, abs=0.01)
    assert got.jitter_us == pytest.approx(0.0, abs=0.01), "more than half of the intervals are equal"


def test_what_lies_before_a_frame_that_is_not_settled_says_nothing() -> None:
    times_s, settled = np.arange(20) * 0.05, np.ones(20, np.bool_)
    times_s[10:] += 0.013
    held_up = cadence(times_s, np.arange(20), settled)
    settled[10] = False
    left_out = cadence(times_s, np.arange(20), settled)
    assert held_up is not None
    assert left_out is not None
    assert (round(held_up.worst_us), round(left_out.worst_us)) == (13_000, 0)


@pytest.mark.parametrize("count", [0, 1, MIN_INTERVALS])
def test_too_few_frames_say_nothing(count: int) -> None:
    assert cadence(np.arange(count) * 0.05, np.arange(count), np.ones(count, np.bool_)) is None


def test_stamps_that_stand_still_or_go_back_say_nothing() -> None:
    many = np.arange(50)
    for times_s in (np.zeros(50), -0.05 * many):
        assert cadence(times_s, many, np.ones(50, np.bool_)) is None
    assert cadence(0.05 * many, 0 * many, np.ones(50, np.bool_)) is None


@given(st.integers(1, 20), st.integers(0, 20), st.floats(-0.2, 0.2), st.floats(2000, 200_000))
def test_missed_triggers_are_whole_periods_without_a_number(
    steps: int, missed: int, off: float, period_us: float
) -> None:
    assert missed_triggers((steps + missed + off) * period_us, steps, period_us) == missed


@pytest.mark.parametrize(("periods", "steps"), [(1.5, 1), (0.5, 1), (0.0, 1), (2.3, 2), (1.0, 2), (-1.0, 1)])
def test_frames_off_the_beat_show_no_missed_trigger(periods: float, steps: int) -> None:
    assert missed_triggers(periods * 50_000, steps, 50_000) is None


def test_no_jitter_is_steady_and_half_a_period_is_not() -> None:
    random = np.random.default_rng(1)
    times_s = np.cumsum(random.exponential(0.05, 100))
    free = cadence(times_s, np.arange(100), np.ones(100, np.bool_))
    even = cadence(np.arange(100) * 0.05, np.arange(100), np.ones(100, np.bool_))
    assert free is not None
    assert even is not None
    assert even.steady
    assert not free.steady
    assert math.isfinite(free.jitter_us)
