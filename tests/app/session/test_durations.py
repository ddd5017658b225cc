"""Lengths of time: how much is left is measured."""

from __future__ import annotations

import pytest

from slopegate.app.session.durations import TimeLeft, time_text


def test_the_time_left_is_that_of_the_pace_so_far() -> None:
    now = [100.0]
    left = TimeLeft(lambda: now[0])
    assert left.seconds(0.2) is None, "where it begins is no pace"
    now[0] += 0.5
    assert left.seconds(0.3) is None, "too soon to tell"
    now[0] += 9.5
    assert left.seconds(0.4) == pytest.approx(30.0)
    now[0] += 30.0
    assert left.seconds(0.5) == pytest.approx(40 / 0.3 * 0.5), "it has become slower"
    assert left.text(0.5) == "1 min 7 s left"
    assert left.text(0.1) == "", "something else has begun"
    now[0] += 5.0
    assert left.seconds(0.6) == pytest.approx(4.0)
    assert left.seconds(1.0) == 0.0


def test_what_was_told_is_taken_back_when_it_is_over() -> None:
    """Work may stand still at a step that takes longer than those before."""
    now = [0.0]
    left = TimeLeft(lambda: now[0])
    assert left.later_text() == ""
    left.text(0.0)
    now[0] = 8.0
    assert left.text(0.8) == "2 s left"
    now[0] = 9.0
    assert left.later_text() == "1 s left"
    now[0] = 11.0
    assert left.later_text() == ""


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "1 s"), (61, "1 min 1 s"), (3600, "1 h 0 min"), (7000, "1 h 57 min")]
)
def test_times_are_short(seconds: float, text: str) -> None:
    assert time_text(seconds) == text


def test_what_there_is_to_do_may_become_more_or_less() -> None:
    now = [0.0]
    left = TimeLeft(lambda: now[0])
    assert left.seconds(100.0, 1000.0) is None
    now[0] = 10.0
    assert left.seconds(200.0, 1000.0) == pytest.approx(80.0)
    assert left.seconds(200.0, 2000.0) == pytest.approx(180.0)
    assert left.seconds(200.0, 300.0) == pytest.approx(10.0)
    assert left.seconds(200.0, 100.0) == 0.0
    assert left.seconds(50.0, 1000.0) is None
