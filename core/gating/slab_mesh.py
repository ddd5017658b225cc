"""The solid that a gate records, as corner points and triangles for drawing.

For one projector pass m the rows lit while a camera row is exposed lie between two times, so each camera ray carries
one interval of inverse depth w = 1/z (z from the camera centre). On an ideal rig w is affine in the camera row for
each edge (the edge is a plane), so a few rows with every kink among them give the exact solid. Lenses that distort and
projectors that are turned bend the edges: there each is sampled along the camera's rays, as finely as it needs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from slopegate.core.gating.gate import rows_at_phase, slab
from slopegate.core.rig.arrays import Bools, Doubles, Ints
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.triangulate import inverse_depth, quotient

MAX_PASSES = 64
_GENERAL_ROWS = 17
_GENERAL_COLUMNS = 9
_FINER = 2
"""So many times finer through distorted lenses."""
_CROSSING_STEPS = 2
_SAME_W = 1e-9
_HAIR_US = 1e-3
"""Exposure of the gate whose slab is the middle of another's."""


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


def bend_m(rig: Rig, settings: GateSettings, z_min_m: float, z_max_m: float) -> float | None:
    """How far the middle of a slab leaves its plane straight ahead, at most, where it is seen between two depths from
    the camera; metres at right angles to the plane. 0 for an ideal rig, None where nothing of it is seen.
    """
    if rig.is_ideal:
        return 0.0
    found = slab(rig, settings)
    middle = replace(settings, exposure_us=_HAIR_US)
    piece = general_piece(Cut(rig, middle, 1 / z_max_m, 1 / z_min_m, None), found.frame)
    if piece is None or not math.isfinite(found.centre.offset_m):
        return None
    return float(np.abs(piece.far @ np.array(found.centre.normal) - found.centre.offset_m).max())


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
    """The solid of any rig (None for `pass_index`: every lit row), bent as its lenses and its turns bend it.

    Every corner lies on the gate's own law along its camera ray, or on one of the bounds. Between them the surface is
    flat: over its area it is off by less than 0.2 % of the distance on average (0.03 % for most rigs), and by 5 % at
    most, beside a corner where bounds meet (tried with lenses of |k1| up to 0.3, projectors turned by 6 degrees).
    """
    breaks = _breaks(cut, pass_index)
    if breaks.size < 2:
        return None
    span = (breaks[-1] - breaks[0]) / cut.rig.camera.lens.height
    rows = np.unique(np.append(breaks, np.linspace(breaks[0], breaks[-1], max(3, round(_GENERAL_ROWS * span)))))
    finer = _FINER if cut.rig.camera.lens.distorted or cut.rig.projector.lens.distorted else 1
    share = fine = np.zeros(1)
    ends = np.full((2, 2, rows.size), cut.column or 0.0)
    if cut.column is None:
        share, fine = (np.linspace(0, 1, _GENERAL_COLUMNS * by) for by in (1, finer))
        ends = _lit_columns(cut, pass_index, rows)
        kept = (ends[0] < ends[1]).all(axis=0)
        if kept.sum() < 2:
            return None
        rows, ends = rows[kept], ends[..., kept]
    grid = _Grid(cut, pass_index, rows, ends, share).where_kinks_cross(breaks)
    grid = replace(grid, share=np.union1d(grid.share, fine))
    at = grid.rows_along(grid.kinks(breaks), finer)
    columns = grid.columns(at)
    if cut.column is None:
        columns = _to_raster(cut, pass_index, at, columns)
    rays, raw = _surfaces(cut, pass_index, at, columns)
    w = _limited(cut, raw)
    if not np.any(w[1] - w[0] > _SAME_W):
        return None
    far, near = cut.rig.camera_centre_m + rays / _closed(cut, w)[..., None]
    # both sides meet where there is nothing between, also where the raster ends on other columns for each
    return Piece(far, np.where((w[0] < w[1])[..., None], near, far))


