"""Frame kernels for comparison only: soft edges in place of the hard ones of `core.exposure.kernels`.

Like those they skip tiles, and round alike whatever is known of a tile: only tiles that an edge crosses cost more than
in the program's own kernel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.kernels import TILE, Noise, Planes, Response, Windows, hash64
from slopegate.core.rig.arrays import Counts, Singles

Single = np.float32


class RayStack(NamedTuple):
    """S rays a pixel, one below the other: rows (H, S, W) float32 and direct (H, S, W) uint16, sorted by camera row so
    that a frame reads them in order, and their mean light (H, W) uint16."""

    rows: Singles
    direct: Counts
    mean: Counts


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def _weight(least: Single, greatest: Single, low: Single, high: Single, hit: Single, miss: Single) -> Single:
    """The weight that all projector rows from least to greatest share; -1 where an edge lies between them."""
    if least > greatest:
        return np.float32(0)
    if greatest < low or least >= high or hit == miss:
        return miss
    return hit if least >= low and greatest < high else np.float32(-1)


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def _count(mean: Single, normal: Single, response: Response) -> np.uint16:
    spread = np.sqrt(response.variance_per_count * mean + response.read_variance)
    value = mean + spread * normal + response.offset
    return np.uint16(np.int32(min(max(value, np.float32(0)), response.max_count)))


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def expose_trapezoid(
    planes: Planes, footprint: np.float32, windows: Windows, response: Response, noise: Noise, out: Counts
) -> None:
    """`core.exposure.kernels.expose` with edges as ramps: a pixel covers `footprint` projector rows about its own.

    Its weight is the share of them within the window; exact for the area of a frontal surface, which is as tall.
    """
    row, light, room = planes.projector_row, planes.direct, planes.ambient
    half, steep = footprint / 2, np.float32(1) / footprint
    places = np.uint64(noise.pool.size - out.shape[1])
    for line in range(out.shape[0]):
        k = np.uint64(line)
        bits = hash64(noise.seed + k)
        start = (bits >> np.uint64(33)) % places
        step = noise.step if bits & np.uint64(1) else -noise.step
        low, high = windows.low[line], windows.high[line]
        hit, miss = np.float32(windows.inside[line]), np.float32(windows.outside[line])
        for tile in range(planes.tile_low.shape[1]):
            least, greatest = planes.tile_low[line, tile] - half, planes.tile_high[line, tile] + half
            shared = _weight(least, greatest, low, high, hit, miss)
            for j in range(np.uint64(tile * TILE), np.uint64(min((tile + 1) * TILE, out.shape[1]))):
                weight = shared
                if shared < 0:
                    upper = min(max((high - row[k, j]) * steep + np.float32(0.5), np.float32(0)), np.float32(1))
                    lower = min(max((low - row[k, j]) * steep + np.float32(0.5), np.float32(0)), np.float32(1))
                    weight = miss + (hit - miss) * (upper - lower)
                mean = weight * response.direct_step * np.float32(light[k, j])
                mean += response.ambient_step * np.float32(room[k, j])
                out[k, j] = _count(mean, step * np.float32(noise.pool[start + j]), response)


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def expose_subrows(
    planes: Planes, stack: RayStack, windows: Windows, response: Response, noise: Noise, sums: Singles, out: Counts
) -> None:
    """`core.exposure.kernels.expose` with the S rays of a stack in each pixel; `sums` (W,) is room for one row.

    planes: the tile table holds the bounds of all rays, and ambient is what it always is; the rest is not read.
    """
    rows, light, room = stack.rows, stack.direct, planes.ambient
    count = rows.shape[1]
    share = np.float32(1.0 / count)
    places = np.uint64(noise.pool.size - out.shape[1])
    for line in range(out.shape[0]):
        k = np.uint64(line)
        bits = hash64(noise.seed + k)
        start = (bits >> np.uint64(33)) % places
        step = noise.step if bits & np.uint64(1) else -noise.step
        low, high = windows.low[line], windows.high[line]
        hit, miss = np.float32(windows.inside[line]), np.float32(windows.outside[line])
        for tile in range(planes.tile_low.shape[1]):
            first, last = np.uint64(tile * TILE), np.uint64(min((tile + 1) * TILE, out.shape[1]))
            shared = _weight(planes.tile_low[line, tile], planes.tile_high[line, tile], low, high, hit, miss)
            if shared >= 0:
                for j in range(first, last):
                    sums[j] = shared * np.float32(stack.mean[k, j])
            else:
                for j in range(first, last):
                    sums[j] = 0
                for s in range(np.uint64(0), np.uint64(count)):
                    for j in range(first, last):
                        within = (rows[k, s, j] >= low) & (rows[k, s, j] < high)
                        sums[j] += np.float32(light[k, s, j]) * (share * (hit if within else miss))
            for j in range(first, last):
                mean = response.direct_step * sums[j] + response.ambient_step * np.float32(room[k, j])
                out[k, j] = _count(mean, step * np.float32(noise.pool[start + j]), response)


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def expose_hashed(planes: Planes, windows: Windows, response: Response, seed: np.uint64, out: Counts) -> None:
    """`core.exposure.kernels.expose` without tiles, and with noise drawn anew for every pixel from a hash of its place.

    The normal is the sum of four uniform 16-bit numbers, scaled to variance 1: its excess kurtosis is -0.3.
    """
    row, light, room = planes.projector_row, planes.direct, planes.ambient
    scale = np.float32(np.sqrt(3.0) / 65536.0)
    width = np.uint64(out.shape[1])
    for line in range(out.shape[0]):
        k = np.uint64(line)
        low, high = windows.low[line], windows.high[line]
        hit = np.float32(windows.inside[line]) * response.direct_step
        miss = np.float32(windows.outside[line]) * response.direct_step
        for j in range(np.uint64(0), width):
            bits = hash64(seed + k * width + j)
            total = (bits & np.uint64(65535)) + ((bits >> np.uint64(16)) & np.uint64(65535))
            total += ((bits >> np.uint64(32)) & np.uint64(65535)) + (bits >> np.uint64(48))
            normal = (np.float32(total) - np.float32(131070.0)) * scale
            weight = hit if (row[k, j] >= low) & (row[k, j] < high) else miss
            out[k, j] = _count(
                weight * np.float32(light[k, j]) + response.ambient_step * np.float32(room[k, j]), normal, response
            )
