"""Where the projector would see the corners of a chart: from the decoded pixels round each corner.

The chart is flat: its perspective and the bend of both lenses tie the projector's pixels smoothly to the camera's. A
surface of second degree, fitted to hundreds of decoded pixels, tells the corner's place far below a stripe's width. A
homography (Moreno and Taubin 2012) bends by perspective alone: what lenses bend beside it shifts corners by a hundredth
of a pixel, neighbours alike, which on large sensors is more than some sums of numbers are said to be known to.
Terms of third degree shift nothing where pixels lie on all sides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.spread import robust_deviation

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
    """The place of the corner itself and the rms distance of the pixels from the surface."""
    x, y = (pixels / float(np.abs(pixels).max())).T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    middle = np.median(places, axis=0)
    to = places - middle
    used = np.ones(len(to), np.bool_)
    for _ in range(ROUNDS):
        some = terms[used]
        surface = np.linalg.solve(some.T @ some + 1e-9 * np.eye(terms.shape[1]), some.T @ to[used])
        missed = np.hypot(*(terms @ surface - to).T)
        deviation = robust_deviation(missed[used], about=0.0) + 1e-12
        used = missed <= OUTLIER * deviation
    error = float(np.sqrt(np.mean(missed[used] ** 2)))
    return middle + surface[0], error
