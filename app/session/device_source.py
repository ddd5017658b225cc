"""Sources of which no scene is known: cameras, video files and folders of pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from slopegate.app.session.describe import frames_text
from slopegate.app.session.loading import Progress
from slopegate.app.session.source import Options, Source, epipolar_gates, everything_lit
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import plan_on_hardware
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Preset, Scene
from slopegate.drivers.cameras.video import open_video
from slopegate.drivers.captures.film import is_film, open_film
from slopegate.drivers.captures.film_camera import FilmCamera
from slopegate.drivers.captures.model import FilmEnd
from slopegate.drivers.contract.camera import Camera
from slopegate.drivers.contract.device_rig import device_rig
from slopegate.drivers.contract.families import Address
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.devices.catalog import open_camera

Delayed = Callable[[Camera, float], Camera]
"""Wraps a camera whose delay a board makes; returns others as they are. Its number is the projector's period, in us."""

FIRST_PLANE = (0.0, 1.0, 0.1)
"""Tilt (degrees), distance and thickness (m) of the first gate on offer where nothing is known of the scene."""


def open_device(
    address: Address, rig: Rig, options: Options, wanted: OpenOptions, delayed: Delayed, progress: Progress
) -> Source:
    """Open a camera of the device list. Blocks for seconds. Raises CameraError, InputError or CancelledError."""
    progress.step(0.0, f"Opening {address} ...")
    camera = open_camera(address.family, address.where, rig, wanted)
    try:
        made = device_source(address, rig, delayed(camera, rig.projector.period_us), options)
        return replace(made, opened=wanted)
    except BaseException:
        camera.close()
        raise


def open_pictures(where: Path, rig: Rig, options: Options, progress: Progress) -> Source:
    """Open a video file, a folder of pictures or a recording at one gate, played over and over.

    Raises CameraError, StorageError or CancelledError.
    """
    progress.step(0.0, f"Opening {where.name} ...")
    if is_film(where):
        return _open_film(where, options)
    return device_source(where, rig, open_video(str(where), rig), options)


def _open_film(where: Path, options: Options) -> Source:
    """A recording at one gate, played over and over with the rig that it was made with. Raises StorageError."""
    folder = open_film(where)
    camera = FilmCamera(folder)
    made = device_source(folder.path, folder.rig, camera, options)
    end = camera.ended
    ended = f"{folder.path.name} was cut short: its {len(folder)} frames are all there" if end is None else _losses(end)
    remark = "; ".join(part for part in (ended, made.remark) if part)
    kept = (Preset("The gate of the recording", camera.gate),) if camera.gate is not None else made.presets
    scene = Scene(f"{folder.manifest.scene} (recorded)", f"Recorded {folder.manifest.created}, {len(folder)} frames")
    return replace(made, scene=scene, presets=kept, remark=remark, film=camera)


def _losses(end: FilmEnd) -> str:
    """What was lost while it was recorded, in one sentence; empty where nothing was."""
    lost = ((end.lost_by_camera, "by the camera"), (end.lost_by_disk, "because the disk was too slow"))
    by = " and ".join(f"{count} {how}" for count, how in lost if count)
    was = "was" if end.lost == 1 else "were"
    return f"{frames_text(end.lost)} {was} lost while this was recorded: {by}" if by else ""


def device_source(where: Path | Address, rig: Rig, camera: Camera, options: Options) -> Source:
    """The source for an open camera whose scene is not known."""
    info = camera.info
    seen, remark = device_rig(rig, info)
    scene = Scene(info.name, f"{info.width} x {info.height} pixels, {info.pixel_format}")
    made = Source(where, seen, scene, options, camera, None, (), remark)
    return replace(made, presets=_presets(seen, made.no_gate))


def with_rig(source: Source, rig: Rig) -> Source:
    """A device's source as another rig sees it; camera and stream go on."""
    seen, remark = device_rig(rig, source.camera.info)
    return replace(source, rig=seen, presets=_presets(seen, source.no_gate), remark=remark, measured=None)


def timed_alike(one: Rig, other: Rig) -> bool:
    """Whether both scan and expose alike: an open camera need not be told of the other one."""
    scans = (one.projector.period_us, one.projector.active_fraction, one.camera.shutter)
    return scans == (other.projector.period_us, other.projector.active_fraction, other.camera.shutter)


def _presets(rig: Rig, no_gate: str) -> tuple[Preset, ...]:
    """Everything lit, which shows whether camera and projector work; then a slab to begin with, or what is epipolar."""
    lit = everything_lit(rig, upright_line_time(rig))
    tilt_deg, distance_m, thickness_m = FIRST_PLANE
    if no_gate:
        return (lit,)
    try:
        applied = plan_on_hardware(rig, tilt_deg, distance_m, thickness_m).applied
    except InputError:  # a rig that cannot do this has no such suggestion
        return (lit, *epipolar_gates(rig))
    return (lit, Preset(f"Upright at {distance_m:g} m", applied), *epipolar_gates(rig))
