"""Errors of a rig's numbers, and what follows from them, against rigs that are drawn by them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rigs import FINE_LINES, bent, calibrated, check_rig, drawn, turned
from slopegate.core.gating.gate import slab
from slopegate.core.gating.plan import plan
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import NUMBERS, Calibration
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks
from slopegate.core.rig.uncertainty import (
    numbers_of,
    really_made,
    retold,
    spread,
    still_known,
    transformed,
    with_numbers,
)
from slopegate.core.rig.variants import binned_gate, binned_rig, in_scan_order

OFFSET = NUMBERS.index("delay_offset_us")
IDEAL = calibrated(check_rig(1600))
GENERAL = calibrated(bent(turned(check_rig(1600))))


def read_outs(believed: Rig, gate: GateSettings, rig: Rig, late_us: float) -> Doubles:
    found = slab(rig, really_made(believed, gate, rig, late_us))
    assert found.distance_m is not None
    assert found.thickness_m is not None
    return np.array([found.tilt_deg, found.distance_m, found.thickness_m])


def believed_numbers(rig: Rig, numbers: Doubles) -> tuple[Rig, float]:
    """The rig that is, and how late a gate comes on it that was set with the offset that is believed in."""
    return with_numbers(rig, numbers), float(numbers_of(rig)[OFFSET] - numbers[OFFSET])


@pytest.mark.parametrize("rig", [IDEAL, GENERAL], ids=["ideal", "general"])
def test_standard_errors_are_those_of_rigs_that_are_drawn(rig: Rig) -> None:
    gate = plan(rig, 15.0, 1.05, 0.1)
    told = spread(rig, lambda one, late_us: read_outs(rig, gate, one, late_us))
    count = 800
    found = np.array([read_outs(rig, gate, *believed_numbers(rig, numbers)) for numbers in drawn(rig, count)])
    assert told is not None
    # 4 standard deviations of a standard deviation's estimate
    np.testing.assert_allclose(told, found.std(axis=0), rtol=4 / np.sqrt(2 * count))
    middle = read_outs(rig, gate, rig, 0.0)
    assert (np.abs(found.mean(axis=0) - middle) < 5 * told / np.sqrt(count) + 0.1 * told).all()


def test_a_late_gate_and_a_slow_clock_show_as_what_they_are() -> None:
    """The derivatives by the two numbers that do not stand in a gate's law, by the gates that really come."""
    rig = check_rig(1600)
    line = rig.camera.shutter.line
    assert isinstance(line, PixelClocks)
    gate = plan(rig, 15.0, 1.05, 0.1)
    for name, error, other in (
        ("delay_offset_us", 2.0, replace(gate, delay_us=gate.delay_us + 2.0)),
        ("clocks_per_line", 0.2, replace(gate, line_time_us=gate.line_time_us * (1 + 0.2 / line.clocks_per_line))),
    ):
        known = replace(rig, calibration=Calibration((name,), ((error**2,),)))
        told = spread(known, lambda one, late_us: read_outs(rig, gate, one, late_us))
        expected = np.abs(read_outs(rig, other, rig, 0.0) - read_outs(rig, gate, rig, 0.0))
        np.testing.assert_allclose(told, expected, rtol=0.02)
    # a camera whose line times are set keeps them, whatever else is uncertain
    lines = check_rig(1600, FINE_LINES)
    assert really_made(lines, gate, lines, 3.0) == replace(gate, delay_us=gate.delay_us + 3.0)


def test_numbers_that_hang_together_may_cancel() -> None:
    """Focal length and distance of a gate: two errors that are one leave what depends on neither alone."""
    rig = check_rig(1600)

    def baseline_over_focal(one: Rig, _late_us: float) -> Doubles:
        return np.array([one.projector.lens.fy * 1e-4 + one.projector_offset_m[1]])

    for sign, expected in ((1.0, 2e-4), (-1.0, 0.0), (0.0, 1e-4 * np.sqrt(2))):
        known = Calibration(("projector.fy", "offset_y_m"), ((1.0, sign * 1e-4), (sign * 1e-4, 1e-8)))
        told = spread(replace(rig, calibration=known), baseline_over_focal)
        assert told == pytest.approx([expected], abs=1e-11)


