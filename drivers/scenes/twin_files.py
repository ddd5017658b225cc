"""Writes a scene that a depth sweep has measured as a folder with photo, depth, intrinsics and rig, which opens again.

color.png     16-bit sRGB: the light that the sweep saw, without its fall with distance
depth_m.exr   metres from the camera along its axis, NaN where unknown
rig.toml      the rig that measured it, and that it is looked at with
scene.json    what `rgbd_files` reads: intrinsics, room light, gates
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from os.path import exists, isdir
from pathlib import Path
from typing import Any

import numpy as np

from slopegate.core.exposure.shown import srgb_curve
from slopegate.core.measure.twin import Twin
from slopegate.core.rig.rig import Rig
from slopegate.core.scene.scene import Preset
from slopegate.drivers.files.durable import StorageError, check_new, replacing
from slopegate.drivers.files.images import write_image
from slopegate.drivers.files.rig_files import rig_to_toml
from slopegate.drivers.scenes.gate_files import gate_table, keys_of
from slopegate.drivers.scenes.rgbd_files import CALIBRATION, RIG_NAME


def check_twin(folder: Path, overwrite: bool = False) -> None:
    """Raise StorageError now for a folder that could not be written later.

    What exists is refused, unless it may be overwritten and is such a folder.
    """
    if not isdir(folder.absolute().parent):
        raise StorageError(f"{folder}: there is no folder {folder.parent}")
    if not overwrite:
        check_new(folder)
    elif exists(folder) and not exists(folder / CALIBRATION):
        raise StorageError(f"{folder} holds no scene: it is not overwritten")


def save_twin(
    folder: Path, rig: Rig, twin: Twin, title: str, content: str, gates: Sequence[Preset] = (), overwrite: bool = False
) -> Path:
    """Write the folder whole or not at all, and return it. Raises StorageError."""
    check_twin(folder, overwrite)
    depth_m = np.full(twin.inverse_depth.shape, np.nan, np.float32)
    np.divide(1, twin.inverse_depth, out=depth_m, where=twin.inverse_depth > 0)
    photo = np.rint(65535 * srgb_curve(twin.photo)).astype(np.uint16)
    with replacing(folder) as part:
        part.mkdir()
        write_image(part / "color.png", ".png", photo)
        write_image(part / "depth_m.exr", ".exr", depth_m)
        (part / RIG_NAME).write_text(rig_to_toml(rig), encoding="utf-8")
        facts = json.dumps(_facts(rig, twin, title, content, gates), indent=1, allow_nan=False, ensure_ascii=False)
        (part / CALIBRATION).write_text(facts + "\n", encoding="utf-8")
    return folder


def _facts(rig: Rig, twin: Twin, title: str, content: str, gates: Sequence[Preset]) -> dict[str, Any]:
    lens = rig.camera.lens
    return {
        "title": title,
        "content": content,
        "width": lens.width,
        "height": lens.height,
        # in files the first pixel's centre is 0, in this program 0.5
        "intrinsics": {
            "fx": lens.fx,
            "fy": lens.fy,
            "cx": lens.cx - 0.5,
            "cy": lens.cy - 0.5,
            "distortion": list(lens.distortion),
        },
        "depth_units": "metres",
        "rig": RIG_NAME,
        "ambient": twin.ambient,
        "counts_per_unit": twin.counts_per_unit,
        **({"gates": [keys_of(gate_table(gate)) for gate in gates]} if gates else {}),
    }
