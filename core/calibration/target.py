"""A flat target before the rig, and which projector rows light it: what gated pictures are measured against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from slopegate.core.calibration.chart_scene import pose_of
from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Matrix3, Rig, Vector3, matrix3, to_pixels
from slopegate.core.rig.triangulate import inverse_depth, projector_rows, to_projector_axes

_KNOWN: Final = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
_LEAST_POINTS: Final = 4
FLAT_SHARE: Final = 0.01
FLAT_ROWS: Final = 2.0
"""Of all rows of the projector, by how many the rows of a plane's pixels may be off it; and at least."""
_PLANES: Final = 400
_FITS: Final = 3
_TRIED_PIXELS: Final = 2000
"""Planes that are tried, times that the best is fitted, and pixels that judge each."""


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


def flat_part(rig: Rig, projector_row: Singles, known: Bools) -> Bools:
    """The known pixels (H, W) of the largest plane, by the rows (H, W) that light them.

    Planes through three pixels are tried, then the best one is fitted to all that lie on it. The rig need not be exact:
    a plane whose rows are off by less than `FLAT_SHARE` counts as one. Nothing where no three pixels meet their rows.
    """
    rows, columns = np.nonzero(known)
    some = slice(None, None, max(1, len(rows) // _TRIED_PIXELS))
    rays = rig.camera_rays(columns + 0.5, rows + 0.5)
    lit = projector_row[rows, columns].astype(np.float64)
    depths, met = inverse_depth(rig, rays, lit)
    met &= np.isfinite(depths)
    near = max(FLAT_ROWS, FLAT_SHARE * rig.projector.lens.height)
    random = np.random.default_rng(0)
    pool = np.flatnonzero(met)
    found, most = np.zeros(len(rows), np.bool_), 0
    if len(pool) < _LEAST_POINTS:
        return np.zeros_like(known)
    for _ in range(_PLANES):
        three = random.choice(pool, 3, replace=False)
        slopes = np.linalg.lstsq(rays[three], depths[three], rcond=None)[0]
        on = np.abs(projector_rows(rig, rays[some], rays[some] @ slopes) - lit[some]) <= near
        if on.sum() > most:
            most, best = int(on.sum()), slopes
    for _ in range(_FITS if most else 0):
        found = np.abs(projector_rows(rig, rays, rays @ best) - lit) <= near
        best = np.linalg.lstsq(rays[found & met], depths[found & met], rcond=None)[0]
    flat = np.zeros_like(known)
    flat[rows[found], columns[found]] = True
    return flat


def chart_target(rig: Rig, points_m: Doubles, pixels: Doubles) -> FlatTarget:
    """The plane of a chart whose points (N, 3), metres and z = 0, the camera sees at pixels (N, 2).

    Raises InputError where no pose of it fits.
    """
    lens = rig.camera.lens
    held = pose_of(lens, points_m, pixels)
    if held is None:
        raise InputError("the chart's points fit no place in front of the camera")
    turn, shift = np.asarray(cv2.Rodrigues(np.array(held.rotation))[0], np.float64).ravel(), np.array(held.shift_m)
    seen, slopes = cv2.projectPoints(points_m, turn, shift, lens.matrix, np.array(lens.distortion))
    missed = pixels - np.asarray(seen, np.float64).reshape(-1, 2)
    by_pose = np.asarray(slopes, np.float64)[:, :6]
    noise = float((missed**2).sum()) / max(1, missed.size - 6)
    pose = np.concatenate([turn, shift])
    change = np.stack([(_plane(pose + step) - _plane(pose - step)) / 2e-6 for step in 1e-6 * np.eye(6)], axis=1)
    covariance = change @ np.linalg.pinv(by_pose.T @ by_pose) @ change.T * noise
    x, y, one = map(float, _plane(pose))
    return FlatTarget((x, y, one), matrix3(covariance))


def _plane(pose: Doubles) -> Doubles:
    """Turn and shift of a chart, (6,) -> the slopes of its plane."""
    normal = np.asarray(cv2.Rodrigues(pose[:3])[0], np.float64)[:, 2]
    return normal / float(normal @ pose[3:])
