"""Takes a pose of the chart: shows Gray code at the projector's full resolution, and takes a frame of each pattern.

One loop for every projector and camera, virtual or real, in the thread of whoever calls it. The gate is wide open, so
that rows and columns of both do not matter. What it gives is what reading the pictures from their folder gives.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from os.path import exists
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from slopegate.core.calibration.codes import white_first
from slopegate.core.calibration.response import LEVELS, LevelResponse, response
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.core.rig.arrays import Bytes, Counts, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import LIT, Raster, even
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, quantise
from slopegate.core.transport.gray import gray_patterns
from slopegate.core.transport.mosaic import demosaic
from slopegate.drivers.calibrations.pictures import CalibrationError, PoseFrames
from slopegate.drivers.contract.device_rig import no_gate
from slopegate.drivers.contract.frame import CameraInfo, filters
from slopegate.drivers.contract.projector import Projector
from slopegate.drivers.files.durable import check_new, make_folder, replacing
from slopegate.drivers.files.images import VIEWER_SUFFIX, write_image
from slopegate.drivers.files.reading import read_plain
from slopegate.drivers.transports.shots import Order, Shots

LOADED: Final = 32
"""Patterns that the projector is given at a time."""
NUMBERS_PER_POSE: Final = 1000
"""Numbers of frames that a pose has to itself; on the bench its noise follows from them."""
RESPONSE_NUMBERS: Final = 900
"""The first number of the frames of grey levels: no pose of a pose's own numbers reaches so far."""
LEAST_LIGHT: Final = 0.15
"""Of full scale, what the brightest parts of the picture should have with the projector white."""
MOST_SATURATED: Final = 0.02
_SQUARE: Final = 8
"""Pixels whose mean tells light from noise."""
_BRIGHTEST: Final = 99.0
"""Percentile of the picture that counts as its brightest parts."""


@dataclass(frozen=True)
class PoseAttendance:
    """Whoever attends. Called for every frame, in the thread that takes them, and must be brief."""

    told: Callable[[int, int], object] = lambda done, count: None
    """How many of how many frames were taken."""
    given_up: Callable[[], bool] = lambda: False
    frame_taken: Callable[[Counts], object] = lambda image: None
    """Sees each frame (H, W), valid during the call only."""


def open_gate(rig: Rig, info: CameraInfo) -> GateSettings | None:
    """The gate through which a chart is looked at: a whole period, as the camera makes it; None where it has none."""
    if no_gate(info):
        return None
    assert info.limits is not None
    return quantise(info.limits, whole_period(rig, upright_line_time(rig)), rig.projector.period_us)


def frames_of_pose(raster: Raster) -> int:
    """How many frames a pose takes with a projector of these pixels."""
    return white_first(raster).count


def pose_name(number: int) -> str:
    """The usual name of pose `number`, from 0."""
    return f"pose_{number + 1:02d}"


def take_pose(
    name: str,
    projector: Projector,
    shots: Shots,
    gate: GateSettings | None,
    attendance: PoseAttendance | None = None,
    *,
    number: int = 0,
    folder: Path | None = None,
) -> PoseFrames | None:
    """Take the pictures of one pose; None when given up. Neither projector nor camera is stopped.

    gate: as of `open_gate`. number: of the pose, from 0. folder: where its pictures are kept, in a folder of the pose's
    name, which appears with all of them or not at all. Counts are scaled to the full range of 8 or 16 bits, so that a
    picture file tells where they end. Raises CalibrationError where the camera sees nothing of the projector's light,
    CameraError, ProjectorError, and StorageError for what cannot be written or is there already.
    """
    if folder is not None:
        check_new(folder / name)
    raster, attend = projector.info.raster, attendance or PoseAttendance()
    order, codes = white_first(raster), gray_patterns(BlockGrid(raster, raster.width, raster.height))
    info = shots.info
    frames = _room(info, order.count)
    scale = float(np.iinfo(frames.dtype).max)
    buffer = np.empty((info.height, info.width), np.uint16)
    for k in range(order.count):
        if k % LOADED == 0:
            some = range(k, min(k + LOADED, order.count))
            projector.load([codes.grid.spread(codes.values(item)) * np.uint8(LIT) for item in some])
        wanted = Order(gate, projector.show(k % LOADED), number * NUMBERS_PER_POSE + k)
        if shots.take(wanted, buffer, attend.given_up) is None:
            return None
        frames[k] = _full_range(buffer, info, scale)
        attend.frame_taken(buffer)
        attend.told(k + 1, order.count)
        if k == max(order.white, order.black):
            _check_light(info.name, frames[order.white], frames[order.black])
    digest = hashlib.sha256(frames.tobytes()).hexdigest() if folder is None else _keep(folder / name, frames)
    return PoseFrames(name, order, frames, scale, digest)


