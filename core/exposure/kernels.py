"""The compiled loops that run for every frame: gating, counts with noise, luminance, fixed-point planes.

`gate` and `expose` repeat the law of `gating.gate.recorded_times` for speed: low <= r < high counts `inside` times, any
other lit row `outside` times. tests/core/exposure/test_kernels.py holds them to it, bit for bit.

Every kernel fills arrays that it is given, allocates nothing and releases the interpreter lock. Tiles are runs of TILE
pixels of one camera row: one whose projector rows all lie on the same side of the window's edges needs no comparison,
and one of weight 0 is not read at all. Every loop rounds each operation alike, so a pixel's value is the same to the
last bit whatever is known of its tile. Arrays are indexed whole and with unsigned numbers: a view of a row costs atomic
reference counts, a signed index a test that hinders vector code.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Counts, Ints, Singles

TILE: Final = 64

_MIXED: Final = np.float32(-1)
"""Stands for a tile whose pixels have to be compared one by one; weights are never negative."""

Pixels = Singles | Counts


class Windows(NamedTuple):
    """`gate.RowWindows` of H camera rows with float32 edges, rounded up (`edges.kernel_windows`)."""

    low: Singles
    high: Singles
    inside: Ints
    outside: Ints


class Planes(NamedTuple):
    """What the camera's pixels see, (H, W), and what is known of its tiles, (H, tiles).

    direct and ambient are float32 for `gate` and uint16 for `expose`. tile_low and tile_high are the least and greatest
    lit projector row.
    """

    projector_row: Singles
    direct: Pixels
    ambient: Pixels
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
                # Written without a branch, so that it becomes vector code.
                low = min(low, row if row >= 0 else np.float32(np.inf))
                high = max(high, row if row >= 0 else np.float32(-np.inf))
            tile_low[k, tile] = low
            tile_high[k, tile] = high


@njit(cache=True, nogil=True)
def _shared_weight(
    least: np.float32, greatest: np.float32, low: np.float32, high: np.float32, hit: np.float32, miss: np.float32
) -> np.float32:
    """Which of the two weights, or 0, all lit pixels of a tile share, or _MIXED. With least < 0 nothing is known.

    Numbers only: a call with arrays in a tuple counts references.
    """
    if least > greatest:  # nothing lit in it
        return np.float32(0)
    if least < 0:
        return _MIXED
    if greatest < low or least >= high or hit == miss:
        return miss
    return hit if least >= low and greatest < high else _MIXED


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def gate(planes: Planes, windows: Windows, exposure_periods: np.float32, out: Singles) -> int:
    """out = weight * direct + exposure_periods * ambient, all (H, W); returns how many pixels' light was not read.

    Without exposure_periods (0) the ambient is not read either.
    """
    row, light, room = planes.projector_row, planes.direct, planes.ambient
    skipped = 0
    for line in range(out.shape[0]):
        k = np.uint64(line)
        low, high = windows.low[k], windows.high[k]
        hit, miss = np.float32(windows.inside[k]), np.float32(windows.outside[k])
        for tile in range(planes.tile_low.shape[1]):
            first, last = np.uint64(tile * TILE), np.uint64(min((tile + 1) * TILE, out.shape[1]))
            least, greatest = planes.tile_low[k, tile], planes.tile_high[k, tile]
            weight = _shared_weight(least, greatest, low, high, hit, miss)
            # Three loops in place of one with branches: each is a straight run that the compiler turns into vector
            # code.
            if weight == _MIXED:
                for j in range(first, last):
                    out[k, j] = light[k, j] * (hit if (row[k, j] >= low) & (row[k, j] < high) else miss)
            elif weight != 0:
                for j in range(first, last):
                    out[k, j] = light[k, j] * weight
            else:
                skipped += int(last - first)
                for j in range(first, last):
                    out[k, j] = 0
        # A pass of its own, while the row is still in the cache: without ambient light it falls away.
        if exposure_periods != 0:
            for j in range(np.uint64(0), np.uint64(out.shape[1])):
                out[k, j] += exposure_periods * room[k, j]
    return skipped


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def expose(planes: Planes, windows: Windows, response: Response, noise: Noise, out: Counts) -> int:
    """One noisy frame (H, W) in counts; returns how many pixels' direct light was not read.

    mean = weight * direct_step * direct + ambient_step * ambient; out = mean + sqrt(variance_per_count * mean +
    read_variance) * normal + offset, cut to 0..max_count, rounded down (so offset is the black level + 1/2). The
    normals of row k are pool[o:o + W] * +-step, with o and the sign hashed from seed + k. The ambient is not read where
    ambient_step is 0.
    """
    row, light, room, normal = planes.projector_row, planes.direct, planes.ambient, noise.pool
    ambient_step = response.ambient_step
    # The pool repeats its beginning at its end (`sensor.NoisePool`), so a row may start anywhere before that.
    places = np.uint64(normal.size - out.shape[1])
    skipped = 0
    for line in range(out.shape[0]):
        k = np.uint64(line)
        # Rows read the same pool from random places, half of them with the sign turned: drawing normals anew for every
        # pixel would cost more than all else in this loop.
        bits = hash64(noise.seed + k)
        start = (bits >> np.uint64(33)) % places
        step = noise.step if bits & np.uint64(1) else -noise.step
        low, high = windows.low[k], windows.high[k]
        hit = np.float32(windows.inside[k]) * response.direct_step
        miss = np.float32(windows.outside[k]) * response.direct_step
        for tile in range(planes.tile_low.shape[1]):
            first, last = np.uint64(tile * TILE), np.uint64(min((tile + 1) * TILE, out.shape[1]))
            least, greatest = planes.tile_low[k, tile], planes.tile_high[k, tile]
            weight = _shared_weight(least, greatest, low, high, hit, miss)
            if weight == _MIXED:
                for j in range(first, last):
                    scale = hit if (row[k, j] >= low) & (row[k, j] < high) else miss
                    mean = scale * np.float32(light[k, j]) + ambient_step * np.float32(room[k, j])
                    out[k, j] = _count(mean, step * np.float32(normal[start + j]), response)
            elif weight != 0:
                for j in range(first, last):
                    mean = weight * np.float32(light[k, j]) + ambient_step * np.float32(room[k, j])
                    out[k, j] = _count(mean, step * np.float32(normal[start + j]), response)
            elif ambient_step != 0:
                # A tile that the gate cannot light: its direct light, half of what the loop reads, stays unread.
                skipped += int(last - first)
                for j in range(first, last):
                    mean = ambient_step * np.float32(room[k, j])
                    out[k, j] = _count(mean, step * np.float32(normal[start + j]), response)
            else:
                skipped += int(last - first)
                for j in range(first, last):
                    out[k, j] = _count(np.float32(0), step * np.float32(normal[start + j]), response)
    return skipped


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def _count(mean: np.float32, normal: np.float32, response: Response) -> np.uint16:
    """Counts of one pixel from its mean and a normal in standard deviations, both in counts."""
    spread = np.sqrt(response.variance_per_count * mean + response.read_variance)
    value = mean + spread * normal + response.offset
    # Cut before the conversion: beyond its range a whole number wraps round. By way of int32, which vector code can do.
    return np.uint16(np.int32(min(max(value, np.float32(0)), response.max_count)))


@njit(cache=True, nogil=True)
def hash64(value: np.uint64) -> np.uint64:
    """64 well-mixed bits of a counter: splitmix64's output function (Steele, Lea and Flood 2014)."""
    value = np.uint64(value) * np.uint64(0x9E3779B97F4A7C15)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@njit(cache=True, nogil=True)
def luminance(rgb: Singles, weights: Singles, out: Singles) -> None:
    """out (h, w) = the weighted sum of the channels of rgb (h, w, 3), from the first to the last."""
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[k, j] = rgb[k, j, 0] * weights[0] + rgb[k, j, 1] * weights[1] + rgb[k, j, 2] * weights[2]


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def to_steps(values: Singles, scale: np.float32, top: int, left: int, out: Pixels) -> None:
    """Write values (h, w) times scale, rounded and cut at 65535, into `out` from row `top` and column `left` on."""
    most = np.float32(65535)
    for k in range(values.shape[0]):
        line, target = values[k], out[top + k, left : left + values.shape[1]]
        for j in range(line.shape[0]):
            # By way of int32, which vector code can do: ten times as fast.
            target[j] = np.uint16(np.int32(np.rint(min(line[j] * scale, most))))
