"""The timing of hidden rigs, through gates of the real virtual camera: what is found, what is told, what is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rigs import check_rig
from slopegate.core.calibration.chart import chart_from
from slopegate.core.calibration.chart_scene import chart_scene, held
from slopegate.core.calibration.target import FlatTarget
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.calibration import NUMBERS, TIMING, Calibration, as_rows
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, Steps
from slopegate.core.rig.uncertainty import numbers_of, with_numbers
from slopegate.core.scene.media import Fog
from slopegate.core.scene.scene import Scene
from slopegate.core.scene.shapes import plane, turn
from slopegate.drivers.calibrations.lit_view import see_lit, whole_gates
from slopegate.drivers.calibrations.pictures import CalibrationError
from slopegate.drivers.calibrations.seen_target import WrongChartError, plane_target
from slopegate.drivers.calibrations.timing_bench import TimingBench
from slopegate.drivers.calibrations.timing_run import (
    TimingAttendance,
    TimingPlan,
    TimingProgress,
    TimingState,
    run_timing,
)
from slopegate.drivers.cameras.faults import Faults
from slopegate.drivers.contract.frame import Abilities, Ability, CameraInfo
from slopegate.drivers.transports.shots import CameraShots
from timed_scenes import JITTER, HiddenPlane, TimingMisses, hidden_plane, misses

MISSING = Faults(missed=0.1, dropped=0.05, late=0.02, duplicated=0.05, jitter_us=5.0, late_s=0.005)
FRAMES = 120
THIN, THICK = Fog(0.1), Fog(0.25)
"""Such as take a fifth, and two fifths, of the light on its way to the plane and back."""


def timed(
    hidden: HiddenPlane,
    frames: int = FRAMES,
    faults: Faults | None = JITTER,
    seed: int = 0,
    by_code: bool = False,
    believed: Rig | None = None,
) -> TimingMisses:
    """How far the timing that gates tell is off."""
    bench = hidden.bench(seed, faults, believed)
    try:
        plan = TimingPlan(None if by_code else hidden.target, frames=frames)
        outcome = run_timing(bench.shots, believed or hidden.believed, plan, None, bench.projector)
    finally:
        bench.close()
    assert outcome is not None
    return misses(outcome, hidden)


def require_right(off: TimingMisses, offset_us: float, line_share: float, sigmas: float = 3.5) -> None:
    assert off.directions
    assert abs(off.off["delay_offset_us"]) < offset_us
    assert abs(off.off["clocks_per_line"]) / 1e4 < line_share
    assert max(map(abs, off.sigmas.values())) < sigmas


@pytest.mark.parametrize("seed", [1, 4])
def test_true_geometry_and_jitter_of_5_us_tell_the_timing(seed: int) -> None:
    require_right(timed(hidden_plane(seed)), 1.5, 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 112))
def test_more_hidden_timings_are_found_to_what_is_promised(seed: int) -> None:
    """Until it is known well enough: offset within 1 us, line time within 0.1 %."""
    require_right(timed(hidden_plane(seed), frames=600, seed=seed), 1.0, 1e-3, sigmas=4.0)


def test_missed_triggers_and_lost_and_late_frames_cost_frames_alone() -> None:
    require_right(timed(hidden_plane(4), faults=MISSING), 1.5, 1e-3)


@pytest.mark.parametrize(("seed", "fog"), [(201, THIN), (1, THICK)])
def test_fog_before_the_plane_does_not_mislead(seed: int, fog: Fog) -> None:
    """It bends the light beside an edge, which has its share in the standard errors."""
    require_right(timed(hidden_plane(seed, fog=fog), 240), 1.0, 1e-3, sigmas=3.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200, 206))
def test_more_hidden_timings_with_missed_triggers_and_in_fog(seed: int) -> None:
    fog = THIN if seed % 2 else None
    found = timed(hidden_plane(seed, fog=fog), 600, MISSING, seed)
    require_right(found, 1.0, 1e-3, sigmas=4.0)


def test_patterns_tell_the_rows_without_any_geometry() -> None:
    """The rig file's pose may be anything: rows are decoded."""
    hidden = hidden_plane(4)
    x, y, z = hidden.believed.projector_offset_m
    wrong = replace(hidden.believed, projector_offset_m=(x + 0.02, 0.8 * y, z - 0.01))
    found = timed(hidden, by_code=True, believed=wrong)
    require_right(found, 2.5, 2e-3)


