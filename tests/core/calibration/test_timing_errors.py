"""Timing on top of a calibrated geometry: its errors are part of the timing's, and both err together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from slopegate.core.calibration.applied import with_geometry, with_timing
from slopegate.core.calibration.geometry import ChartView, calibrate
from slopegate.core.calibration.law import Shot
from slopegate.core.calibration.target import FlatTarget, TargetOf, chart_target, flat_part, target_rows
from slopegate.core.calibration.timing import GateTiming
from slopegate.core.calibration.timing_errors import TimingErrors, timing_covariance
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.axis import infinity_us, solve_axis, time_on_axis
from slopegate.core.rig.calibration import GEOMETRY, TIMING
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.core.rig.uncertainty import spread
from slopegate.core.rig.variants import in_scan_order
from tests.support.gated_target import GatedTarget, HiddenTiming, drawn_timing, measured, off_us, small_rig

POINTS = np.array([[x, y, 0.0] for y in np.linspace(-0.12, 0.12, 6) for x in np.linspace(-0.12, 0.12, 8)])
CORNER_PX = 0.1


def pictured(rig: Rig, turn: Doubles, shift: Doubles) -> tuple[Doubles, Doubles]:
    """Where camera and projector see the chart's points, both (N, 2) pixels."""
    world = POINTS @ np.asarray(cv2.Rodrigues(turn)[0]).T + shift + rig.camera_centre_m
    camera, projector = (np.stack(see(world)[:2], axis=1) for see in (rig.to_camera, rig.to_projector))
    return camera, projector


