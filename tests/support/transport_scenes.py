"""The scenes of the paper's figures 15 to 18, acquired by a virtual projector and camera with larger pixels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from slopegate.app import api
from slopegate.app.rig_gates import OpenRig
from slopegate.core.render.coverage import true_alpha
from slopegate.core.rig.arrays import Bools, Singles
from slopegate.core.rig.variants import binned_rig
from slopegate.drivers.files.rig_files import load_rig

Image = np.ndarray[Any, Any]


def small_scene(key: str, binning: int) -> api.OpenScene:
    """A shipped scene seen by the usual rig with pixels so many times as wide and high."""
    return api.open_scene(key, OpenRig(binned_rig(load_rig(None), binning)))


def acquired(opened: api.OpenScene, folder: Path, near_m: float, far_m: float, count: int, **how: Any) -> Any:
    """Its light transport without noise: `count` slices between two distances."""
    return opened.acquire_transport(folder, opened.plan_slices(near_m, far_m, count), noise=False, **how)


def covered(opened: api.OpenScene, *names: str) -> Bools:
    """Pixels (H, W) that these objects cover wholly."""
    return true_alpha(opened.rig, opened.scene, names, 4) == 1


def arrow(height: int, width: int) -> Singles:
    """An arrow that points right, 0 or 1."""
    picture = np.zeros((height, width), np.uint8)
    outline = [(0.1, 0.4), (0.55, 0.4), (0.55, 0.2), (0.9, 0.5), (0.55, 0.8), (0.55, 0.6), (0.1, 0.6)]
    cv2.fillPoly(picture, [np.rint(np.array(outline) * (width, height)).astype(np.int32)], 1)
    return picture.astype(np.float32)


def inside_box(picture: Singles, mask: Bools) -> Singles:
    """Zeros, but for the picture scaled to the bounding box of the mask (h, w)."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    out = np.zeros(mask.shape, np.float32)
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    size = columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0]
    out[box] = cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST)
    return out


def mean_over(image: Image, where: Bools) -> float:
    """Mean of an image (H, W) over some pixels."""
    return float(image[where].mean(dtype=np.float64))


def alone(count: int, place: int, light: api.SliceLight) -> Sequence[api.SliceLight]:
    """Lights of which only one slice's is visible."""
    return [light if k == place else api.SliceLight(visible=False) for k in range(count)]
