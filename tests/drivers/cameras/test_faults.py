"""A camera with faults, in a time of its own: what is done to the frames, and what their stamps give away."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import soak
from fake_time import FakeTime
from slopegate.drivers.cameras.faults import PRESETS, SHARES, FaultCounts, Faults, FaultyCamera, parse_faults
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.camera import CameraGoneError
from slopegate.drivers.contract.frame import FrameStamp, exposed_s
from slopegate.drivers.stream.frame_watch import FrameWatch
from slopegate.drivers.stream.sieve import Sieve

RIG = soak.small_rig(32, 24)
GATES = soak.gates(RIG, 6)
PERIOD_S = 0.05


class FaultyRun:
    """A faulty camera in fake time; `run` reads it as a stream does."""

    def __init__(self, faults: Faults, seed: int = 0) -> None:
        self.time = FakeTime()
        clock, sleep = self.time.clock, self.time.sleep
        self.inner = VirtualCamera(RIG, soak.scene(), rate_hz=1 / PERIOD_S, noise=False, clock=clock, sleep=sleep)
        self.camera = FaultyCamera(self.inner, faults, seed=seed, clock=clock, sleep=sleep)
        self.camera.configure(GATES[0])
        self.camera.start()
        self.errors = 0

    def run(
        self, seconds: float, between: Callable[[], None] = lambda: None
    ) -> list[tuple[NDArray[np.uint16], FrameStamp, float]]:
        frames, end_s = [], self.time.now_s + seconds
        while self.time.now_s < end_s:
            buffer = np.zeros((24, 32), np.uint16)
            try:
                between()
                stamp = self.camera.read(buffer, 0.002)
            except CameraGoneError:
                self.errors += 1
                self.time.sleep(0.1)
                continue
            if stamp is not None:
                frames.append((buffer, stamp, self.time.now_s))
        return frames


def stamps(frames: list[tuple[NDArray[np.uint16], FrameStamp, float]]) -> list[FrameStamp]:
    return [stamp for _, stamp, _ in frames]


def test_without_faults_nothing_is_changed() -> None:
    got = stamps(FaultyRun(Faults()).run(4.99))
    assert len(got) == 100
    assert [stamp.sequence for stamp in got] == list(range(100))
    np.testing.assert_allclose(np.diff([stamp.time_s for stamp in got]), PERIOD_S)
    assert [stamp.settled for stamp in got] == [False] + 99 * [True]


def test_a_missed_trigger_leaves_a_gap_in_time_only_and_a_dropped_frame_one_in_the_numbers_too() -> None:
    for faults, name in ((Faults(missed=0.2), "missed"), (Faults(dropped=0.2), "dropped")):
        faulty = FaultyRun(faults)
        got = stamps(faulty.run(9.99))
        count = getattr(faulty.camera.counts, name)
        assert faulty.camera.counts == replace(FaultCounts(), **{name: count})
        assert 20 < count < 60
        assert len(got) + count == 200
        steps = np.diff([stamp.sequence for stamp in got])
        intervals = np.diff([stamp.time_s for stamp in got]) / PERIOD_S
        np.testing.assert_allclose(intervals, np.rint(intervals), atol=1e-6)
        assert round(intervals.max()) >= 2
        np.testing.assert_array_equal(steps, 1 if name == "missed" else np.rint(intervals))


def test_the_first_frame_after_a_change_is_marked_even_when_its_trigger_is_missed() -> None:
    faulty = FaultyRun(Faults(missed=0.5))
    for turn in range(40):
        faulty.camera.configure(GATES[turn % len(GATES)])
        first, *others = stamps(faulty.run(10 * PERIOD_S))
        assert not first.settled
        assert all(stamp.settled for stamp in others)


def test_a_late_frame_keeps_the_settings_that_made_it_when_they_change_before_it_comes() -> None:
    wanted = soak.references(RIG, GATES)
    faulty = FaultyRun(Faults(late=0.4, late_s=0.03), seed=5)
    random = np.random.default_rng(2)

    def change() -> None:
        faulty.camera.configure(GATES[random.integers(len(GATES))])

    frames = faulty.run(10.0, change)
    assert faulty.camera.counts.late > 20
    overtaken = 0
    for image, stamp, at_s in frames:
        assert stamp.applied is not None
        np.testing.assert_array_equal(image, wanted[stamp.applied])
        assert stamp.time_s + exposed_s(stamp.applied, faulty.camera.info.height) <= at_s + 1e-9
        overtaken += stamp.applied != faulty.inner._applied
    assert [stamp.sequence for stamp in stamps(frames)] == list(range(len(frames)))
    after_s = np.array([at_s - 100.0 for _, _, at_s in frames])
    off_s = np.abs(after_s - PERIOD_S * np.rint(after_s / PERIOD_S))
    assert ((off_s < 1e-6) | (np.abs(off_s - 0.02) < 1e-6)).all(), "30 ms late is 20 ms before the next"
    assert 0 <= faulty.camera.counts.late - (off_s > 1e-6).sum() <= 1, "the last one may not have come yet"
    assert overtaken > 10


def test_a_duplicated_frame_is_the_same_frame_with_the_same_number() -> None:
    faulty = FaultyRun(Faults(duplicated=0.3))
    frames = faulty.run(5.0)
    again = [(a, b) for a, b in pairwise(frames) if b[1].sequence == a[1].sequence]
    assert len(again) == faulty.camera.counts.duplicated > 10
    for (first, one, _), (second, other, _) in again:
        np.testing.assert_array_equal(first, second)
        assert (one.applied, one.settled) == (other.applied, other.settled)


def test_a_loose_plug_takes_the_device_away_and_the_frame_after_it_is_not_settled() -> None:
    faulty = FaultyRun(Faults(disconnected=0.02, away_s=1.0), seed=3)
    frames = faulty.run(30.0)
    times = faulty.camera.counts.disconnected
    assert times >= 3
    assert faulty.errors >= 9 * times
    gaps = [(a, b) for a, b in pairwise(stamps(frames)) if b.sequence != a.sequence + 1]
    assert len(gaps) == times
    for before, after in gaps:
        assert after.sequence == before.sequence + 2
        assert after.time_s - before.time_s > 1.0
        assert not after.settled


def test_while_the_device_is_away_nothing_works_and_afterwards_all_does() -> None:
    faulty = FaultyRun(Faults(disconnected=0.5, away_s=1.0))
    buffer = np.zeros((24, 32), np.uint16)
    with suppress(CameraGoneError):
        while faulty.camera.read(buffer, 0.1) is not None:
            pass
    with pytest.raises(CameraGoneError, match="does not answer"):
        faulty.camera.read(buffer, 0.1)
    for call in (lambda: faulty.camera.configure(GATES[1]), lambda: faulty.camera.set_rows(0, 8), faulty.camera.start):
        with pytest.raises(CameraGoneError):
            call()
    faulty.time.sleep(1.0)
    assert faulty.camera.configure(GATES[1]) == GATES[1]


def test_jitter_shows_in_the_stamps_as_it_was_asked_for() -> None:
    faulty = FaultyRun(Faults(jitter_us=200.0))
    got = stamps(faulty.run(60.0))
    due_s = np.array([stamp.time_s + exposed_s(stamp.applied, faulty.camera.info.height) for stamp in got])
    off_us = (due_s - 100.0) * 1e6 - np.arange(len(got)) * PERIOD_S * 1e6
    assert off_us.std() == pytest.approx(200.0, rel=0.1)
    assert abs(off_us.mean()) < 30


def test_a_trigger_that_comes_late_opens_the_gate_as_late() -> None:
    """Each frame is that of the gate moved by as much as its stamp is late; what was set is told as set."""
    time, alone = FakeTime(), VirtualCamera(RIG, soak.scene(), rate_hz=math.inf, noise=False)
    inner = VirtualCamera(RIG, soak.scene(), rate_hz=1 / PERIOD_S, noise=False, clock=time.clock, sleep=time.sleep)
    told: list[float] = []

    def trigger_late(late_us: float) -> None:
        told.append(late_us)
        inner.trigger_late(late_us)

    faults = Faults(missed=0.2, dropped=0.1, jitter_us=150.0)
    camera = FaultyCamera(inner, faults, seed=3, clock=time.clock, sleep=time.sleep, trigger_late=trigger_late)
    gate_set = camera.configure(GATES[0])
    camera.start()
    alone.configure(gate_set)
    alone.start()
    image, wanted, frames = np.zeros((24, 32), np.uint16), np.zeros((24, 32), np.uint16), 0
    start_s = time.now_s
    while frames < 100:
        stamp = camera.read(image, 0.002)
        if stamp is None:
            continue
        frames += 1
        assert stamp.applied == gate_set
        due_s = stamp.time_s + exposed_s(gate_set, 24) - start_s
        late_us = 1e6 * (due_s - PERIOD_S * round(due_s / PERIOD_S))
        assert late_us == pytest.approx(told[-1], abs=1e-3)
        alone.trigger_late(told[-1])
        assert alone.read(wanted, 1.0) is not None
        np.testing.assert_array_equal(image, wanted)
    assert len(told) == frames + camera.counts.missed + camera.counts.dropped
    assert np.std(told) == pytest.approx(150.0, rel=0.2)
    assert min(camera.counts.missed, camera.counts.dropped) > 3


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), late=st.sampled_from([0.0, 0.02, 0.06]), gates=st.integers(1, 6))
def test_the_stamps_give_away_what_was_done(seed: int, late: float, gates: int) -> None:
    """Every lost and repeated frame, and every missed trigger that is not beside a change or a late frame."""
    faults = Faults(missed=0.05, dropped=0.05, late=late, duplicated=0.05, jitter_us=100.0, late_s=0.02)
    faulty, watch, random = FaultyRun(faults, seed), FrameWatch(), np.random.default_rng(seed)
    delays = [replace(GATES[0], delay_us=GATES[k].delay_us) for k in range(gates)]

    def change() -> None:
        if random.random() < 0.01:
            faulty.camera.configure(delays[random.integers(gates)])

    frames = stamps(faulty.run(15.0, change))
    seen = [watch.judge(stamp) for stamp in frames]
    counts, counted = faulty.camera.counts, watch.counters
    assert (counted.made, counted.errors) == (len(frames), 0)
    assert sum(one.repeated for one in seen) == counted.repeated == counts.duplicated
    assert sum(one.lost for one in seen) == counted.lost <= counts.dropped
    assert counted.lost >= counts.dropped - 3, "those before the first frame and after the last one are not missed"
    assert counted.missed <= counts.missed
    assert counted.late <= 1.3 * counts.late + 2, "it may be the first one that was late"
    if gates == 1:
        unjudged = sum(1 for stamp in frames if stamp.sequence < 30)
        assert counted.missed >= counts.missed - unjudged
        assert watch.beat is not None
        assert watch.beat.period_us == pytest.approx(PERIOD_S * 1e6, rel=0.01)
        assert watch.beat.jitter_us == pytest.approx(100.0, rel=0.6)


def test_equal_seeds_make_equal_faults() -> None:
    one, same, other = (stamps(FaultyRun(PRESETS["all"], seed).run(10.0)) for seed in (1, 1, 2))
    assert one == same
    assert one != other


def test_a_frame_that_the_sieve_lets_through_is_right_whatever_happens() -> None:
    wanted, watch, sieve = soak.references(RIG, GATES), FrameWatch(), Sieve()
    faulty = FaultyRun(Faults(0.1, 0.1, 0.1, 0.1, 0.01, jitter_us=100.0, away_s=0.2), seed=9)
    taken = 0
    for target in 20 * GATES:
        sieve.begin()

        def hold(target: object = target) -> None:
            if faulty.inner._asked != target:
                faulty.camera.configure(target)

        for image, stamp, _ in faulty.run(0.5, hold):
            if sieve.take(watch.judge(stamp), target):
                np.testing.assert_array_equal(image, wanted[target])
                taken += 1
    assert taken > 300


def test_presets_by_name_and_faults_by_number() -> None:
    for name, preset in PRESETS.items():
        assert parse_faults(name) == preset
    assert parse_faults("missed=0.1, jitter_us = 50") == Faults(missed=0.1, jitter_us=50.0)
    assert set(SHARES) == set(FaultCounts.__dataclass_fields__)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "faults is ''"),
        ("gremlins", "faults is 'gremlins': it must be one of trigger, link, plug, all"),
        ("missed=often", "missed is 'often': it must be a number"),
        ("missed=0.7", "missed is 0.7: it must be a share"),
        ("missed=nan", "missed is nan"),
        ("missed=0.4,dropped=0.4,late=0.4", "sum of all shares"),
        ("jitter_us=-1", "jitter_us is -1.0: it must be 0 or more"),
        ("away_s=inf", "away_s is inf: it must be a finite number"),
    ],
)
def test_impossible_faults_are_refused_with_a_sentence(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_faults(text)
