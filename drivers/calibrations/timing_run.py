"""Takes gated pictures of a plane until they tell when projector and camera scan.

One loop for every camera, virtual or real, in the thread of whoever calls it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from slopegate.core.calibration.chart import Chart
from slopegate.core.calibration.codes import decode
from slopegate.core.calibration.informative import FIRST, GOAL, TimingGoal, TimingVerdict
from slopegate.core.calibration.target import FlatTarget
from slopegate.core.calibration.timing import GateTiming
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.calibrations.lit_view import see_lit
from slopegate.drivers.calibrations.pictures import CalibrationError
from slopegate.drivers.calibrations.plane_gates import PlaneGates, TimingOutcome, UselessFrames
from slopegate.drivers.calibrations.seen_target import seen_chart, seen_code, seen_plane
from slopegate.drivers.calibrations.taking import PoseAttendance, open_gate, take_pose
from slopegate.drivers.contract.device_rig import no_gate
from slopegate.drivers.contract.frame import filters
from slopegate.drivers.contract.projector import Projector, Showing
from slopegate.drivers.stream.sieve import Tally
from slopegate.drivers.transports.shots import Order, Shots

USUAL_FRAMES: Final = 400
MOST_FRAMES: Final = 10_000

TimingState = Literal["looking", "running", "enough", "ended", "cancelled"]
"""Looking at the plane, taking gates; and how it ended: known well enough, all frames taken, given up."""

Shade = Literal["white", "black"]
"""What the projector shows: all on, or all off."""

_ALWAYS: Final = Showing(-1, -math.inf, -math.inf)
"""Of a projector that shows all on by itself."""


@dataclass(frozen=True)
class TimingPlan:
    """What gates are seen on, and how well the timing has to be known.

    target: a chart, a plane, or None: then patterns of the projector tell which rows light what is seen. frames: that
    are taken through gates, at most.
    """

    target: Chart | FlatTarget | None = None
    goal: TimingGoal = GOAL
    frames: int = USUAL_FRAMES

    def __post_init__(self) -> None:
        require(FIRST <= self.frames <= MOST_FRAMES, "frames", self.frames, f"from {FIRST} to {MOST_FRAMES}")


def more_gates(outcome: TimingOutcome, how: str) -> str:
    """What to add to why a timing is not known well enough: how many gates would do, and `how` to ask for them.

    Empty where more gates alone would not do.
    """
    if outcome.needed is None:
        return ""
    if outcome.needed > MOST_FRAMES:
        return f"; more than {MOST_FRAMES} gates would be needed"
    return f"; about {outcome.needed} gates should do ({how} {outcome.needed})"


@dataclass(frozen=True)
class TimingProgress:
    """How far a run is: what the gates so far tell (None until they tell anything), and the gate that is under way."""

    state: TimingState
    doing: str
    frames: int
    timing: GateTiming | None
    verdict: TimingVerdict | None
    gate: GateSettings | None
    useless: UselessFrames
    tally: Tally
    """Frames that were lost, repeated, or made with another gate."""


@dataclass(frozen=True)
class TimingAttendance:
    """Whoever attends a run. Its functions are called between frames, in the run's thread, and must be brief."""

    told: Callable[[TimingProgress], object] = lambda progress: None
    given_up: Callable[[], bool] = lambda: False
    """No more frames are taken; those that were tell what they can."""
    frame_taken: Callable[[Counts], object] = lambda image: None
    """Sees each frame (H, W), valid during the call only."""


def run_timing(
    shots: Shots,
    rig: Rig,
    plan: TimingPlan,
    attendance: TimingAttendance | None = None,
    projector: Projector | None = None,
) -> TimingOutcome | None:
    """Take gates until the timing is known well enough; None when given up before the first one.

    rig: as the file has it, with the camera's own limits (`device_rig`). projector: where there is one that shows
    patterns, other light is measured with it, too. Raises CalibrationError and InputError where camera, plane or gates
    do not do, CameraError, ProjectorError.
    """
    missing = no_gate(shots.info)
    if missing:
        raise CalibrationError(f"{shots.info.name} has no gates that could be timed: {missing}")
    if plan.target is None and projector is None:
        raise CalibrationError(
            "it is not known which projector rows light what the camera sees: name the chart that it sees, give a "
            "plane, or a projector that shows patterns"
        )
    return _TimingRun(shots, rig, plan, attendance or TimingAttendance(), projector).take()


