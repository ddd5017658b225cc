"""The compiled steps of paths from the camera: where they start, turn, land and are lit.

All paths of a batch take a step together; those that end are left out of the next.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from slopegate.core.light.kernels_surfaces import Met
from slopegate.core.light.points import hashed, pair, single, woven
from slopegate.core.rig.arrays import Bools, Bytes, Doubles, Indices, Ints, Singles, Words

NOTHING: Final = -1
IN_FOG: Final = -2
"""What stands in a vertex's kind where it is no surface."""

BY_COLOUR: Final = 0
FROM_GLOSS: Final = 1
FROM_FOG: Final = 2
"""What the first vertex of a path did, in `Paths.plain`: only matt light is multiplied by a pixel's colour."""

_ROULETTE_FROM: Final = 4
_ENDS_FROM: Final = 8
"""Number of the first vertex after which dim paths may end by chance."""

# Seeds of what is drawn: the pixel, then per vertex a direction, whether the path goes on, and how far it flies.
_PIXEL, _TURN, _GO_ON = 0, 1000, 2000


class Paths(NamedTuple):
    """N paths on their way: origin and direction of the leg (N, 3), weight (N, C), slot (N,): the cell that they add
    to, plain (N,): BY_COLOUR where what they bring is to be multiplied by the pixel's albedo, number (N,): which of the
    points."""

    origin: Singles
    direction: Singles
    weight: Singles
    slot: Ints
    plain: Bytes
    number: Words


class Tables(NamedTuple):
    """What paths bring: the fields of `Baked`, of one half."""

    matt: Singles
    plain: Singles
    paths: Singles
    nearness: Singles


class Vertices(NamedTuple):
    """Where N paths change direction: point, normal towards the path's last leg (N, 3), albedo (N, C), kind (N,)."""

    point: Singles
    normal: Singles
    albedo: Singles
    kind: Ints


class SeenPixels(NamedTuple):
    """What the camera sees, flat over pixels: rays (P, 2) x/z and y/z, depth (P,), normal (P, 3), kind (P,), home
    (P,): the cell that a pixel's light is kept in."""

    rays: Singles
    depth: Singles
    normal: Singles
    kind: Ints
    home: Ints


class Grid(NamedTuple):
    """Cells of `pitch` x `pitch` pixels, rows x columns of them, over width x height pixels."""

    rows: int
    columns: int
    pitch: int
    width: int
    height: int


@njit(cache=True, nogil=True, error_model="numpy")
def start(
    some: tuple[int, int, int, int],
    grid: Grid,
    view: SeenPixels,
    camera: Doubles,
    paths: Paths,
    at: Vertices,
    begun: Singles,
) -> None:
    """Begin paths: their first vertices, not yet lit. some: the first cell, how many, paths in each, the seed.

    begun (cells,) counts them by the cell that they add to. A path's index is Morton's number of its cell times the
    paths in each, so neighbours share one evenly spread set.
    """
    first, count, each, seed = some
    n = 0
    for cell in range(first, first + count):
        row, column = cell // grid.columns, cell % grid.columns
        high = min(grid.pitch, grid.height - row * grid.pitch)
        wide = min(grid.pitch, grid.width - column * grid.pitch)
        base = woven(row, column) * each
        for j in range(each):
            index = np.uint32(base + j)
            u, v = pair(index, hashed(seed, _PIXEL))
            y, x = row * grid.pitch + int(v * high), column * grid.pitch + int(u * wide)
            p = y * grid.width + x
            depth = view.depth[p]
            a, b = view.rays[p, 0], view.rays[p, 1]
            length = np.sqrt(a * a + b * b + np.float32(1.0))
            paths.direction[n, 0], paths.direction[n, 1], paths.direction[n, 2] = a / length, b / length, 1.0 / length
            for k in range(3):
                paths.origin[n, k] = camera[k]
                at.normal[n, k] = view.normal[p, k]
            at.point[n, 0] = camera[0] + depth * a
            at.point[n, 1] = camera[1] + depth * b
            at.point[n, 2] = camera[2] + depth
            at.kind[n] = view.kind[p]
            for k in range(paths.weight.shape[1]):
                paths.weight[n, k] = 1.0
                at.albedo[n, k] = 1.0
            paths.slot[n], paths.plain[n], paths.number[n] = view.home[p], 0, index
            begun[view.home[p]] += 1.0
            n += 1


