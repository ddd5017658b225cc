"""Gray-code pictures of a chart from a folder, whoever took them: one folder a pose, one picture a pattern."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from slopegate.core.calibration.code_check import MOST_DARK, code_signs, misplaced, wrong_order
from slopegate.core.calibration.codes import CodeOrder, white_first, white_last
from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.patterns import Raster
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_files import COLOUR_SUFFIXES, read_raw
from slopegate.drivers.files.reading import read_plain

MAX_PICTURES: Final = 200
MAX_POSES: Final = 200
FULL_SCALES: Final = (1023, 4095, 16383, 65535)
"""Of cameras with 10 to 16 bits."""
_SAMPLE: Final = 8
"""Every eighth pixel tells which picture is the brightest."""
_SAME_LEVEL: Final = 0.02
"""Share of the difference of white and black by which pictures may differ that show the same."""
_ALLOWED_ORDER: Final = (
    "it must be pattern and inverse of every bit, the coarsest first, columns then rows, and white and black first or "
    "last"
)
_NUMBERS = re.compile(r"\d+")


class CalibrationError(UserError):
    """What a calibration is to be made of cannot be used; the message is one sentence that names it."""


@dataclass(frozen=True)
class PoseFolder:
    """The pictures of one pose, in the order of their numbers."""

    name: str
    files: tuple[Path, ...]


@dataclass(frozen=True, eq=False)
class PoseFrames:
    """The pictures of one pose as numbers: frames (N, H, W) uint8 or uint16, and what stands where among them.

    full_scale: counts at which the camera's end. digest: SHA-256 of all files.
    """

    name: str
    order: CodeOrder
    frames: Bytes | Counts
    full_scale: float
    digest: str


def pose_folders(folder: Path, leave_out: Collection[str] = ()) -> list[PoseFolder]:
    """The poses in a folder: its folders that hold pictures, or the folder itself where it holds some.

    leave_out: names of folders in it that are passed over, whatever they hold. Raises CalibrationError where there are
    none, or where numbers of pictures are missing.
    """
    if not folder.is_dir():
        raise CalibrationError(
            f"{folder} is no folder: give one that holds a folder of pictures for every pose of the chart"
        )
    own = _pictures(folder)
    if own:
        return [_pose(folder, own)]
    inside = sorted((entry for entry in folder.iterdir() if entry.is_dir()), key=lambda path: _natural(path.name))
    missing = sorted(set(leave_out) - {path.name for path in inside})
    if missing:
        raise CalibrationError(
            f"{missing[0]!r} is to be left out and no folder in {folder}: there are "
            f"{', '.join(path.name for path in inside) or 'none'}"
        )
    found = [_pose(path, files) for path in inside if path.name not in leave_out and (files := _pictures(path))]
    if not found:
        raise CalibrationError(
            f"{folder} holds no pictures and no folders of pictures ({', '.join(COLOUR_SUFFIXES)}): there must be one "
            "folder for every pose of the chart"
        )
    if len(found) > MAX_POSES:
        raise CalibrationError(f"{folder} holds {len(found)} poses: at most {MAX_POSES} are allowed")
    return found


def _pictures(folder: Path) -> list[Path]:
    files = (path for path in folder.iterdir() if path.suffix.lower() in COLOUR_SUFFIXES and path.is_file())
    return sorted(files, key=lambda path: _natural(path.name))


def _natural(name: str) -> list[tuple[int, str]]:
    """Numbers in a name count as numbers: 2 comes before 10."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdigit() and part.isascii() else (-1, part) for part in parts]


def _pose(folder: Path, files: Sequence[Path]) -> PoseFolder:
    """Raises CalibrationError where numbers are missing among the names, or names differ by more than one number."""
    if len(files) > MAX_PICTURES:
        raise CalibrationError(f"{folder} holds {len(files)} pictures: at most {MAX_PICTURES} belong to one pose")
    stems = {_NUMBERS.sub("#", path.stem) for path in files}
    numbers = [_NUMBERS.findall(path.stem) for path in files]
    if len(stems) > 1 or not all(numbers):
        odd = next(
            (path.name for path in files if not _NUMBERS.search(path.stem)), sorted(path.name for path in files)[0]
        )
        raise CalibrationError(
            f"{folder} holds pictures whose names differ by more than a number ({odd} is one): their order is not known"
        )
    counted = [int(one[-1]) for one in numbers]
    for before, after in pairwise(counted):
        if after != before + 1:
            missing = f"number {before + 1} is missing" if after > before + 1 else f"number {before} is there twice"
            raise CalibrationError(f"{folder}: {missing} among its pictures {files[0].name} to {files[-1].name}")
    return PoseFolder(folder.name, tuple(files))