def test_a_chart_is_its_own_plane() -> None:
    """320 pixels: its corners, and so its pose, are then known to a few microseconds of the offset."""
    rig = check_rig(320)
    chart = chart_from("9x6:60")
    scene = chart_scene(rig, chart, held(chart, (0.0, -0.02, 0.95), 10.0, 15.0))
    bench = TimingBench(scene, rig, rig, faults=JITTER)
    outcome = run_timing(bench.shots, rig, TimingPlan(chart, frames=60), None, bench.projector)
    assert outcome is not None
    assert outcome.how == "chart 9x6:60, 54 corners"
    known = outcome.rig.calibration
    assert known is not None
    error_us = known.standard_errors["delay_offset_us"]
    assert error_us > outcome.timing.standard_errors[2], "how well the chart's pose is known is part of it"
    offset_us = math.remainder(outcome.rig.camera.shutter.delay_offset_us, rig.projector.period_us)
    assert abs(offset_us) < 3.5 * error_us < 10
    facts = dict(known.facts)
    assert facts["timing.target"] == outcome.how
    assert facts["timing.frames"] == "60"
    assert len(facts["timing.pictures_sha256"]) == 64


def told_of_chart(named: str, tilt: float, pan: float) -> str:
    """What is said of a chart 9x6:60, held like this, that was named so; nothing where it is taken."""
    rig, chart = check_rig(320), chart_from("9x6:60")
    scene = chart_scene(rig, chart, held(chart, (0.0, -0.02, 0.95), tilt, pan))
    bench = TimingBench(scene, rig, rig, faults=JITTER)
    try:
        run_timing(bench.shots, rig, TimingPlan(chart_from(named), frames=60), None, bench.projector)
    except WrongChartError as error:
        return str(error)
    finally:
        bench.close()
    return ""


@pytest.mark.parametrize(
    ("named", "pan", "told"),
    [
        ("9x6:60", 15.0, ""),
        ("9x6:40", 15.0, r"if its squares are (59|60)[.\d]* mm, and not if they are 40 mm"),
        ("9x6:90", 15.0, r"if its squares are (59|60)[.\d]* mm, and not if they are 90 mm"),
        ("9x6:12", 0.0, r"if it were chart 9x6:12, \d+% of it would stand where the projector does not reach"),
    ],
)
def test_a_chart_of_another_size_is_refused(named: str, pan: float, told: str) -> None:
    """One that is panned is contradicted by the edges, one that faces the rig by what the projector reaches."""
    found = told_of_chart(named, 10.0 if pan else 0.0, pan)
    assert bool(found) == bool(told), found
    assert re.search(told, found), found


def test_it_is_told_frame_by_frame_and_ends_when_given_up() -> None:
    hidden = hidden_plane(4)
    bench = hidden.bench()
    told: list[TimingProgress] = []
    frames: list[int] = []

    def given_up() -> bool:
        return bool(told) and told[-1].frames >= 30

    attendance = TimingAttendance(told.append, given_up, lambda image: frames.append(int(image.max())))
    outcome = run_timing(bench.shots, hidden.believed, TimingPlan(hidden.target), attendance)
    assert outcome is not None
    states: list[TimingState] = [one.state for one in told]
    assert states == ["looking", *["running"] * 31, "cancelled"]
    assert [one.frames for one in told] == [0, *range(31), 30]
    assert told[10].timing is None
    timing = told[-1].timing
    assert timing is not None
    assert timing.values.tolist() == outcome.timing.values.tolist()
    assert all(one.gate is not None for one in told[1:])
    assert "should be to" in outcome.verdict.reason or "direction" in outcome.verdict.reason
    assert len(frames) >= 30
    assert not outcome.verdict.enough


def test_given_up_at_once_there_is_nothing() -> None:
    hidden = hidden_plane(4)
    bench = hidden.bench()
    plan = TimingPlan(hidden.target)
    assert run_timing(bench.shots, hidden.believed, plan, TimingAttendance(given_up=lambda: True)) is None


def short_exposures(rig: Rig, longest_us: float) -> Rig:
    shutter = replace(rig.camera.shutter, exposure_us=Steps(100.0, longest_us, 1.0))
    return replace(rig, camera=replace(rig.camera, shutter=shutter))


