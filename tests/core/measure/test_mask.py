"""The best gate for a region, against exhaustive search and against gates that made the region."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigs import LADDER, check_rig
from slopegate.core.exposure.gated import gated
from slopegate.core.exposure.sensor import SensorModel, expose
from slopegate.core.gating.gate import phase_us, row_windows
from slopegate.core.measure.mask import (
    EQUAL_SHARE,
    TRIMMED_SHARE,
    best_gate,
    best_interval,
    count_phases,
    overlap,
    recorded,
    seen_in_frames,
    thinnest_run,
)
from slopegate.core.rig.settings import LineTimes, PixelClocks, Steps, gate, quantise

HEIGHT, WIDTH = 120, 160
RIG = check_rig(WIDTH)


def some_scene(seed: int) -> NDArray[np.float32]:
    """Projector rows of a random pile of tilted cards at 0.5 to 3 m before a wall, with shadows."""
    rng = np.random.default_rng(seed)
    rows = np.arange(HEIGHT)[:, None] + 0.5
    row_of = np.broadcast_to(rows * 6 + 100 / 3.0, (HEIGHT, WIDTH)).copy()
    for _ in range(6):
        y, x = rng.integers(0, HEIGHT - 40), rng.integers(0, WIDTH - 40)
        patch = (slice(y, y + rng.integers(10, 40)), slice(x, x + rng.integers(10, 40)))
        inverse = rng.uniform(0.4, 1.8) + rng.uniform(-0.004, 0.004) * (rows[patch[0]] - y)
        row_of[patch] = rows[patch[0]] * 6 + 100 * inverse
    row_of[(rng.random((HEIGHT, WIDTH)) < 0.1) | (row_of >= 720) | (row_of < 0)] = -1
    return row_of.astype(np.float32)


@given(st.floats(60, 900), st.integers(0, 2**32 - 1))
def test_phases_are_counted_as_the_gate_defines_them(line_time_us: float, seed: int) -> None:
    """The kernel repeats `phase_us`; its bins of 4 us hold the same pixels, but for those at an edge in float32."""
    rng = np.random.default_rng(seed)
    camera_rows, projector_rows = rng.integers(0, HEIGHT, 300), rng.uniform(0, 720, 300)
    period = RIG.projector.period_us
    counts = np.zeros(round(period / 4), np.int64)
    turns = phase_us(RIG, line_time_us, camera_rows + 0.5, projector_rows) % period / period * counts.size
    clear = np.abs(turns - np.rint(turns)) > 1e-3
    lit_us = (projector_rows[clear] / RIG.projector.rows_per_us).astype(np.float32)
    count_phases(lit_us, camera_rows[clear].astype(np.int32), line_time_us, period, counts)
    np.testing.assert_array_equal(counts, np.bincount(turns[clear].astype(int), minlength=counts.size))
    assert clear.mean() > 0.95


bins = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=14)


@given(bins)
def test_the_interval_is_the_best_of_all(pairs: list[tuple[int, int]]) -> None:
    wanted, other = np.array(pairs, np.float64).T
    count, total = len(pairs), wanted.sum()
    start, length, ratio = best_interval(wanted, other)

    def iou(first: int, many: int) -> float:
        run = (first + np.arange(many)) % count
        union = total + other[run].sum()
        return float(wanted[run].sum() / union) if union else 0.0

    best = max(iou(first, many) for first in range(count) for many in range(count + 1))
    assert ratio == pytest.approx(best)
    if total:
        assert iou(start, length) == pytest.approx(best)


@given(st.lists(st.integers(-4, 5), min_size=1, max_size=14), st.integers(-2, 20))
def test_the_thinnest_run_is_the_shortest_of_all(gains: list[int], need: int) -> None:
    gain, count = np.array(gains, np.float64), len(gains)
    start, length = thinnest_run(gain, float(need))

    def total(first: int, many: int) -> float:
        return float(gain[(first + np.arange(many)) % count].sum())

    enough = [many for many in range(count + 1) for first in range(count) if total(first, many) >= need]
    if not enough:
        assert length == count
        return
    assert length == min(enough)
    assert total(start, length) == max(total(first, length) for first in range(count))


@given(
    seed=st.integers(0, 10_000),
    clock=st.sampled_from([clock for clock in LADDER if 50 <= clock <= 112]),
    delay_us=st.integers(-2000, 16_000),
    exposure_us=st.integers(100, 16_000),
    hide=st.booleans(),
)
@example(seed=299, clock=52.0, delay_us=112, exposure_us=110, hide=False)  # a shortest exposure that fits tightly
@example(seed=122, clock=70.0, delay_us=122, exposure_us=110, hide=False)  # rounding would lose a row
@settings(max_examples=40)
def test_a_region_that_a_gate_made_is_found_again(
    seed: int, clock: float, delay_us: int, exposure_us: int, hide: bool
) -> None:
    row_of = some_scene(seed)
    line = RIG.camera.shutter.line
    assert isinstance(line, PixelClocks)
    region = recorded(RIG, gate(line.line_time_us(clock), delay_us, exposure_us), row_of)
    if np.count_nonzero(region) < 200:
        return
    found = best_gate(RIG, row_of, region, hide)
    # a step of the shutter can cost up to a camera row of the small sensor at either edge
    assert found.iou > 0.96 * (1 - EQUAL_SHARE)
    shorter_us = min(exposure_us, RIG.projector.period_us - exposure_us)
    assert found.gate.exposure_us <= max(shorter_us, 100) + 5 / RIG.projector.rows_per_us
    assert found.gate.exposure_us <= RIG.projector.period_us / 2 + 1


@given(seed=st.integers(0, 10_000), hide=st.booleans())
@settings(max_examples=20)
def test_the_prediction_counts_every_pixel_of_what_is_sent(seed: int, hide: bool) -> None:
    row_of = some_scene(seed)
    row_of[:2] = [[0.0], [0.5]]  # the projector's first row lights like any other
    rng = np.random.default_rng(seed + 1)
    region = np.zeros(row_of.shape, bool)
    y, x = rng.integers(0, HEIGHT - 30), rng.integers(0, WIDTH - 30)
    region[y : y + 30, x : x + 30] = True
    if not (region & (row_of >= 0)).any():
        return
    found = best_gate(RIG, row_of, region, hide)
    assert found.sent == quantise(RIG.camera.shutter, found.sent, RIG.projector.period_us)
    lit = row_of >= 0
    seen = recorded(RIG, found.sent, row_of)
    chosen = ~seen & lit if hide else seen
    assert found.iou == pytest.approx(overlap(chosen, region, lit))
    assert found.hit_pixels + found.missed_pixels == np.count_nonzero(region & lit)
    assert found.line_times == len(LADDER)


class EveryGate:
    """Best overlap and thinnest slab of every clock, by trying each delay and exposure of 8 us up to 3.2 ms."""

    STEP_US = 8.0

    def __init__(self, row_of: NDArray[np.float32], region: NDArray[np.bool_]) -> None:
        line, period = RIG.camera.shutter.line, RIG.projector.period_us
        assert isinstance(line, PixelClocks)
        lit = row_of >= 0
        rows = np.broadcast_to(np.arange(HEIGHT)[:, None] + 0.5, row_of.shape)
        bins = round(period / self.STEP_US)
        self.iou: dict[float, float] = {}
        self.thin_us: dict[float, float] = {}
        for clock in LADDER:
            phase = (row_of / RIG.projector.rows_per_us - rows * line.line_time_us(clock)) % period
            kinds = (region & lit, lit & ~region)
            counts = [np.histogram(phase[kind], bins, (0, period))[0] for kind in kinds]
            sums = [np.concatenate([[0], np.cumsum(np.tile(count, 2))]) for count in counts]
            start, wanted = np.arange(bins), counts[0].sum()
            # The hardware's shortest exposure is 100 us.
            lengths = range(math.ceil(100 / self.STEP_US), 400)
            ious = np.array(
                [
                    float((hit / (wanted + extra)).max())
                    for hit, extra in ((total[start + many] - total[start] for total in sums) for many in lengths)
                ]
            )
            self.iou[clock] = float(ious.max())
            self.thin_us[clock] = self.STEP_US * lengths[int(np.argmax(ious >= (1 - TRIMMED_SHARE) * ious.max()))]

    @property
    def equal(self) -> list[float]:
        """The clocks that do equally well."""
        best = max(self.iou.values())
        return [clock for clock, iou in self.iou.items() if iou >= (1 - EQUAL_SHARE) * best]


def check_against_every_gate(row_of: NDArray[np.float32], region: NDArray[np.bool_]) -> None:
    """What is found is as good as the best of all gates, to the tolerance, and as thin as the thinnest of those."""
    found, every = best_gate(RIG, row_of, region), EveryGate(row_of, region)
    # A clock just within the tolerance for one way of rounding may be just beyond it for the other.
    slack = 0.01
    assert found.iou >= (1 - EQUAL_SHARE - slack) * max(every.iou.values())
    surely = [clock for clock in every.equal if every.iou[clock] >= (1 - EQUAL_SHARE + slack) * max(every.iou.values())]
    # Margins are two projector rows at either edge; of gates that differ by one row, the tilt decides.
    margins_us = 5 / RIG.projector.rows_per_us + 2 * EveryGate.STEP_US
    assert found.gate.exposure_us <= min(every.thin_us[clock] for clock in surely) + margins_us


@pytest.mark.parametrize("seed", range(4))
def test_no_gate_of_all_is_better_or_as_good_and_thinner(seed: int) -> None:
    row_of = some_scene(seed)
    region = np.zeros(row_of.shape, bool)
    region[20:80, 30 + 20 * seed : 70 + 20 * seed] = True
    check_against_every_gate(row_of, region)


def leaning_cards() -> tuple[NDArray[np.float32], dict[float, tuple[slice, slice]]]:
    """Projector rows of three cards before a wall, and where each one's clock sees it: they lean as its gates do."""
    rows = np.arange(HEIGHT)[:, None] + 0.5
    row_of = np.broadcast_to(rows * 6 + 45.0, (HEIGHT, WIDTH)).copy()
    line, where = RIG.camera.shutter.line, {}
    assert isinstance(line, PixelClocks)
    for clock, left, inverse in ((72.0, 10, 1.0), (78.0, 60, 0.9), (84.0, 110, 0.8)):
        card = (slice(30, 90), slice(left, left + 40))
        slope = line.line_time_us(clock) * RIG.projector.rows_per_us
        row_of[card] = 60 * 6 + 100 * inverse + slope * (rows[card[0]] - 60)
        where[clock] = card
    return row_of.astype(np.float32), where