class _TimingRun:
    """The state of one run."""

    def __init__(
        self, shots: Shots, rig: Rig, plan: TimingPlan, attendance: TimingAttendance, projector: Projector | None
    ) -> None:
        self._shots, self._rig, self._plan, self._projector = shots, rig, plan, projector
        self._attendance = attendance
        self._buffer = np.empty((shots.info.height, shots.info.width), np.uint16)
        self._number = 0
        self._shade: Shade | None = None
        self._showing = _ALWAYS
        self._applied: GateSettings | None = None
        self._gates: PlaneGates | None = None
        self._gate: GateSettings | None = None

    def take(self) -> TimingOutcome | None:
        """The plane first, then gate after gate."""
        self._tell("looking", "Looking at the plane with all of the projector's light")
        self._gates = gates = self._look()
        if gates is None:
            return None
        state: TimingState = "ended"
        while gates.frames < self._plan.frames and state == "ended":
            self._gate = gates.next_gate()
            self._tell("running", f"Gate {gates.frames + 1} of at most {self._plan.frames}")
            image = self._lit(self._gate)
            if image is None:
                state = "cancelled"
                break
            assert self._applied is not None
            gates.add(image, self._applied)
            if gates.due:
                gates.fit()
                state = "enough" if gates.verdict.enough else state
        if not gates.frames:
            return None
        outcome = gates.outcome(self._shots.info.name)
        self._tell(state, outcome.verdict.reason)
        return outcome

    def _look(self) -> PlaneGates | None:
        """The plane in the lit picture; None when given up."""
        info, target, rig = self._shots.info, self._plan.target, self._rig
        dark = None if self._projector is None else self._unlit
        view = see_lit(self._lit, dark, rig, (info.black_count, info.max_count))
        if view is None:
            return None
        if isinstance(target, Chart):
            seen = seen_chart(view, rig, target, bool(filters(info.pixel_format)))
        elif target is not None:
            seen = seen_plane(view, rig, target)
        else:
            rows = self._decoded()
            if rows is None:
                return None
            seen = seen_code(view, rig, rows)
        return PlaneGates(rig, view, seen, info.max_count, self._plan.goal)

    def _lit(self, gate: GateSettings) -> Counts | None:
        return self._frame(gate, "white")

    def _unlit(self, gate: GateSettings) -> Counts | None:
        return self._frame(gate, "black")

    def _show(self, shade: Shade) -> Showing:
        """Let the projector show all on or all off, unless it does."""
        if self._projector is None:
            return _ALWAYS
        if self._shade != shade:
            self._showing = self._projector.white() if shade == "white" else self._projector.black()
            self._shade = shade
        return self._showing

    def _decoded(self) -> Singles | None:
        """The projector row that patterns tell of each pixel, NaN where they do not."""
        assert self._projector is not None
        self._tell("looking", "Showing patterns that tell which rows light the plane")
        attend = PoseAttendance(given_up=self._attendance.given_up, frame_taken=self._attendance.frame_taken)
        whole = open_gate(self._rig, self._shots.info)
        self._shade = None
        pose = take_pose("plane", self._projector, self._shots, whole, attend)
        return None if pose is None else np.ascontiguousarray(decode(pose.order, pose.frames).place[..., 1])

    def _frame(self, gate: GateSettings, shade: Shade) -> Counts | None:
        """A frame of this gate, valid until the next one; None when given up."""
        order = Order(gate, self._show(shade), self._number)
        stamp = self._shots.take(order, self._buffer, self._attendance.given_up)
        if stamp is None:
            return None
        self._number += 1
        self._applied = stamp.applied
        self._attendance.frame_taken(self._buffer)
        return self._buffer

    def _tell(self, state: TimingState, doing: str) -> None:
        gates = self._gates
        useless = UselessFrames() if gates is None else gates.useless
        timing, verdict = (None, None) if gates is None else (gates.timing, gates.verdict)
        frames = 0 if gates is None else gates.frames
        self._attendance.told(
            TimingProgress(state, doing, frames, timing, verdict, self._gate, useless, self._shots.tally)
        )
