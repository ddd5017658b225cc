"""Turns sensor counts into screen pixels: levels, demosaicing and resampling in one pass over the visible pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.shown import srgb_curve
from slopegate.core.rig.arrays import Bytes, Counts, Ints, Words

# OpenCV names a mosaic by the second row's second and third pixel
_DEMOSAIC = {
    "RGGB": cv2.COLOR_BayerBG2RGB,
    "GRBG": cv2.COLOR_BayerGB2RGB,
    "GBRG": cv2.COLOR_BayerGR2RGB,
    "BGGR": cv2.COLOR_BayerRG2RGB,
}
TABLE_SIZE = 65536
"""One entry for every value of a 16-bit count, so that no kernel needs a range check."""
NEAREST_FROM = 2.0
"""From this magnification on pixels are shown as squares; below, neighbours are mixed."""
MAX_SCALE = 64.0


@dataclass(frozen=True)
class Viewport:
    """The part of the image that a view shows: screen pixel p lies at image coordinate left + p / scale."""

    scale: float
    left: float
    top: float

    def to_image(self, x: float, y: float) -> tuple[float, float]:
        """Image column and row, continuous, at these screen coordinates."""
        return self.left + x / self.scale, self.top + y / self.scale

    def zoomed(self, factor: float, x: float, y: float, least: float) -> Viewport:
        """Magnified by `factor` (within `least`..MAX_SCALE) about the image point at screen point (x, y)."""
        scale = min(max(self.scale * factor, least), MAX_SCALE)
        column, row = self.to_image(x, y)
        return Viewport(scale, column - x / scale, row - y / scale)

    def moved(self, dx: float, dy: float) -> Viewport:
        """Moved as if the image was dragged by (dx, dy) screen pixels."""
        return replace(self, left=self.left - dx / self.scale, top=self.top - dy / self.scale)

    def held(self, image: tuple[int, int], view: tuple[int, int]) -> Viewport:
        """Moved so that the image (width, height) fills the view (width, height), or is centred where it is smaller."""

        def hold(start: float, length: int, seen: float) -> float:
            return (length - seen) / 2 if seen >= length else min(max(start, 0.0), length - seen)

        seen = (view[0] / self.scale, view[1] / self.scale)
        return replace(self, left=hold(self.left, image[0], seen[0]), top=hold(self.top, image[1], seen[1]))


def fitted(image: tuple[int, int], view: tuple[int, int]) -> Viewport:
    """The viewport in which the whole image (width, height) just fits the view (width, height)."""
    scale = min(view[0] / image[0], view[1] / image[1])
    return Viewport(scale, 0.0, 0.0).held(image, view)


def level_table(black: float, white: float, srgb: bool) -> Bytes:
    """Grey 0..255 of every count, (65536,) uint8: linear between the levels, or on the sRGB curve (IEC 61966-2-1)."""
    counts = np.arange(TABLE_SIZE, dtype=np.float64)
    level = np.clip((counts - black) / max(white - black, 1.0), 0.0, 1.0)
    if srgb:
        level = srgb_curve(level)
    return np.asarray(np.rint(level * 255.0), np.uint8)


def shade_table(levels: Bytes, ramp: Words) -> Words:
    """What the screen shows of every count, (65536,) 0xffRRGGBB: `level_table` through the 256 colours of a ramp."""
    return ramp[levels]


def demosaic(mosaic: Counts, out: Counts, filters: str = "RGGB") -> None:
    """Write bilinear RGB (H, W, 3) uint16 to `out` from a mosaic (H, W) uint16 with these filters in its first rows."""
    cv2.cvtColor(mosaic, _DEMOSAIC[filters], dst=out)


def auto_levels(
    counts: Counts, max_count: int, dark_percent: float = 0.1, bright_percent: float = 0.1
) -> tuple[int, int]:
    """Black and white levels that leave so many percent of a sample of the pixels dark, and so many bright."""
    low, high = (int(x) for x in np.percentile(counts[::8, ::8], (dark_percent, 100.0 - bright_percent)))
    low, high = min(low, max_count - 1), min(high, max_count)
    return low, max(high, low + max(max_count // 64, 1))


class Resampler:
    """Draws images into one RGB32 screen buffer; tables are rebuilt only when the viewport or the sizes change."""

    def __init__(self) -> None:
        self.screen: Words = np.zeros((1, 1), np.uint32)
        self._key: tuple[object, ...] = ()
        self._columns = self._rows = _axis(0.0, 1.0, 1, 1)

    def draw(self, image: Counts, table: Bytes | Words, viewport: Viewport, size: tuple[int, int]) -> Words:
        """The image (H, W) or (H, W, 3) as it looks through the viewport, in the buffer (height, width) 0xffRRGGBB.

        `table` is a `level_table`, or a `shade_table` for an image (H, W).
        `size` is the screen's (width, height). Screen pixels beyond the image keep 0, fully transparent.
        """
        key = (viewport, size, image.shape[:2])
        if key != self._key:
            self._key = key
            if self.screen.shape != (size[1], size[0]):
                self.screen = np.zeros((size[1], size[0]), np.uint32)
            self.screen.fill(0)
            self._columns = _axis(viewport.left, viewport.scale, size[0], image.shape[1])
            self._rows = _axis(viewport.top, viewport.scale, size[1], image.shape[0])
        grey = _draw_mono if table.dtype == np.uint8 else _draw_mapped
        kernel = grey if image.ndim == 2 else _draw_colour
        kernel(image, table, *self._columns, *self._rows, self.screen)
        return self.screen

    def mark(self, counts: Counts, ends: tuple[int, int], viewport: Viewport, tones: tuple[int, int]) -> None:
        """Colour what was drawn last where any of the pixels behind it is at most the first end or at least the last.

        counts: (H, W), raw ones of a mosaic. tones: the colours of both, 0xffRRGGBB; where both are, the last wins.
        """
        (height, width), (rows, columns) = counts.shape, self.screen.shape
        across = _footprints(viewport.left, viewport.scale, columns, width)
        down = _footprints(viewport.top, viewport.scale, rows, height)
        _mark(counts, ends[0], ends[1], *across, *down, np.uint32(tones[0]), np.uint32(tones[1]), self.screen)


def warm_up() -> None:
    """Compile, or fetch from the cache, what `Resampler` needs: seconds on the very first start."""
    table = level_table(0, 1, srgb=False)
    one, resampler = Viewport(1.0, 0.0, 0.0), Resampler()
    for shape in ((2, 2), (2, 2, 3)):
        resampler.draw(np.zeros(shape, np.uint16), table, one, (1, 1))
    resampler.draw(np.zeros((2, 2), np.uint16), np.zeros(TABLE_SIZE, np.uint32), one, (1, 1))
    resampler.mark(np.zeros((2, 2), np.uint16), (-1, 1), one, (0, 0))


def _inside(start: float, scale: float, count: int, length: int) -> tuple[int, int]:
    """First and last + 1 screen pixel whose centre lies inside the image along an axis."""
    where = start + (np.arange(count) + 0.5) / scale
    return int(np.searchsorted(where, 0.0)), int(np.searchsorted(where, float(length)))


Axis = tuple[int, int, Ints, Ints, Ints]


def _axis(start: float, scale: float, count: int, length: int) -> Axis:
    """First and last + 1 screen pixel inside the image along an axis; two texels each, the second's weight / 256."""
    where = start + (np.arange(count) + 0.5) / scale
    first, last = _inside(start, scale, count, length)
    if scale >= NEAREST_FROM:
        near = np.clip(np.floor(where), 0, length - 1).astype(np.int32)
        return first, last, near, near, np.zeros(count, np.int32)
    texel = np.clip(where - 0.5, 0.0, length - 1.0)
    near = np.floor(texel).astype(np.int32)
    weight = np.rint((texel - near) * 256).astype(np.int32)
    return first, last, near, np.minimum(near + 1, length - 1).astype(np.int32), weight


