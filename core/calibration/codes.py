"""Which place of the projector lights each pixel of a camera, to a fraction of the projector's pixels, by Gray code.

Every bit is shown as a pattern and as its inverse. A bit is taken where the difference of the two stands out of the
noise and of the light that comes round by other ways (direct and global light after Nayar et al. 2006; the rules of Xu
and Aliaga 2007). Neighbours differ in one bit of a Gray code, so that a pixel whose one bit is in doubt lies on the
border of two neighbours: that is a place too, and a more exact one. Where the finest stripes are not resolved, the
code is read without them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import prange

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Bools, Bytes, Counts, Doubles, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster, gray_bits

SIGMAS: Final = 4.0
"""By how many standard deviations of the noise a difference has to stand out."""
DOUBT: Final = 0.25
"""A bit is in doubt where its difference is below this share of the direct light."""
MOST_LOST: Final = 2
"""Finest bits that a place may lack; it is then known to 2 or 4 pixels, and a corner from hundreds of places."""
FINE_PX: Final = 16
"""Stripes up to this width tell direct and global light apart: wider ones leave the neighbourhood half lit."""

IN_DOUBT: Final = -1.0
BEYOND: Final = -2.0


@dataclass(frozen=True)
class CodeOrder:
    """Where the frames of a sequence stand: first frame of the columns' pairs and of the rows', white and black.

    Pairs are a pattern and its inverse, coarsest bit first.
    """

    raster: Raster
    first_column: int
    first_row: int
    white: int
    black: int

    @property
    def bits(self) -> tuple[int, int]:
        """How many bits columns and rows have."""
        return gray_bits(self.raster, "columns"), gray_bits(self.raster, "rows")

    @property
    def count(self) -> int:
        """How many frames there are in all."""
        return 2 + 2 * sum(self.bits)


def white_last(raster: Raster) -> CodeOrder:
    """Columns, rows, white, black: the order of OpenCV's own patterns and of most captures."""
    bits = gray_bits(raster, "columns")
    return CodeOrder(
        raster, 0, 2 * bits, 2 * (bits + gray_bits(raster, "rows")), 2 * (bits + gray_bits(raster, "rows")) + 1
    )


def white_first(raster: Raster) -> CodeOrder:
    """White, black, columns, rows: the order of `transport.gray`."""
    return CodeOrder(raster, 2, 2 + 2 * gray_bits(raster, "columns"), 0, 1)


@dataclass(frozen=True, eq=False)
class Decoded:
    """What the code tells of each pixel.

    place (H, W, 2) float32: continuous column and row of the projector, NaN where there is no light or a bit too many
    is in doubt. direct (H, W) float32: the light straight from the projector, counts. noise (H, W) float32: standard
    deviation of the difference of two frames, counts. contrast (2, bits) float64: mean difference of each bit's pair as
    a share of the direct light, columns and rows, NaN beyond an axis' own bits; what the finest lack tells the
    projector's blur.
    """

    place: Singles
    direct: Singles
    noise: Singles
    contrast: Doubles
    beyond: Bools


def decode(order: CodeOrder, frames: Bytes | Counts) -> Decoded:
    """Decode frames (count, H, W) uint8 or uint16 of a sequence. Raises InputError where they are not as many."""
    if frames.ndim != 3 or frames.shape[0] != order.count:
        columns, rows = order.bits
        raise InputError(
            f"the sequence has {len(frames)} frames: a projector of {order.raster} pixels needs {order.count} "
            f"({columns} pairs for columns, {rows} for rows, white and black)"
        )
    shape = frames.shape[1:]
    place = np.empty((*shape, 2), np.float32)
    direct, noise = np.empty(shape, np.float32), np.empty(shape, np.float32)
    beyond = np.zeros(shape, np.bool_)
    sums = np.zeros((shape[0], 2, max(order.bits)))
    lit = np.zeros(shape[0])
    firsts, sizes = (order.first_column, order.first_row), (order.raster.width, order.raster.height)
    _decode(frames, firsts, order.bits, sizes, (order.white, order.black), place, direct, noise, beyond, sums, lit)
    total = float(lit.sum())
    contrast = sums.sum(axis=0) / total if total > 0 else np.full(sums.shape[1:], np.nan)
    for axis, bits in enumerate(order.bits):
        contrast[axis, bits:] = np.nan
    return Decoded(place, direct, noise, contrast, beyond)


