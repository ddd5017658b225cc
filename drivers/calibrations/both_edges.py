"""Takes the timing once more by the other edge of the trigger: how long its pulse lasts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from slopegate.core.calibration.informative import TimingGoal
from slopegate.core.calibration.timing import GateTiming
from slopegate.core.calibration.timing_errors import PulseWidth, pulse_width
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.pictures import CalibrationError
from slopegate.drivers.calibrations.timing_run import TimingAttendance, TimingPlan, run_timing
from slopegate.drivers.contract.camera import Camera, unable
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.transports.shots import Shots

EDGE_GOAL: Final = TimingGoal(1.0, math.inf, math.inf)
"""The offset alone: all else is as it was."""
EDGE_FRAMES: Final = 120
"""Gates by the other edge, at most."""


@dataclass(frozen=True)
class PulseFound:
    """The trigger's pulse, or one sentence on why the gates by the falling edge do not tell it."""

    width: PulseWidth | None
    why_not: str = ""


def require_edges(camera: Camera) -> None:
    """Raise InputError for a camera whose trigger edge cannot be chosen."""
    if not camera.info.can.edge:
        raise unable(camera.info, camera.info.can.edge)


def pulse_by_edges(
    camera: Camera,
    shots: Shots,
    rig: Rig,
    plan: TimingPlan,
    first: GateTiming,
    attendance: TimingAttendance | None = None,
    projector: Projector | None = None,
) -> PulseFound:
    """Take gates by the falling edge, after `first` by the rising one, which the camera then has again.

    camera: whose frames `shots` are. rig, plan: as for `first`. Raises CameraError, ProjectorError.
    """
    camera.trigger_on("falling")
    try:
        some = replace(plan, goal=EDGE_GOAL, frames=EDGE_FRAMES)
        second = run_timing(shots, rig, some, attendance, projector)
        if second is None:
            return PulseFound(None, "it was given up before a gate by the falling edge was taken")
        return PulseFound(pulse_width(first, second.timing))
    except (CalibrationError, InputError) as error:
        return PulseFound(None, str(error))
    finally:
        camera.trigger_on("rising")
