"""The compiled steps of paths from the camera: where they start, turn, land and are lit.

All paths of a batch take a step together; those that end are left out of the next.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.light.halo import SMALL_COSINE
from slopegate.core.light.kernels_surfaces import GLASS, GLOSS, MATT, Met
from slopegate.core.light.points import hashed, pair, single, woven
from slopegate.core.render.glass import fresnel
from slopegate.core.rig.arrays import Bools, Bytes, Doubles, Indices, Ints, Singles, Words

NOTHING: Final = -1
IN_FOG: Final = -2
"""What stands in a vertex's kind where it is no surface."""

BY_COLOUR: Final = 0
FROM_GLOSS: Final = 1
FROM_FOG: Final = 2
THROUGH_GLASS: Final = 3
ON_SIGHT: Final = 4
WIDE_IN_FOG: Final = 5
PAST_FOG: Final = 6
"""What the first vertex of a path did, in `Paths.plain`: only matt light is multiplied by a pixel's colour. ON_SIGHT is
still on its way through glass along the line of sight: what the projector lights at its end is direct light. FROM_FOG
is a path that fog alone has turned so far, each time by a small angle; WIDE_IN_FOG one that it turned once by a wide
one, PAST_FOG all others that began in fog (see `halo`)."""

_ROULETTE_FROM: Final = 4
_ENDS_FROM: Final = 8
"""Number of the first vertex after which dim paths may end by chance."""

# Seeds of what is drawn: the pixel, then per vertex a direction, whether the path goes on, and how far it flies.
_PIXEL, _TURN, _GO_ON, _CHOOSE = 0, 1000, 2000, 5000


class Paths(NamedTuple):
    """N paths on their way: origin and direction of the leg (N, 3), weight (N, C), slot (N,): the cell that they add
    to, plain (N,): BY_COLOUR where what they bring is to be multiplied by the pixel's albedo, number (N,): which of the
    points, inside (N,): 1 in glass, seen (N, 2): x/z and y/z of the camera's ray that the path began with."""

    origin: Singles
    direction: Singles
    weight: Singles
    slot: Ints
    plain: Bytes
    number: Words
    inside: Bytes
    seen: Singles


