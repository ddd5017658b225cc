"""The loops that run per frame or per pixel, compiled; nothing else.

Every kernel fills arrays that it is given, allocates nothing and releases the interpreter lock. Tiles are runs of TILE
pixels of one camera row: one whose projector rows all lie on the same side of the window's edges needs no comparison,
and one of weight 0 is not read at all. Tiles of equal weight are done in one go.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

TILE: Final = 64

_MIXED: Final = -1

Singles = NDArray[np.float32]


class Windows(NamedTuple):
    """`gate.RowWindows` of H camera rows with float32 edges, rounded as `windows.kernel_windows` does."""

    low: Singles
    high: Singles
    inside: NDArray[np.int32]
    outside: NDArray[np.int32]


class Planes(NamedTuple):
    """What the camera's pixels see, (H, W), and the least and greatest lit projector row of each tile (H, tiles).

    direct and ambient are float32 for `gate` and uint16 for `expose`.
    """

    projector_row: Singles
    direct: NDArray[np.float32] | NDArray[np.uint16]
    ambient: NDArray[np.float32] | NDArray[np.uint16]
    tile_low: Singles
    tile_high: Singles


class Response(NamedTuple):
    """A sensor's arithmetic, float32, in counts: what a step of the planes and a unit of variance are worth."""

    direct_step: np.float32
    ambient_step: np.float32
    variance_per_count: np.float32
    read_variance: np.float32
    offset: np.float32
    max_count: np.float32


class Noise(NamedTuple):
    """Normals in whole steps, the size of a step, and the number that decides where each row starts to read."""

    pool: NDArray[np.int16]
    step: np.float32
    seed: np.uint64


class _Line(NamedTuple):
    """Pixels of one row that share a weight, or that are _MIXED; one-dimensional views."""

    row: Singles
    light: NDArray[np.uint16]
    room: NDArray[np.uint16]
    normal: NDArray[np.int16]
    target: NDArray[np.uint16]


class _Edges(NamedTuple):
    low: np.float32
    high: np.float32
    hit: np.float32
    miss: np.float32


@njit(cache=True, nogil=True)
def tile_bounds(projector_row: Singles, rows: tuple[int, int], tile_low: Singles, tile_high: Singles) -> None:
    """Fill the tile bounds of camera rows rows[0]..rows[1] - 1 from projector_row (H, W).

    Unlit pixels (below 0) are left out: whatever their weight, they add nothing. A tile without lit pixels gets
    low = +inf, high = -inf.
    """
    width = projector_row.shape[1]
    for k in range(rows[0], rows[1]):
        for tile in range(tile_low.shape[1]):
            low, high = np.float32(np.inf), np.float32(-np.inf)
            for j in range(tile * TILE, min(width, (tile + 1) * TILE)):
                row = projector_row[k, j]
                low = min(low, row if row >= 0 else np.float32(np.inf))
                high = max(high, row if row >= 0 else np.float32(-np.inf))
            tile_low[k, tile] = low
            tile_high[k, tile] = high


@njit(cache=True, nogil=True)
def _tile_weight(planes: Planes, windows: Windows, k: int, tile: int) -> int:
    """The weight that all lit pixels of a tile share, or _MIXED."""
    least, greatest = planes.tile_low[k, tile], planes.tile_high[k, tile]
    low, high, inside, outside = windows.low[k], windows.high[k], windows.inside[k], windows.outside[k]
    if least > greatest:
        return 0
    if inside == outside or greatest < low or least >= high:
        return int(outside)
    if least >= low and greatest < high:
        return int(inside)
    return _MIXED


