"""The cells that say what a body shows a viewer, and the compiled loops that read them in place of casting rays.

A cell names the triangle that is met first, wherever that is beyond doubt. A viewer's directions x/z, y/z are cut into
cells. Inverse depth is affine over a plane's picture, so within a cell each triangle is between two numbers: one that
fills the cell and lies before whatever else touches it is met first. Cells are judged with a margin about them, a
hundred times larger than what float32 does to a ray, so embree would agree.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Bools, Doubles, Indices, Ints, Singles

NOTHING: Final = 0
ASK: Final = 1
FIRST: Final = 2
"""A cell holds NOTHING, ASK (only a ray can tell), or FIRST + the number of the triangle that is met first."""

ROUND: Final = 1 << 30
"""Added to that where a sphere may be seen."""

SHADED: Final = 1.0 + 1.3e-4
LIT: Final = 1.0 + 0.7e-4
"""A point's depth in those of what is met first on its way: above the one it is shaded and below the other it is not,
by rays that end at `tracing.SHADOW_REACH`; in between a ray decides."""


class CellRaster(NamedTuple):
    """Cell (r, c) covers (x/z - left) scale in [c, c + 1) and (y/z - top) scale in [r, r + 1)."""

    left: float
    top: float
    scale: float
    width: int
    height: int


class Patch(NamedTuple):
    """Cells first_row .. + height, first_column .. + width of a raster."""

    first_row: int
    first_column: int
    height: int
    width: int


class Cells(NamedTuple):
    """What a body shows a viewer: what (h, w) in the cells of the patch, nothing in the others of the raster.

    planes (T, 3): inverse depth of each triangle's plane is p[0] column + p[1] row + p[2], in continuous cells.
    """

    raster: CellRaster
    patch: Patch
    what: Ints
    planes: Doubles


class Spheres(NamedTuple):
    """Centres (S, 3), radii (S,) and albedo (S, 3) in a body's frame."""

    centres: Doubles
    radii: Doubles
    albedo: Singles


@njit(cache=True, nogil=True)
def cell_at(raster: CellRaster, patch: Patch, x: float, y: float) -> tuple[int, int]:
    """Row and column within the patch of the direction x/z, y/z; rows -1 and -2 beside the patch and the raster.

    Without arrays, which would cost atomic reference counts at every call.
    """
    column, row = (x - raster.left) * raster.scale, (y - raster.top) * raster.scale
    if not (0.0 <= column < raster.width and 0.0 <= row < raster.height):
        return -2, 0
    r, c = int(row) - patch.first_row, int(column) - patch.first_column
    inside = 0 <= r < patch.height and 0 <= c < patch.width
    return (r if inside else -1), c


@njit(cache=True, nogil=True)
def first_met(directions: Doubles, cells: Cells, prim: Ints, spheres: Bools) -> int:
    """Which triangle rays (R, 3), z = 1 in viewer's axes, meet first: -1 for none, -2 to be asked for.

    Also whether a sphere may be in the way. Returns how many rays are to be asked for.
    """
    raster, patch, what = cells.raster, cells.patch, cells.what
    asked = 0
    for i in range(prim.shape[0]):
        r, c = cell_at(raster, patch, directions[i, 0], directions[i, 1])
        # Beside the patch the body shows nothing; beside the whole raster nothing was drawn, so nothing is known.
        cell = what[r, c] if r >= 0 else (NOTHING if r == -1 else ASK | ROUND)
        spheres[i] = cell & ROUND != 0
        kind = cell & ~ROUND
        asked += kind == ASK
        prim[i] = -1 if kind == NOTHING else (-2 if kind == ASK else kind - FIRST)
    return asked


@njit(cache=True, nogil=True, error_model="numpy")
def judge_shade(raster: CellRaster, a: float, b: float, c: float, x: float, y: float, z: float) -> int:
    """Whether the triangle of the plane a, b, c, first met in its direction, shades the point x/z, y/z, z.

    1 yes, 0 no, -1 to be asked for.
    """
    # Inverse depths, not depths: they are affine over the picture of a plane, and a plane seen edge-on needs no case.
    w = a * (x - raster.left) * raster.scale + b * (y - raster.top) * raster.scale + c
    if z * w > SHADED:
        return 1
    return 0 if z * w < LIT else -1


@njit(cache=True, nogil=True)
def sphere_between(sphere: Spheres, light: Doubles, dx: float, dy: float, dz: float, reach: float) -> bool:
    """Whether the segment light .. light + reach (dx, dy, dz) crosses a sphere's surface, all in the body's frame."""
    for s in range(sphere.radii.shape[0]):
        cx, cy, cz = (
            sphere.centres[s, 0] - light[0],
            sphere.centres[s, 1] - light[1],
            sphere.centres[s, 2] - light[2],
        )
        square = dx * dx + dy * dy + dz * dz
        middle = (cx * dx + cy * dy + cz * dz) / square
        px, py, pz = middle * dx - cx, middle * dy - cy, middle * dz - cz
        rest = sphere.radii[s] * sphere.radii[s] - (px * px + py * py + pz * pz)
        if rest > 0.0:
            half = np.sqrt(rest / square)
            if 0.0 < middle - half < reach or 0.0 < middle + half < reach:
                return True
    return False


@njit(cache=True, nogil=True)
def shade(
    cells: Cells,
    sphere: Spheres,
    light: Doubles,
    rotation: Doubles,
    vectors: Doubles,
    q: Doubles,
    reach: float,
    row: Singles,
    asked: Indices,
) -> int:
    """Set row (R,) to -1 where the body keeps the light from a lit point; returns how many points are to be asked for.

    vectors (R, 3): from the light in world axes; q (R, 3): x/z, y/z, z in the light's axes; light: in the body's frame.
    asked (R,): the points to be asked for come first.
    """
    raster, patch, what, planes = cells.raster, cells.patch, cells.what, cells.planes
    count = 0
    for i in range(row.shape[0]):
        if row[i] < 0:  # dark already: out of the projector's frame, or shaded by another body
            continue
        r, c = cell_at(raster, patch, q[i, 0], q[i, 1])
        if r == -1:
            continue
        cell = what[r, c] if r >= 0 else ASK | ROUND
        t = (cell & ~ROUND) - FIRST
        verdict = -1 if t == ASK - FIRST else 0
        if t >= 0:
            verdict = judge_shade(raster, planes[t, 0], planes[t, 1], planes[t, 2], q[i, 0], q[i, 1], q[i, 2])
        # Rays are asked about triangles only, so spheres are tested here, exactly.
        if verdict != 1 and cell & ROUND:
            x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
            dx = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
            dy = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
            dz = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
            if sphere_between(sphere, light, dx, dy, dz, reach):
                verdict = 1
        if verdict == 1:
            row[i] = -1
        elif verdict == -1:
            asked[count] = i
            count += 1
    return count
