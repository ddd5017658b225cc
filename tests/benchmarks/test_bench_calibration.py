"""Decoding 42 frames of 1600 x 1200: Gray code of a projector of 1024 x 768 pixels, with its noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from slopegate.core.calibration.codes import decode, white_last
from slopegate.core.rig.patterns import Raster, gray_code

SHAPE = 1200, 1600
BUDGET = "2 s"
ROUNDS = 12


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    """Two camera pixels and a little for every pixel of the projector, with 2 counts of noise."""
    order, rng = white_last(Raster(1024, 768)), np.random.default_rng(0)
    rows, columns = (np.arange(n) * 0.61 for n in SHAPE)
    found = np.empty((order.count, *SHAPE), np.uint8)
    for first, axis, bits in zip((order.first_column, order.first_row), ("columns", "rows"), order.bits, strict=True):
        for bit in range(bits):
            pattern = gray_code(order.raster, axis, bit)[np.ix_(rows.astype(int), columns.astype(int))] / 255
            for k, light in enumerate((pattern, 1 - pattern)):
                found[first + 2 * bit + k] = np.clip(20 + 150 * light + rng.normal(0, 2, SHAPE), 0, 255)
    found[order.white], found[order.black] = 170, 20
    return found


def test_decode(frames: np.ndarray, compare: Callable[..., None]) -> None:
    order = white_last(Raster(1024, 768))
    assert np.isfinite(decode(order, frames).place[..., 0]).mean() > 0.99
    total = np.empty(SHAPE, np.uint32)
    compare(
        "decode 42 frames / sum of 42 frames",
        lambda: decode(order, frames),
        lambda: frames.sum(axis=0, dtype=np.uint32, out=total),
        BUDGET,
        ROUNDS,
    )