@pytest.mark.parametrize("clock", [72.0, 78.0, 84.0])
@pytest.mark.parametrize("beyond", [-1, 0, 4])
def test_a_card_gets_the_thin_gate_that_leans_as_it_does(clock: float, beyond: int) -> None:
    """Painted exactly, or by a hand that strays over its edge or stops short of it."""
    row_of, where = leaning_cards()
    rows, columns = where[clock]
    region = np.zeros(row_of.shape, bool)
    region[rows.start - beyond : rows.stop + beyond, columns.start - beyond : columns.stop + beyond] = True
    found = best_gate(RIG, row_of, region)
    line = RIG.camera.shutter.line
    assert isinstance(line, PixelClocks)
    assert line.clock_mhz(found.gate.line_time_us) == pytest.approx(clock)
    assert found.gate.exposure_us <= 100 + 4 / RIG.projector.rows_per_us
    check_against_every_gate(row_of, region)


def test_to_hide_is_to_keep_the_rest() -> None:
    row_of = some_scene(3)
    region = np.zeros(row_of.shape, bool)
    region[30:90, 40:100] = True
    keep, hide = best_gate(RIG, row_of, region), best_gate(RIG, row_of, region, hide=True)
    assert hide.complement != keep.complement
    both = recorded(RIG, keep.sent, row_of) == recorded(RIG, hide.sent, row_of)
    assert np.count_nonzero(both & (row_of >= 0)) < 0.01 * both.size
    assert hide.iou == pytest.approx(keep.iou, abs=0.01)


