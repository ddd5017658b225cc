"""Depth maps on disk.

| suffix | what |
| --- | --- |
| .npy | metres from the camera along its axis, float32 (H, W), NaN where unknown |
| .exr .tif .tiff | the same, with the sweep's facts inside |
| .png | millimetres, 16 bit, 0 where unknown or beyond 65.5 m, as in folders with photo and depth; facts inside |
| .ply | points in world coordinates, metres, x right, y down, z forward, with a grey value each |

Where the rig was calibrated, the standard error of each depth goes with it, metres, NaN where unknown: as a map in a
file of its own (`error_file`), or as `standard_error` of each point.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slopegate.core.measure.sweep import DepthMap, points_m
from slopegate.core.rig.arrays import Bytes, Counts, Singles
from slopegate.core.rig.rig import Rig
from slopegate.drivers.files.durable import check_destination, write_durably
from slopegate.drivers.files.images import save_image

SUFFIXES = (".npy", ".exr", ".tif", ".tiff", ".png", ".ply")

_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])


def error_file(path: Path) -> Path | None:
    """Where the standard errors of a depth map in this file stand; None where they are in the file itself."""
    suffix = path.suffix.lower()
    if suffix == ".ply":
        return None
    # a PNG's whole millimetres would tell nothing of errors
    return path.with_name(f"{path.stem}_error{'.tif' if suffix == '.png' else path.suffix}")


def save_depth(
    path: Path,
    rig: Rig,
    found: DepthMap,
    facts: Mapping[str, Any],
    counts: Counts | None = None,
    errors_m: Singles | None = None,
) -> None:
    """Write a depth map, and its standard errors (H, W) where they are known.

    `facts` must be fit for JSON; counts (H, W) give points their grey. Raises StorageError.
    """
    check_destination(path, SUFFIXES)
    suffix, beside = path.suffix.lower(), error_file(path)
    if errors_m is not None and beside is not None:
        save_image(beside, errors_m, facts)
    if suffix == ".ply":
        _save_points(
            path, points_m(rig, found), _grey(found, counts), None if errors_m is None else errors_m[found.known]
        )
    elif suffix == ".png":
        millimetres = np.nan_to_num(found.depth_m * np.float32(1000), nan=0.0)
        save_image(path, np.where(millimetres < 65535.5, np.rint(millimetres), 0).astype(np.uint16), facts)
    else:
        save_image(path, found.depth_m, facts)


def _grey(found: DepthMap, counts: Counts | None) -> Bytes:
    if counts is None:
        return np.full(int(np.count_nonzero(found.known)), 200, np.uint8)
    bright = max(float(np.percentile(counts, 99.5)), 1.0)
    level = np.clip(counts[found.known] / bright, 0, 1) ** (1 / 2.2)
    return np.rint(255 * level).astype(np.uint8)


def _save_points(path: Path, points: Singles, grey: Bytes, errors_m: Singles | None) -> None:
    kind = _POINT if errors_m is None else np.dtype([*_POINT.descr, ("standard_error", "<f4")])
    table = np.empty(len(points), kind)
    if errors_m is not None:
        table["standard_error"] = errors_m
    for index, name in enumerate("xyz"):
        table[name] = points[:, index]
    for name in ("red", "green", "blue"):
        table[name] = grey
    kinds = {"f4": "float", "u1": "uchar"}
    fields = [f"property {kinds[str(kind[name].str)[1:]]} {name}" for name in kind.names or ()]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}", *fields, "end_header", ""]
    write_durably(path, "\n".join(header).encode("ascii"), table.tobytes())
