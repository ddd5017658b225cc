"""`slopegate calibrate --camera` and `--practice`: poses of the chart one after the other, taken and looked at at once.

A real rig's chart is held by somebody, who is told how and says when; the practice rig holds its own.
"""

from __future__ import annotations

import os
import select
import shlex
import sys
from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, Protocol

from slopegate.app.commands.calibrate import MOST_POSES
from slopegate.app.commands.capture_camera import opened_camera
from slopegate.app.commands.projecting import project
from slopegate.app.commands.report import CommandError, ShareLine, print_warnings, say_line
from slopegate.app.commands.transport_camera import camera_shots, settle_frames
from slopegate.core.calibration.advice import Judgement, hint, next_pose, view_verdict
from slopegate.core.calibration.chart import Chart
from slopegate.core.calibration.chart_scene import ChartPose, pose_of
from slopegate.core.calibration.geometry import LEAST_VIEWS
from slopegate.core.calibration.response import LevelResponse
from slopegate.core.calibration.sight import ChartSight
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.calibrations.geometry_run import CalibratedGeometry, GeometryRun, judgement
from slopegate.drivers.calibrations.pictures import PoseFrames, pose_folders, read_pose
from slopegate.drivers.calibrations.practice import PracticeRig
from slopegate.drivers.calibrations.taking import (
    PoseAttendance,
    light_advice,
    next_pose_number,
    open_gate,
    pose_name,
    take_pose,
    take_response,
)
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.files.durable import check_folder
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.transports.shots import Shots

_SLICE_S: Final = 0.2


class Holder(Protocol):
    """Holds the chart."""

    def __call__(self, wanted: ChartPose | None, words: str) -> bool:
        """Hold it like this, told in words too; False when no pose is to follow."""
        ...


@dataclass
class _Views:
    """The views so far, and the rig as they tell it."""

    run: GeometryRun
    base: Rig
    poses: list[ChartPose] = field(default_factory=list)
    found: CalibratedGeometry | None = None
    response: LevelResponse | None = None

    def add(self, sight: ChartSight) -> None:
        """Take a view that was looked at into account."""
        if not self.run.views[-1].usable or sight.corners is None:
            return
        points = self.run.chart.points_m[sight.corners.index]
        pose = pose_of(self.rig.camera.lens, points, sight.corners.points)
        if pose is not None:
            self.poses.append(pose)
        if self.run.usable >= LEAST_VIEWS:
            self._fit()

    @property
    def rig(self) -> Rig:
        """As it is known so far."""
        return self.base if self.found is None else self.found.rig

    def _fit(self) -> None:
        # all from one side so far: the rig stays as it was believed to be
        with suppress(UserError):
            self.found = self.run.finish(self.base)

    def judged(self) -> Judgement:
        """Whether it is enough, and how good it is in words."""
        return judgement(self.run.chart, self.run.usable, self.found)


@dataclass(frozen=True)
class _Taker:
    """What takes the pictures of a pose, and where they are kept."""

    projector: Projector
    shots: Shots
    gate: GateSettings | None
    keep: Path | None
    interrupted: Callable[[], bool]

    def take(self, number: int) -> PoseFrames | None:
        """The pictures of a pose; None when interrupted."""
        name = pose_name(number)
        line = ShareLine(f"{name}: taking pictures")
        attendance = PoseAttendance(lambda done, count: line(done / count), self.interrupted)
        try:
            return take_pose(name, self.projector, self.shots, self.gate, attendance, number=number, folder=self.keep)
        finally:
            say_line("")

    def response(self) -> LevelResponse | None:
        """How the projector answers grey levels, from what it lights now; None where that cannot be told."""
        attendance = PoseAttendance(given_up=self.interrupted)
        try:
            return take_response(self.projector, self.shots, self.gate, attendance)
        except InputError as error:
            print_warnings([f"gamma is not told: {error}"])
            return None


@dataclass(frozen=True)
class LiveResult:
    """The views that were taken, and the rig that they belong to before its geometry is known."""

    views: GeometryRun
    base: Rig
    warnings: tuple[str, ...] = ()
    hidden: Rig | None = None
    """Of a practice rig."""
    response: LevelResponse | None = None
    """Of the projector to grey levels."""


def calibrate_with_camera(options: Namespace, chart: Chart) -> LiveResult:
    """Poses that a camera sees, with patterns on the screen that is the projector.

    Raises CommandError for a camera that does not open or a screen that is not there, and what taking a pose raises.
    """
    keep = _kept_in(options)
    check_folder(keep)
    try:
        return project(
            options.screen, settle_frames(options), load_rig(options.rig), partial(_take_live, options, chart, keep)
        )
    except KeyboardInterrupt:
        kept = len(pose_folders(keep)) if next_pose_number(keep) else 0
        words = ["--chart", options.chart, *(["--rig", options.rig] if options.rig else []), "--out", options.out]
        again = " ".join(["slopegate calibrate", *(shlex.quote(str(word)) for word in (keep, *words))])
        raise KeyboardInterrupt(
            f"interrupted: poses kept in {keep}: {kept}; start it again to go on, or fit those: {again}"
        ) from None


