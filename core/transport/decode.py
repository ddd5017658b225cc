"""From frames under coded patterns to the light of each block alone: fast Walsh-Hadamard transforms.

With y = H x for light x in the matrix's columns, M its order and N blocks, patterns (1 + H) / 2 give frames
f = (y_0 + y) / 2. Where a block stands in every column, x = (2 / M) H' f, minus f_0 in column 0; H' is the transpose.
The inverse of (1 + H) / 2 is not a multiple of it.

Where column 0 stands for no block, the light is the least-squares solution. The patterns' normal matrix is then
M / 4 (1 + J) with J all ones, whose inverse is 4 / M (1 - J / (N + 1)), so

    x_j = (2 / M) (h_j + (h_0 - sum of all blocks' h) / (N + 1)),    h = H' f,

and for an S-matrix, whose frames are (y_0 - y) / 2 from row 1 on, the same with -h of the blocks and f_0 = 0. The
second term only turns noise away: in frames without noise it is 0.

Transforms run over a scratch of a few pixels that fits the cache, in float32. Single columns are off by at most 1.1e-7
of a pixel's fully lit value from float frames (all columns of 512 x 512 blocks for 3,072 pixels; tests hold 1e-6).
Frames in whole counts with 3000 fully lit bring 2.7e-4 at most, less than a count, and 4e-7 in the root mean square.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Indices, Singles
from slopegate.core.transport.codes import Codes, factor

_SCRATCH: Final = 1 << 18
"""Numbers in the scratch, 1 MB: what is transformed together stays in the second cache."""
_WIDTHS: Final = (32, 256)
"""Least and most pixels that are transformed together: fewer waste cache lines, more gain nothing."""
_CACHED: Final = 1 << 16
"""Numbers, 256 KB, below which part of the scratch is transformed by itself where all of it does not fit."""


def decode(codes: Codes, frames: Singles) -> Singles:
    """Light of each block alone, (blocks, P) float32, from counts above the dark, (count, P) float32, C-contiguous.

    In place: the result is a view of the first rows of `frames`, whose old contents are gone. Needs a scratch of 1 MB,
    or of 128 bytes a pattern where that is more, and releases the interpreter lock, so that threads decode tiles of
    pixels side by side.
    """
    if frames.ndim != 2 or frames.shape[0] != codes.count:
        raise ValueError(f"frames {frames.shape} do not fit {codes.count} patterns")
    if frames.dtype != np.float32 or not frames.flags.c_contiguous:
        raise ValueError("frames must be float32 and C-contiguous")
    if codes.kind != "impulse":
        scratch = np.zeros((codes.order, _width(codes.order)), np.float32)
        sign = np.float32(-1 if codes.kind == "s" else 1)
        small = np.ascontiguousarray(factor(codes.order).T.astype(np.float32))
        _decode(frames, codes.places(), small, sign, codes.first, codes.grid.count, scratch)
    return frames[: codes.grid.count]


def _width(order: int) -> int:
    """How many pixels are transformed together."""
    return int(np.clip(_SCRATCH // order, *_WIDTHS))


@njit(cache=True, nogil=True)
def _decode(
    frames: Singles,
    places: Indices,
    small: Singles,
    sign: np.float32,
    first: int,
    blocks: int,
    scratch: Singles,
) -> None:
    """Frames (count, P) -> light of blocks, (blocks, P), in their first rows.

    places: the row of the matrix of each frame. sign: of the matrix in the patterns. first: the column of block 0.
    """
    count, pixels = frames.shape
    order, width = scratch.shape
    scale = np.float32(2 / order)
    lit, spare = np.zeros(width, np.float32), np.zeros(width, np.float32)
    for start in range(0, pixels, width):
        across = min(width, pixels - start)
        if count < order:
            scratch[0] = 0
        for i in range(count):
            row = places[i]
            for w in range(across):
                scratch[row, w] = frames[i, start + w]
        for w in range(width):
            lit[w] = scratch[0, w]
        _transform(scratch, small)
        if first == 1:
            _spare(scratch, sign, blocks, spare)
        for j in range(blocks):
            for w in range(across):
                frames[j, start + w] = scale * (sign * scratch[first + j, w] + spare[w])
        if first == 0:
            for w in range(across):
                frames[0, start + w] -= lit[w]


@njit(cache=True, nogil=True)
def _spare(rows: Singles, sign: np.float32, blocks: int, spare: Singles) -> None:
    """The second term of the least-squares solution, times M / 2: from rows (M, width), blocks from row 1 on."""
    width = rows.shape[1]
    sums = np.zeros(width, np.float64)
    for j in range(1, blocks + 1):
        for w in range(width):
            sums[w] += rows[j, w]
    for w in range(width):
        spare[w] = (rows[0, w] - sign * sums[w]) / (blocks + 1)


@njit(cache=True, nogil=True)
def _transform(rows: Singles, small: Singles) -> None:
    """rows (M, width) -> (small x natural Hadamard) rows, in place."""
    order = rows.shape[0]
    size = small.shape[0]
    part = order // size
    if size > 1:
        _mix(rows, small, part)
    for base in range(0, order, part):
        span = part
        while span * rows.shape[1] > _CACHED and span >= 4:
            _four(rows, base, part, span)
            span //= 4
        for inner in range(base, base + part, span):
            step = span
            while step >= 4:
                _four(rows, inner, span, step)
                step //= 4
            if step == 2:
                _two(rows, inner, span)


@njit(cache=True, nogil=True)
def _mix(rows: Singles, small: Singles, part: int) -> None:
    """The small dense factor, over rows that are `part` apart."""
    size = small.shape[0]
    width = rows.shape[1]
    mixed = np.empty((size, width), np.float32)
    for b in range(part):
        mixed[:] = 0
        for i in range(size):
            for j in range(size):
                for w in range(width):
                    mixed[i, w] += small[i, j] * rows[j * part + b, w]
        for i in range(size):
            for w in range(width):
                rows[i * part + b, w] = mixed[i, w]


@njit(cache=True, nogil=True)
def _four(rows: Singles, base: int, length: int, span: int) -> None:
    """Two steps of the transform at once on rows base..base + length - 1: those span / 2 and span / 4 apart."""
    quarter, width = span // 4, rows.shape[1]
    for group in range(base, base + length, span):
        for i in range(group, group + quarter):
            for w in range(width):
                a, b = rows[i, w], rows[i + quarter, w]
                c, d = rows[i + 2 * quarter, w], rows[i + 3 * quarter, w]
                sum0, sum1, gap0, gap1 = a + b, c + d, a - b, c - d
                rows[i, w] = sum0 + sum1
                rows[i + quarter, w] = gap0 + gap1
                rows[i + 2 * quarter, w] = sum0 - sum1
                rows[i + 3 * quarter, w] = gap0 - gap1


@njit(cache=True, nogil=True)
def _two(rows: Singles, base: int, length: int) -> None:
    """The last step of the transform on neighbouring rows base..base + length - 1."""
    width = rows.shape[1]
    for i in range(base, base + length, 2):
        for w in range(width):
            a, b = rows[i, w], rows[i + 1, w]
            rows[i, w] = a + b
            rows[i + 1, w] = a - b
