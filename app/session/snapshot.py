"""Saves a frame with the settings that made it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from slopegate.app.widgets.paint import demosaic
from slopegate.core.gating.gate import slab_if_any
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks
from slopegate.core.scene.scene import Scene
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp, filters
from slopegate.drivers.files.durable import StorageError, make_folder, reason
from slopegate.drivers.files.images import save_image

SUFFIXES = (".tif", ".tiff", ".png")


def snapshot_metadata(rig: Rig, scene: Scene, place: str, info: CameraInfo, stamp: FrameStamp) -> dict[str, Any]:
    """The settings of the frame and the slab that they select, fit for JSON.

    place: the scene's file or the device.
    """
    facts: dict[str, Any] = {
        "scene": scene.name,
        "scene_file": place,
        "rig": rig.name,
        "camera": info.name,
        "pixel_format": info.pixel_format,
        "max_count": info.max_count,
        "black_count": info.black_count,
        "sequence": stamp.sequence,
        "settled": stamp.settled,
        "rows_read": stamp.rows,
        "asked": _settings(rig, stamp.asked),
        "applied": _settings(rig, stamp.applied),
    }
    if stamp.applied is not None:
        read = slab_if_any(rig, stamp.applied)
        facts |= {"slab": None if read.slab is None else asdict(read.slab), "no_slab": read.why or None}
    return facts


def _settings(rig: Rig, settings: GateSettings | None) -> dict[str, float] | None:
    if settings is None:
        return None
    found = {key: float(value) for key, value in asdict(settings).items()}
    line = rig.camera.shutter.line
    if isinstance(line, PixelClocks):
        found["clock_mhz"] = line.clock_mhz(settings.line_time_us)
    return found


def save_snapshot(path: Path, counts: Counts, metadata: Mapping[str, Any], raw: bool) -> Path:
    """Write counts (H, W) uint16, a mosaic as RGB unless `raw`; returns the path. Raises StorageError.

    A path without a suffix becomes a .tif.
    """
    target = path if path.suffix else path.with_suffix(".tif")
    pattern = filters(metadata["pixel_format"])
    if pattern and not raw:
        colour = np.empty((*counts.shape, 3), np.uint16)
        demosaic(counts, colour, pattern)
        save_image(target, colour, {**metadata, "demosaiced": True})
    else:
        save_image(target, counts, {**metadata, "demosaiced": False})
    return target


def save_numbered(folder: Path, counts: Counts, metadata: Mapping[str, Any], now: datetime) -> Path:
    """Write counts as `save_snapshot` does, to a new file of this folder; returns its path. Raises StorageError.

    Its name has the scene's, the next number there, and the time. The folder is made where there is none.
    """
    make_folder(folder)
    try:
        words = _words(metadata["scene"])
        pattern = re.compile(rf"{re.escape(words)}-(\d{{4,9}})-")
        number = max((int(found[1]) for name in os.listdir(folder) if (found := pattern.match(name))), default=0)
        path = _new_file(folder, words, number + 1, now)
    except OSError as error:
        raise StorageError(reason(folder, error)) from None
    try:
        return save_snapshot(path, counts, metadata, raw=False)
    except StorageError:
        path.unlink(missing_ok=True)
        raise


def _new_file(folder: Path, words: str, number: int, now: datetime) -> Path:
    """An empty file that was not there before."""
    while True:
        path = folder / f"{words}-{number:04d}-{now:%Y%m%d-%H%M%S}.tif"
        with suppress(FileExistsError):
            path.touch(exist_ok=False)
            return path
        number += 1


def suggested_name(scene: Scene, now: datetime) -> str:
    """A file name from the scene's name and the time, safe on every system."""
    return f"{_words(scene.name)}-{now:%Y%m%d-%H%M%S}.tif"


def _words(name: str) -> str:
    plain = "".join(letter if letter.isalnum() else "-" for letter in name.lower())
    return "-".join(part for part in plain.split("-") if part)[:40] or "frame"