def _kept_in(options: Namespace) -> Path:
    """Where a camera's pictures are kept: nobody holds a chart twice because a fit did not do."""
    keep: Path = options.keep or options.out.with_name(f"{options.out.stem}_poses")
    return keep


def _take_live(
    options: Namespace, chart: Chart, keep: Path, projector: Projector, interrupted: Callable[[], bool]
) -> LiveResult:
    with ExitStack() as held:
        camera, rig = opened_camera(options, held, gated=False)
        shots = camera_shots(options, camera)
        gate = open_gate(rig, camera.info)
        raster = projector.info.raster
        warnings = _other_size(rig, raster)
        views = _Views(GeometryRun(chart, raster), rig)
        _take_up(views, keep, raster)
        camera.start()
        terminal = _Terminal(projector, interrupted)
        _take_views(views, _Taker(projector, shots, gate, keep, interrupted), terminal, options.views)
        return LiveResult(views.run, rig, warnings, response=views.response)


def _other_size(rig: Rig, raster: Raster) -> tuple[str, ...]:
    if raster == rig.projector.raster:
        return ()
    return (
        f"the screen has {raster} pixels and the rig file's projector {rig.projector.raster}: it is calibrated as the "
        "screen is",
    )


def _take_up(views: _Views, keep: Path, raster: Raster) -> None:
    """Poses that an earlier start has kept count as well."""
    if next_pose_number(keep) == 0:
        return
    for folder in pose_folders(keep):
        views.add(views.run.add(read_pose(folder, raster)))
        _say(f"{folder.name}, taken before: {view_verdict(views.run.views[-1]).text}")


class _Terminal:
    """Asks somebody at the terminal to hold the chart."""

    def __init__(self, projector: Projector, interrupted: Callable[[], bool]) -> None:
        self._projector, self._interrupted = projector, interrupted

    def __call__(self, wanted: ChartPose | None, words: str) -> bool:
        self._projector.white()
        _say(f"{words} Then press Enter; 'done' ends it.")
        line = _line(self._interrupted)
        return line is not None and line.strip().lower() not in ("done", "d", "q", "quit")


def _line(interrupted: Callable[[], bool]) -> str | None:
    """A line from standard input; None where it has ended, or when interrupted meanwhile."""
    while not interrupted():
        try:
            ready = os.name == "nt" or bool(select.select([sys.stdin], [], [], _SLICE_S)[0])
        except (OSError, ValueError):  # no file
            ready = True
        if ready:
            return sys.stdin.readline() or None
    return None


def calibrate_practice(options: Namespace, chart: Chart) -> LiveResult:
    """Poses that a practice rig sees, with numbers that are told at the end."""
    base = load_rig(options.rig)
    practice = PracticeRig(base, chart, options.practice)
    if options.keep is not None:
        check_folder(options.keep)
    views = _Views(GeometryRun(chart, base.projector.raster), base)
    practice.camera.start()

    def hold(wanted: ChartPose | None, words: str) -> bool:
        if wanted is None:
            raise CommandError(f"the chart {chart} is nowhere seen whole by camera and projector: take a smaller one")
        _say(words)
        practice.move(wanted)
        return True

    try:
        gate = open_gate(base, practice.camera.info)
        taker = _Taker(practice.projector, practice.shots(), gate, options.keep, lambda: False)
        _take_views(views, taker, hold, options.views)
    finally:
        practice.camera.close()
    return LiveResult(views.run, base, hidden=practice.truth, response=views.response)


def _take_views(views: _Views, taker: _Taker, hold: Holder, wanted: int | None) -> None:
    """Pose after pose, until there are as many good ones as wanted, or None: until it is enough."""
    number = 0
    for _ in range(MOST_POSES):
        judged = views.judged()
        if views.run.usable >= wanted if wanted is not None else judged.light == "green":
            _say(judged.text)
            return
        number = next_pose_number(taker.keep, number)
        pose = next_pose(views.rig, views.run.chart, views.poses)
        place = "Hold the chart where both see all of it." if pose is None else hint(views.run.chart, None, pose)
        if not hold(pose, f"{pose_name(number)}: {place}"):
            return
        taken = taker.take(number)
        if taken is None:
            return
        views.add(views.run.add(taken))
        _say(f"  {view_verdict(views.run.views[-1]).text}")
        print_warnings(filter(None, [light_advice(taken)]))
        if views.run.views[-1].usable and views.response is None:
            views.response = taker.response()
        number += 1


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
