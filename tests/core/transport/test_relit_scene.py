"""From coded frames of a matt scene to its relit picture: codes, decoding, keeping and relighting together."""

from __future__ import annotations

import numpy as np
import pytest

from rigs import check_rig
from slopegate.core.exposure.patterned import shares
from slopegate.core.exposure.sensor import mono
from slopegate.core.gating.gate import row_windows, upright_line_time, weights
from slopegate.core.gating.slices import occupied_times, tile_times
from slopegate.core.measure.quality import psnr_db
from slopegate.core.render.render import Buffers, render
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.scene.scene import Scene, Sphere
from slopegate.core.scene.shapes import plane, turn
from slopegate.core.transport.codes import CodeKind, make_codes
from slopegate.core.transport.decode import decode
from slopegate.core.transport.keeping import joined, keep
from slopegate.core.transport.relight import SliceLight, relight
from slopegate.core.transport.sliced import SliceTransport

RIG = check_rig(96)
RASTER = Raster(RIG.projector.lens.width, RIG.projector.lens.height)
COUNTS = 3000.0
"""That the brightest light gives."""


@pytest.fixture(scope="module")
def seen() -> Buffers:
    objects = (
        Sphere("ball", (0.06, 0.02, 0.8), 0.08),
        plane("card", (-0.1, 0.0, 0.9), (0.2, 0.2), turn(20.0, 30.0)),
        plane("wall", (0.0, 0.0, 1.3), (3.0, 3.0), turn()),
    )
    return render(RIG, Scene("three", objects=objects))


def lit(seen: Buffers) -> Singles:
    """Light (H, W) in counts."""
    light = mono(seen.direct)
    return light * np.float32(COUNTS / float(light.max()))


def acquired(seen: Buffers, grid: BlockGrid, kind: CodeKind, whole_counts: bool) -> list[SliceTransport]:
    """Three slices in counts that tile what is lit, from a frame of every pattern."""
    line = upright_line_time(RIG)
    first, last = occupied_times(RIG, line, seen.projector_row) or (0.0, 0.0)
    codes = make_codes(kind, grid)
    # rounding errors, 1/12 count^2 each, leave 4 / N of themselves in a column of Hadamard's and S codes
    spread = np.sqrt((1 if kind == "impulse" else 4 / codes.count) / 12) if whole_counts else 0.0
    made = []
    for settings in tile_times(RIG, line, first - 1, last + 1, 3):
        total = (lit(seen) * weights(row_windows(RIG, settings), seen.projector_row)).astype(np.float32)
        frames = np.empty((codes.count, total.size), np.float32)
        for number in range(codes.count):
            frames[number] = under(seen, total, grid.spread(codes.values(number).astype(np.float32))).ravel()
        if whole_counts:
            frames, total = np.rint(frames), np.rint(total)
        kept = joined([keep(decode(codes, frames), grid, np.full(total.size, spread, np.float32))])
        made.append(SliceTransport(total, kept.layers))
    return made


def under(seen: Buffers, light: Singles, picture: Singles) -> Singles:
    """What light (H, W) becomes under a picture: the truth."""
    return light * shares(picture, seen.projector_row, seen.projector_column)


def random_picture(grid: BlockGrid) -> Singles:
    return grid.spread(np.random.default_rng(1).random((grid.rows, grid.columns), np.float32))


@pytest.mark.parametrize("kind", ["hadamard", "sequency", "s", "impulse"])
def test_relit_by_a_random_pattern_it_is_the_rendered_picture(seen: Buffers, kind: CodeKind) -> None:
    grid = BlockGrid(RASTER, 16, 9)
    picture = random_picture(grid)
    truth = under(seen, lit(seen), picture)
    found = relight(acquired(seen, grid, kind, False), [SliceLight(picture=picture)] * 3)[..., 0]
    assert psnr_db(found, truth, COUNTS) > 100


@pytest.mark.parametrize(("kind", "least_db"), [("hadamard", 70), ("s", 70), ("impulse", 72)])
def test_frames_in_whole_counts_keep_60_db(seen: Buffers, kind: CodeKind, least_db: float) -> None:
    """A frame of 12 bit is off by 0.29 counts: 20 log10(3000 / 0.29) = 80 dB by itself."""
    grid = BlockGrid(RASTER, 32, 32)
    picture = random_picture(grid)
    truth = under(seen, lit(seen), picture)
    slices = acquired(seen, grid, kind, True)
    found = relight(slices, [SliceLight(picture=picture)] * 3)[..., 0]
    assert psnr_db(found, truth, COUNTS) > least_db
    # a pixel sees one block, or two where it straddles none: noise adds next to nothing
    entries = sum(len(layer.value) for one in slices for layer in one.layers)
    assert entries < 1.2 * np.count_nonzero(lit(seen))


def test_each_slice_can_be_lit_by_itself(seen: Buffers) -> None:
    """Of three slices with a colour each, every pixel has the colour of its own slice."""
    grid = BlockGrid(RASTER, 8, 8)
    slices = acquired(seen, grid, "hadamard", True)
    colours = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    found = relight(slices, [SliceLight(colour) for colour in colours])
    assert np.allclose(found.sum(axis=2), lit(seen), atol=1.01)
    assert (np.count_nonzero(found, axis=2) <= 1).all()