@njit(cache=True, nogil=True, error_model="numpy")
def turn(count: int, order: int, seed: int, g: float, paths: Paths, at: Vertices) -> int:
    """Send paths on from their vertices; those that go on move to the front. Returns how many.

    Surfaces send them cosine-weighted, fog by its phase function (mean cosine g). order: how often the light that goes
    on has changed its direction, this vertex included.
    """
    kept = 0
    channels = paths.weight.shape[1]
    own = hashed(seed, _TURN + order)
    chance = hashed(seed, _GO_ON + order)
    surest = np.float32(1.0 if order < _ENDS_FROM else 0.95)
    for i in range(count):
        if at.kind[i] == NOTHING:
            continue
        number = paths.number[i]
        bright = np.float32(0.0)
        for k in range(channels):
            bright = max(bright, paths.weight[i, k] * at.albedo[i, k])
        if bright <= 0.0:
            continue
        scale = np.float32(1.0)
        if order >= _ROULETTE_FROM:
            likely = min(bright * np.float32(4.0), surest)
            if single(number, chance) >= likely:
                continue
            scale = np.float32(1.0) / likely
        for k in range(channels):
            paths.weight[kept, k] = paths.weight[i, k] * at.albedo[i, k] * scale
        u, v = pair(number, own)
        if at.kind[i] == IN_FOG:
            cosine = phase_cosine(g, u)
            nx, ny, nz = paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2]
            away = np.float32(0.0)
        else:
            cosine = sqrt(1.0 - u)
            nx, ny, nz = at.normal[i, 0], at.normal[i, 1], at.normal[i, 2]
            away = np.float32(1e-5)
        sine = np.float32(sqrt(max(1.0 - cosine * cosine, 0.0)))
        x, y, z = about(nx, ny, nz, np.float32(cosine), sine, np.float32(2.0 * pi * v))
        px, py, pz = at.point[i, 0], at.point[i, 1], at.point[i, 2]
        off = away * (abs(px) + abs(py) + abs(pz) + np.float32(0.01))
        paths.origin[kept, 0], paths.origin[kept, 1], paths.origin[kept, 2] = (
            px + off * nx,
            py + off * ny,
            pz + off * nz,
        )
        paths.direction[kept, 0], paths.direction[kept, 1], paths.direction[kept, 2] = x, y, z
        paths.slot[kept], paths.plain[kept], paths.number[kept] = paths.slot[i], paths.plain[i], number
        kept += 1
    return kept