@pytest.mark.parametrize(("longest_us", "count"), [(50_000.0, 3), (16_000.0, 3), (5_000.0, 4), (2_000.0, 10)])
def test_everything_is_lit_between_a_few_gates_however_short(longest_us: float, count: int) -> None:
    hidden = hidden_plane(4)
    rig = short_exposures(hidden.believed, longest_us)
    assert len(whole_gates(rig)) == count
    bench = TimingBench(hidden.scene, hidden.true, rig, noise=False, projector_up=hidden.projector_up)
    taken = _taker(bench)
    view = see_lit(taken("white"), taken("black"), rig, (40.0, 4095))
    assert view is not None
    plain = TimingBench(hidden.scene, hidden.true, hidden.believed, noise=False, projector_up=hidden.projector_up)
    whole = _taker(plain)("white")(whole_gates(hidden.believed)[1])
    assert whole is not None
    other = 40.0 + hidden.believed.projector.period_us * view.ambient
    got, wanted = view.full, whole - other
    assert (view.ambient >= 0).all()
    assert float(view.ambient.mean()) > 0
    # But for rows at the ends of exposures, of which there are few.
    assert float((np.abs(got - wanted) > 5).mean()) < 0.03
    assert view.noise == 0.0


def _taker(bench: TimingBench) -> Callable[[str], Callable[[GateSettings], Counts | None]]:
    from slopegate.drivers.transports.shots import Order

    image = np.zeros((bench.shots.info.height, bench.shots.info.width), np.uint16)

    def by(shade: str) -> Callable[[GateSettings], Counts | None]:
        def take(gate: GateSettings) -> Counts | None:
            showing = bench.projector.white() if shade == "white" else bench.projector.black()
            assert bench.shots.take(Order(gate, showing, 0), image, lambda: False) is not None
            return image

        return take

    return by


def test_exposures_that_are_too_short_are_refused() -> None:
    rig = short_exposures(check_rig(160), 1000.0)
    with pytest.raises(CalibrationError, match=r"longest exposure is 1000 us: it must be at least 1543 us"):
        whole_gates(rig)


def refused(rig: Rig, scene: Scene, plan: TimingPlan, with_projector: bool = False) -> str:
    bench = TimingBench(scene, rig, rig)
    try:
        with pytest.raises(UserError) as caught:
            run_timing(bench.shots, rig, plan, None, bench.projector if with_projector else None)
    finally:
        bench.close()
    return str(caught.value)


WALL = Scene("wall", objects=(plane("wall", (0.0, 0.0, 1.2), (5.0, 4.0), turn(10.0, 10.0)),))


def test_what_is_no_plane_is_refused_with_a_sentence() -> None:
    rig = check_rig(160)
    chart = TimingPlan(chart_from("9x6:60"))
    assert "no chart 9x6:60 was found in the picture" in refused(rig, WALL, chart)
    assert "it is not known which projector rows light" in refused(rig, WALL, TimingPlan())
    behind = TimingPlan(FlatTarget((0.0, 0.0, -1.0)))
    assert "camera and projector share too little of the plane: 0 pixels in 0 rows" in refused(rig, WALL, behind)
    aside = TimingPlan(FlatTarget((1.0, 0.0, -0.475)))
    assert "share too little of the plane" in refused(rig, WALL, aside)
    dark = Scene("hole", objects=(plane("wall", (0.0, 0.0, 40.0), (500.0, 400.0), turn()),), ambient=0.4)
    told = refused(rig, dark, TimingPlan(FlatTarget((0.0, 0.0, 1 / 40))), with_projector=True)
    assert "the plane is too dark: the projector brings" in told
    assert "sees no light of the projector" in refused(rig, Scene("nothing", ambient=0.2), TimingPlan(), True)


def test_a_plane_that_is_elsewhere_is_never_enough() -> None:
    rig = check_rig(160)
    bench = TimingBench(WALL, rig, rig, faults=JITTER)
    outcome = run_timing(bench.shots, rig, TimingPlan(FlatTarget((0.0, 0.0, 1 / 1.5)), frames=80))
    assert outcome is not None
    assert not outcome.verdict.enough
    assert "rows of the picture off where one timing puts them" in outcome.verdict.reason


