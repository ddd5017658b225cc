"""Corner points of what a gate lets through, for drawing: the slab, and the two fields of view that bound it.

For one projector pass m the rows lit while a camera row is exposed lie between two times, so each camera ray carries
one interval of inverse depth w = 1/z (z from the camera centre). On an ideal rig w is affine in the camera row for
each edge (the edge is a plane), so a few rows with every kink among them give the exact solid; other rigs are sampled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from slopegate.core.checks import require
from slopegate.core.rig import Floats, Lens, Rig
from slopegate.core.settings import GateSettings

MAX_PASSES = 64
_GENERAL_ROWS = 17
_GENERAL_COLUMNS = 9
_NEWTON_STEPS = 8
_ROW_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Piece:
    """The slab of one projector pass: `far` and `near` (R, C, 3) float64 world points on the same camera rows."""

    far: Floats
    near: Floats


def inverse_depth(rig: Rig, columns: ArrayLike, rows: ArrayLike, projector_rows: ArrayLike) -> Floats:
    """1/z in 1/m where the camera ray through (column, row) meets the light of a continuous projector row.

    Arguments broadcast; the result is 0 at infinity, negative behind the rig and NaN where the ray never crosses the
    row. Closed form for a pinhole projector (model section 3), Newton steps from it for a distorted one.
    """
    lens = rig.projector.lens
    rays = rig.camera_rays(columns, rows) @ rig.rotation.T
    shift = rig.rotation @ (rig.camera_centre_m - rig.projector_centre_m)
    wanted, _ = np.broadcast_arrays(np.asarray(projector_rows, np.float64), rays[..., 0])
    kappa = (wanted - lens.cy) / lens.fy
    w = _solve(rays, shift, kappa)
    if not lens.distorted:
        return w
    for _ in range(_NEWTON_STEPS):
        depth = rays[..., 2] + w * shift[2]
        x = _divide(rays[..., 0] + w * shift[0], depth)
        # lens.project wants numbers; what is NaN here stays NaN in `kappa`.
        error = wanted - lens.project(np.nan_to_num(x), np.nan_to_num(kappa))[1]
        kappa = kappa + error / lens.fy
        w = _solve(rays, shift, kappa)
        if not np.any(np.abs(error) > _ROW_TOLERANCE):
            break
    return w


def _solve(rays: Floats, shift: Floats, kappa: Floats) -> Floats:
    return _divide(kappa * rays[..., 2] - rays[..., 1], np.asarray(shift[1] - kappa * shift[2], np.float64))


def _divide(numerator: Floats, denominator: Floats) -> Floats:
    out = np.full(np.broadcast_shapes(numerator.shape, denominator.shape), np.nan)
    return np.divide(numerator, denominator, out=out, where=denominator != 0)


def window_rows(rig: Rig, settings: GateSettings, rows: ArrayLike, pass_index: int) -> tuple[Floats, Floats]:
    """Projector rows, not yet limited to the raster, that pass m lights at the start and end of each row's exposure."""
    projector = rig.projector
    centre = settings.delay_us + np.asarray(rows, np.float64) * settings.line_time_us
    centre = centre - pass_index * projector.period_us
    half = settings.exposure_us / 2
    return projector.rows_per_us * (centre - half), projector.rows_per_us * (centre + half)


def passes(rig: Rig, settings: GateSettings) -> range:
    """Projector passes m whose light can fall into the exposure of some camera row; at most `MAX_PASSES` of them."""
    projector = rig.projector
    lit_us = projector.lens.height / projector.rows_per_us
    start = settings.delay_us - settings.exposure_us / 2
    end = settings.delay_us + settings.exposure_us / 2 + rig.camera.lens.height * settings.line_time_us
    first = math.ceil((start - lit_us) / projector.period_us)
    return range(first, min(math.floor(end / projector.period_us), first + MAX_PASSES - 1) + 1)


