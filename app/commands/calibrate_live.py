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
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from slopegate.app.commands.capture_camera import USUAL_WAIT_S, opened_camera
from slopegate.app.commands.projecting import project
from slopegate.app.commands.report import CommandError, ShareLine, print_warnings, say_line
from slopegate.app.commands.transport_camera import USUAL_SETTLE_FRAMES, USUAL_TRANSFER_US
from slopegate.core.calibration.advice import (
    coverage,
    distance_error,
    hint,
    next_pose,
    pose_of,
    verdict,
    view_verdict,
)
from slopegate.core.calibration.chart import Chart
from slopegate.core.calibration.chart_scene import ChartPose
from slopegate.core.calibration.geometry import LEAST_VIEWS, Geometry
from slopegate.core.calibration.response import LevelResponse
from slopegate.core.calibration.sight import ChartSight
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.calibrations.geometry_run import GeometryRun
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
from slopegate.drivers.transports.shots import CameraShots, Shots

MOST_VIEWS: Final = 60
"""Poses that are taken at most, good ones and others."""
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
    rig: Rig
    poses: list[ChartPose] = field(default_factory=list)
    geometry: Geometry | None = None
    response: LevelResponse | None = None

    def add(self, sight: ChartSight) -> None:
        """Take a view that was looked at into account."""
        if not self.run.views[-1].usable or sight.corners is None:
            return
        pose = pose_of(self.run.chart, self.rig.camera.lens, sight.corners)
        if pose is not None:
            self.poses.append(pose)
        if self.run.usable >= LEAST_VIEWS:
            self._fit()

    def _fit(self) -> None:
        try:
            found = self.run.finish(self.base)
        except UserError:  # all from one side so far: the rig stays as it was believed to be
            return
        self.rig, self.geometry = found.rig, found.geometry

    def judged(self) -> tuple[bool, str]:
        """Whether it is enough, and how good it is in words."""
        lens = self.rig.camera.lens
        views = [view.view for view in self.run.views if view.usable and view.view is not None]
        error = float("inf")
        if self.geometry is not None and self.poses:
            error = distance_error(self.rig, np.concatenate([p.placed(self.run.chart.points_m) for p in self.poses]))
        count = coverage([view.camera for view in views], (lens.width, lens.height))
        told = verdict(self.run.usable, count, self.geometry, error)
        return told.light == "green", told.text


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
    settle = USUAL_SETTLE_FRAMES if options.settle_frames is None else options.settle_frames
    try:
        return project(options.screen, settle, load_rig(options.rig), partial(_take_live, options, chart, keep))
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
        transfer_us = USUAL_TRANSFER_US if options.transfer_us is None else options.transfer_us
        shots = CameraShots(camera, transfer_us, timeout_s=options.wait_s or USUAL_WAIT_S)
        gate = open_gate(rig, camera.info)
        raster = projector.info.raster
        warnings = _other_size(rig, raster)
        views = _Views(GeometryRun(chart, raster), rig, rig)
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
    views = _Views(GeometryRun(chart, base.projector.raster), base, base)
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
    for _ in range(MOST_VIEWS):
        enough, told = views.judged()
        if views.run.usable >= wanted if wanted is not None else enough:
            _say(told)
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
