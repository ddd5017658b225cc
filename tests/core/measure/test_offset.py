"""How far a window stands from the direct row: against the gate's own law, on rigs with tilted surfaces and wraps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import check_rig
from slopegate.core.gating.gate import recorded_times, row_windows, upright_line_time
from slopegate.core.measure.offset import (
    LitPlace,
    at_line_time,
    brightest,
    coarse_gates,
    fine_gates,
    offset_rows,
    place_from,
    place_in,
    with_offset,
)
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.settings import gate

RIG = check_rig(320)
ROWS = st.floats(1.0, 719.0)
LINES = st.floats(20.0, 200.0)


@given(row=st.integers(0, 239), lit_by=ROWS, line_time_us=LINES, rows=st.floats(-200.0, 200.0))
def test_a_window_is_put_where_it_was_wished(row: int, lit_by: float, line_time_us: float, rows: float) -> None:
    place = LitPlace(row + 0.5, lit_by)
    placed = with_offset(RIG, gate(line_time_us, 0.0, 300.0), place, rows)
    assert offset_rows(RIG, placed, place) == pytest.approx(rows, abs=1e-6)
    turned = at_line_time(placed, RIG, place, 1.3 * line_time_us)
    assert turned.line_time_us == 1.3 * line_time_us
    assert offset_rows(RIG, turned, place) == pytest.approx(rows, abs=1e-6)


@given(row=st.integers(0, 239), lit_by=ROWS, line_time_us=LINES, rows=st.floats(-40.0, 40.0))
def test_the_gate_records_the_direct_light_where_the_offset_says_so(
    row: int, lit_by: float, line_time_us: float, rows: float
) -> None:
    half = 300.0 / 2 * RIG.projector.rows_per_us
    placed = with_offset(RIG, gate(line_time_us, 0.0, 300.0), LitPlace(row + 0.5, lit_by), rows)
    if abs(abs(rows) - half) > 1e-6:
        seen = recorded_times(row_windows(RIG, placed), np.array([row]), np.array([lit_by]))
        assert bool(seen[0]) == (abs(rows) < half)


def test_the_place_of_a_box_is_its_middle_frontal_or_tilted() -> None:
    scale = RIG.projector.lens.fy / RIG.camera.lens.fy
    camera_rows = np.arange(240)[:, None] + 0.5
    for slope in (scale, 0.7 * scale):
        surface = np.broadcast_to(300.0 + slope * (camera_rows - 110.0), (240, 320)).astype(np.float32).copy()
        surface[:, 100:110] = -1  # a shadow in the box does not count
        place = place_in(RIG, surface, (90, 100, 130, 120))
        assert place is not None
        assert place.camera_row == 110.0
        assert place.projector_row == pytest.approx(300.0, abs=1e-3)
    assert place_in(RIG, np.full((240, 320), -1, np.float32), (90, 100, 130, 120)) is None


@pytest.mark.parametrize("lit_by", [4.0, 150.3, 411.7, 716.0])
@pytest.mark.parametrize("camera_row", [3, 120, 238])
def test_the_direct_row_is_found_by_moving_the_window(lit_by: float, camera_row: int) -> None:
    line_time_us = upright_line_time(RIG)
    spread = np.linspace(-3.0, 3.0, 61)  # rows that light the place

    def light(gates: list) -> np.ndarray:
        each = [recorded_times(row_windows(RIG, one), np.array([camera_row]), lit_by + spread).mean() for one in gates]
        return 7.0 + 100.0 * np.array(each)

    coarse = coarse_gates(RIG, line_time_us)
    fine = fine_gates(RIG, coarse[brightest(light(coarse))])
    found = place_from(RIG, camera_row + 0.5, fine, light(fine))
    assert found.projector_row == pytest.approx(lit_by, abs=0.5)


def test_a_place_without_light_of_its_own_is_refused() -> None:
    with pytest.raises(InputError, match="no more of the projector's light"):
        brightest(np.array([10.0, 10.5, 9.8, 10.1]))
    with pytest.raises(InputError, match="no more of the projector's light"):
        brightest(np.zeros(24))