class Tables(NamedTuple):
    """What paths bring: the fields of `Baked`, of one half."""

    matt: Singles
    plain: Singles
    paths: Singles
    matt_paths: Singles
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
    materials: Singles,
    camera: Doubles,
    paths: Paths,
    at: Vertices,
    tables: Tables,
) -> None:
    """Begin paths: their first vertices, not yet lit. some: the first cell, how many, paths in each, the seed.

    tables.paths and .matt_paths count them by the cell that they add to. A path's index is Morton's number of its cell
    times the paths in each, so neighbours share one evenly spread set.
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
            paths.seen[n, 0], paths.seen[n, 1] = a, b
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
            r, c = view.home[p] // grid.columns, view.home[p] % grid.columns
            tables.paths[r, c] += 1.0
            if view.kind[p] != NOTHING:
                tables.matt_paths[r, c] += 1.0
            n += 1


@njit(cache=True, nogil=True, error_model="numpy")
def turn(count: int, order: int, seed: int, g: float, materials: Singles, paths: Paths, at: Vertices) -> int:
    """Send paths on from their vertices; those that go on move to the front. Returns how many.

    Matt surfaces send them cosine-weighted, glossy ones also by their lobe, glass mirrors or refracts them, and fog
    turns them by its phase function (mean cosine g). order: how often the light that goes on has changed its direction,
    this vertex included.
    """
    kept = 0
    channels = paths.weight.shape[1]
    own, chance, choice = hashed(seed, _TURN + order), hashed(seed, _GO_ON + order), hashed(seed, _CHOOSE + order)
    surest = np.float32(1.0 if order < _ENDS_FROM else 0.95)
    for i in range(count):
        if at.kind[i] == NOTHING:
            continue
        number = paths.number[i]
        matter = materials[at.kind[i], 0] if at.kind[i] >= 0 else np.float32(MATT)
        scale = np.float32(1.0)
        if order >= _ROULETTE_FROM:
            bright = np.float32(0.0)
            for k in range(channels):
                kept_light = at.albedo[i, k] if matter == MATT else np.float32(1.0)
                bright = max(bright, paths.weight[i, k] * kept_light)
            likely = min(bright * np.float32(4.0), surest)
            if single(number, chance) >= likely:
                continue
            scale = np.float32(1.0) / likely
        u, v = pair(number, own)
        if matter == GLASS:
            _through_glass(i, kept, single(number, choice), scale, materials, paths, at)
        elif matter == GLOSS:
            if not _off_gloss(i, kept, single(number, choice), (u, v), scale, order == 1, materials, paths, at):
                continue
        else:
            if at.kind[i] == IN_FOG:
                cosine, away = phase_cosine(g, u), np.float32(0.0)
                nx, ny, nz = paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2]
            else:
                cosine, away = sqrt(1.0 - u), np.float32(1.0)
                nx, ny, nz = at.normal[i, 0], at.normal[i, 1], at.normal[i, 2]
            sine = np.float32(sqrt(max(1.0 - cosine * cosine, 0.0)))
            way = about(nx, ny, nz, np.float32(cosine), sine, np.float32(2.0 * pi * v))
            _go_on(i, kept, way, away, paths, at)
            for k in range(channels):
                paths.weight[kept, k] = paths.weight[i, k] * at.albedo[i, k] * scale
            plain = paths.plain[i]
            paths.plain[kept] = THROUGH_GLASS if plain == ON_SIGHT else plain
            paths.inside[kept] = paths.inside[i]
        paths.plain[kept] = _past(paths.plain[kept], at.kind[i], order, phase_cosine(g, u))
        paths.slot[kept], paths.number[kept] = paths.slot[i], number
        paths.seen[kept, 0], paths.seen[kept, 1] = paths.seen[i, 0], paths.seen[i, 1]
        kept += 1
    return kept


@njit(cache=True, nogil=True, error_model="numpy")
def _past(was: int, kind: int, order: int, cosine: float) -> int:
    """What stands in `Paths.plain` of a path from fog after one more turn, by this cosine if in fog; others stay."""
    if was not in (FROM_FOG, WIDE_IN_FOG):
        return was
    if kind != IN_FOG or was == WIDE_IN_FOG:
        return PAST_FOG
    if cosine >= SMALL_COSINE:
        return FROM_FOG
    return WIDE_IN_FOG if order == 1 else PAST_FOG


@njit(cache=True, nogil=True, error_model="numpy")
def _go_on(
    i: int, to: int, way: tuple[np.float32, np.float32, np.float32], away: np.float32, paths: Paths, at: Vertices
) -> None:
    """Path `to` leaves vertex i this way, a little off the surface: `away` 1 before it, -1 behind it, 0 in fog."""
    off = away * np.float32(1e-5) * (abs(at.point[i, 0]) + abs(at.point[i, 1]) + abs(at.point[i, 2]) + np.float32(0.01))
    for k in range(3):
        paths.origin[to, k] = at.point[i, k] + off * at.normal[i, k]
    paths.direction[to, 0], paths.direction[to, 1], paths.direction[to, 2] = way


@njit(cache=True, nogil=True, error_model="numpy")
def _through_glass(
    i: int, to: int, u: float, scale: np.float32, materials: Singles, paths: Paths, at: Vertices
) -> None:
    """Mirror or refract path i by Fresnel's share; what passes takes the glass's colour."""
    nx, ny, nz = at.normal[i, 0], at.normal[i, 1], at.normal[i, 2]
    dx, dy, dz = paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2]
    cosine = min(-(nx * dx + ny * dy + nz * dz), np.float32(1.0))
    index = materials[at.kind[i], 3]
    ratio = index if paths.inside[i] else np.float32(1.0) / index
    mirrored = fresnel(float(cosine), float(ratio))
    plain, inside = paths.plain[i], paths.inside[i]
    if u < mirrored:
        lean, stretch, away = np.float32(2.0) * cosine, np.float32(1.0), np.float32(1.0)
        if plain == ON_SIGHT and mirrored < 1.0:
            plain = THROUGH_GLASS
    else:
        behind = np.float32(sqrt(1.0 - ratio * ratio * (1.0 - cosine * cosine)))
        lean, stretch, away = ratio * cosine - behind, ratio, np.float32(-1.0)
        inside = 1 - inside
    for k in range(paths.weight.shape[1]):
        paths.weight[to, k] = paths.weight[i, k] * scale * (at.albedo[i, k] if away < 0 else np.float32(1.0))
    way = (stretch * dx + lean * nx, stretch * dy + lean * ny, stretch * dz + lean * nz)
    _go_on(i, to, way, away, paths, at)
    paths.plain[to], paths.inside[to] = plain, inside


@njit(cache=True, nogil=True, error_model="numpy")
def _off_gloss(
    i: int,
    to: int,
    u: float,
    places: tuple[float, float],
    scale: np.float32,
    first: bool,
    materials: Singles,
    paths: Paths,
    at: Vertices,
) -> bool:
    """Send path i off a glossy surface, matt or into its lobe; False where the lobe reaches into the surface."""
    nx, ny, nz = at.normal[i, 0], at.normal[i, 1], at.normal[i, 2]
    share, exponent = materials[at.kind[i], 1], materials[at.kind[i], 2]
    bright = 1e-3
    for k in range(at.albedo.shape[1]):
        bright = max(bright, float(at.albedo[i, k]))
    in_lobe = np.float32(share / (share + bright))
    turned = np.float32(2.0 * pi * places[1])
    plain = paths.plain[i]
    if u < in_lobe:
        dx, dy, dz = paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2]
        lean = np.float32(-2.0) * (nx * dx + ny * dy + nz * dz)
        cosine = float((1.0 - places[0]) ** (1.0 / (float(exponent) + 1.0)))
        sine = np.float32(sqrt(max(1.0 - cosine * cosine, 0.0)))
        way = about(dx + lean * nx, dy + lean * ny, dz + lean * nz, np.float32(cosine), sine, turned)
        up = way[0] * nx + way[1] * ny + way[2] * nz
        if up <= 0.0:
            return False
        light = scale * share * (exponent + np.float32(2.0)) / (exponent + np.float32(1.0)) * up / in_lobe
        for k in range(paths.weight.shape[1]):
            paths.weight[to, k] = paths.weight[i, k] * light
        plain = FROM_GLOSS if first and plain == BY_COLOUR else plain
    else:
        way = about(nx, ny, nz, np.float32(sqrt(1.0 - places[0])), np.float32(sqrt(places[0])), turned)
        for k in range(paths.weight.shape[1]):
            paths.weight[to, k] = paths.weight[i, k] * at.albedo[i, k] * scale / (np.float32(1.0) - in_lobe)
    _go_on(i, to, way, np.float32(1.0), paths, at)
    paths.plain[to], paths.inside[to] = THROUGH_GLASS if plain == ON_SIGHT else plain, paths.inside[i]
    return True


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
    count: int,
    materials: Singles,
    paths: Paths,
    at: Vertices,
    light: Doubles,
    rotation: Doubles,
    q: Doubles,
    rays: Singles,
    value: Singles,
) -> None:
    """How brightly the projector lights surfaces, as `render.tracing` has it: value (N, C) = albedo facing / z_p^3.

    q (N, 3): the point as x/z, y/z, z in the projector's axes, NaN where the surface turns its back on it; rays (N, 3)
    from it to the point. A lobe adds share (exponent + 2) / 2 cos^exponent to the albedo. Glass is lit by nothing, and
    what stands at the end of a line of sight is not this part's.
    """
    for i in range(count):
        q[i, 0], q[i, 1], q[i, 2] = np.nan, np.nan, -1.0
        if at.kind[i] < 0 or paths.plain[i] == ON_SIGHT or materials[at.kind[i], 0] == GLASS:
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
        shine = np.float32(0.0)
        if materials[at.kind[i], 0] == GLOSS:
            share, exponent = materials[at.kind[i], 1], materials[at.kind[i], 2]
            # The light's direction, mirrored, along the way to where the path comes from.
            dx, dy, dz = paths.direction[i, 0], paths.direction[i, 1], paths.direction[i, 2]
            lean = np.float32(2.0) * facing
            along = (x + lean * at.normal[i, 0]) * dx + (y + lean * at.normal[i, 1]) * dy
            along = -(along + (z + lean * at.normal[i, 2]) * dz) / np.sqrt(x * x + y * y + z * z)
            if along > 0.0:
                shine = share * (exponent + np.float32(2.0)) / np.float32(2.0) * np.float32(along**exponent)
        for k in range(value.shape[1]):
            value[i, k] = (at.albedo[i, k] + shine) * strength


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
def part_of_line(place: float, size: int, parts: int) -> int:
    """Which of the parts of a raster's rows or columns holds a place.

    Parts are of whole pixels: as in `blocks.BlockGrid`, part i begins with pixel floor(i size / parts).
    """
    return ((int(place) + 1) * parts - 1) // size


@njit(cache=True, nogil=True)
def deposit(
    asked: Indices,
    shaded: Bools,
    place: tuple[Singles, Singles],
    raster: tuple[int, int],
    value: Singles,
    paths: Paths,
    tables: Tables,
) -> None:
    """Add value (N, C) times the paths' weights to the tables where nothing stands before the projector.

    place: row and column (N,) of the projector, whose raster has so many rows and columns.
    """
    columns, bands, parts = tables.matt.shape[4], tables.matt.shape[1], tables.matt.shape[2]
    for n in range(asked.shape[0]):
        if shaded[n]:
            continue
        i = asked[n]
        band, part = part_of_line(place[0][i], raster[0], bands), part_of_line(place[1][i], raster[1], parts)
        r, c = paths.slot[i] // columns, paths.slot[i] % columns
        for k in range(tables.matt.shape[3]):
            light = paths.weight[i, k] * value[i, k]
            if paths.plain[i] == BY_COLOUR:
                tables.matt[r, band, part, k, c] += light
            else:
                tables.plain[r, band, part, k, c] += light


@njit(cache=True, nogil=True, error_model="numpy")
def note_nearness(count: int, paths: Paths, met: Met, nearness: Singles) -> None:
    """Add 1 / distance of what paths met next to their cells, nearness (R, W)."""
    for i in range(count):
        if met.kind[i] != NOTHING and paths.plain[i] == BY_COLOUR:
            slot = paths.slot[i]
            nearness[slot // nearness.shape[1], slot % nearness.shape[1]] += 1.0 / max(met.distance[i], 1e-6)
