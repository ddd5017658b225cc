"""Sources whose frames come from outside: cameras, video files and folders of pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from slopegate.app.session.loading import Progress
from slopegate.app.session.source import Options, Source, everything_lit
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import plan_on_hardware
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Preset, Scene
from slopegate.drivers.cameras.video import open_video
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.device_rig import device_rig
from slopegate.drivers.contract.families import Address
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.devices.catalog import open_camera

Delayed = Callable[[Camera, float], Camera]
"""The camera itself, or with its delay made by a board, for a projector's period in microseconds."""

FIRST_PLANE = (0.0, 1.0, 0.1)
"""Tilt, distance and thickness of the gate that is offered first, where nothing is known of the scene."""


def open_device(
    address: Address, rig: Rig, options: Options, wanted: OpenOptions, delayed: Delayed, progress: Progress
) -> Source:
    """A camera of the device list. Blocks for seconds. Raises CameraError, ValueError or CancelledError."""
    progress.step(0.0, f"Opening {address} ...")
    camera = open_camera(address.family, address.where, rig, wanted)
    try:
        made = device_source(address, rig, delayed(camera, rig.projector.period_us), options)
        return replace(made, opened=wanted)
    except BaseException:
        camera.close()
        raise


def open_pictures(where: Path, rig: Rig, options: Options, progress: Progress) -> Source:
    """A video file or a folder of pictures, played over and over. Raises CameraError or CancelledError."""
    progress.step(0.0, f"Opening {where.name} ...")
    return device_source(where, rig, open_video(str(where), rig), options)


def device_source(where: Path | Address, rig: Rig, camera: Camera, options: Options) -> Source:
    """What the window needs to stream from an open camera of which it knows no scene."""
    info = camera.info
    seen, remark = device_rig(rig, info)
    scene = Scene(info.name, f"{info.width} x {info.height} pixels, {info.pixel_format}")
    made = Source(where, seen, scene, options, camera, None, (), remark)
    return replace(made, presets=_presets(seen, made.no_gate))


def _presets(rig: Rig, no_gate: str) -> tuple[Preset, ...]:
    """Everything lit, which shows whether camera and projector work; then a slab to begin with."""
    lit = everything_lit(rig, upright_line_time(rig))
    tilt_deg, distance_m, thickness_m = FIRST_PLANE
    try:
        applied = plan_on_hardware(rig, tilt_deg, distance_m, thickness_m).applied
    except ValueError:  # a rig that cannot do this has no such suggestion
        return (lit,)
    return (lit,) if no_gate else (lit, Preset(f"Upright at {distance_m:g} m", applied))
