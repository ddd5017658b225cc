"""What is calibrated: the camera and projector that are connected, a practice rig, or pictures that are there."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol

import cv2
import numpy as np

from slopegate.app.panels.panel import Desk
from slopegate.app.session.holding import Needs
from slopegate.app.session.loading import CancelledError, Progress
from slopegate.app.session.source import Source
from slopegate.core.calibration.advice import candidates
from slopegate.core.calibration.chart import Chart
from slopegate.core.calibration.chart_scene import ChartPose, about, held
from slopegate.core.calibration.response import LevelResponse
from slopegate.core.render.render import Cancelled
from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.calibrations.both_edges import PulseFound, pulse_by_edges
from slopegate.drivers.calibrations.pictures import PoseFrames
from slopegate.drivers.calibrations.plane_gates import TimingOutcome
from slopegate.drivers.calibrations.practice import PracticeRig
from slopegate.drivers.calibrations.taking import PoseAttendance, open_gate, take_pose, take_response
from slopegate.drivers.calibrations.timing_run import TimingAttendance, TimingPlan, TimingProgress, run_timing
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.contract.device_rig import device_rig
from slopegate.drivers.contract.frame import CameraInfo, filters
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.stream.stream import Stream
from slopegate.drivers.transports.shots import Shots, shots_behind

PRACTICE_PX: Final = 800
"""Width of a practice camera's picture, at most: rendering it is what people wait for."""
READ_S: Final = 5.0
TAKEN: Final = 0.5
"""Of the progress of a pose, when its last frame has been taken: to keep and to understand them takes as long."""
KEPT: Final = 0.55
"""When its pictures are on the disk."""
HAND_M, HAND_DEG = 0.01, 2.0
"""How exactly a hand holds a chart where it is told to."""

Showing = Callable[[], object]
Taking = Callable[[Progress], PoseFrames]
Answering = Callable[[Progress], LevelResponse]


@dataclass(frozen=True, eq=False)
class TimingFound:
    """What gates told, and of the trigger's pulse where both its edges were asked for."""

    outcome: TimingOutcome
    pulse: PulseFound | None


Timing = Callable[[], TimingFound | None]


class CalibratedDevice(Protocol):
    """A camera and a projector whose numbers are wanted. Its methods are called in the window's thread; what those
    return is called in another one.
    """

    needs: Needs
    """What must stay as it is while a pose is taken."""

    @property
    def believed(self) -> Rig:
        """What is taken to be true of them before."""
        ...

    @property
    def raster(self) -> Raster:
        """The projector's pixels."""
        ...

    def sight(self) -> Callable[[], Bytes] | None:
        """What gives the live picture (H, W), grey; None where there is none now."""
        ...

    def taking(self, name: str, number: int, folder: Path) -> Taking:
        """What takes pose `number` and keeps its pictures in the folder. Raises UserError."""
        ...

    def answering(self, name: str) -> Answering:
        """What shows grey levels after pose `name` was taken, on what it left before the camera, and tells how the
        projector answers them. Raises UserError.
        """
        ...

    def showing(self, pattern: Bytes) -> Showing:
        """What shows a pattern. Raises UserError."""
        ...

    @property
    def edges_missing(self) -> str:
        """Why the camera cannot be triggered by either edge; empty where it can."""
        ...

    def timing(self, rig: Rig, plan: TimingPlan, attendance: TimingAttendance, both_edges: bool) -> Timing:
        """What takes gates until they tell the timing of the rig, and some by the other edge. Raises UserError."""
        ...

    def close(self) -> None:
        """Let it go."""
        ...


