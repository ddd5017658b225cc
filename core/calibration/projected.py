"""Where the projector would see the corners of a chart: a homography round each corner (Moreno and Taubin 2012).

The chart is flat, and over a few millimetres of it both lenses are as good as undistorted: camera pixels and the
projector's pixels that light them are then tied by a homography. Fitted to hundreds of decoded pixels it tells the
corner's place far below the width of a stripe.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Bools, Doubles, Singles

LEAST_PIXELS: Final = 40
LEAST_SIDES: Final = 3
"""Of the four quarters round a corner, in how many pixels have to be decoded."""
OUTLIER: Final = 4.0
"""Pixels further from the fit than this many of its own (robust) standard deviations are left out."""
ROUNDS: Final = 3


@dataclass(frozen=True, eq=False)
class Projected:
    """Corners in the projector's picture.

    points (N, 2) float64: continuous columns and rows, NaN where too little was decoded round a corner. error_px (N,)
    float64: rms distance of the decoded pixels from the fit, pixels of the projector.
    """

    points: Doubles
    error_px: Doubles


def projected(corners: Doubles, place: Singles, radius_px: float) -> Projected:
    """Places (N, 2) of corners (N, 2) in the projector, from its decoded places (H, W, 2) within `radius_px`."""
    points, errors = np.full_like(corners, np.nan), np.full(len(corners), np.nan)
    for number, corner in enumerate(corners):
        pixels, places = _around(corner, place, radius_px)
        if len(pixels) >= LEAST_PIXELS and _sides(pixels) >= LEAST_SIDES:
            points[number], errors[number] = _fit(pixels, places)
    return Projected(points, errors)


def _around(corner: Doubles, place: Singles, radius_px: float) -> tuple[Doubles, Doubles]:
    """Decoded pixels near a corner, seen from it, and their places in the projector."""
    height, width = place.shape[:2]
    x0, y0 = (max(0, int(value - radius_px)) for value in corner)
    x1, y1 = min(width, int(corner[0] + radius_px) + 1), min(height, int(corner[1] + radius_px) + 1)
    part = place[y0:y1, x0:x1].astype(np.float64)
    rows, columns = np.mgrid[y0:y1, x0:x1]
    seen = np.stack([columns + 0.5 - corner[0], rows + 0.5 - corner[1]], axis=-1)
    kept = np.isfinite(part[..., 0]) & ((seen**2).sum(axis=-1) <= radius_px**2)
    return seen[kept], part[kept]


def _sides(pixels: Doubles) -> int:
    quarter = 2 * (pixels[:, 0] > 0) + (pixels[:, 1] > 0)
    return int((np.bincount(quarter, minlength=4) >= LEAST_PIXELS // 8).sum())


def _fit(pixels: Doubles, places: Doubles) -> tuple[Doubles, float]:
    """The place of the corner itself and the rms distance of the pixels from the homography."""
    scale = float(np.abs(pixels).max())
    at, to = pixels / scale, places - np.median(places, axis=0)
    spread = float(np.abs(to).max()) or 1.0
    to = to / spread
    used = np.ones(len(at), np.bool_)
    for _ in range(ROUNDS):
        origin, missed = _homography(at, to, used)
        deviation = 1.4826 * float(np.median(missed[used])) + 1e-12
        used = missed <= OUTLIER * deviation
    error = spread * float(np.sqrt(np.mean(missed[used] ** 2)))
    return np.median(places, axis=0) + spread * origin, error


def _homography(at: Doubles, to: Doubles, used: Bools) -> tuple[Doubles, Doubles]:
    """Least squares of a homography over the used pixels: where 0, 0 goes, and how far each pixel is missed (N,).

    Solved twice: the second time each equation is divided by its denominator, so that it is the distance that counts.
    """
    x, y = at.T
    one, none = np.ones_like(x), np.zeros_like(x)
    weight = one
    for _ in range(2):
        u = np.stack([x, y, one, none, none, none, -x * to[:, 0], -y * to[:, 0]], axis=-1)
        v = np.stack([none, none, none, x, y, one, -x * to[:, 1], -y * to[:, 1]], axis=-1)
        left = np.concatenate([u[used] * weight[used, None], v[used] * weight[used, None]])
        right = np.concatenate([to[used, 0] * weight[used], to[used, 1] * weight[used]])
        h = np.linalg.solve(left.T @ left + 1e-12 * np.eye(8), left.T @ right)
        weight = 1 / (1 + h[6] * x + h[7] * y)
    across = (h[0] * x + h[1] * y + h[2]) * weight
    down = (h[3] * x + h[4] * y + h[5]) * weight
    return h[[2, 5]], np.hypot(across - to[:, 0], down - to[:, 1])
