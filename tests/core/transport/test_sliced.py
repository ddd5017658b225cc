"""Sparse transport of a slice: what it shows under pictures, from either side."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.blocks import BlockGrid
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.sliced import (
    Entries,
    SliceTransport,
    camera_image,
    dual_image,
    one_a_pixel,
    projector_image,
    relit,
)

RASTER = Raster(13, 11)
FINE, COARSE = BlockGrid(RASTER, 6, 5), BlockGrid(RASTER, 2, 2)
SHAPE = 4, 7


def some_entries(grid: BlockGrid, seed: int) -> Entries:
    """0 to 3 entries a pixel."""
    generator = np.random.default_rng(seed)
    lengths = generator.integers(0, 4, SHAPE[0] * SHAPE[1])
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    chosen = [np.sort(generator.choice(grid.count, length, replace=False)) for length in lengths]
    return Entries(
        grid,
        starts,
        np.concatenate(chosen).astype(np.int32),
        generator.uniform(0.1, 1, starts[-1]).astype(np.float32),
    )


def some_slice() -> SliceTransport:
    total = np.random.default_rng(3).uniform(4, 9, SHAPE).astype(np.float32)
    return SliceTransport(total, (some_entries(FINE, 1), some_entries(COARSE, 2)))


def dense(transport: SliceTransport) -> Doubles:
    """The same as a matrix (camera pixels, projector pixels)."""
    left = transport.total.ravel().astype(np.float64)
    out = np.zeros((left.size, RASTER.height * RASTER.width))
    for layer in transport.layers:
        numbers = layer.grid.spread(np.arange(layer.grid.count).reshape(layer.grid.rows, -1)).ravel()
        for pixel in range(left.size):
            for entry in range(layer.starts[pixel], layer.starts[pixel + 1]):
                inside = numbers == layer.block[entry]
                out[pixel, inside] += layer.value[entry] / inside.sum()
                left[pixel] -= layer.value[entry]
    return out + left[:, None] / out.shape[1]


def some_picture() -> Singles:
    return np.random.default_rng(4).random((RASTER.height, RASTER.width), np.float32)


def test_a_slice_is_frozen() -> None:
    found = SliceTransport(np.zeros((2, 3), np.float32), ())
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.layers = ()  # type: ignore[misc]


def test_relit_is_the_matrix_times_the_picture() -> None:
    transport, picture = some_slice(), some_picture()
    expected = (dense(transport) @ picture.ravel()).reshape(SHAPE)
    assert np.abs(relit(transport, picture) - expected).max() <= 2e-6 * expected.max()


def test_all_on_is_the_total_to_the_last_bit() -> None:
    transport = some_slice()
    assert (relit(transport, np.ones((RASTER.height, RASTER.width), np.float32)) == transport.total).all()


def test_a_colour_picture_is_three() -> None:
    transport = some_slice()
    picture = np.random.default_rng(5).random((RASTER.height, RASTER.width, 3), np.float32)
    found = relit(transport, picture)
    assert found.shape == (*SHAPE, 3)
    for k in range(3):
        assert (found[..., k] == relit(transport, np.ascontiguousarray(picture[..., k]))).all()


def test_a_projector_image_is_a_row_of_the_matrix() -> None:
    transport = some_slice()
    expected = dense(transport)
    for row, column in ((0, 0), (2, 3), (3, 6)):
        found = projector_image(transport, RASTER, column, row)
        assert np.abs(found.ravel() - expected[row * SHAPE[1] + column]).max() < 1e-6


def test_a_camera_image_shows_the_block_of_the_finest_grid() -> None:
    transport = some_slice()
    numbers = FINE.spread(np.arange(FINE.count).reshape(FINE.rows, -1)).ravel()
    matrix = dense(transport)
    for row, column in ((0, 0), (5, 7), (10, 12)):
        block = numbers[row * RASTER.width + column]
        found = camera_image(transport, RASTER, column, row)
        assert np.abs(found.ravel() - matrix[:, numbers == block].sum(axis=1)).max() < 5e-6


def test_without_entries_the_camera_image_is_all_light() -> None:
    transport = SliceTransport(np.full(SHAPE, 2, np.float32), ())
    assert (camera_image(transport, RASTER, 0, 0) == 2).all()


def test_the_dual_image_is_the_transpose() -> None:
    transport = some_slice()
    lamps = np.random.default_rng(6).random(SHAPE, np.float32)
    found = dual_image(transport, RASTER, lamps)
    expected = dense(transport).T @ lamps.ravel().astype(np.float64)
    assert np.abs(found.ravel() - expected).max() <= 1e-6 * expected.max()


def test_one_block_a_pixel() -> None:
    block = np.array([[0, -1, 29]], np.int32)
    entries = one_a_pixel(FINE, block, np.array([[1.0, 7.0, 3.0]], np.float32))
    assert entries.starts.tolist() == [0, 1, 1, 2]
    assert entries.block.tolist() == [0, 29]
    assert entries.value.tolist() == [1, 3]


@pytest.mark.parametrize(("column", "row", "name"), [(-1, 0, "column"), (7, 0, "column"), (0, 4, "row")])
def test_a_pixel_outside_is_refused(column: int, row: int, name: str) -> None:
    with pytest.raises(InputError, match=name):
        projector_image(some_slice(), RASTER, column, row)
    with pytest.raises(InputError, match=name):
        camera_image(some_slice(), RASTER, column * 2, row * 3)


def test_memory_is_that_of_the_arrays() -> None:
    transport = SliceTransport(
        np.zeros((2, 2), np.float32), (one_a_pixel(FINE, np.zeros((2, 2), np.int32), np.ones((2, 2), np.float32)),)
    )
    assert transport.bytes == 16 + 5 * 8 + 4 * 4 + 4 * 4
