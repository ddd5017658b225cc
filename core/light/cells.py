"""Cells of pixels that share indirect light: which cell each pixel's light is kept in, and which cells are alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from slopegate.core.light.kernels_bake import Grid, SeenPixels
from slopegate.core.light.surfaces import Guides
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.rig import Rig

_PROBES = 4
"""Pixels that are compared across a cell, each way, to find the surface that most of it shows."""


class CellGuides(NamedTuple):
    """What stands for each cell: a point (N, 3) float32 metres, world, its normal (N, 3), the cell's width there (N,)
    in metres, 0 where the cell shows nothing."""

    point: Singles
    normal: Singles
    size: Singles


class Picture(NamedTuple):
    """The camera's picture divided into cells: what its pixels and cells show."""

    grid: Grid
    guides: Guides
    view: SeenPixels
    cells: CellGuides


def make_picture(rig: Rig, guides: Guides, pitch: int) -> Picture:
    """The cells of pitch x pitch pixels, what stands for each, and which of them each pixel's light is kept in."""
    lens = rig.camera.lens
    grid = Grid(-(-lens.height // pitch), -(-lens.width // pitch), pitch, lens.width, lens.height)
    rows, columns = np.indices((lens.height, lens.width))
    rays = rig.camera_rays(columns + 0.5, rows + 0.5)[..., :2].astype(np.float32).reshape(-1, 2)
    depth, normal, kind = guides.depth.ravel(), guides.normal.reshape(-1, 3), guides.kind.ravel()
    count = grid.rows * grid.columns
    cells = CellGuides(np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32), np.zeros(count, np.float32))
    view = SeenPixels(rays, depth, normal, kind, np.empty(len(depth), np.int32))
    _choose(grid, view, rig.camera_centre_m, pitch / min(lens.fx, lens.fy), cells)
    _house(grid, view, rig.camera_centre_m, cells)
    return Picture(grid, guides, view, cells)


@njit(cache=True, nogil=True, error_model="numpy")
def likeness(
    x: float, y: float, z: float, nx: float, ny: float, nz: float, other: int, size: float, cells: CellGuides
) -> float:
    """How much a surface (a point, its normal, a cell's width there) is like that of a cell, 0 to 1.

    It falls with the angle between the normals and with how far each point lies off the other's plane, in cells.
    """
    if cells.size[other] <= 0.0 or size <= 0.0:
        return 0.0
    mx, my, mz = cells.normal[other, 0], cells.normal[other, 1], cells.normal[other, 2]
    dx, dy, dz = cells.point[other, 0] - x, cells.point[other, 1] - y, cells.point[other, 2] - z
    off = max(abs(nx * dx + ny * dy + nz * dz), abs(mx * dx + my * dy + mz * dz)) / size
    same = nx * mx + ny * my + nz * mz
    if same <= 0.5 or off >= 4.0:
        return 0.0
    return float(np.exp(-2.0 * off * off - 8.0 * (1.0 - same)))


@njit(cache=True, nogil=True, error_model="numpy")
def _choose(grid: Grid, view: SeenPixels, camera: Doubles, spread: float, cells: CellGuides) -> None:
    """For every cell the pixel that is most like the others in it."""
    ys, xs = np.empty(_PROBES * _PROBES, np.int64), np.empty(_PROBES * _PROBES, np.int64)
    points, normals = np.empty((_PROBES * _PROBES, 3)), np.empty((_PROBES * _PROBES, 3))
    for cell in range(grid.rows * grid.columns):
        top, left = cell // grid.columns * grid.pitch, cell % grid.columns * grid.pitch
        high, wide = min(grid.pitch, grid.height - top), min(grid.pitch, grid.width - left)
        n = 0
        for a in range(_PROBES):
            for b in range(_PROBES):
                ys[n] = top + min(int((a + 0.5) * high / _PROBES), high - 1)
                xs[n] = left + min(int((b + 0.5) * wide / _PROBES), wide - 1)
                n += 1
        kept = 0
        for i in range(n):
            p = ys[i] * grid.width + xs[i]
            if view.kind[p] < 0:
                continue
            depth = view.depth[p]
            points[kept, 0] = camera[0] + depth * view.rays[p, 0]
            points[kept, 1] = camera[1] + depth * view.rays[p, 1]
            points[kept, 2] = camera[2] + depth
            for k in range(3):
                normals[kept, k] = view.normal[p, k]
            kept += 1
        best, most = -1, -1.0
        for i in range(kept):
            size = spread * (points[i, 2] - camera[2])
            total = 0.0
            for j in range(kept):
                dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
                same = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
                off = abs(normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz) / size
                total += max(same, 0.0) * np.exp(-2.0 * off * off) * (1.0 - 1e-3 * np.sqrt(dx * dx + dy * dy) / size)
            if total > most:
                best, most = i, total
        if best >= 0:
            for k in range(3):
                cells.point[cell, k], cells.normal[cell, k] = points[best, k], normals[best, k]
            cells.size[cell] = spread * (points[best, 2] - camera[2])


@njit(cache=True, nogil=True, error_model="numpy")
def _house(grid: Grid, view: SeenPixels, camera: Doubles, cells: CellGuides) -> None:
    """The home of every pixel: of its own cell and the eight about it the one most like it; its own if none is."""
    for y in range(grid.height):
        for x in range(grid.width):
            p = y * grid.width + x
            row, column = y // grid.pitch, x // grid.pitch
            home, most = row * grid.columns + column, 0.0
            if view.kind[p] >= 0:
                depth = view.depth[p]
                px, py = camera[0] + depth * view.rays[p, 0], camera[1] + depth * view.rays[p, 1]
                pz = camera[2] + depth
                own = home
                for dr in range(-1, 2):
                    for dc in range(-1, 2):
                        r, c = row + dr, column + dc
                        if r < 0 or c < 0 or r >= grid.rows or c >= grid.columns:
                            continue
                        other = r * grid.columns + c
                        size = cells.size[own] if cells.size[own] > 0 else cells.size[other]
                        alike = likeness(
                            px, py, pz, view.normal[p, 0], view.normal[p, 1], view.normal[p, 2], other, size, cells
                        )
                        # A like surface in its own cell is home enough.
                        alike = min(alike, 0.5) * (4.0 if other == own else 1.0 / (1.0 + abs(dr) + abs(dc)))
                        if alike > most:
                            home, most = other, alike
            view.home[p] = home
