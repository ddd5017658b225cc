"""Lens blur: light of neighbouring pixels in a camera's row, light of neighbouring rows on a surface point.

**Camera.** Its lens lays the light of a point over the pixels around it, a Gaussian. What lands in row k is recorded in
the window of row k, whichever row it came from: pixel (k, j) shows

    SUM over (m, n) of G(k - m, j - n) w_k(r(m, n)) direct(m, n),

w_k the weight that row k's window gives to light of projector row r. Over columns that is a plain blur, so the sum is
taken down the columns first, with the weights, and then along the rows.

**Projector.** Its lens lays the light of every row over the rows around it: a point at row coordinate r is lit by rows
r', a Gaussian about r, cut off at the raster's ends. In place of 0 or 1 a window low .. high holds a difference of
error functions of it.

Without blur none of this is called.
"""

from __future__ import annotations

from math import erf, sqrt
from typing import NamedTuple

import cv2
import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.edges import kernel_windows
from slopegate.core.exposure.kernels import TILE, Windows, tile_bounds
from slopegate.core.gating.gate import RowWindows
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig

_REACH = 5.0
"""Standard deviations beyond which the projector's blur lays no light: 3e-7 of it."""


class Lit(NamedTuple):
    """Light (H, C) and the projector row that it comes from; tile bounds (H, tiles) as in `kernels.Planes`.

    A cell may be a pixel or several of one row.
    """

    row: Singles
    light: Singles
    tile_low: Singles
    tile_high: Singles


