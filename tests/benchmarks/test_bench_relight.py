"""Relighting five slices at 1600 x 1200: what a picture costs when only colours change, and when a picture does."""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle

import numpy as np
import pytest

from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.keeping import keep
from slopegate.core.transport.relight import LiveRelight, SliceLight
from slopegate.core.transport.sliced import Entries, SliceTransport

GRID = BlockGrid(Raster(1280, 720), 32, 32)
SHAPE = 1200, 1600
FRAME = "16.7 ms"


@pytest.fixture(scope="module")
def slices() -> list[SliceTransport]:
    """Two blocks a pixel in each of them."""
    generator = np.random.default_rng(0)
    pixels = SHAPE[0] * SHAPE[1]
    block = np.sort(generator.integers(0, GRID.count, (pixels, 2)).astype(np.int32), axis=1).ravel()
    entries = Entries(GRID, np.arange(pixels + 1) * 2, block, np.full(2 * pixels, 0.4, np.float32))
    return [SliceTransport(generator.random(SHAPE, np.float32), (entries,)) for _ in range(5)]


@pytest.mark.parametrize("mosaic", ["", "RGGB"])
def test_relight(slices: list[SliceTransport], compare: Callable[..., None], mosaic: str) -> None:
    live, out = LiveRelight(slices, mosaic=mosaic), np.empty((*SHAPE, 3), np.uint8)
    for index in range(5):
        live.light(index, SliceLight((0.2 * index, 1 - 0.2 * index, 0.5)))
    target = np.empty((5, *SHAPE), np.float32)
    sources = np.stack([one.total for one in slices])
    kind = "mosaic" if mosaic else "mono"
    compare(
        f"mix of 5 slices, {kind} / copy of 5 float planes",
        lambda: live.paint(3.0, out),
        lambda: np.copyto(target, sources),
        FRAME,
    )
    raster = GRID.raster
    pictures: cycle[Singles] = cycle(np.random.default_rng(1).random((2, raster.height, raster.width), np.float32))
    compare(
        f"another picture on a slice, {kind} / mix",
        lambda: live.light(0, SliceLight(picture=next(pictures))),
        lambda: live.paint(3.0, out),
        "",
    )


def test_keep(compare: Callable[..., None]) -> None:
    """A tile of 16384 pixels that see one block each, in noise."""
    pixels = 16384
    columns = np.random.default_rng(0).normal(0, 0.02, (GRID.count, pixels)).astype(np.float32)
    columns[np.arange(pixels) // 60 % GRID.count, np.arange(pixels)] += 1
    noise, work = np.full(pixels, 0.02, np.float32), columns.copy()

    def kept() -> None:
        np.copyto(work, columns)
        keep(work, GRID, noise)

    compare("keep of 1024 x 16384 columns / copy", kept, lambda: np.copyto(work, columns), "", rounds=5)