def test_a_number_known_exactly_adds_nothing_and_none_is_no_calibration() -> None:
    def fy(one: Rig, _late_us: float) -> Doubles:
        return np.array([one.camera.lens.fy, one.projector.lens.fy])

    rig = check_rig(1600)
    exact = replace(rig, calibration=Calibration(("camera.fy", "projector.fy"), ((0.0, 0.0), (0.0, 4.0))))
    assert spread(exact, fy) == pytest.approx([0.0, 2.0])
    all_exact = replace(rig, calibration=Calibration(("camera.fy",), ((0.0,),)))
    assert spread(all_exact, fy) == pytest.approx([0.0, 0.0])
    assert spread(rig, fy) is None


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("active_fraction", 0.02),
        ("active_fraction", 5.0),
        ("camera.fy", 1e5),
        ("period_us", 1e6),
        ("offset_y_m", 30.0),
        ("camera.k1", 1e3),
        ("projector.fy", 1e-9),
        ("delay_offset_us", 1e-12),
    ],
)
def test_errors_of_any_size_are_told_to_first_order(name: str, error: float) -> None:
    """Beyond what a rig may be, and below what float64 can step by: the slope times the error, never a refusal."""
    rig = replace(check_rig(1600), projector=replace(check_rig(1600).projector, active_fraction=1.0))
    gate = plan(rig, 10.0, 1.05, 0.1)
    small = {"active_fraction": 1e-5, "camera.fy": 0.1, "period_us": 0.1, "offset_y_m": 1e-5, "camera.k1": 1e-4}
    step = small.get(name, 0.1)
    wide, narrow = (
        spread(
            replace(rig, calibration=Calibration((name,), ((size**2,),))),
            lambda one, late_us: read_outs(rig, gate, one, late_us),
        )
        for size in (error, step)
    )
    assert wide is not None
    assert narrow is not None
    np.testing.assert_allclose(wide / error, narrow / step, rtol=0.03, atol=1e-9)


def test_a_figure_that_is_missing_on_one_side_has_no_error() -> None:
    rig = calibrated(check_rig(1600))

    def only_above(one: Rig, _late_us: float) -> Doubles:
        return np.array([1.0 if one.camera.lens.fy >= rig.camera.lens.fy else np.nan, 2.0])

    told = spread(rig, only_above)
    assert told is not None
    assert np.isnan(told[0])
    assert told[1] == 0.0


@pytest.mark.parametrize("rig", [IDEAL, GENERAL], ids=["ideal", "general"])
@pytest.mark.parametrize("ups", [(True, False), (False, True), (True, True)])
def test_a_calibration_turns_with_the_rows(rig: Rig, ups: tuple[bool, bool]) -> None:
    """Drawn rigs that are turned scatter as the turned rig says, the angles about half a turn too."""
    found = in_scan_order(rig, *ups)
    assert found.calibration is not None
    assert found.calibration != rig.calibration
    count = 2000
    turned_rigs = [in_scan_order(with_numbers(rig, numbers), *ups) for numbers in drawn(rig, count)]
    scattered = np.array([pixels(one) for one in turned_rigs])
    told = spread(found, lambda one, _late_us: pixels(one))
    np.testing.assert_allclose(told, scattered.std(axis=0), rtol=4 / np.sqrt(2 * count))
    there_and_back = in_scan_order(found, *ups)
    assert there_and_back.calibration is not None
    assert rig.calibration is not None
    errors = np.sqrt(np.diag(rig.calibration.array))
    np.testing.assert_allclose(
        there_and_back.calibration.array / errors / errors[:, None],
        rig.calibration.array / errors / errors[:, None],
        atol=1e-6,
    )


def pixels(rig: Rig) -> Doubles:
    """Where a point before the camera is lit, and where it is seen."""
    local = np.array([[0.05, -0.1, 1.0], [0.2, 0.15, 1.4]])
    place = local + rig.camera_centre_m
    (column, row, _), (lit_column, lit_row, _) = rig.to_camera(place), rig.to_projector(place)
    return np.concatenate([column, row, lit_column, lit_row])


