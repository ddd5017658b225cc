"""Cells of pixels that share indirect light: which cell each pixel's light is kept in, and which cells are alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.kernels_bake import Grid, SeenPixels
from slopegate.core.light.surfaces import Guides
from slopegate.core.rig.arrays import Bools, Doubles, Singles
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
    count = grid.rows * grid.columns
    cells = CellGuides(np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32), np.zeros(count, np.float32))
    view = _seen(rig, guides, (0.5, 0.5))
    camera, spread = rig.camera_centre_m, pitch / min(lens.fx, lens.fy)
    alone = np.zeros(len(view.depth), np.bool_)
    _choose(grid, view, alone, camera, spread, cells)
    _house(grid, view, camera, cells, alone)
    # What no cell shows the like of, as the thin side of a box, takes over cells whose own surface has others.
    _choose(grid, view, alone, camera, spread, cells)
    _house(grid, view, camera, cells, alone)
    return Picture(grid, guides, view, cells)


def seen_through(rig: Rig, guides: Guides, offset: tuple[float, float], picture: Picture) -> SeenPixels:
    """What pixels show at another place than their centres, and which of the picture's cells that is kept in."""
    view = _seen(rig, guides, offset)
    _house(picture.grid, view, rig.camera_centre_m, picture.cells, np.empty(len(view.depth), np.bool_))
    return view


def _seen(rig: Rig, guides: Guides, offset: tuple[float, float]) -> SeenPixels:
    lens = rig.camera.lens
    rows, columns = np.indices((lens.height, lens.width))
    rays = rig.camera_rays(columns + offset[0], rows + offset[1])[..., :2].astype(np.float32).reshape(-1, 2)
    depth, normal, kind = guides.depth.ravel(), guides.normal.reshape(-1, 3), guides.kind.ravel()
    return SeenPixels(rays, depth, normal, kind, np.empty(len(depth), np.int32))


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
def _choose(grid: Grid, view: SeenPixels, alone: Bools, camera: Doubles, spread: float, cells: CellGuides) -> None:
    """For every cell that has none the pixel that is most like the others in it.

    Where pixels are `alone` (P,), those alone are asked, if the cell can spare its own: another shows the like.
    """
    most_points = _PROBES * _PROBES
    points, normals = np.empty((most_points, 3)), np.empty((most_points, 3))
    taken = np.zeros(grid.rows * grid.columns, np.bool_)
    for cell in range(grid.rows * grid.columns):
        has = cells.size[cell] > 0
        if has and not _spared(grid, cell, taken, cells):
            continue
        top, left = cell // grid.columns * grid.pitch, cell % grid.columns * grid.pitch
        high, wide = min(grid.pitch, grid.height - top), min(grid.pitch, grid.width - left)
        kept = 0
        for n in range(most_points):
            y = top + min(int((n // _PROBES + 0.5) * high / _PROBES), high - 1)
            x = left + min(int((n % _PROBES + 0.5) * wide / _PROBES), wide - 1)
            p = y * grid.width + x
            if view.kind[p] < 0 or (has and not alone[p]):
                continue
            depth = view.depth[p]
            points[kept, 0] = camera[0] + depth * view.rays[p, 0]
            points[kept, 1] = camera[1] + depth * view.rays[p, 1]
            points[kept, 2] = camera[2] + depth
            for k in range(3):
                normals[kept, k] = view.normal[p, k]
            kept += 1
        if kept < (2 if has else 1):
            continue
        best = _middle(kept, points, normals, spread, camera[2])
        taken[cell] = has
        for k in range(3):
            cells.point[cell, k], cells.normal[cell, k] = points[best, k], normals[best, k]
        cells.size[cell] = spread * (points[best, 2] - camera[2])


@njit(cache=True, nogil=True, error_model="numpy")
def _middle(count: int, points: Doubles, normals: Doubles, spread: float, camera_z: float) -> int:
    """Which of the points is most like the others and nearest to them."""
    best, most = 0, -1.0
    for i in range(count):
        size = spread * (points[i, 2] - camera_z)
        total = 0.0
        for j in range(count):
            dx, dy, dz = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            same = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] + normals[i, 2] * normals[j, 2]
            off = abs(normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz) / size
            total += max(same, 0.0) * np.exp(-2.0 * off * off) * (1.0 - 1e-3 * np.sqrt(dx * dx + dy * dy) / size)
        if total > most:
            best, most = i, total
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def _spared(grid: Grid, cell: int, taken: Bools, cells: CellGuides) -> bool:
    """Whether a cell beside this one shows the same surface, and will go on to."""
    row, column = cell // grid.columns, cell % grid.columns
    x, y, z = cells.point[cell, 0], cells.point[cell, 1], cells.point[cell, 2]
    nx, ny, nz = cells.normal[cell, 0], cells.normal[cell, 1], cells.normal[cell, 2]
    for dr, dc in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        r, c = row + dr, column + dc
        if 0 <= r < grid.rows and 0 <= c < grid.columns:
            other = r * grid.columns + c
            if not taken[other] and likeness(x, y, z, nx, ny, nz, other, cells.size[cell], cells) > 0.3:
                return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _house(grid: Grid, view: SeenPixels, camera: Doubles, cells: CellGuides, alone: Bools) -> None:
    """The home of every pixel: of its own cell and the eight about it the one most like it; its own if none is.

    alone (P,) is set where none is.
    """
    for y in range(grid.height):
        for x in range(grid.width):
            p = y * grid.width + x
            view.home[p] = y // grid.pitch * grid.columns + x // grid.pitch
            alone[p] = False
            if view.kind[p] >= 0:
                depth = view.depth[p]
                px, py = camera[0] + depth * view.rays[p, 0], camera[1] + depth * view.rays[p, 1]
                nx, ny, nz = view.normal[p, 0], view.normal[p, 1], view.normal[p, 2]
                home = _home(grid, y, x, (px, py, camera[2] + depth), (nx, ny, nz), cells)
                alone[p] = home < 0
                if home >= 0:
                    view.home[p] = home


@njit(cache=True, nogil=True, error_model="numpy")
def _home(
    grid: Grid,
    y: int,
    x: int,
    place: tuple[float, float, float],
    normal: tuple[float, float, float],
    cells: CellGuides,
) -> int:
    """The cell most like what pixel (y, x) shows, of the nine about it, the nearer the better; -1 if none is."""
    row, column = y // grid.pitch, x // grid.pitch
    home, most = -1, 0.005
    for dr in range(-1, 2):
        for dc in range(-1, 2):
            r, c = row + dr, column + dc
            if 0 <= r < grid.rows and 0 <= c < grid.columns:
                other = r * grid.columns + c
                alike = likeness(*place, *normal, other, cells.size[other], cells)
                # A like surface in its own cell is home enough.
                alike = min(alike, 0.5) * (4.0 if dr == 0 and dc == 0 else 1.0 / (1.0 + abs(dr) + abs(dc)))
                if alike > most:
                    home, most = other, alike
    return home
