"""Calibrations of a projector and a camera as others keep them: OpenCV's storage files (XML, YAML, JSON), and ours."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from slopegate.core.calibration.applied import Difference, differences
from slopegate.core.calibration.consistency import Misfit, misfit
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import GEOMETRY
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import DISTORTION_LENGTHS, Lens, Rig, matrix3
from slopegate.drivers.calibrations.geometry_run import CalibratedGeometry
from slopegate.drivers.calibrations.pictures import CalibrationError
from slopegate.drivers.files.reading import decoding, read_plain
from slopegate.drivers.files.rig_files import load_rig

STORAGE_SUFFIXES: Final = (".xml", ".yml", ".yaml")
MOST_BYTES: Final = 1_000_000
UNITS: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_NAMES: Final = {
    "camera": ("cam_K", "cam_int", "cam_intrinsic", "camera_matrix", "cam_mtx"),
    "camera_bent": ("cam_kc", "cam_dist", "cam_distortion", "camera_distortion"),
    "projector": ("proj_K", "proj_int", "proj_intrinsic", "projector_matrix", "proj_mtx"),
    "projector_bent": ("proj_kc", "proj_dist", "proj_distortion", "projector_distortion"),
    "rotation": ("R", "rotation", "roration", "cam_proj_rmat"),
    "moved": ("T", "translation", "cam_proj_tvec"),
}
"""What the files of several programs call it, among them Moreno and Taubin's."""


@dataclass(frozen=True)
class Published:
    """A calibration that was given: as a rig, and the unit that its lengths were taken to have ("" where it says)."""

    path: Path
    rig: Rig
    unit: str

    @property
    def unit_told(self) -> str:
        """The guess, in brackets."""
        return f" (lengths taken as {self.unit})" if self.unit else ""


@dataclass(frozen=True)
class PublishedCheck:
    """A given calibration beside the pictures, and beside the fit to them; `differences` in the fit's errors."""

    published: Published
    misfit: Misfit
    fitted: Misfit
    differences: tuple[Difference, ...]

    @property
    def contradicts(self) -> bool:
        """Whether it cannot be the calibration of what took the pictures."""
        return self.misfit.contradicts(self.fitted)

    @property
    def sentence(self) -> str:
        """By how much it misses them."""
        own, best = self.misfit, self.fitted
        verdict = "is inconsistent with" if self.contradicts else "fits"
        return (
            f"{self.published.path} {verdict} the pictures: it misses the epipolar lines of their corners by "
            f"{own.epipolar_px:.2f} projector pixels (the fit: {best.epipolar_px:.2f}), the corners by "
            f"{own.camera_px:.2f} in the camera ({best.camera_px:.2f}) and {own.projector_px:.2f} in the projector "
            f"({best.projector_px:.2f})"
        )


def check_published(published: Published, found: CalibratedGeometry) -> PublishedCheck:
    """Hold a given calibration to the corners of the views that were fitted."""
    fitted = {view.name for view in found.geometry.views}
    views = [view.view for view in found.views if view.name in fitted and view.view is not None]
    apart = tuple(one for one in differences(published.rig, found.rig) if one.name in GEOMETRY)
    return PublishedCheck(published, misfit(published.rig, views), misfit(found.rig, views), apart)


def read_published(path: Path, found: Rig) -> Published:
    """Read a rig file (.toml) or an OpenCV storage file, whose unit of length is guessed by the rig that was found.

    Raises CalibrationError or RigError with one sentence.
    """
    if path.suffix.lower() == ".toml":
        return Published(path, load_rig(path), "")
    if path.suffix.lower() not in STORAGE_SUFFIXES:
        raise CalibrationError(
            f"{path} is no calibration that can be read: it must be a rig file (.toml) or one of OpenCV's "
            f"({', '.join(STORAGE_SUFFIXES)})"
        )
    nodes = _nodes(path)
    missing = [names[0] for key, names in _NAMES.items() if key not in nodes and not key.endswith("_bent")]
    if missing:
        raise CalibrationError(
            f"{path} holds no {', '.join(missing)}: a calibration has cam_K, cam_kc, proj_K, proj_kc, R and T"
        )
    return _as_rig(path, nodes, found)


def published_beside(folder: Path, found: Rig) -> Iterator[Published]:
    """The calibrations of OpenCV's kind that lie in a folder; files that hold something else are passed over."""
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in STORAGE_SUFFIXES and path.is_file():
            try:
                yield read_published(path, found)
            except CalibrationError:
                continue


def _nodes(path: Path) -> dict[str, Doubles]:
    """The matrices of a storage file, by what they are."""
    text = read_plain(path, MOST_BYTES, CalibrationError)
    refusal = CalibrationError(f"{path} is no storage file of OpenCV that can be read")
    found = {}
    with decoding(refusal):
        storage = cv2.FileStorage(text.decode("utf-8"), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        for key, names in _NAMES.items():
            matrices = (storage.getNode(name).mat() for name in names)
            matrix = next((one for one in matrices if one is not None and one.size), None)
            if matrix is not None:
                found[key] = np.asarray(matrix, np.float64)
        storage.release()
    return found


def _as_rig(path: Path, nodes: dict[str, Doubles], found: Rig) -> Published:
    rotation, moved = nodes["rotation"], nodes["moved"].ravel()
    if rotation.size == 3:
        rotation = np.asarray(cv2.Rodrigues(rotation.ravel())[0], np.float64)
    fits = rotation.shape == (3, 3) and moved.shape == (3,)
    if not fits or any(nodes[side].shape != (3, 3) for side in ("camera", "projector")):
        raise CalibrationError(f"{path} has matrices of other shapes than a calibration: 3 x 3, and 3 numbers for T")
    unit = min(UNITS, key=lambda name: _ratio(float(np.linalg.norm(moved)) * UNITS[name], found.baseline_m))
    offset = -rotation.T @ moved * UNITS[unit]
    try:
        rig = replace(
            found,
            name=path.name,
            camera=replace(found.camera, lens=_lens(nodes, "camera", found.camera.lens)),
            projector=replace(found.projector, lens=_lens(nodes, "projector", found.projector.lens)),
            projector_offset_m=(float(offset[0]), float(offset[1]), float(offset[2])),
            projector_rotation=matrix3(rotation),
            calibration=None,
        )
    except InputError as error:
        raise CalibrationError(f"{path}: {error}") from None
    return Published(path, rig, unit)


def _ratio(one: float, other: float) -> float:
    return abs(math.log(one / other)) if one > 0 else math.inf


def _lens(nodes: dict[str, Doubles], side: str, found: Lens) -> Lens:
    matrix = nodes[side]
    bent = nodes.get(f"{side}_bent", np.zeros(0)).ravel()
    if len(bent) not in DISTORTION_LENGTHS:
        raise InputError(f"{side}'s distortion is {len(bent)} numbers: it must be 0, 4, 5, 8, 12 or 14")
    fx, fy, cx, cy = (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    # OpenCV counts pixel centres from 0
    return Lens(found.width, found.height, fx, fy, cx + 0.5, cy + 0.5, tuple(map(float, bent)))
