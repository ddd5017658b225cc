"""The chart in a live picture, found quickly and roughly: to show that it is seen, and how it is held."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from slopegate.core.calibration.chart import Chart, Corners, find_corners
from slopegate.core.rig.arrays import Bytes, Doubles

GLANCED_PX: Final = 640
"""Width that a picture is brought to: a picture without the chart takes longest, a quarter of a second."""
MOST_ENLARGED: Final = 2.0
"""Squares of few pixels are found better in a larger picture."""


def glance(chart: Chart, image: Bytes) -> Corners | None:
    """The chart's corners in a grey image (H, W) uint8, to about a pixel; None where it is not seen.

    As `find_corners`, in a bounded time.
    """
    height, width = image.shape
    step = max(1 / MOST_ENLARGED, width / GLANCED_PX)
    size = (round(width / step), max(1, round(height / step)))
    how = cv2.INTER_AREA if step > 1 else cv2.INTER_LINEAR
    small = np.asarray(cv2.resize(image, size, interpolation=how), np.uint8)
    if chart.kind == "charuco":
        found = find_corners(chart, small)
        return None if found is None else Corners(found.index, step * found.points)
    size, evened = (chart.columns, chart.rows), cv2.CALIB_CB_NORMALIZE_IMAGE
    seen, points = cv2.findChessboardCornersSB(small, size, flags=evened)
    if not seen:  # small and tilted charts are better found by their squares
        by_squares = cv2.CALIB_CB_ADAPTIVE_THRESH | evened | cv2.CALIB_CB_FAST_CHECK
        seen, points = cv2.findChessboardCorners(small, size, flags=by_squares)
    if not seen:
        return None
    places: Doubles = np.asarray(points, np.float64).reshape(-1, 2) + 0.5
    return Corners(np.arange(chart.count, dtype=np.int32), step * places)