def test_an_angle_that_was_told_alone_becomes_those_that_follow_from_it() -> None:
    """Half a turn mixes the axes: the angle about one of them is then one about two."""
    rig = replace(turned(check_rig(1600)), calibration=Calibration(("rotation_x_rad",), ((1e-8,),)))
    found = in_scan_order(rig, False, True)
    assert found.calibration is not None
    assert set(found.calibration.names) == {"rotation_x_rad", "rotation_y_rad", "rotation_z_rad"}
    told = spread(found, lambda one, _late_us: np.degrees(one.rotation.ravel()))
    expected = spread(rig, lambda one, _late_us: np.degrees((np.diag([-1.0, -1, 1]) @ one.rotation).ravel()))
    np.testing.assert_allclose(told, expected, rtol=1e-6, atol=1e-11)


def test_larger_pixels_are_known_as_well() -> None:
    gate = plan(IDEAL, 15.0, 1.05, 0.1)
    small = binned_rig(IDEAL, 4)
    assert small.calibration is not None
    assert IDEAL.calibration is not None
    errors, before = small.calibration.standard_errors, IDEAL.calibration.standard_errors
    assert errors["camera.fy"] == pytest.approx(before["camera.fy"] / 4)
    assert errors["clocks_per_line"] == pytest.approx(before["clocks_per_line"] * 4)
    assert errors["projector.fy"] == pytest.approx(before["projector.fy"])
    other = spread(small, lambda one, late_us: read_outs(small, binned_gate(gate, 4), one, late_us))
    told = spread(IDEAL, lambda one, late_us: read_outs(IDEAL, gate, one, late_us))
    np.testing.assert_allclose(other, told, rtol=1e-6)


def test_only_what_stays_the_same_stays_known() -> None:
    other = replace(IDEAL, camera=replace(IDEAL.camera, shutter=replace(IDEAL.camera.shutter, delay_offset_us=9.0)))
    left = still_known(IDEAL, other)
    assert left.calibration is not None
    assert set(NUMBERS) - set(left.calibration.names) == {"delay_offset_us"}
    assert left.calibration.array == pytest.approx(IDEAL.calibration.array[:-1, :-1])  # type: ignore[union-attr]
    assert left.calibration.facts == IDEAL.calibration.facts  # type: ignore[union-attr]
    only = replace(other, calibration=Calibration(("delay_offset_us",), ((1.0,),)))
    assert still_known(IDEAL, only).calibration is None
    assert still_known(IDEAL, replace(other, calibration=None)).calibration is None


def test_a_change_of_terms_leaves_a_rig_without_calibration_alone() -> None:
    plain = replace(IDEAL, calibration=None)
    assert retold(plain, lambda one: replace(one, name="other")).calibration is None
    same = retold(IDEAL, lambda one: replace(one, name="other"))
    assert same.calibration is not None
    assert IDEAL.calibration is not None
    np.testing.assert_allclose(same.calibration.array, IDEAL.calibration.array, rtol=1e-6, atol=1e-20)


def test_the_covariance_of_a_turned_axis_is_that_of_the_chain_rule() -> None:
    """Against derivatives in closed form, by OpenCV's: of R' by R, where R' = R Rz(pi)."""
    rig = replace(turned(check_rig(1600), (20.0, -30.0, 100.0)))
    names = ("rotation_x_rad", "rotation_y_rad", "rotation_z_rad")
    rig = replace(rig, calibration=Calibration(names, ((1e-8, 2e-9, 0.0), (2e-9, 4e-8, 0.0), (0.0, 0.0, 1e-8))))
    assert rig.calibration is not None
    found = transformed(rig.calibration, rig, lambda one: in_scan_order(replace(one, calibration=None), True, False))
    after, there = in_scan_order(rig, True, False), numbers_of(in_scan_order(rig, True, False))
    by_before = cv2.Rodrigues(numbers_of(rig)[18:21])[1].reshape(3, 3, 3) @ np.diag([-1.0, -1.0, 1.0])
    by_after = np.linalg.pinv(cv2.Rodrigues(there[18:21])[1])
    slopes = (by_before.reshape(3, 9) @ by_after).T
    np.testing.assert_allclose(found.array, slopes @ rig.calibration.array @ slopes.T, rtol=1e-5, atol=1e-13)
    np.testing.assert_allclose(after.rotation @ after.rotation.T, np.eye(3), atol=1e-12)