def test_numbers_of_a_plan_are_checked() -> None:
    with pytest.raises(InputError, match="frames is 5: it must be from 12 to 10000"):
        TimingPlan(None, frames=5)
    with pytest.raises(InputError, match="plane is 0,0,1,0: D must not be 0"):
        plane_target((0.0, 0.0, 1.0, 0.0))


class _Gateless(CameraShots):
    """Frames of a camera that cannot set its exposure."""

    @property
    def info(self) -> CameraInfo:
        return replace(super().info, limits=None, can=Abilities(exposure=Ability("It has no shutter to set.")))


def test_a_camera_without_gates_is_refused() -> None:
    bench = TimingBench(WALL, check_rig(160), check_rig(160))
    shots = _Gateless(bench.camera)
    with pytest.raises(CalibrationError, match=r"has no gates that could be timed: It has no shutter to set\."):
        run_timing(shots, check_rig(160), TimingPlan(FlatTarget((0.0, 0.0, 1.0))))


def test_one_clock_on_a_plane_that_faces_the_rig_leaves_numbers_open() -> None:
    """Rows of camera and projector then go together, and so do line time and active fraction: that is said."""
    rig = check_rig(160)
    line = rig.camera.shutter.line
    assert isinstance(line, PixelClocks)
    shutter = replace(rig.camera.shutter, line=replace(line, ladder_mhz=(110.0,)))
    rig = replace(rig, camera=replace(rig.camera, shutter=shutter))
    scene = Scene("wall", objects=(plane("wall", (0.0, 0.0, 1.2), (5.0, 4.0), turn()),))
    bench = TimingBench(scene, rig, rig, faults=JITTER)
    outcome = run_timing(bench.shots, rig, TimingPlan(FlatTarget((0.0, 0.0, 1 / 1.2)), frames=48), None)
    assert outcome is not None
    assert [line.clock_mhz for line in outcome.line_times] == [110.0]
    assert not outcome.verdict.enough
    assert set(outcome.open_numbers) >= {"active_fraction", "line_time_us"}


GEOMETRY_ERRORS = {
    "camera.fy": 0.2,
    "camera.cy": 0.1,
    "projector.fy": 1.0,
    "projector.cy": 0.5,
    "rotation_x_rad": 3e-4,
    "offset_y_m": 1e-4,
}


def calibrated(hidden: HiddenPlane, seed: int) -> Rig:
    """The believed rig as a calibration of its geometry would tell it: off by its standard errors, which are told."""
    draw = np.random.default_rng((seed, 0xCA))
    rig = hidden.believed
    numbers = numbers_of(rig)
    for name, error in GEOMETRY_ERRORS.items():
        numbers[NUMBERS.index(name)] += error * draw.standard_normal()
    covariance = as_rows(np.diag(np.square(list(GEOMETRY_ERRORS.values()))))
    known = Calibration(tuple(GEOMETRY_ERRORS), covariance)
    return replace(with_numbers(rig, numbers), calibration=known)


def test_a_calibrated_geometry_s_errors_are_part_of_the_offset_s() -> None:
    hidden = hidden_plane(4)
    rig = calibrated(hidden, 4)
    bench = hidden.bench(believed=rig)
    outcome = run_timing(bench.shots, rig, TimingPlan(hidden.target, frames=96), None, bench.projector)
    assert outcome is not None
    known = outcome.rig.calibration
    assert known is not None
    assert set(known.names) >= {*GEOMETRY_ERRORS, *TIMING}
    told_us, pictures_us = known.standard_errors["delay_offset_us"], outcome.timing.standard_errors[2]
    assert told_us > 5 * pictures_us, "half a projector row is ten microseconds"
    found = misses(outcome, hidden)
    assert found.directions
    assert max(map(abs, found.sigmas.values())) < 3.5


@pytest.mark.slow
def test_with_calibrated_geometries_numbers_are_within_three_standard_errors() -> None:
    off = []
    for seed in range(300, 340):
        hidden = hidden_plane(seed)
        found = timed(hidden, 96, JITTER, seed, believed=calibrated(hidden, seed))
        assert found.directions
        off.append(list(found.sigmas.values()))
    within = (np.abs(off) <= 3).mean(axis=0)
    print("within three standard errors:", within, "rms:", np.sqrt(np.mean(np.square(off), axis=0)))
    assert (within >= 0.95).all()