def slab_pieces(
    rig: Rig, settings: GateSettings, z_min_m: float, z_max_m: float, column: float | None = None
) -> tuple[Piece, ...]:
    """The space that the gate records, between two depths from the camera and inside both fields of view.

    One piece for each projector pass that reaches in; an exposure of a whole period or more records every lit row and
    gives the whole common space as one piece. With `column` only the cut along that camera column (C = 1).
    Raises ValueError unless 0 < z_min_m < z_max_m.
    """
    require(0 < z_min_m < z_max_m < math.inf, "z_max_m", z_max_m, f"finite and above z_min_m ({z_min_m:g}), itself > 0")
    depths = (1 / z_max_m, 1 / z_min_m)
    everything = settings.exposure_us >= rig.projector.period_us
    found = (
        _piece(rig, settings, None if everything else m, depths, column)
        for m in (range(1) if everything else passes(rig, settings))
    )
    return tuple(piece for piece in found if piece is not None)


def _edges(rig: Rig, settings: GateSettings, m: int | None, rows: Floats) -> tuple[Floats, Floats]:
    height = rig.projector.lens.height
    if m is None:
        return np.zeros_like(rows), np.full_like(rows, height)
    low, high = window_rows(rig, settings, rows, m)
    return np.clip(low, 0, height), np.clip(high, 0, height)


