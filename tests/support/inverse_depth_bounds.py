"""Bounds on inverse depth, the gate in its other form (model section 3): what tests hold the row windows against.

The program itself compares projector rows, which needs no depth; these bounds come to the same by way of the geometry.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.axis import us_per_row
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.triangulate import meeting_slope, quotient, to_projector_axes


def inverse_depth_bounds(rig: Rig, settings: GateSettings, frame: int = 0) -> tuple[Doubles, Doubles]:
    """Bounds on inverse depth (1/z from the camera, 1/m) of what projector frame `frame` adds to the gate.

    A pixel whose surface has low <= w < high records it. Shapes (N_c, 1) for the ideal rig, whose bounds are those of
    the row, else (N_c, W) for rays through the pixels' centres. Bounds are clipped to w >= 0 and to the rows that the
    projector has; where nothing is left both are 0. The projector's columns are not looked at.

    Ideal rig: 3e-16 relative plus 1e-25 of what row and edge each contribute to w, so relative to themselves at
    infinity too. Others without distortion: the projector row on a camera ray is a ratio of two affine functions of w,
    so an edge is one linear inequality; its w is exact for an edge moved by at most 8 roundings of the rows' times
    (1e-11 rows of the check rig's projector). Through a distorted projector lens an edge is met as `meeting_slope`
    says; a ray that does not meet one has empty bounds.
    """
    if rig.is_ideal:
        return _ideal_bounds(rig, settings, frame)
    lens = rig.camera.lens
    rows = np.arange(lens.height)[:, None] + 0.5
    rays = rig.camera_rays(np.arange(lens.width)[None, :] + 0.5, rows)
    centre = settings.delay_us + rows * settings.line_time_us + frame * -rig.projector.period_us
    speed, last = rig.projector.rows_per_us, float(rig.projector.lens.height)
    edges = [np.clip(speed * (centre + sign * settings.exposure_us / 2), 0.0, last) for sign in (-1, 1)]
    at_infinity, change = to_projector_axes(rig, rays)
    low, high = np.zeros(rays.shape[:2]), np.full(rays.shape[:2], np.inf)
    _cut(low, high, at_infinity[..., 2], np.full(low.shape, change[2]))
    empty = np.broadcast_to(edges[0] >= edges[1], low.shape)
    for edge, sign in zip(edges, (1.0, -1.0), strict=True):
        slope, met = meeting_slope(rig, at_infinity, change, np.broadcast_to(edge, low.shape))
        empty = empty | ~met
        _cut(
            low,
            high,
            sign * (at_infinity[..., 1] - slope * at_infinity[..., 2]),
            sign * (change[1] - slope * change[2]),
        )
    empty = empty | ~(low < high)
    low[empty] = 0.0
    high[empty] = 0.0
    return low, high


def _ideal_bounds(rig: Rig, settings: GateSettings, frame: int) -> tuple[Doubles, Doubles]:
    """w = (kappa_p - kappa_c) / b, affine in the camera row, for the window's edges and for the raster's."""
    lens_c, lens_p = rig.camera.lens, rig.projector.lens
    f_c, f_p, b = Fraction(lens_c.fy), Fraction(lens_p.fy), Fraction(rig.baseline_m)
    row_us, half = us_per_row(rig.projector), Fraction(settings.exposure_us) / 2
    centre = Fraction(settings.delay_us) - frame * Fraction(rig.projector.period_us)
    at_row_0 = Fraction(lens_c.cy) / f_c - Fraction(lens_p.cy) / f_p
    per_row = Fraction(settings.line_time_us) / row_us / f_p
    first, last = (
        _affine((row / f_p + at_row_0) / b, -1 / f_c / b, lens_c.height) for row in (Fraction(0), lens_p.height)
    )
    start, end = (
        _affine(((centre + sign * half) / row_us / f_p + at_row_0) / b, (per_row - 1 / f_c) / b, lens_c.height)
        for sign in (-1, 1)
    )
    low, high = np.maximum(np.maximum(start, first), 0.0), np.minimum(end, last)
    empty = ~(low < high)
    return np.where(empty, 0.0, low)[:, None], np.where(empty, 0.0, high)[:, None]


def _affine(at_row_0: Fraction, per_row: Fraction, height: int) -> Doubles:
    """at_row_0 + (k + 1/2) per_row for rows k, (height,), to two roundings however much the two cancel.

    Both are split. The leading 35 bits of per_row times a row of up to 2^17 are exact, and where they cancel at_row_0
    their sum is, too; then it is added to what both leave behind.
    """
    rows = np.arange(height) + 0.5
    mantissa, exponent = math.frexp(float(per_row))
    lead = math.ldexp(round(math.ldexp(mantissa, 35)), exponent - 35)
    start = float(at_row_0)
    left = float(at_row_0 - Fraction(start)) + rows * float(per_row - Fraction(lead))
    return np.asarray((start + rows * lead) + left, np.float64)


def _cut(low: Doubles, high: Doubles, constant: Doubles, slope: Doubles) -> None:
    """Narrow [low, high] in place to where constant - w slope >= 0."""
    root = quotient(constant, slope)
    np.minimum(high, np.where(slope > 0, root, np.inf), out=high)
    np.maximum(low, np.where(slope < 0, root, 0.0), out=low)
    high[(slope == 0) & (constant < 0)] = 0.0