class PicturesDevice:
    """Poses that were taken before."""

    needs: Needs = "program"

    def __init__(self, believed: Rig, raster: Raster) -> None:
        self.believed, self.raster = believed, raster

    def sight(self) -> None:
        """There is no live picture."""
        return

    def taking(self, name: str, number: int, folder: Path) -> Taking:
        """See `CalibratedDevice`."""
        raise InputError(f"{name} cannot be taken: nothing is connected, read poses from a folder")

    def answering(self, name: str) -> Answering:
        """See `CalibratedDevice`."""
        raise InputError("pictures that were taken before do not tell it")

    def showing(self, pattern: Bytes) -> Showing:
        """See `CalibratedDevice`."""
        raise InputError("no pattern can be shown: nothing is connected")

    @property
    def edges_missing(self) -> str:
        """See `CalibratedDevice`."""
        return "Nothing is connected."

    def timing(self, rig: Rig, plan: TimingPlan, attendance: TimingAttendance, both_edges: bool) -> Timing:
        """See `CalibratedDevice`."""
        raise InputError("no gates can be taken: nothing is connected; slopegate calibrate-timing reads captures")

    def close(self) -> None:
        """Nothing is held."""


class ConnectedDevice:
    """The camera of the live image and the screen that shows patterns."""

    needs: Needs = "gate"

    def __init__(self, desk: Desk, transfer_us: float) -> None:
        """Raises UserError where one of them is missing. transfer_us: how long a frame may be on its way."""
        source = desk.session.source
        if source is None or not source.is_device or source.replayed:
            raise InputError(
                "no camera is connected: open one in the menu Camera, or choose the practice rig to learn how it goes"
            )
        self._desk, self._transfer_us = desk, transfer_us
        self._source = source
        self.believed = source.rig
        projector, _ = desk.screen()
        self.raster = projector.info.raster

    def sight(self) -> Callable[[], Bytes] | None:
        """See `CalibratedDevice`."""
        frame, info = self._desk.live.copy_frame(), self._source.camera.info
        if frame is None or self._desk.session.source is not self._source:
            return None
        return lambda: grey(frame.image, info)

    def _running(self) -> tuple[Stream, Source]:
        """Raises CameraError where another camera runs now, or none."""
        stream, source = self._desk.session.stream, self._source
        if stream is None or self._desk.session.source is not source:
            raise CameraError("the camera that is calibrated has gone: begin anew")
        return stream, source

    def taking(self, name: str, number: int, folder: Path) -> Taking:
        """See `CalibratedDevice`."""
        stream, source = self._running()
        projector, _ = self._desk.screen()
        if projector.info.raster != self.raster:
            raise InputError(f"the projector has {projector.info.raster} pixels now and had {self.raster}: begin anew")
        info, gate = source.camera.info, open_gate(source.rig, source.camera.info)

        def take(progress: Progress) -> PoseFrames:
            with shots_behind(stream, info, self._transfer_us) as shots:
                made = taken(name, number, folder, projector, shots, gate, progress)
            projector.white()
            return made

        return take

    def answering(self, name: str) -> Answering:
        """See `CalibratedDevice`."""
        stream, source = self._running()
        projector, _ = self._desk.screen()
        info, gate = source.camera.info, open_gate(source.rig, source.camera.info)

        def answer(progress: Progress) -> LevelResponse:
            with shots_behind(stream, info, self._transfer_us) as shots:
                made = answered(name, projector, shots, gate, progress)
            projector.white()
            return made

        return answer

    def showing(self, pattern: Bytes) -> Showing:
        """See `CalibratedDevice`."""
        projector, _ = self._desk.screen()

        def show() -> None:
            projector.load([pattern])
            projector.show(0)

        return show

    @property
    def edges_missing(self) -> str:
        """See `CalibratedDevice`."""
        return self._source.camera.info.can.edge.missing

    def timing(self, rig: Rig, plan: TimingPlan, attendance: TimingAttendance, both_edges: bool) -> Timing:
        """See `CalibratedDevice`."""
        stream, source = self._running()
        projector, _ = self._desk.screen()
        info = source.camera.info
        seen, _ = device_rig(rig, info)

        def time() -> TimingFound | None:
            with shots_behind(stream, info, self._transfer_us) as shots:
                made = timed(source.camera if both_edges else None, shots, seen, plan, attendance, projector)
            projector.white()
            return made

        return time

    def close(self) -> None:
        """Camera and projector belong to others."""