def _interval(
    rig: Rig, columns: Floats, rows: Floats, edges: tuple[Floats, Floats], depths: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Inverse depths of both edges, sorted and limited to `depths`; low > high where nothing is left."""
    a, b = (inverse_depth(rig, columns, rows, edge) for edge in edges)
    low, high = np.fmin(a, b), np.fmax(a, b)
    return np.maximum(low, depths[0]), np.minimum(high, depths[1])


def _piece(
    rig: Rig, settings: GateSettings, m: int | None, depths: tuple[float, float], column: float | None
) -> Piece | None:
    middle = np.array([rig.camera.lens.cx if column is None else column])
    rows = _rows(rig, settings, m, depths, middle)
    if rows.size < 2:
        return None
    edges = _edges(rig, settings, m, rows[:, None])
    low, high = _interval(rig, middle, rows[:, None], edges, depths)
    # Rows at which the piece ends have an interval of no length; rounding must not lose them.
    kept = (low <= high * (1 + 1e-9))[:, 0]
    if kept.sum() < 2:
        return None
    rows, edges = rows[kept, None], (edges[0][kept], edges[1][kept])
    if column is not None:
        low, high = low[kept], np.maximum(high, low)[kept]
        return Piece(_points(rig, middle, rows, low), _points(rig, middle, rows, high))
    far, near = (_surface(rig, rows, edges, depths, side) for side in (0, 1))
    piece = Piece(far, near)
    return piece if np.isfinite(far).all() and np.isfinite(near).all() else None


def _rows(rig: Rig, settings: GateSettings, m: int | None, depths: tuple[float, float], column: Floats) -> Floats:
    """Camera rows (sorted) that carry every kink of the piece: its ends, the raster's edges, the depth limits."""
    height = rig.camera.lens.height
    first, last = 0.0, float(height)
    kinks: list[float] = []
    if m is not None:
        lit_us = rig.projector.lens.height / rig.projector.rows_per_us
        at_zero = (m * rig.projector.period_us - settings.delay_us) / settings.line_time_us
        half, lit = settings.exposure_us / 2 / settings.line_time_us, lit_us / settings.line_time_us
        first, last = max(first, at_zero - half), min(last, at_zero + lit + half)
        kinks = [at_zero + half, at_zero + lit - half]
    if not first < last:
        return np.empty(0)
    corners = np.clip(np.array([first, *kinks, last]), first, last)
    fill = np.linspace(first, last, 2 if rig.is_ideal else _GENERAL_ROWS)
    rows = np.unique(np.concatenate([corners, fill]))
    edges = _edges(rig, settings, m, rows)
    columns = np.broadcast_to(column, rows.shape)
    crossings = [
        _crossings(rows, inverse_depth(rig, columns, rows, edge) - depth) for edge in edges for depth in depths
    ]
    return np.unique(np.concatenate([rows, *crossings]))


def _crossings(at: Floats, values: Floats) -> Floats:
    """Where piecewise linear values pass through zero."""
    v0, v1 = values[:-1], values[1:]
    crossed = v0 * v1 < 0
    share = v0[crossed] / (v0[crossed] - v1[crossed])
    return at[:-1][crossed] + share * np.diff(at)[crossed]


def _surface(rig: Rig, rows: Floats, edges: tuple[Floats, Floats], depths: tuple[float, float], side: int) -> Floats:
    """One side of the piece, (R, C, 3), between the columns that the projector reaches too."""
    width = float(rig.camera.lens.width)
    count = 2 if rig.is_ideal else _GENERAL_COLUMNS
    columns = np.broadcast_to(np.linspace(0, width, count), (rows.shape[0], count))
    for _ in range(1 if rig.is_ideal else 2):
        w = _side(rig, columns, rows, edges, depths, side)
        lit = rig.to_projector(_points(rig, columns, rows, w))[0]
        left, right = _limits(columns, lit, float(rig.projector.lens.width))
        columns = left[:, None] + (right - left)[:, None] * np.linspace(0, 1, count)
    return _points(rig, columns, rows, _side(rig, columns, rows, edges, depths, side))


def _side(
    rig: Rig, columns: Floats, rows: Floats, edges: tuple[Floats, Floats], depths: tuple[float, float], side: int
) -> Floats:
    low, high = _interval(rig, columns, rows, edges, depths)
    return np.minimum(low, depths[1]) if side == 0 else np.maximum(high, low)


def _limits(columns: Floats, lit: Floats, width: float) -> tuple[Floats, Floats]:
    """First and last camera column (R,) whose projector column lies in [0, width]; linear in between; may be NaN."""
    left = np.empty(columns.shape[0])
    right = np.empty(columns.shape[0])
    for k, (c, u) in enumerate(zip(columns, lit, strict=True)):
        inside = (u >= 0) & (u <= width)
        ends = np.concatenate([c[inside], _crossings(c, u), _crossings(c, u - width)])
        left[k], right[k] = (ends.min(), ends.max()) if ends.size else (np.nan, np.nan)
    return left, right


def _points(rig: Rig, columns: Floats, rows: Floats, w: Floats) -> Floats:
    return rig.camera_centre_m + rig.camera_rays(columns, rows) / w[..., None]


def piece_triangles(rows: int, columns: int) -> NDArray[np.int32]:
    """Triangles (F, 3) that close a piece of R x C points a side, vertices being far then near, row by row."""
    far = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    near = far + rows * columns
    walls = [
        np.stack([far[0], near[0]]),
        np.stack([far[-1], near[-1]]),
        np.stack([far[:, 0], near[:, 0]]),
        np.stack([far[:, -1], near[:, -1]]),
    ]
    return np.concatenate([_grid_triangles(grid) for grid in (far, near, *walls)])


def _grid_triangles(grid: NDArray[np.int32]) -> NDArray[np.int32]:
    a, b, c, d = grid[:-1, :-1].ravel(), grid[:-1, 1:].ravel(), grid[1:, :-1].ravel(), grid[1:, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([b, d, c], axis=-1)])


def camera_view(rig: Rig, depth_m: float) -> Floats:
    """The camera's centre and the corners of its field of view at a depth, clockwise from top left, (5, 3) metres."""
    return _view(rig.camera.lens, rig.camera_centre_m, np.eye(3), depth_m)


def projector_view(rig: Rig, depth_m: float) -> Floats:
    """The projector's centre and the corners of its field of view at a depth along its own axis, (5, 3) metres."""
    return _view(rig.projector.lens, rig.projector_centre_m, rig.rotation, depth_m)


def _view(lens: Lens, centre: Floats, rotation: Floats, depth_m: float) -> Floats:
    x, y = lens.normalise([0, lens.width, lens.width, 0], [0, 0, lens.height, lens.height])
    corners = np.stack([x, y, np.ones_like(x)], axis=-1) * depth_m
    return np.concatenate([centre[None], centre + corners @ rotation])
