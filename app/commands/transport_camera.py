"""`slopegate transport --camera`: a real camera, and a window on the screen that is the projector."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any, Final

from slopegate.app.api import OpenRig, OpenTransport
from slopegate.app.commands.capture_camera import USUAL_WAIT_S, opened_camera
from slopegate.app.commands.projecting import project
from slopegate.app.commands.report import print_warnings, say_line
from slopegate.app.transports import with_decoding
from slopegate.core.gating.slices import Slices
from slopegate.core.rig.blocks import parse_grid
from slopegate.core.transport.plan import TransportPlan, plan_transport
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.device_rig import no_gate
from slopegate.drivers.contract.families import read_address
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.devices.catalog import no_gate_at
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.transports.run import AcquireProgress, Attendance, run_acquisition
from slopegate.drivers.transports.shots import CameraShots
from slopegate.drivers.transports.storage import (
    TransportFolder,
    check_new_transport,
    create_transport,
    make_transport,
    open_transport,
)

USUAL_SETTLE_FRAMES: Final = 2
USUAL_TRANSFER_US: Final = 50_000.0

Plan = Callable[[OpenRig], Slices]
"""The gates asked for, once the camera's rig is known."""


def settle_frames(options: Namespace) -> int:
    """Frames of the screen to wait until a pattern is certainly on the wall."""
    return USUAL_SETTLE_FRAMES if options.settle_frames is None else int(options.settle_frames)


def camera_shots(options: Namespace, camera: Camera) -> CameraShots:
    """Frames of the camera, with the transfer time and the patience that the options name."""
    transfer_us = USUAL_TRANSFER_US if options.transfer_us is None else options.transfer_us
    return CameraShots(camera, transfer_us, timeout_s=options.wait_s or USUAL_WAIT_S)


def acquire_with_camera(options: Namespace, plan: Plan, patterns: dict[str, Any]) -> OpenTransport:
    """Acquire what the camera at the address named sees, with patterns on the screen named.

    Raises InputError for what is no address, RigError, StorageError, and CommandError for a camera that does not open,
    or a screen that is not there.
    """
    begun = open_transport(options.out) if options.resume else None
    if begun is None:
        check_new_transport(options.out)
    settle = settle_frames(options) if begun is None else begun.manifest.settle_frames
    work = partial(_acquire, options, plan, patterns, begun)
    return project(options.screen, settle, load_rig(options.rig), work)


def _acquire(
    options: Namespace,
    plan: Plan,
    patterns: dict[str, Any],
    begun: TransportFolder | None,
    projector: Projector,
    interrupted: Callable[[], bool],
) -> OpenTransport:
    with ExitStack() as held:
        camera, rig = opened_camera(options, held, gated=False)
        folder = _begin(options, camera, OpenRig(rig), plan, patterns, projector) if begun is None else begun
        folder.require_begun_with(rig, camera.info, projector.info.raster)
        shots = camera_shots(options, camera)
        camera.start()
        attendance = Attendance(_say, given_up=interrupted)
        run_acquisition(projector, shots, folder, attendance, options.keep_raw)
        return OpenTransport(folder.rig, folder)


def _begin(
    options: Namespace, camera: Camera, rig: OpenRig, plan: Plan, patterns: dict[str, Any], projector: Projector
) -> TransportFolder:
    missing = no_gate(camera.info)
    if missing:
        print_warnings([f"{camera.info.name} has no gate, so there is one slice, with everything in it: {missing}"])
    gates = [None] if missing else plan(rig)
    manifest = make_transport(
        camera.info.name,
        rig.rig,
        camera.info,
        parse_grid(patterns["grid"], projector.info.raster),
        patterns["codes"],
        gates,
        frames=patterns["frames"],
        settle_frames=settle_frames(options),
    )
    return create_transport(options.out, manifest)


def _say(progress: AcquireProgress) -> None:
    say_line(progress.sentence)


def plan_with_camera(options: Namespace, plan: Plan, patterns: dict[str, Any]) -> TransportPlan:
    """What such an acquisition will take, by the rig file: the camera is not opened."""
    address, rig = read_address(options.camera), OpenRig(load_rig(options.rig))
    count = 1 if no_gate_at(address) else len(plan(rig))
    grid, frame_s = parse_grid(patterns["grid"], rig.rig.projector.raster), 1e-6 * rig.period_us
    wait_s = USUAL_SETTLE_FRAMES * frame_s + 1e-6 * USUAL_TRANSFER_US
    planned = plan_transport(patterns["codes"], grid, rig.shape, count, patterns["frames"], frame_s, wait_s)
    return with_decoding(planned, count, rig.shape)