def take_response(
    projector: Projector, shots: Shots, gate: GateSettings | None, attendance: PoseAttendance | None = None
) -> LevelResponse | None:
    """How the projector answers grey levels, from a picture of each; None when given up. Whatever it lights will do.

    Raises what `response` and `take_pose` raise.
    """
    raster, attend = projector.info.raster, attendance or PoseAttendance()
    info = shots.info
    frames = _room(info, len(LEVELS))
    scale = float(np.iinfo(frames.dtype).max)
    buffer = np.empty((info.height, info.width), np.uint16)
    projector.load([even(raster, level) for level in LEVELS])
    for k in range(len(LEVELS)):
        if shots.take(Order(gate, projector.show(k), RESPONSE_NUMBERS + k), buffer, attend.given_up) is None:
            return None
        frames[k] = _full_range(buffer, info, scale)
        attend.frame_taken(buffer)
        attend.told(k + 1, len(LEVELS))
    return response(LEVELS, frames, scale)


def light_advice(pose: PoseFrames) -> str:
    """What to do about a pose's light, in a sentence; empty where it is right."""
    white = pose.frames[pose.order.white]
    bright = float(np.percentile(white, _BRIGHTEST)) / pose.full_scale
    saturated = float((white >= 0.995 * pose.full_scale).mean())
    if saturated > MOST_SATURATED:
        return (
            f"{saturated:.0%} of the picture is saturated with the projector white: lower the camera's gain, close its "
            "iris, or turn the chart's gloss away"
        )
    if bright < LEAST_LIGHT:
        return (
            f"the picture is dark, its brightest parts at {bright:.0%} of full scale with the projector white: open "
            "the camera's iris, raise its gain, or bring the chart nearer"
        )
    return ""


def _room(info: CameraInfo, count: int) -> Bytes | Counts:
    shape = (count, info.height, info.width)
    return np.empty(shape, np.uint8) if info.max_count <= np.iinfo(np.uint8).max else np.empty(shape, np.uint16)


def _full_range(image: Counts, info: CameraInfo, scale: float) -> Singles:
    """Counts of which the camera's largest is `scale`; of a colour camera the green ones, filled in."""
    mosaic = filters(info.pixel_format)
    grey = image.astype(np.float32)
    if mosaic:
        grey = demosaic(grey, mosaic)[:, :, 1]
    return np.asarray(np.rint(grey * np.float32(scale / info.max_count)), np.float32)


def _check_light(name: str, white: Bytes | Counts, black: Bytes | Counts) -> None:
    """Raise CalibrationError where white is black: their difference is then noise, as often below 0 as above."""
    gap = cv2.blur(white.astype(np.float32) - black, (_SQUARE, _SQUARE))
    low, high = np.percentile(gap, (100 - _BRIGHTEST, _BRIGHTEST))
    if high <= max(3 * -low, 1.0):
        raise CalibrationError(
            f"{name} sees no light of the projector with all of it lit: see that the projector shows its picture, and "
            "that both look at the chart"
        )


def _keep(place: Path, frames: Bytes | Counts) -> str:
    """Write a pose's pictures; returns the SHA-256 of their files."""
    make_folder(place.parent)
    digest = hashlib.sha256()
    with replacing(place) as part:
        part.mkdir()
        for number, image in enumerate(frames):
            path = part / f"pattern_{number:02d}{VIEWER_SUFFIX}"
            write_image(path, VIEWER_SUFFIX, image)
            digest.update(read_plain(path))
    return digest.hexdigest()


def next_pose_number(folder: Path | None, number: int = 0) -> int:
    """The first pose from `number` on whose name is free in a folder."""
    while folder is not None and exists(folder / pose_name(number)):
        number += 1
    return number