@dataclass(frozen=True)
class _Grid:
    """Where a pass is sampled: camera rows (N,), between columns `ends` (first and last, far and near, N) that the
    projector reaches there, at shares (C,) of the way.
    """

    cut: Cut
    pass_index: int | None
    rows: Doubles
    ends: Doubles
    share: Doubles

    def columns(self, at: Doubles) -> Doubles:
        """Camera columns (2, R, C) of both sides at camera rows (R, C)."""
        left, right = (np.stack([np.interp(at, self.rows, side) for side in end]) for end in self.ends)
        return np.asarray(left + self.share * (right - left), np.float64)

    def surfaces(self, at: Doubles) -> Doubles:
        """Inverse depths (2, R, C) of both sides at camera rows (R, C)."""
        return _surfaces(self.cut, self.pass_index, at, self.columns(at))[1]

    def where_kinks_cross(self, breaks: Doubles) -> _Grid:
        """The grid with further columns, at which two kinks cross: between columns their order stays the same."""
        grid = self
        for _ in range(_CROSSING_STEPS):
            closer = _with_crossings(grid.share, grid.kinks(breaks))
            if closer.size == grid.share.size:
                break
            grid = replace(grid, share=closer)
        return grid

    def kinks(self, breaks: Doubles) -> Doubles:
        """Camera rows (K, C) at which the surfaces have a kink on each column, in no order, also beyond the rows.

        Kinks are at `breaks` (B,), and where a side meets the nearest or the farthest depth.
        """
        inside = np.clip(breaks, self.rows[0], self.rows[-1])
        lines = [np.broadcast_to(inside[:, None], (inside.size, self.share.size))]
        over = np.broadcast_to(self.rows[:, None], (self.rows.size, self.share.size))
        reach = float(self.rows[-1] - self.rows[0])
        for side, surface in enumerate(self.surfaces(over)):
            for depth in (self.cut.w_min, self.cut.w_max):
                for sign in (1.0, -1.0):
                    line, slope = _rising(self.rows, sign * (surface - depth))
                    if np.isnan(line).all():
                        continue
                    # Steps along the slope, for between samples the surface is not straight; and one column on, where
                    # it meets the depth beyond the rows. Farther on it stays beyond.
                    known = np.isfinite(line)
                    line, slope = _from_beside(line, slope)
                    for stays in (False, ~known):
                        missed = sign * (self.surfaces(line[None])[side][0] - depth)
                        step = np.clip(np.nan_to_num(quotient(missed, slope)), -reach, reach)
                        line = np.where(stays, line, line - step)
                    near = known | np.append(known[1:], False) | np.append(False, known[:-1])
                    lines.append(_from_beside(np.where(near, line, np.nan), line)[0][None])
        return np.concatenate(lines)

    def rows_along(self, kinks: Doubles, finer: int) -> Doubles:
        """Camera rows (R, C), each column's own, from where its slab begins to where it ends: lines of the grid run
        along `kinks` (K, C), and between them `finer` times as closely as the grid's rows.
        """
        fixed = np.sort(np.clip(kinks, self.rows[0], self.rows[-1]), axis=0)
        low, high = _limited(self.cut, self.surfaces((fixed[:-1] + fixed[1:]) / 2))
        thick = (low + _SAME_W < high) & (np.diff(fixed, axis=0) > 0)
        first, last = thick.argmax(axis=0), len(thick) - thick[::-1].argmax(axis=0)
        begin, end = (np.take_along_axis(fixed, place[None], axis=0)[0] for place in (first, last))
        begin, end = _from_beside(np.where(thick.any(axis=0), begin, np.nan), end)
        fixed = np.clip(fixed, begin, end)
        parts = [fixed[:1]]
        for above, below in pairwise(fixed):
            longest = float((below - above).max())
            count = math.ceil(_GENERAL_ROWS * finer * longest / self.cut.rig.camera.lens.height - 1e-9)
            if count:
                parts.append(above + np.linspace(0, 1, count + 1)[1:, None] * (below - above))
        return np.concatenate(parts)


def _with_crossings(share: Doubles, kinks: Doubles) -> Doubles:
    """The shares (C,) with those at which two kinks (K, C) cross: on neither side of one their order changes then."""
    first, second = np.triu_indices(len(kinks), 1)
    apart = kinks[first] - kinks[second]
    crossed = apart[:, :-1] * apart[:, 1:] < 0
    line, column = np.nonzero(crossed)
    before, after = apart[line, column], apart[line, column + 1]
    found = share[column] + before / (before - after) * (share[column + 1] - share[column])
    return np.unique(np.append(share, found))


def _surfaces(cut: Cut, pass_index: int | None, rows: Doubles, columns: Doubles) -> tuple[Doubles, Doubles]:
    """Camera rays (2, R, C, 3) of the far and of the near side, and the inverse depths (2, R, C) of the window's edges
    on them, the smaller on the far side and the larger on the near; NaN where a ray meets neither.

    rows (R, C); columns (2, R, C), each side's own.
    """
    edges = _edge_rows(cut, pass_index, rows)
    if np.array_equal(columns[0], columns[1]):
        rays = cut.rig.camera_rays(columns[0], rows)
        w, met = inverse_depth(cut.rig, rays, edges)
        one, other = np.where(met, w, np.nan)
        return np.stack([rays, rays]), np.stack([np.fmin(one, other), np.fmax(one, other)])
    rays = cut.rig.camera_rays(columns, rows)
    w, met = inverse_depth(cut.rig, rays, edges[:, None])
    w = np.where(met, w, np.nan)
    return rays, np.stack([np.fmin(w[0, 0], w[1, 0]), np.fmax(w[0, 1], w[1, 1])])


