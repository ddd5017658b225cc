"""The work of a calibration beside the window: looks for the chart, takes poses, fits, all in threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from PySide6.QtCore import QObject, QTimer, Signal

from slopegate.app.panels.calibrate_device import Answering, CalibratedDevice
from slopegate.app.session.describe import as_sentence
from slopegate.app.session.loading import WRITTEN_S, Loader, Newest, Progress
from slopegate.app.session.session import Session
from slopegate.core.calibration.advice import hint, is_there, next_pose, outline_m
from slopegate.core.calibration.chart import Chart, Corners
from slopegate.core.calibration.chart_scene import ChartPose, pose_of, seen_by_both
from slopegate.core.calibration.geometry import LEAST_VIEWS, ChartView
from slopegate.core.calibration.glance import glance
from slopegate.core.calibration.response import LevelResponse
from slopegate.core.rig.arrays import Bytes, Doubles
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.rig import Lens, Rig
from slopegate.drivers.calibrations.geometry_run import CalibratedGeometry, GeometryRun
from slopegate.drivers.calibrations.pictures import PoseFrames, pose_folders, read_pose
from slopegate.drivers.calibrations.sizes import projector_of
from slopegate.drivers.calibrations.taking import light_advice, next_pose_number, pose_name

LOOK_MS: Final = 250
"""From one look for the chart to the next, at least."""
SHOWN_PX: Final = 800
"""Width of the live picture that is shown, at most."""
LOOKED: Final = 0.6
"""Of the progress of a pose, when its pictures begin to be looked at."""
READ: Final = 0.9
"""Of the progress of a folder, when all of it has been read and looked at."""
FITTED: Final = 0.9
"""Of either, when the fit begins."""
RESTS_PX: Final = 1.5
"""How little the chart's corners move between two looks while it rests, pixels of the picture on the average."""
RESTS_LOOKS: Final = 3
"""So many looks in a row have to find it resting where it is wanted before a pose is taken by itself."""


MakeDevice = Callable[[Progress], CalibratedDevice]


@dataclass(frozen=True, eq=False)
class ChartLook:
    """What one look for the chart found: a small picture (h, w), and corners and pose in the camera's own pixels."""

    picture: Bytes
    size: tuple[int, int]
    corners: Corners | None
    pose: ChartPose | None


@dataclass(frozen=True, eq=False)
class Advice:
    """How to hold the chart next, and its outline (4, 2) in the camera's picture."""

    pose: ChartPose
    outline: Doubles


@dataclass(frozen=True, eq=False)
class Taken:
    """What a job on the views has come to: result or why there is none, advice, and what is to be said."""

    work: CalibrationWork
    result: CalibratedGeometry | None
    why: str
    advice: Advice | None
    remark: str


@dataclass(eq=False)
class CalibrationWork:
    """All that belongs to one calibration."""

    chart: Chart
    device: CalibratedDevice
    folder: Path
    views: GeometryRun
    chart_error_percent: float
    poses: dict[str, ChartPose] = field(default_factory=dict)
    """How the chart was held, by the name of the view."""
    left_out: set[str] = field(default_factory=set)
    result: CalibratedGeometry | None = None
    why: str = ""
    """Why there is no result."""
    response: LevelResponse | None = None
    """Of the projector to grey levels, from the first pose that tells it."""
    no_response: str = "it is told with the first pose"
    """Why there is none."""

    @property
    def rig(self) -> Rig:
        """As it is known so far."""
        return self.device.believed if self.result is None else self.result.rig

    @property
    def used(self) -> list[ChartView]:
        """The views that a fit takes."""
        found = (view for view in self.views.views if view.usable and view.name not in self.left_out)
        return [view.view for view in found if view.view is not None]

    @property
    def next_number(self) -> int:
        """The number of the next pose, from 0: one whose name neither a view nor a folder has."""
        known, number = {view.name for view in self.views.views}, next_pose_number(self.folder)
        while pose_name(number) in known:
            number = next_pose_number(self.folder, number + 1)
        return number


