"""The timing from captures on disk: slices that are gates of a plane, with or without one that shows everything lit."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from rigs import check_rig
from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.target import FlatTarget
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.drivers.calibrations.pictures import CalibrationError
from slopegate.drivers.calibrations.timing_capture import timing_of_capture
from timed_captures import CLOCKS, captured, gates_of
from timed_scenes import hidden_plane, misses


@pytest.mark.parametrize("whole", [False, True], ids=["slices alone", "one fully lit"])
def test_slices_of_a_plane_tell_the_timing(tmp_path: Path, whole: bool) -> None:
    hidden = hidden_plane(4)
    gates = gates_of(hidden.believed)
    if whole:
        gates.insert(3, whole_period(hidden.believed, upright_line_time(hidden.believed)))
    folder = captured(tmp_path / "c", hidden, gates, dark=whole)
    shares: list[float] = []
    outcome = timing_of_capture(folder, folder.rig, hidden.target, told=shares.append)
    off = misses(outcome, hidden)
    assert off.directions
    assert abs(off.off["clocks_per_line"]) / 1e4 < 2e-3
    assert abs(off.off["delay_offset_us"]) < 15
    assert max(map(abs, off.sigmas.values())) < 4
    assert {line.clock_mhz for line in outcome.line_times} <= set(CLOCKS)
    assert len(outcome.line_times) >= 4
    assert outcome.frames == len(gates)
    assert shares == sorted(shares)
    assert 0.4 < shares[len(shares) // 2] < 0.8


def test_one_clock_tells_what_it_can(tmp_path: Path) -> None:
    hidden = hidden_plane(4)
    folder = captured(tmp_path / "c", hidden, gates_of(hidden.believed, (108.0, 108.0, 108.0)))
    outcome = timing_of_capture(folder, folder.rig, hidden.target)
    assert [line.clock_mhz for line in outcome.line_times] == [108.0]
    assert not outcome.verdict.enough
    offset_us = misses(outcome, hidden).off["delay_offset_us"]
    known = outcome.rig.calibration
    assert known is not None
    assert abs(offset_us) < 4 * known.standard_errors["delay_offset_us"]
    assert math.isfinite(offset_us)


def test_a_capture_that_does_not_do_is_refused_with_a_sentence(tmp_path: Path) -> None:
    hidden = hidden_plane(4)
    few = captured(tmp_path / "few", hidden, gates_of(hidden.believed)[:3])
    with pytest.raises(CalibrationError, match=r"few has 3 slices with light: at least 4, through several gates"):
        timing_of_capture(few, few.rig, hidden.target)
    folder = captured(tmp_path / "some", hidden, gates_of(hidden.believed, (74.0,)))
    with pytest.raises(CalibrationError, match=r"160 x 120 pixels and the rig's camera has 80 x 60"):
        timing_of_capture(folder, check_rig(80), hidden.target)
    with pytest.raises(CalibrationError, match="no chart 9x6:60 was found"):
        timing_of_capture(folder, folder.rig, chart_from("9x6:60"))
    with pytest.raises(CalibrationError, match="share too little of the plane"):
        timing_of_capture(folder, folder.rig, FlatTarget((0.0, 0.0, -1.0)))


def test_whole_slices_alone_have_no_edges(tmp_path: Path) -> None:
    hidden = hidden_plane(4)
    whole = whole_period(hidden.believed, upright_line_time(hidden.believed))
    folder = captured(tmp_path / "c", hidden, [whole] * 5)
    with pytest.raises(CalibrationError, match=r"5 gates tell no timing: .* is 0: it must be at least 12"):
        timing_of_capture(folder, folder.rig, hidden.target)
