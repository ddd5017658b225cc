"""Slices tile what they are asked to cover, on the camera's own steps, and add up to the fully lit image."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import FINE_LINES, check_rig
from slopegate.core.exposure.gated import gated
from slopegate.core.gating.gate import complement, row_windows, slab, upright_line_time, weights
from slopegate.core.gating.slices import (
    Probe,
    Slices,
    at_delays,
    occupied_times,
    once_around,
    share_edges,
    tile_depths,
    tile_times,
)
from slopegate.core.render.render import render
from slopegate.core.rig.axis import time_on_axis
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, Steps, gate, quantise
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import plane, turn

RIG = check_rig(160, FINE_LINES)
LEVEL = upright_line_time(RIG)
SCENE = Scene(
    "ball and wall",
    objects=(
        plane("wall", (0.0, 0.0, 2.0), (6.0, 4.0), turn(20.0)),
        Sphere("ball", (0.1, 0.0, 0.9), 0.2),
    ),
)


def edges(slices: Slices) -> list[tuple[float, float]]:
    ordered = sorted(slices, key=lambda item: item.delay_us)
    return [(item.delay_us - item.exposure_us / 2, item.delay_us + item.exposure_us / 2) for item in ordered]


def on_hardware(rig: Rig, slices: Slices) -> bool:
    return all(quantise(rig.camera.shutter, item, rig.projector.period_us) == item for item in slices)


@given(
    line=st.floats(20.0, 400.0),
    start=st.floats(-5000.0, 9000.0),
    span=st.floats(200.0, 9000.0),
    count=st.integers(1, 40),
    delay_step=st.sampled_from([1.0, 0.5, 2.0, 3.0]),
    exposure_step=st.sampled_from([1.0, 0.25, 2.0, 5.0]),
)
def test_equal_slices_meet_cover_and_are_the_cameras_own(
    line: float, start: float, span: float, count: int, delay_step: float, exposure_step: float
) -> None:
    rig = check_rig(
        160, FINE_LINES, delay=Steps(-16668.0, 33334.0, delay_step), exposure=Steps(90.0, 50000.0, exposure_step)
    )
    if count > 1 and span / count < 90 + 15:
        with pytest.raises(ValueError, match="count"):
            tile_times(rig, line, start, start + span, 60 + count)
        return
    slices = tile_times(rig, line, start, start + span, count)
    assert len(slices) == count
    assert on_hardware(rig, slices)
    assert share_edges(slices)
    assert [item.delay_us for item in slices] == sorted((item.delay_us for item in slices), reverse=True)
    assert edges(slices)[0][0] <= start
    assert edges(slices)[-1][1] >= start + span


@pytest.mark.parametrize("spacing", ["delay", "depth"])
@pytest.mark.parametrize("count", [1, 2, 7, 8])
def test_depth_slices_cover_the_range_nearest_first(spacing: str, count: int) -> None:
    slices = tile_depths(RIG, LEVEL, 0.6, 1.4, count, "depth" if spacing == "depth" else "delay")
    assert len(slices) == count
    assert on_hardware(RIG, slices)
    assert share_edges(slices)
    read = [slab(RIG, item) for item in slices]
    assert read[0].near_m is not None
    assert read[0].near_m <= 0.6
    assert read[-1].far_m is not None
    assert read[-1].far_m >= 1.4
    distances = [item.distance_m or 0.0 for item in read]
    assert distances == sorted(distances)
    widths = [item.exposure_us for item in slices]
    if spacing == "delay":
        assert len(set(widths)) == 1
    elif count > 1:
        # two microseconds are what an edge may move by
        inner = [item.thickness_m or 0.0 for item in read[1:-1]]
        assert all(math.isclose(value, 0.8 / count, rel_tol=0.2) for value in inner)
        assert widths == sorted(widths, reverse=True)


def test_a_range_to_infinity_has_slices_of_equal_disparity() -> None:
    slices = tile_depths(RIG, LEVEL, 1.0, math.inf, 8)
    assert edges(slices)[0][0] <= time_on_axis(RIG, slices[0].line_time_us, 0.0)
    with pytest.raises(ValueError, match=r"far_m is inf: it must be finite"):
        tile_depths(RIG, LEVEL, 1.0, math.inf, 8, "depth")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: tile_times(RIG, LEVEL, 0.0, 1000.0, 11), "count is 11: it must be at most 10"),
        (lambda: tile_times(RIG, LEVEL, 0.0, 0.0, 1), "end_us is 0.0"),
        (lambda: tile_times(RIG, LEVEL, 0.0, math.nan, 1), "end_us is nan"),
        (lambda: tile_times(RIG, LEVEL, 0.0, 1000.0, 0), "count is 0"),
        (lambda: tile_times(RIG, LEVEL, 0.0, 60000.0, 1), "at most 50000 us"),
        (lambda: tile_times(RIG, LEVEL, -16000.0, 40000.0, 40), "reach too far"),
        (lambda: tile_depths(RIG, LEVEL, -1.0, 2.0, 4), "near_m is -1.0"),
        (lambda: tile_depths(RIG, LEVEL, 2.0, 1.0, 4), "far_m is 1.0: it must be above near_m"),
        (lambda: tile_depths(RIG, LEVEL, 1.0, 3.0, 30, "depth"), "the shortest exposure is 100 us"),
        (lambda: at_delays(RIG, LEVEL, 400.0, []), "at least one delay"),
    ],
)
def test_what_cannot_be_sliced_is_said(call: object, words: str) -> None:
    assert callable(call)
    with pytest.raises(ValueError, match=words):
        call()


def test_steps_that_never_fit_are_refused() -> None:
    rig = check_rig(160, FINE_LINES, delay=Steps(0.0, 30000.0, 1000.0), exposure=Steps(100.5, 50000.0, 1000.0))
    with pytest.raises(ValueError, match="none of them is a whole number of delay steps"):
        tile_times(rig, LEVEL, 0.0, 5000.0, 2)


def test_delays_by_hand_are_rounded_in_their_order() -> None:
    slices = at_delays(RIG, LEVEL, 400.3, [2000.4, 1000.6, 3000.0])
    assert [item.delay_us for item in slices] == [2000.0, 1001.0, 3000.0]
    assert {item.exposure_us for item in slices} == {400.0}
    assert not share_edges(slices)


def test_slices_of_different_line_times_never_share_edges() -> None:
    a, b = tile_times(RIG, LEVEL, 0.0, 1000.0, 2)
    assert share_edges((a, b))
    assert not share_edges((a, replace(b, line_time_us=b.line_time_us + 1)))


@pytest.mark.parametrize("tilt_line", [LEVEL, LEVEL * 0.8, LEVEL * 1.3])
def test_slices_of_all_that_is_lit_add_up_to_the_floodlit_image_bit_for_bit(tilt_line: float) -> None:
    buffers = render(RIG, SCENE)
    line = RIG.camera.shutter.line.nearest(tilt_line)
    times = occupied_times(RIG, line, buffers.projector_row)
    assert times is not None
    slices = tile_times(RIG, line, *times, 12)
    total = np.zeros_like(buffers.direct)
    counts = np.zeros(buffers.projector_row.shape, np.int64)
    for item in slices:
        windows = row_windows(RIG, item)
        counts += weights(windows, buffers.projector_row)
        total += gated(buffers.projector_row, buffers.direct, buffers.ambient, windows, 0.0)
    np.testing.assert_array_equal(counts, buffers.projector_row >= 0)
    assert (total == buffers.direct).all()
    assert buffers.direct.any()


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("steps", [(1.0, 1.0), (0.5, 2.0), (3.0, 2.0)])
def test_slices_once_around_record_every_row_of_the_projector_once(count: int, steps: tuple[float, float]) -> None:
    delay, exposure = Steps(-16667.0, 33334.0, steps[0]), Steps(100.0, 50000.0, steps[1])
    rig = check_rig(160, FINE_LINES, delay=delay, exposure=exposure)
    inner = tile_times(rig, LEVEL, 1200.0, 2400.0, count)
    slices = once_around(rig, inner)
    assert slices[1:-1] == inner[1:-1]
    assert on_hardware(rig, slices)
    assert share_edges(slices)
    starts = edges(slices)
    assert starts[0][0] <= edges(inner)[0][0]
    assert starts[-1][1] >= edges(inner)[-1][1]
    assert 0 <= starts[-1][1] - starts[0][0] - rig.projector.period_us <= 12
    middles = np.broadcast_to(np.arange(0.0, 720.0, 0.125, np.float32), (rig.camera.lens.height, 5760))
    counts = sum(weights(row_windows(rig, item), middles) for item in slices)
    assert counts.min() == 1
    assert counts.mean() - 1 < 0.001  # of whole steps too many


def test_a_camera_whose_exposures_are_too_short_for_a_period_is_told() -> None:
    rig = check_rig(160, FINE_LINES, exposure=Steps(100.0, 5000.0, 1.0))
    with pytest.raises(InputError, match="at most 5000 us: take more slices"):
        once_around(rig, tile_times(rig, LEVEL, 1200.0, 2400.0, 3))


def test_a_set_of_slices_and_the_complement_of_its_whole_make_the_floodlit_image() -> None:
    buffers = render(RIG, SCENE)
    slices = tile_depths(RIG, LEVEL, 0.7, 1.2, 9)
    start, end = edges(slices)[0][0], edges(slices)[-1][1]
    rest = complement(gate(slices[0].line_time_us, (start + end) / 2, end - start), RIG.projector.period_us)
    counts = sum(weights(row_windows(RIG, item), buffers.projector_row) for item in (*slices, rest))
    np.testing.assert_array_equal(counts, buffers.projector_row >= 0)


def test_nothing_lit_has_no_times() -> None:
    assert occupied_times(RIG, LEVEL, np.full((4, 5), -1, np.float32)) is None


def probe(slices: Slices, is_lit: set[int]) -> tuple[set[int], int]:
    """Which slices a probe finds lit, and how many gates it looked through."""
    state, asked = Probe.over(RIG, slices), 0
    while (settings := state.asked) is not None:
        asked += 1
        assert quantise(RIG.camera.shutter, settings, RIG.projector.period_us) == settings
        start, end = settings.delay_us - settings.exposure_us / 2, settings.delay_us + settings.exposure_us / 2
        lit = any(start <= slices[index].delay_us < end for index in is_lit)
        state = state.tell(lit)
    return set(state.lit), asked


@given(st.integers(1, 60), st.data())
def test_a_probe_finds_the_lit_slices(count: int, data: st.DataObject) -> None:
    slices = tile_times(RIG, LEVEL, -500.0, -500.0 + 101 * count, count)
    lit = data.draw(st.sets(st.integers(0, count - 1)))
    found, asked = probe(slices, lit)
    assert found == lit
    assert asked <= max(1, 2 * len(lit) * (1 + math.ceil(math.log2(count))))


def test_an_empty_scene_costs_one_look() -> None:
    slices = tile_times(RIG, LEVEL, 0.0, 8000.0, 64)
    assert probe(slices, set()) == (set(), 1)
    assert probe(slices, {17})[1] <= 1 + 2 * 6


def test_the_first_looks_of_a_probe_are_as_long_as_a_period_allows() -> None:
    slices = tile_times(RIG, LEVEL, 0.0, 33_000.0, 66)
    together = RIG.projector.period_us // slices[0].exposure_us
    assert probe(slices, set()) == (set(), math.ceil(66 / together)) == (set(), 2)


def test_a_probe_looks_through_gates_of_one_line_time_and_less_than_a_period() -> None:
    a = at_delays(RIG, LEVEL, 400.0, [1000.0, 2000.0])
    b = at_delays(RIG, LEVEL + 10, 400.0, [1000.0, 20000.0])
    state, looked = Probe.over(RIG, (*a, *b)), []
    while state.asked is not None:
        looked.append(state.asked)
        state = state.tell(False)
    assert [(item.line_time_us, item.delay_us, item.exposure_us) for item in looked] == [
        (a[0].line_time_us, 1500.0, 1400.0),
        (b[0].line_time_us, 1000.0, 400.0),
        (b[0].line_time_us, 20000.0, 400.0),
    ]


def test_a_union_on_odd_steps_covers_its_parts() -> None:
    slices = (gate(LEVEL, 1000.0, 101.0), gate(LEVEL, 1101.0, 101.0))
    asked = Probe.over(RIG, slices).asked
    assert isinstance(asked, GateSettings)
    assert asked.delay_us - asked.exposure_us / 2 <= 949.5
    assert asked.delay_us + asked.exposure_us / 2 >= 1151.5
    assert all(a[1] == b[0] for a, b in pairwise(edges(slices)))
