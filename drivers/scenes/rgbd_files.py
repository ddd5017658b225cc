"""Reads RGB-D folders: a photo, depth or disparity, and the calibration in scene.json."""

from __future__ import annotations

import re
from dataclasses import replace
from os.path import exists
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.pinhole import require_pinhole
from slopegate.core.rig.rig import DISTORTION_LENGTHS, Lens, Rig, RigCamera
from slopegate.core.rig.settings import LineTimes, PixelClocks
from slopegate.core.scene.scene import MeasuredScene
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_files import COLOUR_SUFFIXES, MAP_SUFFIXES, read_colour, read_map
from slopegate.drivers.files.reading import json_value, read_plain
from slopegate.drivers.scenes.light_toml import FogTable
from slopegate.drivers.scenes.scene_toml import MAX_FILE_BYTES, checked
from slopegate.drivers.scenes.scene_values import MAX_METRES, MIN_METRES, Flag, NotNegative, Number, Positive

CALIBRATION = "scene.json"
RIG_NAME = "rig.toml"
PHOTO_NAMES = ("color", "colour", "rgb", "photo", "image", "left")
DISPARITY_NAMES = ("disparity", "disp")
LEAST_KNOWN = 0.01
"""Of the pixels, those that must have a depth."""
METRES_PER_UNIT = {"mm": 1e-3, "millimetre": 1e-3, "millimeter": 1e-3, "cm": 1e-2, "m": 1.0, "metre": 1.0, "meter": 1.0}


class _Facts(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True, frozen=True)


class Intrinsics(_Facts):
    """Pinhole in pixels, with the centre of the first pixel at 0, and OpenCV's distortion."""

    fx: Positive | None = None
    fy: Positive | None = None
    cx: Number | None = None
    cy: Number | None = None
    distortion: list[Number] = []


class Stereo(_Facts):
    """The stereo rig behind a disparity map: depth = focal * baseline / (disparity + offset)."""

    focal_px: Positive | None = None
    baseline_m: Positive | None = None
    disparity_offset_px: Number = 0.0


class DisparityCoding(_Facts):
    """How many stored counts make a pixel of disparity, as a number or in words ("uint16 = disparity_px * 64")."""

    counts_per_px: Positive | None = None
    encoding: str = ""


class CaptureFacts(_Facts):
    """The keys of scene.json that are used; others are ignored."""

    title: str | None = None
    name: str | None = None
    content: str = ""
    width: int | None = None
    height: int | None = None
    intrinsics: Intrinsics = Intrinsics()
    stereo: Stereo = Stereo()
    disparity: DisparityCoding = DisparityCoding()
    depth_units: str = ""
    depth_scale_m: Positive | None = None
    ambient: NotNegative = 0.0
    indirect: Flag = False
    fog: FogTable | None = None
    rig: str | None = None
    """A rig file beside it: what measured the scene, and looks at it."""
    gates: Any = None
    planes: Any = None

    def label(self, folder: Path) -> str:
        """The name to show."""
        return self.title or self.name or folder.name


def read_facts(folder: Path) -> CaptureFacts:
    """The scene.json of a folder."""
    path = folder / CALIBRATION
    return checked(CaptureFacts, json_value(read_plain(path, MAX_FILE_BYTES), str(path)), path)


def read_capture(folder: Path) -> tuple[CaptureFacts, MeasuredScene, tuple[str, ...]]:
    """Read an RGB-D folder: its scene.json, the scene as its camera saw it, and remarks on what was left out.

    If there are both depth and disparity, depth is used. Pixels without a usable value get inverse depth 0: those that
    are 0, negative, infinite or NaN, the largest value of an integer type, and what is no distance of a surface.
    Raises SceneError for what is missing, does not match, or cannot be meant.
    """
    photo_path = _find(folder, PHOTO_NAMES, COLOUR_SUFFIXES)
    depth_path = _find(folder, ("depth_mm", "depth_cm", "depth_m", "depth"), MAP_SUFFIXES)
    disparity_path = _find(folder, DISPARITY_NAMES, MAP_SUFFIXES)
    if not exists(folder / CALIBRATION):
        _refuse_folder(folder, any((photo_path, depth_path, disparity_path)))
    facts = read_facts(folder)
    if photo_path is None:
        raise SceneError(f"{folder} has no photo: a file such as color.png or color.jpg must be beside the depth")
    map_path = depth_path or disparity_path
    if map_path is None:
        raise SceneError(
            f"{folder} has no depth: a file such as depth_mm.png or disparity.png must be beside the photo"
        )
    _check_calibration(folder, facts, by_disparity=depth_path is None)
    photo = read_colour(photo_path, turn_upright=False)
    height, width = photo.shape[:2]
    _same_size(folder / CALIBRATION, (facts.width or width, facts.height or height), photo_path, (width, height))
    values = read_map(map_path)
    _same_size(map_path, (values.shape[1], values.shape[0]), photo_path, (width, height))
    inverse = _from_depth(map_path, values, facts) if depth_path else _from_disparity(map_path, values, facts)
    inverse, remarks = _plausible(map_path, inverse, facts)
    return facts, MeasuredScene(_lens(folder, facts, width, height), inverse, photo), remarks


