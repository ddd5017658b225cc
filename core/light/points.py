"""Points for sampling: evenly spread pairs in the unit square, and scattered single numbers.

Pairs are Sobol's first two dimensions with Owen's scrambling by hashing (Laine and Karras 2011; Burley 2020, "Practical
hash-based Owen scrambling"): the pairs of any aligned run of 2^m indices hit each of the 2^m boxes of every equal
division of the square once, and each by itself is uniform. Pairs for other purposes get other seeds; these also shuffle
the index, so that they do not depend on each other.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from slopegate.core.compiled.kept import njit

_TO_UNIT: Final = 2.0**-32


@njit(cache=True, nogil=True)
def hashed(value: int | np.uint32, seed: int | np.uint32) -> np.uint32:
    """32 bits that depend on both without any visible pattern (a multiply-xorshift hash)."""
    x = np.uint32(np.uint32(value) ^ np.uint32(np.uint32(seed) * np.uint32(0x9E3779B1)))
    x = np.uint32(np.uint32(x ^ np.uint32(x >> np.uint32(16))) * np.uint32(0x7FEB352D))
    x = np.uint32(np.uint32(x ^ np.uint32(x >> np.uint32(15))) * np.uint32(0x846CA68B))
    return np.uint32(x ^ np.uint32(x >> np.uint32(16)))


@njit(cache=True, nogil=True)
def single(index: np.uint32, seed: np.uint32) -> float:
    """A number from 0 to 1, 1 excluded."""
    return float(hashed(index, seed)) * _TO_UNIT


@njit(cache=True, nogil=True)
def pair(index: np.uint32, seed: np.uint32) -> tuple[float, float]:
    """The pair of this index in the set of this seed, each from 0 to 1, 1 excluded."""
    shuffled = _reversed(_permuted(_reversed(index), hashed(seed, 1)))
    x = _reversed(_permuted(shuffled, hashed(seed, 2)))
    y = _reversed(_permuted(_pascal(shuffled), hashed(seed, 3)))
    return float(x) * _TO_UNIT, float(y) * _TO_UNIT


@njit(cache=True, nogil=True)
def _permuted(x: np.uint32, seed: np.uint32) -> np.uint32:
    """A permutation of 32-bit numbers in which no bit depends on a higher one (Laine and Karras)."""
    x = np.uint32(x + seed)
    x = np.uint32(x ^ np.uint32(x * np.uint32(0x6C50B47C)))
    x = np.uint32(x ^ np.uint32(x * np.uint32(0xB82F1E52)))
    x = np.uint32(x ^ np.uint32(x * np.uint32(0xC7AFE638)))
    return np.uint32(x ^ np.uint32(x * np.uint32(0x8D22F6E6)))


@njit(cache=True, nogil=True)
def _pascal(x: np.uint32) -> np.uint32:
    """Sobol's second dimension, least digit first: Pascal's triangle modulo 2, which is a tensor power."""
    x = np.uint32(x ^ np.uint32(np.uint32(x >> np.uint32(1)) & np.uint32(0x55555555)))
    x = np.uint32(x ^ np.uint32(np.uint32(x >> np.uint32(2)) & np.uint32(0x33333333)))
    x = np.uint32(x ^ np.uint32(np.uint32(x >> np.uint32(4)) & np.uint32(0x0F0F0F0F)))
    x = np.uint32(x ^ np.uint32(np.uint32(x >> np.uint32(8)) & np.uint32(0x00FF00FF)))
    return np.uint32(x ^ np.uint32(x >> np.uint32(16)))


@njit(cache=True, nogil=True)
def _reversed(x: np.uint32) -> np.uint32:
    """The 32 bits in the other order."""
    x = _swapped(x, np.uint32(1), np.uint32(0x55555555))
    x = _swapped(x, np.uint32(2), np.uint32(0x33333333))
    x = _swapped(x, np.uint32(4), np.uint32(0x0F0F0F0F))
    x = _swapped(x, np.uint32(8), np.uint32(0x00FF00FF))
    return _swapped(x, np.uint32(16), np.uint32(0x0000FFFF))


@njit(cache=True, nogil=True)
def _swapped(x: np.uint32, by: np.uint32, mask: np.uint32) -> np.uint32:
    """Neighbouring groups of bits exchanged."""
    return np.uint32(np.uint32(np.uint32(x >> by) & mask) | np.uint32(np.uint32(x & mask) << by))


@njit(cache=True, nogil=True)
def woven(row: int, column: int) -> int:
    """Row and column below 2^15 with their bits interleaved: near places get near numbers (Morton order)."""
    out = 0
    for bit in range(15):
        out |= ((row >> bit) & 1) << (2 * bit + 1)
        out |= ((column >> bit) & 1) << (2 * bit)
    return out