def _footprints(start: float, scale: float, count: int, length: int) -> tuple[int, int, Ints, Ints]:
    """First and last + 1 screen pixel inside the image along an axis, and of each the first and last + 1 texel."""
    edges = start + np.arange(count + 1) / scale
    first, last = _inside(start, scale, count, length)
    low = np.clip(np.floor(edges[:-1] + 1e-6), 0, length - 1).astype(np.int32)
    high = np.clip(np.ceil(edges[1:] - 1e-6), low + 1, length).astype(np.int32)
    return first, last, low, high


@njit(cache=True, nogil=True)
def _mark(
    counts: Any,
    low: int,
    high: int,
    c0: int,
    c1: int,
    ca: Any,
    cb: Any,
    r0: int,
    r1: int,
    ra: Any,
    rb: Any,
    dark: Any,
    bright: Any,
    out: Any,
) -> None:
    for r in range(r0, r1):
        for c in range(c0, c1):
            is_dark = False
            is_bright = False
            for y in range(ra[r], rb[r]):
                for x in range(ca[c], cb[c]):
                    is_bright |= counts[y, x] >= high
                    is_dark |= counts[y, x] <= low
            if is_bright:
                out[r, c] = bright
            elif is_dark:
                out[r, c] = dark


@njit(cache=True, nogil=True)
def _draw_mono(
    image: Any,
    table: Any,
    c0: int,
    c1: int,
    ca: Any,
    cb: Any,
    cw: Any,
    r0: int,
    r1: int,
    ra: Any,
    rb: Any,
    rw: Any,
    out: Any,
) -> None:
    for r in range(r0, r1):
        upper, lower = image[ra[r]], image[rb[r]]
        v = np.uint32(rw[r])
        u = np.uint32(256 - rw[r])
        target = out[r]
        for c in range(c0, c1):
            a, b = ca[c], cb[c]
            w = np.uint32(cw[c])
            x = np.uint32(256 - cw[c])
            top = np.uint32(upper[a]) * x + np.uint32(upper[b]) * w
            bottom = np.uint32(lower[a]) * x + np.uint32(lower[b]) * w
            # 16 + 8 bits fit; dropping 8 before the second product keeps it in 32 bits
            level = np.uint32(((top >> np.uint32(8)) * u + (bottom >> np.uint32(8)) * v) >> np.uint32(8))
            target[c] = np.uint32(0xFF000000) + np.uint32(0x010101) * np.uint32(table[level])


