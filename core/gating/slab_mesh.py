"""The solid that a gate records, as corner points and triangles for drawing.

For one projector pass m the rows lit while a camera row is exposed lie between two times, so each camera ray carries
one interval of inverse depth w = 1/z (z from the camera centre). On an ideal rig w is affine in the camera row for
each edge (the edge is a plane), so a few rows with every kink among them give the exact solid; other rigs are sampled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slopegate.core.gating.gate import rows_at_phase
from slopegate.core.rig.arrays import Bools, Doubles, Ints
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.triangulate import inverse_depth, quotient

MAX_PASSES = 64
_GENERAL_ROWS = 17
_GENERAL_COLUMNS = 9
_SAME_W = 1e-9


@dataclass(frozen=True, eq=False)
class Piece:
    """The slab of one projector pass: world points `far` and `near` (R, C, 3) float64, along the same camera rays."""

    far: Doubles
    near: Doubles


def window_rows(rig: Rig, settings: GateSettings, rows: ArrayLike, pass_index: int) -> tuple[Doubles, Doubles]:
    """Projector rows, not yet limited to the raster, that pass m lights at the start and end of each row's exposure.

    The law of `gate.row_windows`, not yet modulo the period.

    To 1e-15 of the times that are added up, in rows.
    """
    at = np.asarray(rows, np.float64)
    edges = np.array([settings.start_us, settings.end_us]) - pass_index * rig.projector.period_us
    low, high = (rows_at_phase(rig, settings.line_time_us, at, edge) for edge in edges)
    return low, high


def passes(rig: Rig, settings: GateSettings) -> range:
    """Projector passes m whose light can fall into the exposure of some camera row; at most `MAX_PASSES` of them."""
    projector = rig.projector
    lit_us = projector.lens.height / projector.rows_per_us
    end = settings.end_us + rig.camera.lens.height * settings.line_time_us
    first = math.ceil((settings.start_us - lit_us) / projector.period_us)
    return range(first, min(math.floor(end / projector.period_us), first + MAX_PASSES - 1) + 1)


def slab_pieces(
    rig: Rig, settings: GateSettings, z_min_m: float, z_max_m: float, column: float | None = None
) -> tuple[Piece, ...]:
    """The space that the gate records, between two depths from the camera and inside both fields of view.

    One piece for each projector pass that reaches in; an exposure of a whole period or more records every lit row and
    gives the whole common space as one piece. With `column` only the cut along that camera column (C = 1).
    Raises ValueError unless 0 < z_min_m < z_max_m.
    """
    if not 0 < z_min_m < z_max_m < math.inf:
        raise ValueError(f"z_max_m is {z_max_m}, z_min_m {z_min_m}: they must be finite, rising and above 0")
    everything = settings.exposure_us >= rig.projector.period_us
    cut = Cut(rig, settings, 1 / z_max_m, 1 / z_min_m, column)
    piece_of = ideal_piece if rig.is_ideal else general_piece
    found = (piece_of(cut, None if everything else m) for m in (range(1) if everything else passes(rig, settings)))
    return tuple(piece for piece in found if piece is not None)


@dataclass(frozen=True)
class Cut:
    """A gate, the inverse depths (1/m, from the camera) between which it is wanted, and a camera column or all."""

    rig: Rig
    settings: GateSettings
    w_min: float
    w_max: float
    column: float | None


def ideal_piece(cut: Cut, pass_index: int | None) -> Piece | None:
    """The exact solid of an ideal rig (None for `pass_index`: every lit row).

    Over the camera row every bound on w is affine, so the solid is a convex polygon in (row, w), whose corners lie on
    rows where two bounds meet, times a fixed range of columns.
    """
    camera, projector = cut.rig.camera.lens, cut.rig.projector
    slope, offset = _edge_lines(cut, pass_index)
    highest = float(camera.height)
    # Between two neighbouring crossings the tightest bounds stay the same pair of lines: those rows are all corners.
    with_row = slope[:, None] - slope[None, :]
    meet = quotient(offset[None, :] - offset[:, None], with_row)
    rows = np.unique(np.clip(np.append(meet, highest), 0.0, highest))
    bounds = slope * rows[:, None] + offset
    low, high = bounds[:, :3].max(axis=1), bounds[:, 3:].min(axis=1)
    kept = low <= high + _SAME_W
    if kept.sum() < 2 or not np.any(high - low > _SAME_W):
        return None
    rows, low, high = rows[kept], low[kept], np.maximum(low, high)[kept]
    if cut.column is None:
        limits = (np.array([0.0, projector.lens.width]) - projector.lens.cx) / projector.lens.fx
        columns = np.clip(limits * camera.fx + camera.cx, 0.0, camera.width)
    else:
        columns = np.array([cut.column])
    if columns.size > 1 and columns[0] >= columns[-1]:
        return None
    w = np.stack([low, high])[..., None]
    far, near = cut.rig.camera_centre_m + cut.rig.camera_rays(columns, rows[:, None]) / w[..., None]
    return Piece(far, near)


def _edge_lines(cut: Cut, pass_index: int | None) -> tuple[Doubles, Doubles]:
    """Bounds on w as slope and offset over the camera row, (6,) each: three from below, then three from above."""
    camera, projector, height = cut.rig.camera.lens, cut.rig.projector.lens, float(cut.rig.projector.lens.height)
    starts, ends = [0.0, 0.0], [height, height]
    per_row = 0.0
    if pass_index is not None:
        per_row = cut.rig.projector.rows_per_us * cut.settings.line_time_us
        low, high = window_rows(cut.rig, cut.settings, 0.0, pass_index)
        starts, ends = [0.0, float(low)], [height, float(high)]
    rows_at_0 = np.array(starts + ends)
    slopes = np.array([0.0, per_row, 0.0, per_row]) / projector.fy - 1 / camera.fy
    offsets = (rows_at_0 - projector.cy) / projector.fy + camera.cy / camera.fy
    slopes, offsets = slopes / cut.rig.baseline_m, offsets / cut.rig.baseline_m
    return (
        np.concatenate([slopes[:2], [0.0], slopes[2:], [0.0]]),
        np.concatenate([offsets[:2], [cut.w_min], offsets[2:], [cut.w_max]]),
    )


def general_piece(cut: Cut, pass_index: int | None) -> Piece | None:
    """The solid of any rig on a grid of camera rows and columns (None for `pass_index`: every lit row)."""
    rig, width = cut.rig, float(cut.rig.camera.lens.width)
    middle = np.array([rig.camera.lens.cx if cut.column is None else cut.column])
    rows = _sampled_rows(cut, pass_index, middle)
    if rows.size < 2:
        return None
    edges = _edge_rows(cut, pass_index, rows)[..., None]
    rays = rig.camera_rays(middle, rows[:, None])
    w = _inside(cut, rays, edges)
    # Rows at which the piece ends have an interval of no length; rounding must not lose them.
    kept = (w[0] <= w[1] + _SAME_W)[:, 0]
    if kept.sum() < 2:
        return None
    rows, edges, rays, w = rows[kept, None], edges[:, kept], rays[kept], w[:, kept]
    if cut.column is None:
        columns = np.linspace(0, width, _GENERAL_COLUMNS)
        rays = rig.camera_rays(columns, rows)
        w = _inside(cut, rays, edges)
        lit = rig.to_projector(rig.camera_centre_m + rays / _closed(cut, w)[..., None])[0]
        # Sampled again between the columns at which the projector's raster ends, so that corners lie on them.
        left, right = _limits(columns, lit, float(rig.projector.lens.width))
        if np.any((left != 0) | (right != width)):
            share = np.linspace(0, 1, _GENERAL_COLUMNS)
            rays = rig.camera_rays(left[..., None] + (right - left)[..., None] * share, rows)
            w = _inside(cut, rays, edges)
    far, near = rig.camera_centre_m + rays / _closed(cut, w)[..., None]
    finite = np.isfinite(far).all(axis=(1, 2)) & np.isfinite(near).all(axis=(1, 2))
    return Piece(far[finite], near[finite]) if finite.sum() >= 2 else None


def _edge_rows(cut: Cut, pass_index: int | None, rows: Doubles) -> Doubles:
    """Projector rows (2, R) at both edges of the window of each camera row, limited to the raster."""
    height = float(cut.rig.projector.lens.height)
    if pass_index is None:
        return np.stack([np.zeros_like(rows), np.full_like(rows, height)])
    return np.clip(np.stack(window_rows(cut.rig, cut.settings, rows, pass_index)), 0.0, height)


def _inside(cut: Cut, rays: Doubles, edges: Doubles) -> Doubles:
    """Inverse depths (2, R, C) of both edges, the smaller first, limited to the cut; the first larger: nothing left."""
    (a, b), _ = inverse_depth(cut.rig, rays, edges)
    return np.stack([np.maximum(np.fmin(a, b), cut.w_min), np.minimum(np.fmax(a, b), cut.w_max)])


def _closed(cut: Cut, w: Doubles) -> Doubles:
    """The same intervals with empty ones closed to a single depth inside the cut, so that they can be drawn."""
    return np.where(w[0] <= w[1], w, np.clip(w.mean(axis=0), cut.w_min, cut.w_max))


def _sampled_rows(cut: Cut, pass_index: int | None, column: Doubles) -> Doubles:
    """Camera rows (sorted) with every kink of the piece at one column: its ends, the raster's edges, the depths."""
    rig, settings = cut.rig, cut.settings
    first, last = 0.0, float(rig.camera.lens.height)
    kinks: list[float] = []
    if pass_index is not None:
        lit = rig.projector.lens.height / rig.projector.rows_per_us / settings.line_time_us
        at_zero = (pass_index * rig.projector.period_us - settings.delay_us) / settings.line_time_us
        half = settings.exposure_us / 2 / settings.line_time_us
        first, last = max(first, at_zero - half), min(last, at_zero + lit + half)
        kinks = [at_zero + half, at_zero + lit - half]
    if not first < last:
        return np.empty(0)
    count = max(3, round(_GENERAL_ROWS * (last - first) / rig.camera.lens.height))
    rows = np.unique(np.clip(np.append(kinks, np.linspace(first, last, count)), first, last))
    w, _ = inverse_depth(rig, rig.camera_rays(column, rows), _edge_rows(cut, pass_index, rows))
    found = [_crossings(rows, edge - depth) for edge in w for depth in (cut.w_min, cut.w_max)]
    return np.unique(np.concatenate([rows, *found]))


