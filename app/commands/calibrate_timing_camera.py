"""`slopegate calibrate-timing --camera`: a real camera that looks at a plane, with or without patterns on a screen."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

from slopegate.app.commands.capture_camera import opened_camera
from slopegate.app.commands.projecting import project
from slopegate.app.commands.transport_camera import camera_shots, settle_frames
from slopegate.core.rig.rig import Rig
from slopegate.drivers.calibrations.both_edges import PulseFound, pulse_by_edges, require_edges
from slopegate.drivers.calibrations.plane_gates import TimingOutcome
from slopegate.drivers.calibrations.timing_run import TimingAttendance, TimingPlan, TimingProgress, run_timing
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.stream.sieve import Tally

Timed = tuple[str, Rig, TimingOutcome, Tally, PulseFound | None]
"""The camera's name, its rig until now, what was found, the frames that were not used, and the trigger's pulse."""


def time_camera(options: Namespace, plan: TimingPlan, told: Callable[[TimingProgress], object]) -> Timed:
    """Take gates with the camera of the options; patterns are shown on the screen named, if one is.

    Raises InputError for what is no address, RigError, CommandError for a camera that does not open or a screen that is
    not there, and what `run_timing` raises.
    """
    work = partial(_time, options, plan, told)
    if options.screen is None:
        return work(None, lambda: False)
    return project(options.screen, settle_frames(options), load_rig(options.rig), work)


def _time(
    options: Namespace,
    plan: TimingPlan,
    told: Callable[[TimingProgress], object],
    projector: Projector | None,
    interrupted: Callable[[], bool],
) -> Timed:
    with ExitStack() as held:
        camera, rig = opened_camera(options, held)
        if options.both_edges:
            require_edges(camera)
        shots = camera_shots(options, camera)
        camera.start()
        attendance = TimingAttendance(told, interrupted)
        outcome = run_timing(shots, rig, plan, attendance, projector)
        if outcome is None:
            raise KeyboardInterrupt("interrupted before a gate was taken")
        pulse = None
        if options.both_edges:
            pulse = pulse_by_edges(camera, shots, rig, plan, outcome.timing, attendance, projector)
        return camera.info.name, rig, outcome, shots.tally, pulse
