"""Which frames count, by their stamps alone."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slopegate.core.rig.settings import gate
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.stream.frame_watch import RESTART_AFTER, FrameWatch
from slopegate.drivers.stream.sieve import Sieve, Tally

A, B = gate(10.0, 0.0, 100.0), gate(10.0, 1.0, 100.0)


@dataclass
class Taken:
    sequences: list[int]
    tally: Tally


def run(stamps: list[tuple[int, bool, bool]], doubtful: int = 0, before: int | None = None) -> Taken:
    """Which of the frames (sequence, gate is right, settled) count."""
    watch, sieve = FrameWatch(), Sieve()
    if before is not None:
        watch.judge(FrameStamp(before, 0.0, A, A))
    sieve.begin(doubtful)
    taken = []
    for sequence, right, settled in stamps:
        asked = B if right else A
        if sieve.take(watch.judge(FrameStamp(sequence, 0.0, asked, asked, settled)), B):
            taken.append(sequence)
    return Taken(taken, sieve.tally)


def test_frames_of_the_old_gate_and_unsettled_ones_do_not_count() -> None:
    taken = run([(1, False, True), (2, True, False), (3, True, True), (4, True, True)], before=0)
    assert taken == Taken([3, 4], Tally(0, 0, 2))


def test_a_frame_twice_counts_once() -> None:
    taken = run([(1, True, False), (2, True, True), (2, True, True), (3, True, True), (2, True, True)], before=0)
    assert taken == Taken([2, 3], Tally(0, 2, 1))


def test_lost_frames_are_counted_and_others_taken_instead() -> None:
    taken = run([(1, True, False), (2, True, True), (5, True, True), (6, True, True)], before=0)
    assert taken == Taken([2, 5, 6], Tally(2, 0, 1))


def test_when_the_flagged_frame_may_be_lost_as_many_are_left_out() -> None:
    """Frames 1 and 2 are missing: either may have been the one flagged as not settled."""
    taken = run([(3, True, True), (4, True, True), (5, True, True)], before=0)
    assert taken == Taken([5], Tally(2, 0, 2))


def test_the_first_frame_ever_is_no_gap() -> None:
    assert run([(7, True, True)]).sequences == [7]


def test_frames_are_left_out_after_the_user_did_something() -> None:
    assert run([(1, True, True), (2, True, True), (3, True, True)], doubtful=2, before=0).sequences == [3]


def test_a_camera_that_counts_anew_is_followed() -> None:
    stamps = [(100, True, True)] + [(n, True, True) for n in range(10)]
    taken = run(stamps, before=99)
    assert taken.sequences == [100, *range(RESTART_AFTER - 1, 10)]
    assert taken.tally.duplicated == RESTART_AFTER - 1


def test_the_same_frame_for_ever_never_counts() -> None:
    assert run([(5, True, True)] * 50, before=5).sequences == []


def test_begin_counts_anew() -> None:
    watch, sieve = FrameWatch(), Sieve()
    for sequence in (1, 4, 4):
        sieve.take(watch.judge(FrameStamp(sequence, 0.0, B, B)), B)
    assert sieve.tally != Tally()
    sieve.begin()
    assert sieve.tally == Tally()


def test_tallies_add_up() -> None:
    assert Tally(1, 2, 3).plus(Tally(10, 20, 30)) == Tally(11, 22, 33)


@given(st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.sampled_from([True, True, True, False])), max_size=60))
def test_what_counts_is_right_new_settled_and_in_order(steps: list[tuple[int, bool, bool]]) -> None:
    sequence, stamps = 0, []
    for step, right, settled in steps:
        sequence += step
        stamps.append((sequence, right, settled))
    taken = run(stamps, before=0)
    assert taken.sequences == sorted(set(taken.sequences))
    good = {number for number, right, settled in stamps if right and settled and number > 0}
    assert set(taken.sequences) <= good
    seen = {number for number, _, _ in stamps if number > 0}
    assert taken.tally.lost == sequence - len(seen)


@pytest.mark.parametrize("settled", [True, False])
def test_another_gate_never_counts(settled: bool) -> None:
    assert run([(n, False, settled) for n in range(1, 20)], before=0).sequences == []


def test_replayed_frames_have_no_beat_and_miss_no_trigger() -> None:
    live, replayed = FrameWatch(), FrameWatch(replayed=True)
    for number in range(40):
        time_s = 0.05 * number + (0.15 if number > 30 else 0.0)
        for watch in (live, replayed):
            watch.judge(FrameStamp(number, time_s, A, A))
    assert live.beat is not None
    assert live.counters.missed == 3
    assert replayed.beat is None
    assert (replayed.counters.missed, replayed.counters.made) == (0, 40)