def drawn_pose(random: np.random.Generator) -> tuple[Doubles, Doubles]:
    turn = random.uniform(-0.5, 0.5, 3)
    return turn, np.array([*random.uniform(-0.05, 0.05, 2), random.uniform(0.6, 1.0)])


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A rig that was calibrated with noisy corners, and then its timing with that geometry."""

    true: Rig
    hidden: HiddenTiming
    rig: Rig
    timed: Rig
    timing: GateTiming
    errors: TimingErrors
    shots: list[Shot]
    place: TargetOf


def calibrated(seed: int) -> Calibrated:
    random = np.random.default_rng(seed)
    true = small_rig(float(random.uniform(0.88, 0.95)))
    views = []
    for number in range(10):
        pose = drawn_pose(random)
        camera, projector = (seen + random.normal(0, CORNER_PX, seen.shape) for seen in pictured(true, *pose))
        views.append(ChartView(str(number), POINTS, camera, projector))
    sizes = [(lens.width, lens.height) for lens in (true.camera.lens, true.projector.lens)]
    geometry = calibrate(views, sizes[0], sizes[1], held_out=False)
    nominal = replace(true, projector=replace(true.projector, active_fraction=0.92))
    rig = with_geometry(nominal, geometry, ())
    turn, shift = 0.4 * random.uniform(-1, 1, 3), np.array([0.0, 0.0, random.uniform(0.6, 0.9)])
    corners = pictured(true, turn, shift)[0]
    seen = corners + random.normal(0, CORNER_PX, corners.shape)

    def place(other: Rig) -> FlatTarget:
        return chart_target(other, POINTS, seen)

    hidden = drawn_timing(random, jitter_us=3.0)
    target = chart_target(true, POINTS, corners)
    view = GatedTarget(true, target, hidden, random, rig, place(rig))
    timing, shots = measured(view, most=60, every=24)
    assert timing is not None
    errors = timing_covariance(timing, rig, shots, [place])
    return Calibrated(true, hidden, rig, with_timing(rig, timing, errors, ()), timing, errors, shots, place)


def distance_sigmas(found: Calibrated) -> float:
    """By how many standard errors a gate's distance on the axis is off, of a gate that is to reach 0.75 m.

    NaN where that is more than a tenth of the distance: the delay hardly tells it, as on many rigs whose scans are
    opposed, and an error that grows by itself is none that could be counted in standard errors.
    """
    clock, hidden = 78.0, found.hidden

    def line_us(rig: Rig) -> float:
        line = rig.camera.shutter.line
        assert isinstance(line, PixelClocks)
        return line.line_time_us(clock)

    delay = time_on_axis(found.timed, line_us(found.timed), 1 / 0.75)

    def distance(rig: Rig, late_us: float) -> Doubles:
        past_infinity = delay + late_us - float(infinity_us(rig, line_us(rig)))
        return np.array([1 / solve_axis(rig, line_us(rig), past_infinity).w])

    error = spread(found.timed, distance)
    assert error is not None
    true = in_scan_order(found.true, hidden.camera == "up", hidden.projector == "up")
    line = true.camera.shutter.line
    assert isinstance(line, PixelClocks)
    real = replace(line, clocks_per_line=line.clocks_per_line * hidden.stretch)
    true = replace(true, camera=replace(true.camera, shutter=replace(true.camera.shutter, line=real)))
    # The delay that is set is shorter by the offset that was found, and comes later by the real one.
    gap = distance(found.timed, 0.0) - distance(true, -off_us(found.timing, hidden))
    return float((gap / error)[0]) if error[0] < 0.1 * 0.75 else math.nan


def test_geometry_has_its_share_in_the_offset() -> None:
    found = calibrated(0)
    own = found.timing.standard_errors[2]
    whole = float(np.sqrt(found.errors.covariance[3, 3]))
    assert whole > 2 * own
    assert abs(off_us(found.timing, found.hidden)) < 3.5 * whole
    assert abs(off_us(found.timing, found.hidden)) > 0.5 * own
    # Rows that patterns were decoded to do not depend on the geometry.
    alone = timing_covariance(found.timing, found.rig, found.shots)
    assert alone.covariance[3, 3] == pytest.approx(own**2)
    assert not alone.by_geometry.any()


def test_both_errors_stay_tied_in_the_rig() -> None:
    found = calibrated(4)
    known = found.timed.calibration
    assert known is not None
    assert set(known.names) == {*GEOMETRY, *TIMING}
    assert np.linalg.eigvalsh(known.array / np.outer(*2 * [np.sqrt(np.diag(known.array))])).min() > -1e-9
    shutter = found.timed.camera.shutter
    assert shutter.delay_offset_us == pytest.approx(-found.timing.offset_us)
    assert abs(distance_sigmas(found)) < 4


@pytest.mark.slow
def test_the_offset_is_within_three_standard_errors_that_include_the_geometry_s() -> None:
    offsets, distances = [], []
    for seed in range(200):
        found = calibrated(2000 + seed)
        offsets.append(off_us(found.timing, found.hidden) / float(np.sqrt(found.errors.covariance[3, 3])))
        distances.append(distance_sigmas(found))
    told = [one for one in distances if math.isfinite(one)]
    assert len(told) > 80
    for name, off in (("offset", offsets), ("distance", told)):
        print(len(off), name, "within three standard errors:", np.mean(np.abs(off) <= 3), "rms", np.std(off))
        assert np.mean(np.abs(off) <= 3) >= 0.98


def test_the_largest_plane_is_found_by_its_rows() -> None:
    """A second plane, and a curved thing, are no part of it."""
    rig = small_rig()
    lens = rig.camera.lens
    rows = target_rows(rig, FlatTarget((0.1, -0.2, 1.2)))
    other = np.zeros(rows.shape, np.bool_)
    other[:, : lens.width // 3] = True
    rows[other] = target_rows(rig, FlatTarget((0.0, 0.3, 2.0)))[other]
    bowl = np.zeros(rows.shape, np.bool_)
    bowl[lens.height // 2 :, -lens.width // 5 :] = True
    rows[bowl] += (30 * np.sin(np.linspace(0.5, 2.5, bowl.sum()))).astype(np.float32)
    known = rows > 1
    flat = flat_part(rig, rows, known)
    plain = known & ~other & ~bowl
    assert flat[plain].all()
    assert flat[known & other].mean() < 0.1
    assert flat[known & bowl].mean() < 0.1