def test_a_region_of_noise_has_no_good_gate_but_a_nearest_one() -> None:
    row_of = some_scene(5)
    region = np.random.default_rng(5).random(row_of.shape) < 0.1
    found = best_gate(RIG, row_of, region)
    assert 0 < found.iou < 0.3
    assert not found.good


def test_a_tiny_region_gets_the_shortest_exposure_where_it_is_hit_best() -> None:
    rig = check_rig(WIDTH, exposure=Steps(400.0, 50000.0, 1.0))
    row_of = np.broadcast_to(((np.arange(HEIGHT) + 0.5) * 6 + 60)[:, None], (HEIGHT, WIDTH)).astype(np.float32)
    row_of = row_of + np.linspace(0, 80, WIDTH, dtype=np.float32)
    row_of[row_of >= 720] = -1
    region = np.zeros(row_of.shape, bool)
    region[:, 0:4] = True
    found = best_gate(rig, row_of, region)
    assert found.gate.exposure_us == pytest.approx(400, abs=60)
    assert found.missed_pixels == 0


def test_everything_and_all_but_nothing() -> None:
    row_of = some_scene(7)
    found = best_gate(RIG, row_of, np.ones(row_of.shape, bool))
    assert found.iou == 1.0
    assert recorded(RIG, found.sent, row_of).sum() == np.count_nonzero(row_of >= 0)


