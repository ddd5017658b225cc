"""The timing picture against the gate's own arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytestqt.qtbot import QtBot

from slopegate.app.views.timing_view import (
    PERIODS_SHOWN,
    TimingView,
    camera_corners,
    first_period,
    projector_lines,
    recorded_stretches,
)
from slopegate.core.gating.gate import row_windows
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import gate
from slopegate.drivers.files.rig_files import load_rig

FLAT_US = 996.66866 / 78
RIG = load_rig(None)
PERIOD_US = RIG.projector.period_us


@pytest.fixture
def rig() -> Rig:
    return RIG


@given(st.floats(-50000, 50000), st.floats(1, 50000))
def test_the_window_is_shown_whole_when_it_fits(start_us: float, length_us: float) -> None:
    first = first_period(start_us, start_us + length_us, PERIOD_US)
    assert first * PERIOD_US <= start_us + 1e-6
    if length_us < (PERIODS_SHOWN - 1) * PERIOD_US:
        assert start_us + length_us <= (first + PERIODS_SHOWN) * PERIOD_US + 1e-6


def test_everyday_windows_do_not_move_the_time_axis() -> None:
    assert {first_period(start, start + 16000, PERIOD_US) for start in range(-16000, 17000, 500)} == {-1}


def test_camera_rows_are_exposed_about_their_centre(rig: Rig) -> None:
    corners = camera_corners(rig, gate(12.0, 2000, 500))
    np.testing.assert_allclose(corners, [[1.75, 0], [2.25, 0], [16.65, 1200], [16.15, 1200]])


def test_projector_lines_end_where_blanking_starts(rig: Rig) -> None:
    lines = projector_lines(rig, -1)
    assert lines.shape == (PERIODS_SHOWN, 2, 2)
    np.testing.assert_allclose(np.diff(lines[:, 0, 0]) * 1000, PERIOD_US)
    np.testing.assert_allclose((lines[:, 1, 0] - lines[:, 0, 0]) * 1000, 0.92 * PERIOD_US)
    np.testing.assert_array_equal(lines[:, :, 1], [[0, 720]] * PERIODS_SHOWN)


@given(st.floats(5, 13), st.floats(-5000, 10000), st.floats(50, 16000), st.floats(0, 719.9))
def test_marked_rows_are_those_that_the_centre_row_records(
    line_us: float, delay_us: float, exposure_us: float, projector_row: float
) -> None:
    # A line time between rows 600 and 601: half a row's difference is allowed for at the edges.
    wanted = gate(line_us, delay_us, exposure_us)
    corners = camera_corners(RIG, wanted)[:, 0] * 1000
    first = first_period(corners.min(), corners.max(), PERIOD_US)
    stretches = recorded_stretches(RIG, wanted, first)
    marked = bool(np.any((stretches[:, 0, 1] <= projector_row) & (projector_row < stretches[:, 1, 1])))
    windows = row_windows(RIG, wanted)
    inside = windows.low[600] <= projector_row < windows.high[600]
    times = windows.inside[600] if inside else windows.outside[600]
    if min(abs(projector_row - windows.low[600]), abs(projector_row - windows.high[600])) > line_us:
        assert marked == bool(times)


@pytest.mark.parametrize("dark", [True, False])
def test_a_moving_slider_only_moves_items(qtbot: QtBot, rig: Rig, dark: bool) -> None:
    view = TimingView()
    qtbot.addWidget(view)
    view.resize(500, 350)
    view.show()
    view.set_dark(dark)
    view.set_rig(rig)
    items = set(map(id, view.plot.items()))
    for delay in range(-16000, 33000, 3500):
        view.show_gate(rig, gate(FLAT_US, delay, 700))
        np.testing.assert_allclose(view.exposed.polygon().at(0).x(), (delay - 350) / 1000)
        left, right = view.plot.viewRange()[0]
        assert left <= (delay - 350) / 1000
        assert right >= (delay + 350 + 1200 * FLAT_US) / 1000
    assert set(map(id, view.plot.items())) == items


def test_rows_count_downwards_and_both_scales_meet(qtbot: QtBot, rig: Rig) -> None:
    view = TimingView()
    qtbot.addWidget(view)
    view.resize(500, 350)
    view.set_rig(rig)
    view.show_gate(rig, gate(FLAT_US, 2000, 700))
    box = view.plot.getViewBox()
    assert box.mapViewToScene(box.viewRect().center()).y() > 0
    assert box.yInverted()
    at = dict((label, where) for where, label in view.plot.getAxis("right")._tickLevels[0])
    assert (at["0"], at["360"], at["720"]) == pytest.approx((0, 600, 1200))


@pytest.mark.parametrize(
    "wanted",
    [
        gate(FLAT_US, 0, 1e-3),
        gate(FLAT_US, 33334, 50000),
        gate(FLAT_US, -16667, 50000),
        gate(1e-6, 0, 500),
        gate(1e4, 0, 500),
        gate(FLAT_US, 16000, 500),
    ],
)
def test_odd_gates_are_drawn(qtbot: QtBot, rig: Rig, wanted: object) -> None:
    view = TimingView()
    qtbot.addWidget(view)
    view.resize(500, 350)
    view.show()
    view.show_gate(rig, wanted)  # type: ignore[arg-type]
    assert not view.grab().isNull()