class PracticeDevice:
    """A practice rig, with the chart in a hand that moves it."""

    needs: Needs = "program"

    def __init__(self, believed: Rig, chart: Chart, seed: int, progress: Progress) -> None:
        """Takes seconds. Raises CancelledError, and InputError where the chart is nowhere seen whole."""
        lens = believed.camera.lens
        if lens.width > PRACTICE_PX:
            small = lens.resized(PRACTICE_PX, round(lens.height * PRACTICE_PX / lens.width))
            believed = replace(believed, camera=replace(believed.camera, lens=small))
        self.believed, self.raster = believed, believed.projector.raster
        self._chart, self._random = chart, np.random.default_rng(seed)
        self._lock = threading.Lock()
        """Over the rig: whoever moves, reads or lights it."""
        seen = candidates(believed, chart)
        if not seen:
            raise InputError(f"the chart {chart} is nowhere seen whole by camera and projector: take a smaller one")
        x, y, z = seen[len(seen) // 2].placed(chart.points_m.mean(axis=0)).tolist()
        self.pose = held(chart, (x, y, z))
        self._shown: ChartPose | None = None
        progress.step(0.1, "Preparing a practice rig ...")
        try:
            self.rig = PracticeRig(
                believed, chart, seed, progress=lambda share: progress.report(share, "Preparing ...")
            )
        except Cancelled:
            raise CancelledError from None
        self.rig.camera.start()

    @property
    def truth(self) -> Rig:
        """The hidden numbers, for the end."""
        return self.rig.truth

    def move(self, x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.0) -> None:
        """Move the chart from where it is, in the camera's axes; it stays before the camera."""
        x, y, z = self.pose.shift_m
        nearest = 0.5 * max(self._chart.size_m)
        self.pose = replace(self.pose, shift_m=(x + x_m, y + y_m, max(z + z_m, nearest)))

    def turn(self, right_away_deg: float, top_away_deg: float) -> None:
        """Turn it about its middle."""
        middle = self.pose.placed(self._chart.points_m.mean(axis=0))
        turned = held(self._chart, (0.0, 0.0, 0.0), top_away_deg, right_away_deg)
        rotation = np.array(turned.rotation) @ np.array(self.pose.rotation)
        if rotation[2, 2] > 0.3:  # farther round nobody would hold it
            self.pose = about(self._chart, middle, rotation)

    def go_to(self, wanted: ChartPose) -> None:
        """Hold it where it is wanted, as exactly as a hand does."""
        x, y, z = self._random.normal(0, HAND_M, 3).tolist()
        tilt, yaw, roll = self._random.normal(0, HAND_DEG, 3).tolist()
        rotation = np.array(held(self._chart, (0, 0, 0), tilt, yaw, roll).rotation) @ np.array(wanted.rotation)
        middle = wanted.placed(self._chart.points_m.mean(axis=0)) + np.array([x, y, z])
        self.pose = about(self._chart, middle, rotation)

    def sight(self) -> Callable[[], Bytes]:
        """See `CalibratedDevice`."""
        return self._picture

    def taking(self, name: str, number: int, folder: Path) -> Taking:
        """See `CalibratedDevice`."""

        def take(progress: Progress) -> PoseFrames:
            with self._lock:
                self._hold()
                gate = open_gate(self.believed, self.rig.camera.info)
                try:
                    return taken(name, number, folder, self.rig.projector, self.rig.shots(), gate, progress)
                finally:
                    self.rig.projector.white()

        return take

    def answering(self, name: str) -> Answering:
        """See `CalibratedDevice`."""

        def answer(progress: Progress) -> LevelResponse:
            with self._lock:  # and the chart stays where the pose has it, wherever the hand has gone
                gate = open_gate(self.believed, self.rig.camera.info)
                try:
                    return answered(name, self.rig.projector, self.rig.shots(), gate, progress)
                finally:
                    self.rig.projector.white()

        return answer

    def showing(self, pattern: Bytes) -> Showing:
        """See `CalibratedDevice`."""

        def show() -> None:
            with self._lock:
                self.rig.projector.load([pattern])
                self.rig.projector.show(0)

        return show

    @property
    def edges_missing(self) -> str:
        """See `CalibratedDevice`."""
        return self.rig.camera.info.can.edge.missing

    def timing(self, rig: Rig, plan: TimingPlan, attendance: TimingAttendance, both_edges: bool) -> Timing:
        """See `CalibratedDevice`."""

        def time() -> TimingFound | None:
            with self._lock:
                self._hold()
                camera = self.rig.camera if both_edges else None
                try:
                    return timed(camera, self.rig.shots(), rig, plan, attendance, self.rig.projector)
                finally:
                    self.rig.projector.white()

        return time

    def close(self) -> None:
        """See `CalibratedDevice`."""
        self.rig.camera.close()

    def _hold(self) -> None:
        pose = self.pose
        if pose != self._shown:
            with suppress(Cancelled):
                self.rig.move(pose)
                self._shown = pose

    def _picture(self) -> Bytes:
        with self._lock:
            self._hold()
            info = self.rig.camera.info
            buffer = np.empty((info.height, info.width), np.uint16)
            if self.rig.camera.read(buffer, READ_S) is None:
                raise CameraError("the practice camera gave no picture")
        return grey(buffer, info)


def taken(
    name: str,
    number: int,
    folder: Path,
    projector: Projector,
    shots: Shots,
    gate: GateSettings | None,
    progress: Progress,
) -> PoseFrames:
    """Take a pose and tell how far it is. Raises CancelledError."""

    def told(done: int, count: int) -> None:
        what = f"picture {done} of {count}, hold the chart still" if done < count else "keeping its pictures ..."
        progress.report(TAKEN * done / count, f"{name}: {what}")

    attendance = PoseAttendance(told, lambda: progress.cancelled)
    made = take_pose(name, projector, shots, gate, attendance, number=number, folder=folder)
    if made is None:
        raise CancelledError
    return made


def answered(
    name: str, projector: Projector, shots: Shots, gate: GateSettings | None, progress: Progress
) -> LevelResponse:
    """The projector's answer to grey levels. Raises CancelledError."""

    def told(done: int, count: int) -> None:
        progress.report(KEPT, f"{name}: grey level {done} of {count}, hold the chart still")

    made = take_response(projector, shots, gate, PoseAttendance(told, lambda: progress.cancelled))
    if made is None:
        raise CancelledError
    return made


def timed(
    camera: Camera | None,
    shots: Shots,
    rig: Rig,
    plan: TimingPlan,
    attendance: TimingAttendance,
    projector: Projector,
) -> TimingFound | None:
    """Take gates, and with a camera some more by the other edge of its trigger; None when given up before the first."""
    outcome = run_timing(shots, rig, plan, attendance, projector)
    if outcome is None or camera is None:
        return None if outcome is None else TimingFound(outcome, None)

    def told(progress: TimingProgress) -> None:
        attendance.told(replace(progress, doing=f"Falling edge: {progress.doing}", timing=None, verdict=None))

    other = replace(attendance, told=told)
    return TimingFound(outcome, pulse_by_edges(camera, shots, rig, plan, outcome.timing, other, projector))


def grey(counts: Counts, info: CameraInfo) -> Bytes:
    """Counts (H, W) as a grey picture, its brightest parts white; of a mosaic, cells of four pixels are one."""
    image = counts
    if filters(info.pixel_format):
        half = cv2.resize(counts, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        image = np.asarray(cv2.resize(half, (counts.shape[1], counts.shape[0])), np.uint16)
    low, high = np.percentile(image[::4, ::4], (1.0, 99.5))
    scaled = (image.astype(np.float32) - np.float32(low)) * np.float32(255 / max(float(high - low), 1.0))
    return np.asarray(np.clip(scaled, 0, 255), np.uint8)
