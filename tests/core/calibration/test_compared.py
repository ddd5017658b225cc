"""A new calibration beside an old rig: what moved, and where a gate really stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigs import calibrated, check_rig, turned
from slopegate.core.calibration.compared import compared
from slopegate.core.gating.gate import slab
from slopegate.core.rig.calibration import NUMBERS, Calibration
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.rig.uncertainty import numbers_of, with_numbers
from slopegate.core.rig.variants import beside_rig, in_scan_order

OLD = calibrated(check_rig(1600))


def moved(rig: Rig, **by: float) -> Rig:
    """The rig with some numbers moved by so many standard errors of both calibrations."""
    assert rig.calibration is not None
    numbers, errors = numbers_of(rig), rig.calibration.standard_errors
    for name, sigmas in by.items():
        key = name.replace("__", ".")
        numbers[NUMBERS.index(key)] += sigmas * np.sqrt(2) * errors[key]
    return replace(with_numbers(rig, numbers), calibration=rig.calibration)


def test_only_what_moved_beyond_both_errors_is_named() -> None:
    same = compared(OLD, moved(OLD, camera__fx=2.9, offset_x_m=-2.9))
    assert same.moved == ()
    assert same.sentences[0] == "none of 28 numbers moved by more than 3 standard errors"
    found = compared(OLD, moved(OLD, camera__fx=3.5, offset_x_m=-12.0))
    assert [(one.name, round(one.sigmas, 2)) for one in found.moved] == [("offset_x_m", 12.0), ("camera.fx", 3.5)]
    first = found.sentences[0]
    assert first.startswith("2 of 28 numbers moved by more than 3 standard errors: offset_x_m from 0.00000 to -0.00")
    assert " m (12.0); camera.fx from 1666.67 to " in first
    assert found.turned == ()
    every = compared(OLD, moved(OLD, **{name.replace(".", "__"): 4.0 for name in NUMBERS[:9]}))
    assert every.sentences[0].endswith("; and 3 more")


def test_the_gate_of_the_old_rig_is_told_where_it_really_stands() -> None:
    """By the slab of the same clock, delay and exposure on the new rig: 40 us later than the old rig believed."""
    line = OLD.camera.shutter.line
    assert isinstance(line, PixelClocks)
    shutter = replace(
        OLD.camera.shutter, delay_offset_us=-40.0, line=replace(line, clocks_per_line=line.clocks_per_line * 1.01)
    )
    new = replace(OLD, camera=replace(OLD.camera, shutter=shutter))
    found = compared(OLD, new, 1.5)
    assert found.settings is not None
    assert found.really is not None
    assert found.really.errors is not None
    before = slab(OLD, found.settings)
    assert (before.tilt_deg, before.distance_m) == pytest.approx((0.0, 1.5), abs=1e-9)
    settings = found.settings
    late = replace(settings, delay_us=settings.delay_us + 40.0, line_time_us=settings.line_time_us * 1.01)
    assert found.really == slab(new, late)
    assert found.really.tilt_deg > 5.0
    last = found.sentences[-1]
    assert last.startswith("a gate that the old rig has upright at 1.5 m really stands at ")
    assert f" +- {found.really.errors.distance_m:.3f} m, tilted by {found.really.tilt_deg:.2f} +- " in last


def test_a_rig_file_that_tells_no_errors_is_compared_by_the_new_ones() -> None:
    found = compared(replace(OLD, calibration=None), moved(OLD, projector__fy=3.0))
    (one,) = found.moved
    assert one.name == "projector.fy"
    assert one.sigmas == pytest.approx(3.0 * np.sqrt(2))
    exact = Calibration(("camera.fy",), ((0.0,),))
    apart = compared(replace(OLD, calibration=exact), replace(moved(OLD, camera__fy=5.0), calibration=exact))
    assert "(it had none)" in apart.sentences[0]


@pytest.mark.parametrize("ups", [(True, False), (False, True), (True, True)])
def test_rows_that_go_the_other_way_are_one_difference(ups: tuple[bool, bool]) -> None:
    old = calibrated(turned(check_rig(1600)))
    found = compared(old, in_scan_order(old, *ups))
    assert found.turned == tuple(which for which, up in zip(("camera", "projector"), ups, strict=True) if up)
    assert found.moved == ()
    assert found.sentences[0].endswith("rows are scanned the other way than the old rig has them")


def test_rigs_without_slabs_are_compared_by_their_numbers_alone() -> None:
    aside = calibrated(beside_rig(check_rig(1600)))
    found = compared(aside, moved(aside, camera__fy=5.0))
    assert found.settings is None
    assert len(found.sentences) == 1
    gone = compared(OLD, calibrated(beside_rig(check_rig(1600))))
    assert gone.sentences[-1] == "a gate that the old rig has upright at 1 m stands nowhere in front of the new one"