def read_pose(pose: PoseFolder, projector: Raster) -> PoseFrames:
    """Read a pose's pictures. Raises CalibrationError, naming the pose, where they do not fit each other or the
    projector; SceneError where one cannot be read.
    """
    wanted = white_last(projector).count
    if len(pose.files) != wanted:
        columns, rows = white_last(projector).bits
        raise CalibrationError(
            f"{pose.name} has {len(pose.files)} pictures: a projector of {projector} pixels needs {wanted} ({columns} "
            f"pairs for columns, {rows} for rows, white and black); give the projector's size if it has another"
        )
    digest = hashlib.sha256()
    frames: Bytes | Counts | None = None
    for number, (path, image) in enumerate(_images(pose, digest.update)):
        if frames is None:
            frames = np.empty((wanted, *image.shape), image.dtype)
        if image.shape != frames.shape[1:] or image.dtype != frames.dtype:
            raise CalibrationError(
                f"{pose.name}: {path.name} has {_size(image)} and {pose.files[0].name} has {_size(frames[0])}: all "
                "must be the same"
            )
        frames[number] = image
    assert frames is not None
    return PoseFrames(pose.name, _order(pose, frames, projector), frames, _full_scale(frames), digest.hexdigest())


def _full_scale(frames: Bytes | Counts) -> float:
    """Where the camera's counts end: files of 16 bits may hold 10, 12 or 14, in their lower or in their upper bits."""
    if frames.dtype == np.uint8:
        return float(np.iinfo(np.uint8).max)
    largest = int(frames.max())
    if largest > FULL_SCALES[-2]:
        # upper bits: the step between counts is what the largest one lacks to 2 ** 16
        step = 1 << max(0, _zero_bits(int(np.bitwise_or.reduce(frames, axis=None))))
        return float((1 << 16) - step)
    return float(next(scale for scale in FULL_SCALES if largest <= scale))


def _zero_bits(value: int) -> int:
    """How many of the lowest bits of a number above 0 are 0."""
    return (value & -value).bit_length() - 1


def _images(pose: PoseFolder, seen: Callable[[bytes], object]) -> Iterator[tuple[Path, Bytes | Counts]]:
    for path in pose.files:
        seen(read_plain(path))
        image = read_raw(path)
        if image.dtype not in (np.uint8, np.uint16):
            raise SceneError(f"{path} has {image.dtype} pixels: a camera's counts of 8 or 16 bits are needed")
        if image.ndim == 3:
            # green is the sharpest of a colour camera, and the mean of equal channels is the channel
            image = image[:, :, 1]
        yield path, np.ascontiguousarray(image)


def _size(image: Bytes | Counts) -> str:
    return f"{image.shape[1]} x {image.shape[0]} pixels of {8 * image.itemsize} bits"


def _order(pose: PoseFolder, frames: Bytes | Counts, projector: Raster) -> CodeOrder:
    """The order in which a pose's pictures stand. Raises CalibrationError, naming what is wrong, where they cannot."""
    found, signs = _white_and_black(frames, projector), code_signs(frames)
    if found is not None and not (wrong := misplaced(found, signs)):
        return found
    for order in (white_last(projector), white_first(projector)) if found is None else (found,):
        if (cause := wrong_order(order, signs)) is not None:
            named = [f"{_named(pose, one)} and {_named(pose, other)}" for one, other in cause.swapped]
            text = cause.words or f"{', '.join(named)} have changed places"
            raise CalibrationError(f"{pose.name}: its pictures are out of order: {text}; {_ALLOWED_ORDER}")
    if found is None:
        raise CalibrationError(
            f"{pose.name}: its pictures are out of order: all white and all black are neither the first two nor the "
            f"last two; {_ALLOWED_ORDER}"
        )
    first, second = wrong
    if first == found.white and signs.both_dark(first, second) > MOST_DARK:
        raise CalibrationError(
            f"{pose.name}: its pictures do not belong together: {_named(pose, first)} is not the brightest everywhere, "
            f"or {_named(pose, second)} not the darkest; the camera or the chart moved, or pictures of another pose "
            "are among them"
        )
    if signs.both_dark(first, second) > MOST_DARK:
        raise CalibrationError(
            f"{pose.name}: its pictures are out of order: {_named(pose, first)} and {_named(pose, second)} are no "
            f"pattern and its inverse; {_ALLOWED_ORDER}"
        )
    return found  # the chart moved, or something else that is looked for in the view


def _named(pose: PoseFolder, place: int) -> str:
    return pose.files[place].name


def _white_and_black(frames: Bytes | Counts, projector: Raster) -> CodeOrder | None:
    """White and black stand first or last: no picture is brighter or darker, but for the noise of those that light or
    leave out all that the camera sees."""
    levels = frames[:, ::_SAMPLE, ::_SAMPLE].mean(axis=(1, 2))
    same = _SAME_LEVEL * float(np.ptp(levels))
    for order in (white_last(projector), white_first(projector)):
        if levels[order.white] >= levels.max() - same and levels[order.black] <= levels.min() + same:
            return order
    return None
