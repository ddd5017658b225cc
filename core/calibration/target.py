"""A flat target before the rig, and which projector rows light it: what gated pictures are measured against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.rig import Lens, Matrix3, Rig, Vector3, to_pixels
from slopegate.core.rig.triangulate import to_projector_axes

_KNOWN: Final = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
_LEAST_POINTS: Final = 4


@dataclass(frozen=True)
class FlatTarget:
    """A plane in front of the camera: 1/z = slopes . (x, y, 1) in 1/m on the camera ray (x, y, 1), z from the camera.

    covariance (3, 3): how well the slopes are known, apart from what the camera's lens brings in.
    """

    slopes: Vector3
    covariance: Matrix3 = _KNOWN


TargetOf = Callable[[Rig], FlatTarget]
"""Where the target stands, if the rig is this one: what is told by the camera's pictures depends on its lens."""


def rows_on(rig: Rig, target: FlatTarget, columns: Doubles, rows: Doubles) -> tuple[Doubles, Bools]:
    """Projector rows that light the target at camera pixels (broadcast), and where the projector's raster does."""
    rays = rig.camera_rays(columns, rows)
    w = rays @ np.array(target.slopes)
    at_infinity, change = to_projector_axes(rig, rays)
    column, row, _ = to_pixels(rig.projector.lens, at_infinity - w[..., None] * change)
    raster = rig.projector.lens
    lit = (w > 0) & (row >= 0) & (row < raster.height) & (column >= 0) & (column < raster.width)
    return row, lit


def target_rows(rig: Rig, target: FlatTarget) -> Singles:
    """The projector row that lights the target at each camera pixel, (H, W) float32; -1 where none does."""
    lens = rig.camera.lens
    row, lit = rows_on(rig, target, lens.column_centres[None, :], lens.row_centres[:, None])
    return np.where(lit, row, -1).astype(np.float32)


def fitted_target(rig: Rig, inverse_depth: Singles, known: Bools) -> FlatTarget:
    """The plane through what a depth map shows: inverse_depth (H, W) 1/m of the known pixels (H, W).

    Raises InputError where that is less than a plane.
    """
    rows, columns = np.nonzero(known & (inverse_depth > 0))
    require(len(rows) >= _LEAST_POINTS, "pixels of the plane", len(rows), f"at least {_LEAST_POINTS}")
    rays = rig.camera_rays(columns + 0.5, rows + 0.5)
    depths = inverse_depth[rows, columns].astype(np.float64)
    x, y, one = np.linalg.lstsq(rays, depths, rcond=None)[0]
    return FlatTarget((float(x), float(y), float(one)))


def chart_target(rig: Rig, points_m: Doubles, pixels: Doubles) -> FlatTarget:
    """The plane of a chart whose points (N, 3), metres and z = 0, the camera sees at pixels (N, 2).

    Raises InputError where no pose of it fits.
    """
    lens = rig.camera.lens
    matrix, bent = _opencv(lens)
    found, turn, shift = cv2.solvePnP(points_m, pixels - 0.5, matrix, bent)
    if not found or float(shift.ravel()[2]) <= 0:
        raise InputError("the chart's points fit no place in front of the camera")
    seen, slopes = cv2.projectPoints(points_m, turn, shift, matrix, bent)
    missed = pixels - 0.5 - np.asarray(seen, np.float64).reshape(-1, 2)
    by_pose = np.asarray(slopes, np.float64)[:, :6]
    noise = float((missed**2).sum()) / max(1, missed.size - 6)
    pose = np.concatenate([turn.ravel(), shift.ravel()]).astype(np.float64)
    change = np.stack([(_plane(pose + step) - _plane(pose - step)) / 2e-6 for step in 1e-6 * np.eye(6)], axis=1)
    (a, b, c), (d, e, f), (g, h, i) = (change @ np.linalg.pinv(by_pose.T @ by_pose) @ change.T * noise).tolist()
    x, y, one = map(float, _plane(pose))
    return FlatTarget((x, y, one), ((a, b, c), (d, e, f), (g, h, i)))


def _plane(pose: Doubles) -> Doubles:
    """Turn and shift of a chart, (6,) -> the slopes of its plane."""
    normal = np.asarray(cv2.Rodrigues(pose[:3])[0], np.float64)[:, 2]
    return normal / float(normal @ pose[3:])


def _opencv(lens: Lens) -> tuple[Doubles, Doubles]:
    """Matrix and distortion for OpenCV, which counts pixel centres from 0."""
    matrix = lens.matrix
    matrix[:2, 2] -= 0.5
    return matrix, np.array(lens.distortion or (0.0,) * 5)