class CalibrationRun(QObject):
    """One calibration at a time. Everything that takes long is done in threads; pictures that are taken are kept."""

    looked = Signal(object)
    """A ChartLook, a few times a second while `watch` is on."""
    changed = Signal()
    """Views, result or advice are others, or work has begun or ended."""
    progressed = Signal(float, str)
    said = Signal(str)
    """What has happened, in a sentence."""
    failed = Signal(str)
    """What did not, in a sentence."""

    def __init__(self, session: Session, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.work: CalibrationWork | None = None
        self.advice: Advice | None = None
        self._skipped: list[ChartPose] = []
        """Advised poses that are not wanted."""
        self._rested = 0
        self._last_corners: Doubles | None = None
        self._looks: Newest[ChartLook] = Newest(self)
        self._looks.finished.connect(self._on_look)
        self._looks.failed.connect(self._on_look_failed)
        self._loader: Loader[Taken] = Loader(self._discard, self)
        self._loader.progressed.connect(self.progressed)
        self._loader.finished.connect(self._on_taken)
        self._loader.failed.connect(self._on_failed)
        self._shower: Loader[bool] = Loader(lambda _: None, self)
        self._shower.failed.connect(self.failed)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        fate = "Poses that were taken are kept in their folder; the one under way is lost."
        self._hold = session.hold("the calibration", fate, self.stop_work)
        self._loader.release(self._hold)
        self._look_fault = ""

    @property
    def busy(self) -> bool:
        """Whether a pose is being taken, read or fitted."""
        return self._loader.busy

    @property
    def rests_there(self) -> bool:
        """Whether the chart has come to rest where it is wanted."""
        return self._rested >= RESTS_LOOKS

    # Beginning and ending

    def begin(
        self, chart: Chart, make: MakeDevice, folder: Path, chart_error_percent: float, read: bool = False
    ) -> None:
        """Calibrate what `make` gives with this chart from now on; what there was is forgotten, but stays on the disk.

        make: called in another thread. read: the poses that the folder holds, at once.
        """
        self.stop_work()
        self.forget()

        def job(progress: Progress) -> Taken:
            device = make(progress)
            views = GeometryRun(chart, device.raster)
            work = CalibrationWork(chart, device, folder, views, chart_error_percent)
            return fitted(work, [], progress, read_poses(work, progress) if read else "")

        self._start(job)

    def forget(self) -> None:
        """Let go what was calibrated."""
        work, self.work, self.advice = self.work, None, None
        self._skipped.clear()
        self._look_fault = ""
        self._looks.cancel()
        if work is not None:
            work.device.close()

    def watch(self, wanted: bool) -> None:
        """Look for the chart from now on, or no longer."""
        if wanted and not self._timer.isActive():
            self._timer.start(LOOK_MS)
            self._look()
        elif not wanted:
            self._timer.stop()
            self._looks.cancel()

    def stop_work(self) -> None:
        """Stop what is under way; what is on the disk stays."""
        if self._loader.busy:
            self._loader.cancel()
            self.said.emit("Stopped: the pose under way was not kept.")
            self.changed.emit()

    def close(self) -> None:
        """Stop all, and wait until what is being written is written."""
        self._timer.stop()
        self._looks.close()
        self._shower.close()
        self._loader.close(WRITTEN_S)
        self.forget()

    # What is done

    def take(self) -> None:
        """Take the pose in which the chart is held now. Raises UserError."""
        work = self.work
        if work is None or self.busy:
            return
        number, skipped = work.next_number, list(self._skipped)
        name = pose_name(number)
        take = work.device.taking(name, number, work.folder)
        answer = work.device.answering(name) if work.response is None else None
        self._rested = 0
        self._hold.begin(work.device.needs)

        def job(progress: Progress) -> Taken:
            pose = take(progress)
            response = None if answer is None else answered(work, answer, progress)
            progress.step(LOOKED, f"Looking at {name} ...")
            if add(work, pose) and response is not None:
                work.response = response
            return fitted(work, skipped, progress, as_sentence(light_advice(pose)))

        self._start(job)

    def read(self, folder: Path) -> None:
        """Read the poses that a folder holds, in place of those that there are."""
        before = self.work
        if before is None or self.busy:
            return
        device = before.device
        views = GeometryRun(before.chart, device.raster)
        self.work = work = CalibrationWork(before.chart, device, folder, views, before.chart_error_percent)
        self.advice = None
        self._skipped.clear()
        self._start(lambda progress: fitted(work, [], progress, read_poses(work, progress)))

    def leave_out(self, name: str, out: bool) -> None:
        """Leave a view out of the fit, or take it in again."""
        work = self.work
        if work is not None and not self.busy:
            (work.left_out.add if out else work.left_out.discard)(name)
            self._refit("Fitting anew ...")

    def skip(self) -> None:
        """Advise another pose than the one that is advised now."""
        if self.advice is not None and not self.busy:
            self._skipped.append(self.advice.pose)
            self._refit("Looking for another pose ...")

    def show(self, pattern: Bytes) -> None:
        """Show a pattern through the projector. Raises UserError."""
        if self.work is not None and not self.busy:
            show = self.work.device.showing(pattern)
            self._shower.start(lambda _: bool(show()) or True)

    def _refit(self, doing: str) -> None:
        work, skipped = self.work, list(self._skipped)
        if work is None:
            return

        def job(progress: Progress) -> Taken:
            progress.step(0.5, doing)
            return fitted(work, skipped, progress)

        self._start(job)

    def _discard(self, late: Taken) -> None:
        if late.work is not self.work:
            late.work.device.close()

    def _start(self, job: Callable[[Progress], Taken]) -> None:
        self._loader.start(job)
        self.changed.emit()

    def _on_taken(self, taken: Taken) -> None:
        if self.work is not taken.work and self.work is not None:
            self.work.device.close()
        self.work = taken.work
        taken.work.result, taken.work.why = taken.result, taken.why
        self.advice = taken.advice
        self.said.emit(taken.remark)
        self.changed.emit()

    def _on_failed(self, sentence: str) -> None:
        self.failed.emit(sentence)
        self.changed.emit()

    # Looking

    def _look(self) -> None:
        work = self.work
        if work is None or self.busy or self._looks.busy:
            return
        sight = work.device.sight()
        if sight is None:
            return
        chart, lens = work.chart, work.rig.camera.lens

        self._looks.want(lambda _: looked(chart, lens, sight()))

    def _on_look(self, look: ChartLook) -> None:
        self._look_fault = ""
        self._rested = self._rested + 1 if self._is_resting(look) else 0
        self._last_corners = None if look.corners is None else look.corners.points
        self.looked.emit(look)

    def _on_look_failed(self, sentence: str) -> None:
        if sentence != self._look_fault:
            self._look_fault = sentence
            self.failed.emit(sentence)

    def _is_resting(self, look: ChartLook) -> bool:
        before, work = self._last_corners, self.work
        if work is None or self.advice is None or look.corners is None or look.pose is None or before is None:
            return False
        if before.shape != look.corners.points.shape:
            return False
        still = float(np.hypot(*(look.corners.points - before).T).mean()) <= RESTS_PX
        return still and is_there(work.rig, work.chart, look.pose, self.advice.pose)

    def hint(self, look: ChartLook | None) -> str:
        """How to move the chart."""
        work = self.work
        if work is None or self.advice is None:
            return ""
        return hint(work.chart, None if look is None else look.pose, self.advice.pose)

    def is_there(self, look: ChartLook) -> bool:
        """Whether the chart is held as wanted."""
        work = self.work
        if work is None or self.advice is None or look.pose is None:
            return False
        return is_there(work.rig, work.chart, look.pose, self.advice.pose)


def looked(chart: Chart, lens: Lens, image: Bytes) -> ChartLook:
    """Look for the chart in a live picture (H, W) of a camera with about this lens."""
    height, width = image.shape
    corners = glance(chart, image)
    pose = None
    if corners is not None:
        pose = pose_of(sized(lens, width, height), chart.points_m[corners.index], corners.points)
    small = image
    if width > SHOWN_PX:
        size = (SHOWN_PX, max(1, round(height * SHOWN_PX / width)))
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return ChartLook(small, (width, height), corners, pose)


def sized(lens: Lens, width: int, height: int) -> Lens:
    """The lens for pictures of this size."""
    return lens if (lens.width, lens.height) == (width, height) else lens.resized(width, height)


def answered(work: CalibrationWork, answer: Answering, progress: Progress) -> LevelResponse | None:
    """How the projector answers grey levels; None where that cannot be told, for no pose is lost by that."""
    try:
        return answer(progress)
    except InputError as error:
        work.no_response = str(error)
        return None


def add(work: CalibrationWork, pose: PoseFrames) -> bool:
    """Look at the pictures of a pose; whether it has no fault."""
    sight = work.views.add(pose)
    height, width = pose.frames.shape[1:]
    if sight.corners is None or sight.faults:
        return False
    lens, corners = sized(work.rig.camera.lens, width, height), sight.corners
    held = pose_of(lens, work.chart.points_m[corners.index], corners.points)
    if held is not None:
        work.poses[pose.name] = held
    return True


def read_poses(work: CalibrationWork, progress: Progress) -> str:
    """Read the poses that the folder holds; a sentence where the projector's size had to be guessed.

    Raises UserError.
    """
    folders = pose_folders(work.folder)
    raster, remarks = projector_of(folders[0], work.views.projector)
    if raster != work.views.projector:
        work.views = GeometryRun(work.chart, raster)
    work.no_response = "pictures that were taken before do not tell it"
    for number, one in enumerate(folders):
        progress.step(READ * number / len(folders), f"Reading {one.name} ...")
        add(work, read_pose(one, raster))
    return " ".join(map(as_sentence, remarks))


def fitted(work: CalibrationWork, skipped: list[ChartPose], progress: Progress, remark: str = "") -> Taken:
    """Fit the views that are there, and find the next pose."""
    result, why = None, ""
    if len(work.used) >= LEAST_VIEWS:
        progress.step(FITTED, "Fitting lenses and pose ...")
        try:
            result = work.views.finish(work.device.believed, work.left_out, work.chart_error_percent)
        except UserError as error:
            why = str(error)
    rig = work.device.believed if result is None else result.rig
    used = [pose for name, pose in work.poses.items() if name not in work.left_out]
    pose = next_pose(rig, work.chart, [*used, *skipped])
    if pose is None:
        return Taken(work, result, why, None, remark)
    outline, _ = seen_by_both(rig, pose.placed(outline_m(work.chart)))
    return Taken(work, result, why, Advice(pose, outline), remark)