def rig_of_capture(rig: Rig, lens: Lens) -> Rig:
    """The rig with another camera lens. Line times are scaled so that B = 1 stays at the same pixel clock.

    B = v_p * line_time * f_c / f_p, so the product of line time and f_c is kept.
    """
    ratio = rig.camera.lens.fy / lens.fy
    shutter = rig.camera.shutter
    line = shutter.line
    if isinstance(line, PixelClocks):
        scaled: PixelClocks | LineTimes = replace(line, clocks_per_line=line.clocks_per_line * ratio)
    else:
        scaled = LineTimes(line.min_us * ratio, line.max_us * ratio, line.step_us * ratio)
    known = rig.calibration if lens == rig.camera.lens else None  # another camera's numbers are not those it told
    return replace(rig, camera=RigCamera(lens, replace(shutter, line=scaled)), calibration=known)


def _find(folder: Path, names: tuple[str, ...], suffixes: tuple[str, ...]) -> Path | None:
    try:
        files = {path.name.lower(): path for path in sorted(folder.iterdir())}
    except OSError as error:
        raise SceneError(f"{folder} cannot be read: {error.strerror}") from error
    wanted = (name + suffix for name in names for suffix in suffixes)
    return next((files[name] for name in wanted if name in files), None)


def _same_size(path: Path, size: tuple[int, int], photo: Path, wanted: tuple[int, int]) -> None:
    if size != wanted:
        raise SceneError(
            f"{path} has {size[0]} x {size[1]} pixels, but {photo.name} has {wanted[0]} x {wanted[1]}:"
            " both must have the same size"
        )


def _refuse_folder(folder: Path, has_pictures: bool) -> None:
    if has_pictures:
        raise SceneError(f"{folder / CALIBRATION} is missing: it must give the camera's intrinsics (fx, fy, cx, cy)")
    raise SceneError(f"{folder} is no scene: it must hold a photo (color.*), depth or disparity, and {CALIBRATION}")


def _check_calibration(folder: Path, facts: CaptureFacts, by_disparity: bool) -> None:
    pinhole = facts.intrinsics
    missing = [f"intrinsics.{name}" for name in ("fx", "fy", "cx", "cy") if getattr(pinhole, name) is None]
    if len(missing) == 4:
        missing = [] if facts.stereo.focal_px else ["intrinsics (fx, fy, cx, cy) or stereo.focal_px"]
    if by_disparity and facts.stereo.focal_px is None and pinhole.fx is None and not missing:
        missing.append("stereo.focal_px")
    if by_disparity and facts.stereo.baseline_m is None:
        missing.append("stereo.baseline_m")
    if missing:
        raise SceneError(f"{folder / CALIBRATION} has no calibration: {' and '.join(missing)} must be given")


def _lens(folder: Path, facts: CaptureFacts, width: int, height: int) -> Lens:
    """The lens of the capture's camera. In files the first pixel's centre is 0, in this program 0.5."""
    pinhole = facts.intrinsics
    fx, fy, cx, cy = pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy
    if fx is None or fy is None or cx is None or cy is None:
        fx = fy = facts.stereo.focal_px or 1.0
        cx, cy = (width - 1) / 2, (height - 1) / 2
    if len(pinhole.distortion) not in DISTORTION_LENGTHS:
        allowed = "0, 4, 5, 8, 12 or 14 numbers in OpenCV's order"
        raise SceneError(f"{folder / CALIBRATION}: intrinsics.distortion is {pinhole.distortion}: it must be {allowed}")
    by_stereo = "stereo.focal_px"
    names = ("intrinsics.fx", "intrinsics.fy") if pinhole.fx is not None else (by_stereo, by_stereo)
    try:
        require_pinhole((width, height), (fx, fy), (cx, cy), (*names, "intrinsics.cx", "intrinsics.cy"))
    except InputError as error:
        raise SceneError(f"{folder / CALIBRATION}: {error}") from None
    return Lens(width, height, fx, fy, cx + 0.5, cy + 0.5, tuple(pinhole.distortion))


