"""From settings to what each camera row records (model sections 2 and 3; equations 7-10 of the paper).

A surface point lit by projector row coordinate r_p shines at t = r_p / v_p + m T for every integer m. Camera row k is
exposed during delay + (k + 1/2) line_time -+ exposure / 2. So a point is recorded once for every m whose instant lies in
that window, and the test needs nothing but r_p and the row, whatever the rig: the geometry sits in r_p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopegate.core.checks import require
from slopegate.core.rig import Rig
from slopegate.core.settings import CentreDelayUs, GateSettings

Floats = NDArray[np.float64]

TICKS_PER_US = 2.0**30
"""Window edges are whole ticks of about a femtosecond, so that a gate and its complement, or two slices that meet, share
their edges to the last bit. An edge is moved by at most half a tick: 5e-10 us, 2.2e-11 rows of the check rig."""


@dataclass(frozen=True, eq=False)
class RowWindows:
    """What each camera row records, by projector row coordinate; arrays of one value per camera row.

    A point at low <= r_p < high (float64) is recorded `inside` times (int32), any other lit point `outside` times.
    Wrap round the frame, blanking and exposures beyond one period are all in these four numbers.
    """

    low: Floats
    high: Floats
    inside: NDArray[np.int32]
    outside: NDArray[np.int32]


def row_windows(rig: Rig, settings: GateSettings) -> RowWindows:
    """The window of every camera row, *continuous* level of detail (model section 2), any rig.

    Edges are exact to half a tick (`TICKS_PER_US`) plus one float64 rounding, for |delay| and exposure below 1e6 us.
    """
    rows = np.arange(rig.camera.lens.height) + 0.5
    period = _ticks(rig.projector.period_us / 2) * 2
    offset = _ticks(rows * settings.line_time_us) + _ticks(settings.delay_us)
    half = _ticks(settings.exposure_us / 2)
    start, end = np.mod(offset - half, period), np.mod(offset + half, period)
    gap = end < start
    whole = (2 * half - (end - start)) // period - gap
    scale = rig.projector.rows_per_us / TICKS_PER_US
    return RowWindows(
        low=np.where(gap, end, start) * scale,
        high=np.where(gap, start, end) * scale,
        inside=np.where(gap, whole, whole + 1).astype(np.int32),
        outside=np.where(gap, whole + 1, whole).astype(np.int32),
    )


def _ticks(time_us: ArrayLike) -> NDArray[np.int64]:
    return np.rint(np.asarray(time_us, np.float64) * TICKS_PER_US).astype(np.int64)


def weights(windows: RowWindows, projector_rows: ArrayLike) -> NDArray[np.int32]:
    """How often light of these projector rows, (N_c,) or (N_c, W), is recorded by each camera row; same shape.

    Negative rows stand for points that the projector does not light and weigh nothing.
    """
    rows = np.asarray(projector_rows)
    column = (slice(None),) + (None,) * (rows.ndim - 1)
    hit = (rows >= windows.low[column]) & (rows < windows.high[column])
    counts = np.where(hit, windows.inside[column], windows.outside[column])
    return np.where(rows < 0, 0, counts).astype(np.int32)


def discrete_weights(rig: Rig, settings: GateSettings, camera_rows: ArrayLike, projector_rows: ArrayLike) -> Floats:
    """Weight of whole projector rows j, all of whose points are lit during [j, j + 1) / v_p (broadcast, float64).

    The *discrete rows* level of detail: the overlap with the window of camera row k (a whole number) in row times,
    a trapezoid in j. It differs from `weights` by at most one row at each edge.
    """
    speed, period = rig.projector.rows_per_us, rig.projector.period_us
    centre = settings.delay_us + (np.asarray(camera_rows, np.float64) + 0.5) * settings.line_time_us
    lit_from = np.asarray(projector_rows, np.float64) / speed

    def lit_until(time_us: Floats) -> Floats:
        phase = (time_us - lit_from) / period
        whole = np.floor(phase)
        return whole + np.minimum((phase - whole) * period * speed, 1.0)

    return lit_until(centre + settings.exposure_us / 2) - lit_until(centre - settings.exposure_us / 2)


def complement(settings: GateSettings, period_us: float) -> GateSettings:
    """The gate that records what this one does not: together every point counts ceil(exposure / T) times.

    Raises ValueError when the exposure is a whole number of periods, since nothing is left to record.
    """
    periods = int(np.ceil(settings.exposure_us / period_us))
    rest = periods * period_us - settings.exposure_us
    require(
        rest > 0,
        "exposure_us",
        settings.exposure_us,
        f"other than a whole number of projector periods ({period_us:g} us) for a complement to exist",
    )
    delay = settings.delay_us + periods * period_us / 2
    if delay > period_us:
        delay -= period_us
    return GateSettings(settings.line_time_us, CentreDelayUs(delay), rest)


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