def _edge_rows(cut: Cut, pass_index: int | None, rows: Doubles) -> Doubles:
    """Projector rows (2, ...) at both edges of the window of camera rows (...), limited to the raster."""
    height = float(cut.rig.projector.lens.height)
    if pass_index is None:
        return np.stack([np.zeros_like(rows), np.full_like(rows, height)])
    return np.clip(np.stack(window_rows(cut.rig, cut.settings, rows, pass_index)), 0.0, height)


def _limited(cut: Cut, raw: Doubles) -> Doubles:
    """Inverse depths (2, ...) of both surfaces limited to the cut; the first larger: nothing left."""
    return np.stack([np.fmax(raw[0], cut.w_min), np.fmin(raw[1], cut.w_max)])


def _closed(cut: Cut, w: Doubles) -> Doubles:
    """The same intervals with empty ones closed to a single depth inside the cut, so that they can be drawn."""
    return np.where(w[0] <= w[1], w, np.clip(w.mean(axis=0), cut.w_min, cut.w_max))


def _breaks(cut: Cut, pass_index: int | None) -> Doubles:
    """Camera rows (sorted) between which the pass may light, with those where its window leaves the raster."""
    rig, settings = cut.rig, cut.settings
    first, last = 0.0, float(rig.camera.lens.height)
    kinks: list[float] = []
    if pass_index is not None:
        lit = rig.projector.lens.height / rig.projector.rows_per_us / settings.line_time_us
        at_zero = (pass_index * rig.projector.period_us - settings.delay_us) / settings.line_time_us
        half = settings.exposure_us / 2 / settings.line_time_us
        first, last = max(first, at_zero - half), min(last, at_zero + lit + half)
        kinks = [at_zero + half, at_zero + lit - half]
    return np.unique(np.clip([first, *kinks, last], first, last)) if first < last else np.empty(0)


def _rising(rows: Doubles, values: Doubles) -> tuple[Doubles, Doubles]:
    """Where values (R, C) given at rows (R,) first rise through zero in each column (C,), NaN where they do not; and
    how steeply.
    """
    hit = (values[:-1] < 0) & (values[1:] >= 0)
    first = hit.argmax(axis=0)[None]
    v0, v1 = (np.take_along_axis(side, first, axis=0)[0] for side in (values[:-1], values[1:]))
    slope = (v1 - v0) / np.diff(rows)[first[0]]
    return np.where(hit.any(axis=0), rows[first[0]] - quotient(v0, slope), np.nan), slope


def _from_beside(line: Doubles, other: Doubles) -> tuple[Doubles, Doubles]:
    """Two lines (C,) with what is missing in the first taken from the nearest column that has it, in both."""
    known = np.flatnonzero(np.isfinite(line))
    if not known.size:
        return np.zeros_like(line), np.zeros_like(line)
    nearest = known[np.abs(np.arange(line.size)[:, None] - known).argmin(axis=1)]
    return line[nearest], other[nearest]


def _lit_columns(cut: Cut, pass_index: int | None, rows: Doubles) -> Doubles:
    """First and last camera column (2, 2, R) of both sides that the projector's raster reaches, by way of samples."""
    width = float(cut.rig.camera.lens.width)
    columns = np.linspace(0, width, _GENERAL_COLUMNS)
    over = np.broadcast_to(rows[:, None], (rows.size, columns.size))
    lit = _lit(cut, pass_index, over, np.broadcast_to(columns, (2, *over.shape)))
    return np.stack(_limits(columns, lit, float(cut.rig.projector.lens.width)))


def _lit(cut: Cut, pass_index: int | None, rows: Doubles, columns: Doubles) -> Doubles:
    """Projector columns (2, R, C) that light both sides."""
    rays, raw = _surfaces(cut, pass_index, rows, columns)
    closed = _closed(cut, _limited(cut, raw))
    return cut.rig.to_projector(cut.rig.camera_centre_m + rays / closed[..., None])[0]


def _to_raster(cut: Cut, pass_index: int | None, rows: Doubles, columns: Doubles) -> Doubles:
    """The same columns (2, R, C) with the first and the last moved onto the ends of the projector's raster."""
    width, ends = float(cut.rig.projector.lens.width), [0, -1]
    columns = columns.copy()
    for _ in range(2):
        outer = columns[..., ends]
        lit = _lit(cut, pass_index, rows[:, ends], outer)
        slope = quotient(lit[..., 1] - lit[..., 0], outer[..., 1] - outer[..., 0])
        wanted = np.where((slope > 0)[..., None], [0.0, width], [width, 0.0])
        moved = outer + np.nan_to_num(quotient(wanted - lit, np.broadcast_to(slope[..., None], lit.shape)))
        columns[..., ends] = np.clip(moved, 0.0, float(cut.rig.camera.lens.width))
    return columns


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