def test_a_camera_that_sets_its_line_time_freely_is_searched_as_well() -> None:
    rig = check_rig(WIDTH, LineTimes(60.0, 900.0, 0.5))
    row_of = some_scene(2)
    wanted = gate(150.0, 1500.0, 900.0)
    region = recorded(rig, wanted, row_of)
    found = best_gate(rig, row_of, region)
    assert region.any()
    assert found.iou > 0.9
    assert found.line_times > 50


def test_refusals_name_the_region() -> None:
    row_of = some_scene(1)
    with pytest.raises(ValueError, match=r"region is .* must be of the image's shape"):
        best_gate(RIG, row_of, np.ones((3, 3), bool))
    with pytest.raises(ValueError, match="region is 'a region without any lit pixel'"):
        best_gate(RIG, row_of, row_of < 0)
    with pytest.raises(ValueError, match="region"):
        best_gate(RIG, np.full_like(row_of, -1), np.ones(row_of.shape, bool))


@pytest.mark.parametrize("ambient", [0.0, 0.1])
def test_frames_of_a_gate_and_its_complement_tell_what_was_recorded(ambient: float) -> None:
    row_of = some_scene(11)
    region = np.zeros(row_of.shape, bool)
    region[30:90, 40:100] = True
    found = best_gate(RIG, row_of, region)
    other = best_gate(RIG, row_of, region, hide=True)
    rng = np.random.default_rng(1)
    direct = np.where(row_of >= 0, rng.uniform(0.2, 0.9, row_of.shape), 0).astype(np.float32)
    room = np.full(row_of.shape, ambient, np.float32)
    frames = []
    for sent in (found.sent, other.sent):
        share = sent.exposure_us / RIG.projector.period_us
        light = gated(row_of, direct, room, row_windows(RIG, sent), share)
        frames.append(expose(light, SensorModel(), rng))
    seen, told = seen_in_frames(frames[0], frames[1], 40.0)
    truth = recorded(RIG, found.sent, row_of)
    both = recorded(RIG, found.sent, row_of) != recorded(RIG, other.sent, row_of)
    lit = (row_of >= 0) & both
    assert np.count_nonzero(told & lit) > 0.98 * np.count_nonzero(lit)
    assert np.count_nonzero((seen != truth) & told & lit) < 1e-3 * lit.sum()
    if ambient == 0:
        assert np.count_nonzero(told & (row_of < 0)) == 0


def test_overlap_of_nothing_with_nothing_is_complete() -> None:
    none, every = np.zeros((2, 2), bool), np.ones((2, 2), bool)
    assert overlap(none, none, every) == 1.0
    assert overlap(every, none, every) == 0.0
    assert overlap(every, every, none) == 1.0
