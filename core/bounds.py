"""Bounds on inverse depth: the gate as a test on what a camera ray can see (model section 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig import Rig
from slopegate.core.settings import GateSettings

Floats = NDArray[np.float64]


def inverse_depth_bounds(rig: Rig, settings: GateSettings, frame: int = 0) -> tuple[Floats, Floats]:
    """Bounds on inverse depth (1/z from the camera, 1/m) of what projector frame `frame` adds to the gate.

    A pixel whose surface has low <= w < high records it. Shapes (N_c, 1) for the ideal rig, whose bounds are those of
    the row, else (N_c, W) for rays through the pixels' centres. Bounds are clipped to w >= 0 and to the rows that the
    projector has; where nothing is left both are 0. The projector's columns are not looked at.

    Exact for undistorted lenses (the projector row on a camera ray is a ratio of two affine functions of w, so an edge
    is one linear inequality); with a distorted projector lens four corrections bring an edge to within 1e-6 rows for
    distortions of up to a tenth of the radius.
    """
    lens = rig.camera.lens
    rows = np.arange(lens.height)[:, None] + 0.5
    columns = np.array([[lens.cx]]) if rig.is_ideal else np.arange(lens.width)[None, :] + 0.5
    rays = rig.camera_rays(columns, rows)
    centre = settings.delay_us + rows * settings.line_time_us + frame * -rig.projector.period_us
    speed, last = rig.projector.rows_per_us, float(rig.projector.lens.height)
    edges = [np.clip(speed * (centre + sign * settings.exposure_us / 2), 0.0, last) for sign in (-1, 1)]
    at_infinity, change = rays @ rig.rotation.T, rig.rotation @ np.array(rig.projector_offset_m)
    low, high = np.zeros(rays.shape[:2]), np.full(rays.shape[:2], np.inf)
    _cut(low, high, at_infinity[..., 2], np.full(low.shape, change[2]))
    for edge, sign in zip(edges, (1.0, -1.0), strict=True):
        slope = _edge_slope(rig, at_infinity, change, np.broadcast_to(edge, low.shape))
        _cut(
            low,
            high,
            sign * (at_infinity[..., 1] - slope * at_infinity[..., 2]),
            sign * (change[1] - slope * change[2]),
        )
    empty = ~(low < high) | np.broadcast_to(edges[0] >= edges[1], low.shape)
    low[empty] = 0.0
    high[empty] = 0.0
    return low, high


def inverse_depth_of_rows(rig: Rig, projector_row: NDArray[np.float32] | Floats) -> Floats:
    """Inverse depth (H, W), 1/z from the camera in 1/m, of what each pixel sees lit by this projector row (H, W).

    0 where the row is negative (unlit) or meets the pixel's ray nowhere in front of the camera: at infinity or beyond.
    Exact for undistorted lenses; a distorted projector lens is followed as in `inverse_depth_bounds`.
    """
    height, width = projector_row.shape
    rays = rig.camera_rays(np.arange(width)[None, :] + 0.5, np.arange(height)[:, None] + 0.5)
    at_infinity, change = rays @ rig.rotation.T, rig.rotation @ np.array(rig.projector_offset_m)
    slope = _edge_slope(rig, at_infinity, change, np.asarray(projector_row, np.float64))
    found = _ratio(at_infinity[..., 1] - slope * at_infinity[..., 2], change[1] - slope * change[2])
    return np.where((projector_row < 0) | (found < 0), 0.0, found)


def _edge_slope(rig: Rig, at_infinity: Floats, change: Floats, edge: Floats) -> Floats:
    """y/z in the projector at which each camera ray meets projector row `edge`."""
    lens = rig.projector.lens
    slope = (edge - lens.cy) / lens.fy
    for _ in range(4 if lens.distorted else 0):
        top, bottom = at_infinity[..., 1] - slope * at_infinity[..., 2], change[1] - slope * change[2]
        w = _ratio(top, bottom)
        point = at_infinity - w[..., None] * change
        in_front = point[..., 2] > 1e-6
        depth = np.where(in_front, point[..., 2], 1.0)
        _, row = lens.project(point[..., 0] / depth, slope)
        slope = np.where(in_front, slope + (edge - row) / lens.fy, slope)
    return slope


def _cut(low: Floats, high: Floats, constant: Floats, slope: Floats) -> None:
    """Narrow [low, high] in place to where constant - w slope >= 0."""
    root = _ratio(constant, slope)
    np.minimum(high, np.where(slope > 0, root, np.inf), out=high)
    np.maximum(low, np.where(slope < 0, root, 0.0), out=low)
    high[(slope == 0) & (constant < 0)] = 0.0


def _ratio(top: Floats, bottom: Floats) -> Floats:
    return np.divide(top, bottom, out=np.zeros(np.broadcast_shapes(top.shape, bottom.shape)), where=bottom != 0)