def _crossings(at: Doubles, values: Doubles) -> Doubles:
    """Where piecewise linear values pass through zero."""
    v0, v1 = values[:-1], values[1:]
    crossed = v0 * v1 < 0
    share = v0[crossed] / (v0[crossed] - v1[crossed])
    return at[:-1][crossed] + share * np.diff(at)[crossed]


def _limits(columns: Doubles, lit: Doubles, width: float) -> tuple[Doubles, Doubles]:
    """First and last camera column (...) whose projector column `lit` (..., C) is in [0, width]; NaN where none is.

    Projector columns are taken to be monotone over camera columns, and linear between samples.
    """
    if np.nansum(lit[..., -1] - lit[..., 0]) < 0:
        lit = width - lit
    left, right = (_reach(columns, lit, target) for target in (0.0, width))
    return np.where(lit[..., -1] >= 0, left, np.nan), np.where(lit[..., 0] <= width, right, np.nan)


def _reach(columns: Doubles, lit: Doubles, target: float) -> Doubles:
    """Column at which rising values pass a target, kept to the columns there are."""
    after = np.clip((lit < target).sum(axis=-1), 1, columns.size - 1)[..., None]
    v0, v1 = (np.take_along_axis(lit, index, axis=-1)[..., 0] for index in (after - 1, after))
    c0, c1 = columns[after - 1][..., 0], columns[after][..., 0]
    share = quotient(target - v0, v1 - v0, np.nan)
    return np.asarray(c0 + np.clip(share, 0.0, 1.0) * (c1 - c0), np.float64)


def piece_triangles(piece: Piece) -> Ints:
    """Triangles (F, 3) of the closed surface, vertices far then near, row by row; none where it has no thickness."""
    rows, columns = piece.far.shape[:2]
    far = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    near = far + rows * columns
    walls = [np.stack([far[end], near[end]]) for end in (0, -1)]
    walls += [np.stack([far[:, end], near[:, end]]) for end in (0, -1)]
    thick = np.tile((piece.far != piece.near).any(axis=-1).ravel(), 2)
    return np.concatenate([_grid_triangles(grid, thick) for grid in (far, near, *walls)])


def _grid_triangles(grid: Ints, thick: Bools) -> Ints:
    """Two triangles (F, 3) for every cell of a grid of vertices (R, C) that has a corner where the slab is thick."""
    a, b, c, d = grid[:-1, :-1].ravel(), grid[:-1, 1:].ravel(), grid[1:, :-1].ravel(), grid[1:, 1:].ravel()
    kept = thick[np.stack([a, b, c, d])].any(axis=0)
    halves = [np.stack([a, b, c], axis=-1)[kept], np.stack([b, d, c], axis=-1)[kept]]
    return np.concatenate(halves)