def _plausible(path: Path, inverse: Singles, facts: CaptureFacts) -> tuple[Singles, tuple[str, ...]]:
    """The inverse depths without those of no surface, and a remark on them; refused where most are such."""
    known = inverse > 0
    count = int(np.count_nonzero(known))
    if not count:
        raise SceneError(f"{path} holds no usable value at all: at least one pixel must have a depth above 0")
    if count < LEAST_KNOWN * inverse.size:
        raise SceneError(
            f"{path} has a depth at {count} of {inverse.size} pixels ({100 * count / inverse.size:.2g} %): at least"
            f" {100 * LEAST_KNOWN:g} % of them must have one"
        )
    meant = known & (inverse >= np.float32(1 / MAX_METRES)) & (inverse <= np.float32(1 / MIN_METRES))
    strange = count - int(np.count_nonzero(meant))
    if 2 * strange > count:
        distances = inverse[known]
        raise SceneError(
            f"{path} puts the nearest surface at {1 / distances.max():.3g} m and the farthest at"
            f" {1 / distances.min():.3g} m: most must lie between {MIN_METRES:g} and {MAX_METRES:g} m"
            + _scale_hint(facts)
        )
    if not strange:
        return inverse, ()
    bounds = f"nearer than {MIN_METRES:g} m or beyond {MAX_METRES:g} m"
    remark = f"{path}: {strange} of {count} depths are {bounds}, left out"
    return np.where(meant, inverse, np.float32(0)), (remark,)


def _scale_hint(facts: CaptureFacts) -> str:
    scale = facts.depth_scale_m
    if scale is None or scale <= 1:
        return ""
    return f" (depth_scale_m is {scale:g} metres per stored unit; {1 / scale:g} if {scale:g} units are a metre)"


def _from_depth(path: Path, values: NDArray[Any], facts: CaptureFacts) -> Singles:
    named = path.stem.lower().partition("_")[2]
    worded = re.match(r"\s*([a-z]+?)s?\b", facts.depth_units.lower())
    units = (named, worded[1] if worded else "")
    scale = facts.depth_scale_m or next((METRES_PER_UNIT[unit] for unit in units if unit in METRES_PER_UNIT), None)
    if scale is None:
        raise SceneError(
            f"{path} has no unit: its name must be depth_mm or depth_m, or {CALIBRATION} must give depth_scale_m"
            " (metres per stored unit)"
        )
    usable = _usable(values)
    if values.dtype.kind in "ui":
        usable &= values != np.iinfo(values.dtype).max
    return _inverse(np.where(usable, values, 1).astype(np.float64) * scale, usable)


def _from_disparity(path: Path, values: NDArray[Any], facts: CaptureFacts) -> Singles:
    worded = re.search(r"disparity(?:_px)?\s*\*\s*(\d+(?:\.\d+)?)", facts.disparity.encoding)
    counts = facts.disparity.counts_per_px or (float(worded[1]) if worded else None)
    if counts is None and values.dtype.kind == "f":
        counts = 1.0
    if not counts:
        raise SceneError(f"{path} holds whole numbers: {CALIBRATION} must give disparity.counts_per_px")
    focal = facts.stereo.focal_px or facts.intrinsics.fx or 1.0
    usable = _usable(values)
    shifted = np.where(usable, values, 1).astype(np.float64) / counts + facts.stereo.disparity_offset_px
    usable &= shifted > 0
    return _inverse(focal * (facts.stereo.baseline_m or 1.0) / np.where(usable, shifted, 1.0), usable)


def _usable(values: NDArray[Any]) -> Bools:
    return np.asarray(np.isfinite(values) & (values > 0), np.bool_)


def _inverse(depth_m: Doubles, usable: Bools) -> Singles:
    """1 / depth as float32, and 0 where there is none or float32 cannot hold it."""
    with np.errstate(over="ignore", divide="ignore", under="ignore"):
        inverse = (1.0 / np.where(usable, depth_m, np.inf)).astype(np.float32)
    return np.where(np.isfinite(inverse), inverse, np.float32(0))
