"""What a gate can light at all, known before any frame is taken: which camera rows.

For undistorted lenses the projector row that lights a point is a ratio of two functions that are linear in the camera
ray's x and y and in the inverse depth, so over a row of pixels and a range of depth it is greatest and least at corners
(eight of them; for the ideal rig r_p = c_p + f_p (kappa_c + b w)).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from slopegate.core.gating.gate import RowWindows
from slopegate.core.render.tracing import field_of
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Lens, Rig

ROUNDING_ROWS = 1e-3
"""Reaches are widened by this, many times what float32 does to a projector row."""

_PLACES = 65


class Reach(NamedTuple):
    """Per camera row (H,), float64: least and greatest projector row that lights anything there; inf, -inf for none."""

    low: Doubles
    high: Doubles


def whole_reach(rig: Rig) -> Reach:
    """Every row of the projector in every row of the camera: nothing is known of the scene."""
    height = rig.camera.lens.height
    return Reach(np.zeros(height), np.full(height, float(rig.projector.lens.height)))


def row_reach(rig: Rig, near_m: float, far_m: float) -> Reach:
    """The reach of surfaces anywhere from near_m to far_m (may be infinite) along z from the origin.

    Wide enough for every ray through the rows' pixels. Undistorted lenses: exact for the whole rows, but for the
    projector's columns, at which nobody looks. Raises InputError unless 0 < near_m <= far_m, beyond the camera.
    """
    behind = float(rig.camera_centre_m[2])
    require(math.isfinite(near_m) and near_m > max(behind, 0.0), "near_m", near_m, "a finite number above 0")
    require(far_m >= near_m, "far_m", far_m, f"at least near_m ({near_m:g})")
    left, right, top, bottom = _row_boxes(rig.camera.lens)
    offset = np.array(rig.projector_offset_m)
    corners = np.array(
        [
            [np.stack([x, y, np.ones_like(x)], axis=-1) - w * offset for x in (left, right) for y in (top, bottom)]
            for w in (1 / (near_m - behind), 1 / (far_m - behind))
        ]
    )
    local = corners.reshape(8, -1, 3) @ rig.rotation.T
    ahead = (local[..., 2] > 1e-9).all(axis=0)
    x, y = (local[..., axis] / np.where(ahead, local[..., 2], 1.0) for axis in (0, 1))
    reach = _projector_rows(rig.projector.lens, x, y)
    last = float(rig.projector.lens.height)
    low = np.where(ahead, np.maximum(reach.low - ROUNDING_ROWS, 0.0), 0.0)
    high = np.where(ahead, np.minimum(reach.high + ROUNDING_ROWS, last), last)
    nothing = low > high
    return Reach(np.where(nothing, np.inf, low), np.where(nothing, -np.inf, high))


def _row_boxes(lens: Lens) -> tuple[Doubles, Doubles, Doubles, Doubles]:
    """Least and greatest x/z, then y/z, (H,), of the rays through each row's pixels."""
    columns, rows = np.linspace(0, lens.width, _PLACES), np.arange(lens.height + 1.0)
    x, y = lens.normalise(*np.broadcast_arrays(columns, rows[:, None]))
    edges = []
    for values in (x, y):
        margin = _between_places(values)
        low, high = values.min(axis=1) - margin, values.max(axis=1) + margin
        edges += [np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])]
    return edges[0], edges[1], edges[2], edges[3]


def _projector_rows(lens: Lens, x: Doubles, y: Doubles) -> Reach:
    """Least and greatest row that lights boxes of x/z and y/z spanned by (n, H) corners."""
    if not lens.distorted:
        rows = y * lens.fy + lens.cy
        return Reach(rows.min(axis=0), rows.max(axis=0))
    # Nothing outside the field is ever lit, and a distorted lens means nothing there.
    low, high = field_of(lens)
    (left, right), (top, bottom) = (
        (np.maximum(values.min(axis=0), low[axis]), np.minimum(values.max(axis=0), high[axis]))
        for axis, values in enumerate((x, y))
    )
    share = np.linspace(0, 1, _PLACES)[None, :]
    across = left[:, None] + share * (right - left)[:, None]
    ends = [lens.project(across, np.broadcast_to(edge[:, None], across.shape))[1] for edge in (top, bottom)]
    margin = max(_between_places(rows) for rows in ends)
    inside = (left <= right) & (top <= bottom)
    least = np.where(inside, np.minimum(*ends).min(axis=1) - margin, np.inf)
    return Reach(least, np.where(inside, np.maximum(*ends).max(axis=1) + margin, -np.inf))


def _between_places(values: Doubles) -> float:
    """How far a smooth function may stray from what it is at places along the last axis: 0 where it is straight."""
    bend = np.abs(values[:, 2:] - 2 * values[:, 1:-1] + values[:, :-2]).max()
    return float(bend) if bend > 1e-12 else 0.0


def seen_reach(projector_row: Singles) -> Reach:
    """The reach of what is really there, from `render.Buffers.projector_row` (H, W), where negative is unlit."""
    lit = projector_row >= 0
    low = projector_row.min(axis=1, where=lit, initial=np.inf).astype(np.float64)
    return Reach(low, projector_row.max(axis=1, where=lit, initial=-np.inf).astype(np.float64))


def lit_rows(windows: RowWindows, reach: Reach) -> tuple[int, int]:
    """First camera row that the gate can light, and one past the last; (0, 0) where it can light none."""
    some = reach.low <= reach.high
    meets = some & (reach.high >= windows.low) & (reach.low < windows.high)
    leaves = some & ((reach.low < windows.low) | (reach.high >= windows.high))
    rows = np.flatnonzero(meets & (windows.inside > 0) | leaves & (windows.outside > 0))
    return (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 0)