@njit(cache=True, nogil=True)
def _draw_mapped(
    image: Any,
    table: Any,
    c0: int,
    c1: int,
    ca: Any,
    cb: Any,
    cw: Any,
    r0: int,
    r1: int,
    ra: Any,
    rb: Any,
    rw: Any,
    out: Any,
) -> None:
    # apart from the grey one, which needs no words and is a tenth faster
    for r in range(r0, r1):
        upper, lower = image[ra[r]], image[rb[r]]
        v = np.uint32(rw[r])
        u = np.uint32(256 - rw[r])
        target = out[r]
        for c in range(c0, c1):
            a, b = ca[c], cb[c]
            w = np.uint32(cw[c])
            x = np.uint32(256 - cw[c])
            top = np.uint32(upper[a]) * x + np.uint32(upper[b]) * w
            bottom = np.uint32(lower[a]) * x + np.uint32(lower[b]) * w
            level = np.uint32(((top >> np.uint32(8)) * u + (bottom >> np.uint32(8)) * v) >> np.uint32(8))
            target[c] = table[level]


@njit(cache=True, nogil=True)
def _draw_colour(
    image: Any,
    table: Any,
    c0: int,
    c1: int,
    ca: Any,
    cb: Any,
    cw: Any,
    r0: int,
    r1: int,
    ra: Any,
    rb: Any,
    rw: Any,
    out: Any,
) -> None:
    for r in range(r0, r1):
        upper, lower = image[ra[r]], image[rb[r]]
        v = np.uint32(rw[r])
        u = np.uint32(256 - rw[r])
        target = out[r]
        for c in range(c0, c1):
            a, b = ca[c], cb[c]
            w = np.uint32(cw[c])
            x = np.uint32(256 - cw[c])
            colour = np.uint32(0xFF)
            for k in range(3):
                top = np.uint32(upper[a, k]) * x + np.uint32(upper[b, k]) * w
                bottom = np.uint32(lower[a, k]) * x + np.uint32(lower[b, k]) * w
                level = np.uint32(((top >> np.uint32(8)) * u + (bottom >> np.uint32(8)) * v) >> np.uint32(8))
                colour = np.uint32((colour << np.uint32(8)) + np.uint32(table[level]))
            target[c] = colour