@njit(cache=True, nogil=True)
def _run(planes: Planes, windows: Windows, k: int, tile: int) -> tuple[int, int]:
    """The weight at this tile, and the first tile after it whose weight differs."""
    weight = _tile_weight(planes, windows, k, tile)
    end = tile + 1
    while end < planes.tile_low.shape[1] and _tile_weight(planes, windows, k, end) == weight:
        end += 1
    return weight, end


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def gate(planes: Planes, windows: Windows, exposure_periods: np.float32, out: Singles) -> int:
    """out = weight * direct + exposure_periods * ambient, all (H, W); returns how many pixels' light was not read.

    Without exposure_periods (0) the ambient is not read either.
    """
    height, width = out.shape
    skipped = 0
    for k in range(height):
        low, high = windows.low[k], windows.high[k]
        hit, miss = np.float32(windows.inside[k]), np.float32(windows.outside[k])
        tile = 0
        while tile < planes.tile_low.shape[1]:
            weight, end = _run(planes, windows, k, tile)
            a, b = tile * TILE, min(end * TILE, width)
            row, light, target = planes.projector_row[k, a:b], planes.direct[k, a:b], out[k, a:b]
            room = planes.ambient[k, a:b]
            scale = np.float32(weight)
            if weight == 0:
                skipped += b - a
                if exposure_periods == 0:
                    target[:] = 0
                else:
                    for j in range(target.size):
                        target[j] = exposure_periods * room[j]
            elif exposure_periods == 0:
                for j in range(target.size):
                    factor = hit if (row[j] >= low) & (row[j] < high) else miss
                    target[j] = light[j] * (factor if weight == _MIXED else scale)
            else:
                for j in range(target.size):
                    factor = hit if (row[j] >= low) & (row[j] < high) else miss
                    factor = factor if weight == _MIXED else scale
                    target[j] = light[j] * factor + exposure_periods * room[j]
            tile = end
    return skipped


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def expose(planes: Planes, windows: Windows, response: Response, noise: Noise, out: NDArray[np.uint16]) -> int:
    """One noisy frame (H, W) in counts; returns how many pixels' direct light was not read.

    mean = weight * direct_step * direct + ambient_step * ambient; out = mean + sqrt(variance_per_count * mean +
    read_variance) * normal + offset, cut to 0..max_count, rounded down (so offset is the black level + 1/2). The
    normals of row k are pool[o:o + W] * +-step, with o and the sign hashed from seed + k. The ambient is not read where
    ambient_step is 0.
    """
    height, width = out.shape
    places = np.uint64(noise.pool.size - width)
    skipped = 0
    for k in range(height):
        bits = hash64(noise.seed + np.uint64(k))
        start = (bits >> np.uint64(33)) % places
        step = noise.step if bits & np.uint64(1) else -noise.step
        edges = _Edges(
            windows.low[k],
            windows.high[k],
            np.float32(windows.inside[k]) * response.direct_step,
            np.float32(windows.outside[k]) * response.direct_step,
        )
        tile = 0
        while tile < planes.tile_low.shape[1]:
            weight, end = _run(planes, windows, k, tile)
            a, b = tile * TILE, min(end * TILE, width)
            line = _Line(
                planes.projector_row[k, a:b],
                planes.direct[k, a:b],
                planes.ambient[k, a:b],
                noise.pool[start + np.uint64(a) : start + np.uint64(b)],
                out[k, a:b],
            )
            if weight == _MIXED:
                _expose_mixed(line, edges, response, step)
            elif weight != 0:
                _expose_even(line, np.float32(weight) * response.direct_step, response, step)
            else:
                skipped += b - a
                _expose_dark(line, response, step)
            tile = end
    return skipped


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _expose_mixed(line: _Line, edges: _Edges, response: Response, step: np.float32) -> None:
    row, light, room, normal, target = line
    for j in range(target.size):
        scale = edges.hit if (row[j] >= edges.low) & (row[j] < edges.high) else edges.miss
        mean = scale * np.float32(light[j]) + response.ambient_step * np.float32(room[j])
        target[j] = _count(mean, step * np.float32(normal[j]), response)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _expose_even(line: _Line, scale: np.float32, response: Response, step: np.float32) -> None:
    _, light, room, normal, target = line
    for j in range(target.size):
        mean = scale * np.float32(light[j]) + response.ambient_step * np.float32(room[j])
        target[j] = _count(mean, step * np.float32(normal[j]), response)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _expose_dark(line: _Line, response: Response, step: np.float32) -> None:
    _, _, room, normal, target = line
    if response.ambient_step == 0:
        for j in range(target.size):
            target[j] = _count(np.float32(0), step * np.float32(normal[j]), response)
    else:
        for j in range(target.size):
            mean = response.ambient_step * np.float32(room[j])
            target[j] = _count(mean, step * np.float32(normal[j]), response)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _count(mean: np.float32, normal: np.float32, response: Response) -> np.uint16:
    spread = np.sqrt(response.variance_per_count * mean + response.read_variance)
    value = mean + spread * normal + response.offset
    return np.uint16(np.int32(min(max(value, np.float32(0)), response.max_count)))


@njit(cache=True, nogil=True)
def hash64(value: np.uint64) -> np.uint64:
    """64 well-mixed bits of a counter: splitmix64's output function (Steele, Lea and Flood 2014)."""
    value = np.uint64(value) * np.uint64(0x9E3779B97F4A7C15)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))
