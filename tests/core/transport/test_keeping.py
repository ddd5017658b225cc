"""What of decoded columns is kept, and how well it says what was left out."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.keeping import KeepRule, coarse_grid, joined, keep
from slopegate.core.transport.sliced import Entries, SliceTransport, projector_image, relit

GRID = BlockGrid(Raster(64, 48), 16, 8)
PIXELS = 200
SIGMA = 0.01


def direct(seed: int = 0) -> Singles:
    """Columns (blocks, P) of pixels that see one or two blocks."""
    generator = np.random.default_rng(seed)
    columns = np.zeros((GRID.count, PIXELS), np.float32)
    for pixel in range(PIXELS):
        columns[generator.choice(GRID.count, 2, replace=False), pixel] = generator.uniform(0.5, 2, 2)
    return columns


def dense(layers: tuple[Entries, ...], total: Singles) -> Singles:
    """The blocks' light (blocks, P) that a slice of these layers shows."""
    transport = SliceTransport(total.reshape(1, -1), layers)
    pictures = np.eye(GRID.count, dtype=np.float32).reshape(-1, GRID.rows, GRID.columns)
    return np.stack([relit(transport, GRID.spread(picture))[0] for picture in pictures])


def test_noise_is_not_kept_and_light_is() -> None:
    truth = direct()
    noise = np.full(PIXELS, SIGMA, np.float32)
    noisy = truth + np.random.default_rng(1).normal(0, SIGMA, truth.shape).astype(np.float32)
    kept = keep(noisy.copy(), GRID, noise)
    fine = kept.layers[0]
    assert (np.diff(fine.starts) >= 2).all()
    # 3.2e-5 of normal deviates lie above 4 deviations
    assert len(fine.value) - 2 * PIXELS < 20
    assert kept.left_out.share < 1e-4
    assert np.abs(dense(kept.layers, truth.sum(axis=0)) - truth).max() < 6 * SIGMA


def test_what_is_left_out_is_the_square_of_the_differences() -> None:
    """With blocks of equal size it is exact."""
    generator = np.random.default_rng(2)
    columns = direct() + (generator.random((GRID.count, PIXELS), np.float32) * np.float32(0.05))
    kept = keep(columns.copy(), GRID, np.full(PIXELS, SIGMA, np.float32))
    wrong = dense(kept.layers, columns.sum(axis=0)) - columns
    assert kept.left_out.left == pytest.approx(float((wrong.astype(np.float64) ** 2).sum()), rel=1e-3)
    assert kept.left_out.energy == pytest.approx(float((columns.astype(np.float64) ** 2).sum()), rel=1e-5)


def test_smooth_light_is_kept_coarsely() -> None:
    """Each entry lies below its threshold, the sums of 16 above theirs."""
    rows, columns = np.mgrid[:8, :16]
    smooth = (2 * SIGMA * (1 + np.cos(rows / 3) * np.cos(columns / 5))).astype(np.float32).reshape(-1, 1)
    light = np.repeat(smooth, PIXELS, axis=1)
    kept = keep(light.copy(), GRID, np.full(PIXELS, SIGMA, np.float32))
    assert len(kept.layers[0].value) == 0
    assert len(kept.layers[1].value) > 0
    assert kept.layers[1].grid == coarse_grid(GRID)
    even = SliceTransport(light.sum(axis=0).reshape(1, -1), ())
    one = projector_image(even, GRID.raster, 0, 0)
    without = float(((GRID.means(one) * 24 - light[:, 0].reshape(8, 16)) ** 2).sum()) * PIXELS
    assert kept.left_out.left < 0.3 * without


def test_a_pixel_with_too_many_entries_keeps_its_largest() -> None:
    columns = np.linspace(1, 9, GRID.count, dtype=np.float32)[:, None].repeat(3, axis=1)
    kept = keep(columns.copy(), GRID, np.full(3, 0.1, np.float32), rule=KeepRule(most=40))
    fine = kept.layers[0]
    assert np.diff(fine.starts).tolist() == [40, 40, 40]
    assert fine.value[:40].tolist() == columns[-40:, 0].tolist()


def test_tiles_of_any_size_give_the_same() -> None:
    columns = direct() + np.random.default_rng(1).normal(0, SIGMA, (GRID.count, PIXELS)).astype(np.float32)
    noise = np.full(PIXELS, SIGMA, np.float32)
    whole = joined([keep(columns.copy(), GRID, noise)])
    cuts = [0, 1, 64, 70, 199, PIXELS]
    tiles = [keep(columns[:, a:b].copy(), GRID, noise[a:b]) for a, b in pairwise(cuts)]
    parts = joined(tiles)
    assert len(parts.layers) == len(whole.layers)
    for one, other in zip(parts.layers, whole.layers, strict=True):
        assert (one.starts == other.starts).all()
        assert (one.block == other.block).all()
        assert (one.value == other.value).all()
    assert parts.left_out.left == pytest.approx(whole.left_out.left)


def test_columns_of_some_blocks_keep_their_numbers() -> None:
    columns = direct()
    numbers = np.flatnonzero(columns.any(axis=1)).astype(np.int32)[::2]
    kept = keep(columns[numbers].copy(), GRID, np.full(PIXELS, SIGMA, np.float32), numbers).layers[0]
    for pixel in range(PIXELS):
        inside = slice(kept.starts[pixel], kept.starts[pixel + 1])
        assert kept.block[inside].tolist() == [n for n in numbers if columns[n, pixel] > 0]
        assert (kept.value[inside] == columns[kept.block[inside], pixel]).all()


def test_dark_columns_leave_no_layer() -> None:
    dark = keep(np.zeros((GRID.count, 5), np.float32), GRID, np.zeros(5, np.float32))
    assert joined([dark]).layers == ()
    assert dark.left_out.share == 0


@pytest.mark.parametrize(
    ("columns", "rows", "coarse"), [(32, 32, (8, 8)), (4, 2, (1, 1)), (16, 9, (4, 3)), (5, 7, None), (1, 1, None)]
)
def test_coarse_grids_hold_whole_blocks(columns: int, rows: int, coarse: tuple[int, int] | None) -> None:
    grid = BlockGrid(Raster(1280, 720), columns, rows)
    found = coarse_grid(grid)
    assert (None if found is None else (found.columns, found.rows)) == coarse
    if found is not None:
        assert set(found.column_edges) <= set(grid.column_edges)
        assert set(found.row_edges) <= set(grid.row_edges)


def test_columns_that_do_not_fit_are_a_bug() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        keep(np.zeros((3, 5), np.float32), GRID, np.zeros(5, np.float32))