def make_lit(row: Singles, light: Singles) -> Lit:
    """Light with its tile table; the arrays are kept, not copied. Where the light is 0 it counts as unlit."""
    low = np.empty((row.shape[0], -(-row.shape[1] // TILE)), np.float32)
    high = np.empty_like(low)
    tile_bounds(np.where(light != 0, row, np.float32(-1)), (0, len(row)), low, high)
    return Lit(row, light, low, high)


def gaussian_taps(sigma_px: float, cut: float = 4.0) -> Singles:
    """A Gaussian on whole pixels, (2 R + 1,) float32 of sum 1, R = `cut` standard deviations; [1] for none.

    From 0.65 pixels on its values there; below, three values of the same variance. The transfer up to a quarter of a
    cycle a pixel is the Gaussian's to 0.02, from 0.8 pixels on to 1e-3.
    """
    if sigma_px <= 0:
        return np.ones(1, np.float32)
    if sigma_px < 0.65:
        side = sigma_px**2 / 2
        return np.array([side, 1 - 2 * side, side], np.float32)
    reach = int(np.ceil(cut * sigma_px))
    values = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    return np.asarray(values / values.sum(), np.float32)


@njit(cache=True, nogil=True)
def _common(
    least: np.float32, greatest: np.float32, low: np.float32, high: np.float32, hit: np.float32, miss: np.float32
) -> tuple[bool, np.float32]:
    """Whether all lit cells of a tile have one weight, and which; as in `kernels`, but weights may be negative."""
    if least > greatest:
        return True, np.float32(0)
    if greatest < low or least >= high or hit == miss:
        return True, miss
    return bool(least >= low) and bool(greatest < high), hit


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def gather(lit: Lit, windows: tuple[Singles, Singles, Singles, Singles], taps: Singles, out: Singles) -> None:
    """out[k, j] += SUM over m of taps[R + k - m] weight_k(row[m, j]) light[m, j]; out (H, C), taps (2 R + 1,).

    windows: low, high, weight inside and weight outside of every row k.
    """
    row, light = lit.row, lit.light
    lows, highs, hits, misses = windows
    height, reach = out.shape[0], taps.shape[0] // 2
    for tile in range(lit.tile_low.shape[1]):
        first, last = np.uint64(tile * TILE), np.uint64(min((tile + 1) * TILE, out.shape[1]))
        for line in range(height):
            k = np.uint64(line)
            low, high, hit, miss = lows[k], highs[k], hits[k], misses[k]
            if hit == 0 and miss == 0:
                continue
            for other in range(max(line - reach, 0), min(line + reach + 1, height)):
                m = np.uint64(other)
                least, greatest = lit.tile_low[m, tile], lit.tile_high[m, tile]
                same, weight = _common(least, greatest, low, high, hit, miss)
                tap = taps[reach + line - other]
                if not same:
                    for j in range(first, last):
                        inside = (row[m, j] >= low) & (row[m, j] < high)
                        out[k, j] += tap * light[m, j] * (hit if inside else miss)
                elif weight != 0:
                    for j in range(first, last):
                        out[k, j] += tap * weight * light[m, j]


@njit(cache=True, nogil=True)
def soft_weight(row: float, low: float, high: float, hit: float, miss: float, raster: float, rows: float) -> np.float32:
    """Weight of a point at `row` that is lit by rows around it, a Gaussian of `rows` cut off at 0 and `raster`."""
    scale = 1.0 / (rows * sqrt(2.0))
    start, end = erf((0.0 - row) * scale), erf((raster - row) * scale)
    lower, upper = erf((max(low, 0.0) - row) * scale), erf((min(high, raster) - row) * scale)
    return np.float32(0.5 * (miss * (end - start) + (hit - miss) * max(upper - lower, 0.0)))


@njit(cache=True, nogil=True)
def gather_soft(
    lit: Lit,
    windows: tuple[Singles, Singles, Singles, Singles],
    taps: Singles,
    projector: tuple[float, float],
    out: Singles,
) -> None:
    """`gather` with the weights of a blurred projector: `projector` is its number of rows and its blur in rows."""
    row, light = lit.row, lit.light
    lows, highs, hits, misses = windows
    raster, rows = projector
    height, reach, margin = out.shape[0], taps.shape[0] // 2, np.float32(_REACH * rows)
    for tile in range(lit.tile_low.shape[1]):
        first, last = tile * TILE, min((tile + 1) * TILE, out.shape[1])
        for k in range(height):
            low, high, hit, miss = lows[k], highs[k], hits[k], misses[k]
            if hit == 0 and miss == 0:
                continue
            for m in range(max(k - reach, 0), min(k + reach + 1, height)):
                least, greatest = lit.tile_low[m, tile] - margin, lit.tile_high[m, tile] + margin
                if not least <= greatest:
                    continue
                same, weight = _common(least, greatest, low, high, hit, miss)
                same = same and least >= 0 and greatest <= raster
                if same and weight == 0:
                    continue
                for j in range(first, last):
                    if light[m, j] != 0:
                        share = weight if same else soft_weight(row[m, j], low, high, hit, miss, raster, rows)
                        out[k, j] += taps[reach + k - m] * share * light[m, j]


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def blur_along(plane: Singles, taps: Singles, line: Singles, out: Singles) -> None:
    """out += every row of plane (H, C) blurred by taps (2 R + 1,), nothing beyond its ends; line (C + 2 R,): spare."""
    reach, width = np.uint64(taps.shape[0] // 2), np.uint64(out.shape[1])
    line[:] = 0
    for row in range(out.shape[0]):
        k = np.uint64(row)
        for j in range(width):
            line[j + reach] = plane[k, j]
        for i in range(np.uint64(taps.shape[0])):
            tap = taps[i]
            for j in range(width):
                out[k, j] += tap * line[i + j]


def _shares(size: int, taps: Singles) -> Singles:
    """How much of a Gaussian about each of `size` pixels lies within them."""
    reach = len(taps) // 2
    return np.convolve(np.ones(size, np.float32), taps)[reach : reach + size]


def blurred(plane: Singles, sigma_px: float) -> Singles:
    """An image (H, W) or (H, W, C) behind the camera's lens: for light that does not depend on rows, as ambient light.

    Each pixel is the weighted mean of what lies in the image.
    """
    taps = gaussian_taps(sigma_px)
    if len(taps) == 1:
        return plane
    seen = cv2.sepFilter2D(plane, -1, taps, taps, borderType=cv2.BORDER_CONSTANT).reshape(plane.shape)
    shares = np.outer(_shares(plane.shape[0], taps), _shares(plane.shape[1], taps))
    return np.asarray(seen / (shares if plane.ndim == 2 else shares[:, :, None]), np.float32)


class BlurredDirect:
    """Direct light behind the blurred lenses of a rig, prepared for gate after gate."""

    def __init__(self, rig: Rig, projector_row: Singles, direct: Singles) -> None:
        """projector_row (H, W) and direct (H, W) or (H, W, C) as in `render.Buffers`."""
        self._projector = float(rig.projector.lens.height), rig.projector.blur_px
        self._taps = gaussian_taps(rig.camera.blur_px)
        self._planes = [make_lit(projector_row, np.ascontiguousarray(p)) for p in _planes(direct)]
        height, width = projector_row.shape
        self._shares = _shares(height, self._taps)[:, None] * _shares(width, self._taps)

    def add(self, windows: RowWindows, out: Singles) -> None:
        """Add to out, of the shape of `direct`, what these windows record."""
        held = weighted(kernel_windows(windows))
        for lit, plane in zip(self._planes, _planes(out), strict=True):  # views: adding to one adds to out
            down, found = np.zeros_like(lit.light), np.zeros_like(lit.light)
            gather_rows(lit, held, self._taps, self._projector, down)
            line = np.empty(down.shape[1] + len(self._taps) - 1, np.float32)
            blur_along(down, self._taps, line, found)
            np.add(plane, found / self._shares, out=plane)


def weighted(windows: Windows) -> tuple[Singles, Singles, Singles, Singles]:
    """Windows as `gather` takes them."""
    return windows.low, windows.high, windows.inside.astype(np.float32), windows.outside.astype(np.float32)


def gather_rows(
    lit: Lit,
    windows: tuple[Singles, Singles, Singles, Singles],
    taps: Singles,
    projector: tuple[float, float],
    out: Singles,
) -> None:
    """`gather`, or `gather_soft` where the projector (its number of rows, its blur) is blurred."""
    if projector[1] > 0:
        gather_soft(lit, windows, taps, projector, out)
    else:
        gather(lit, windows, taps, out)


def _planes(image: Singles) -> list[Singles]:
    """The channels of an image, as views."""
    return [image] if image.ndim == 2 else [image[:, :, c] for c in range(image.shape[2])]