@njit(cache=True, nogil=True, error_model="numpy")
def phase_cosine(g: float, u: float) -> float:
    """A cosine between the directions before and after scattering, drawn from Henyey and Greenstein's law by u."""
    if abs(g) < 1e-4:
        return 1.0 - 2.0 * u
    s = (1.0 - g * g) / (1.0 - g + 2.0 * g * u)
    return min(max((1.0 + g * g - s * s) / (2.0 * g), -1.0), 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def about(
    nx: np.float32, ny: np.float32, nz: np.float32, cosine: np.float32, sine: np.float32, angle: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    """The unit vector at this angle from the axis n, turned about it by `angle`."""
    # Axes across n without a branch that loses accuracy (Duff et al. 2017).
    sign = np.float32(1.0) if nz >= 0 else np.float32(-1.0)
    a = np.float32(-1.0) / (sign + nz)
    b = nx * ny * a
    across, along = sine * np.float32(cos(angle)), sine * np.float32(sin(angle))
    x = (np.float32(1.0) + sign * nx * nx * a) * across + b * along + nx * cosine
    y = sign * b * across + (sign + ny * ny * a) * along + ny * cosine
    z = -sign * nx * across - ny * along + nz * cosine
    return x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def arrive(count: int, paths: Paths, met: Met, at: Vertices) -> None:
    """The vertices where the legs end."""
    channels = paths.weight.shape[1]
    for i in range(count):
        at.kind[i] = met.kind[i]
        if met.kind[i] == NOTHING:
            continue
        t = met.distance[i]
        for k in range(3):
            at.point[i, k] = paths.origin[i, k] + t * paths.direction[i, k]
            at.normal[i, k] = met.normal[i, k]
        for k in range(channels):
            at.albedo[i, k] = met.albedo[i, k]


@njit(cache=True, nogil=True, error_model="numpy")
def face(
    count: int, at: Vertices, light: Doubles, rotation: Doubles, q: Doubles, rays: Singles, value: Singles
) -> None:
    """How brightly the projector lights surfaces, as `render.tracing` has it: value (N, C) = albedo facing / z_p^3.

    q (N, 3): the point as x/z, y/z, z in the projector's axes, NaN where the surface turns its back on it; rays (N, 3)
    from it to the point.
    """
    for i in range(count):
        q[i, 0], q[i, 1], q[i, 2] = np.nan, np.nan, -1.0
        if at.kind[i] < 0:
            continue
        x, y, z = at.point[i, 0] - light[0], at.point[i, 1] - light[1], at.point[i, 2] - light[2]
        facing = -(at.normal[i, 0] * x + at.normal[i, 1] * y + at.normal[i, 2] * z)
        qz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
        if facing <= 0.0 or qz <= 0.0:
            continue
        q[i, 0] = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) / qz
        q[i, 1] = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) / qz
        q[i, 2] = qz
        rays[i, 0], rays[i, 1], rays[i, 2] = x, y, z
        strength = facing / (qz * qz * qz)
        for k in range(value.shape[1]):
            value[i, k] = at.albedo[i, k] * strength


@njit(cache=True, nogil=True)
def gather(
    count: int, row: Singles, rays: Singles, light: Doubles, asked: Indices, starts: Singles, ways: Singles
) -> int:
    """The rays (N, 3) that a row of the projector (row (N,), below 0: none) sends, one after the other; their number.

    asked (N,): which they are; starts and ways (N, 3): from the projector, as far as the point.
    """
    kept = 0
    for i in range(count):
        if row[i] < 0:
            continue
        asked[kept] = i
        for k in range(3):
            starts[kept, k] = light[k]
            ways[kept, k] = rays[i, k]
        kept += 1
    return kept


@njit(cache=True, nogil=True)
def deposit(
    asked: Indices, shaded: Bools, row: Singles, band_rows: float, value: Singles, paths: Paths, tables: Tables
) -> None:
    """Add value (N, C) times the paths' weights to the tables where nothing stands before the projector."""
    columns = tables.matt.shape[3]
    for n in range(asked.shape[0]):
        if shaded[n]:
            continue
        i = asked[n]
        band = min(int(row[i] / band_rows), tables.matt.shape[1] - 1)
        r, c = paths.slot[i] // columns, paths.slot[i] % columns
        for k in range(tables.matt.shape[2]):
            light = paths.weight[i, k] * value[i, k]
            if paths.plain[i] == BY_COLOUR:
                tables.matt[r, band, k, c] += light
            else:
                tables.plain[r, band, k, c] += light


@njit(cache=True, nogil=True, error_model="numpy")
def note_nearness(count: int, paths: Paths, met: Met, nearness: Singles) -> None:
    """Add 1 / distance of what paths met next to their cells, nearness (R, W)."""
    for i in range(count):
        if met.kind[i] != NOTHING and paths.plain[i] == BY_COLOUR:
            slot = paths.slot[i]
            nearness[slot // nearness.shape[1], slot % nearness.shape[1]] += 1.0 / max(met.distance[i], 1e-6)