@njit(cache=True, nogil=True, parallel=True)
def _decode(
    frames: Bytes | Counts,
    firsts: tuple[int, int],
    bits: tuple[int, int],
    sizes: tuple[int, int],
    even: tuple[int, int],
    place: Singles,
    direct: Singles,
    noise: Singles,
    beyond: Bools,
    sums: Doubles,
    lit: Doubles,
) -> None:
    """Fill place (H, W, 2), direct and noise (H, W); add the differences of valid pixels up by rows of the image."""
    for y in prange(direct.shape[0]):
        for x in range(direct.shape[1]):
            own, around, deviation = _light(frames, firsts, bits, sizes, even, y, x)
            direct[y, x], noise[y, x] = own, deviation
            place[y, x, 0] = place[y, x, 1] = np.nan
            if own <= SIGMAS * deviation or own < 1:
                continue
            column = _number(frames, firsts[0], bits[0], sizes[0], own, around, deviation, y, x)
            row = _number(frames, firsts[1], bits[1], sizes[1], own, around, deviation, y, x)
            if column < 0 or row < 0:
                beyond[y, x] = BEYOND in (column, row)
                continue
            place[y, x, 0], place[y, x, 1] = column, row
            lit[y] += own
            for axis in range(2):
                for bit in range(bits[axis]):
                    k = firsts[axis] + 2 * bit
                    sums[y, axis, bit] += abs(float(frames[k, y, x]) - float(frames[k + 1, y, x]))


@njit(cache=True, nogil=True)
def _light(
    frames: Bytes | Counts,
    firsts: tuple[int, int],
    bits: tuple[int, int],
    sizes: tuple[int, int],
    even: tuple[int, int],
    y: int,
    x: int,
) -> tuple[float, float, float]:
    """Direct and global light of a pixel, and the noise of a difference of two frames.

    Under fine stripes half of the global light arrives, whether the pixel itself is lit or not: lit it has direct +
    global / 2, unlit global / 2. A blurred projector never shows the finest stripes in full: the largest and the
    smallest over all fine pairs count. Pattern and inverse always add up to white and black: what they miss is noise.
    """
    black = float(frames[even[1], y, x])
    white = float(frames[even[0], y, x])
    total, squares, pairs = white + black, (white + black) ** 2, 1
    most, least = 0.0, 1e9
    for axis in range(2):
        for bit in range(bits[axis]):
            k = firsts[axis] + 2 * bit
            one, other = float(frames[k, y, x]), float(frames[k + 1, y, x])
            total += one + other
            squares += (one + other) ** 2
            pairs += 1
            if 1 << (bits[axis] - bit) <= FINE_PX or bits[axis] - bit <= 2:
                most = max(most, one, other)
                least = min(least, one, other)
    variance = max(squares - total * total / pairs, 0.0) / (pairs - 1)
    return most - least, 2 * max(least - black, 0.0), np.sqrt(variance) + 0.3


@njit(cache=True, nogil=True)
def _number(
    frames: Bytes | Counts,
    first: int,
    bits: int,
    size: int,
    own: float,
    around: float,
    deviation: float,
    y: int,
    x: int,
) -> float:
    """The place along one axis, in pixels of the projector; IN_DOUBT where the code does not tell, BEYOND the last.

    The finest stripes, which a blurred projector does not resolve, may be in doubt: the code is then read without them.
    """
    # where less arrives directly than by other ways, a wide stripe beside a pixel can outshine its own
    least = max(DOUBT * own, SIGMAS * deviation + max(around - own, 0.0))
    kept = bits
    while kept > 1 and abs(_gap(frames, first, kept - 1, y, x)) < least:
        kept -= 1
    if bits - kept > MOST_LOST:
        return IN_DOUBT
    number, other, bit, other_bit, doubts = 0, 0, 0, 0, 0
    for i in range(kept):
        gap = _gap(frames, first, i, y, x)
        flip = 1 if gap > 0 else 0
        bit ^= flip
        if abs(gap) < least:
            doubts += 1
            other_bit ^= 1 - flip
        else:
            other_bit ^= flip
        number = 2 * number + bit
        other = 2 * other + other_bit
    step = 1 << (bits - kept)
    if doubts == 0:
        start = number * step
        return 0.5 * (start + min(start + step, size)) if start < size else BEYOND
    border = max(number, other) * step
    if doubts > 1 or abs(number - other) != 1 or border >= size:
        return IN_DOUBT
    return float(border)


@njit(cache=True, nogil=True)
def _gap(frames: Bytes | Counts, first: int, bit: int, y: int, x: int) -> float:
    """Pattern less inverse of a bit."""
    return float(frames[first + 2 * bit, y, x]) - float(frames[first + 2 * bit + 1, y, x])
