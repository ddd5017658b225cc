"""Raw frames on the disk: what is written pattern by pattern is read in tiles, whatever their shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.transports import raw_frames
from slopegate.drivers.transports.raw_frames import RawFrames, tiles_of


@pytest.mark.parametrize("numbers", [10, 200, 3000, 100_000])
@pytest.mark.parametrize("most", [4095, 100_000])
def test_tiles_are_what_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, numbers: int, most: int) -> None:
    monkeypatch.setattr(raw_frames, "TILE_NUMBERS", numbers)
    monkeypatch.setattr(raw_frames, "_BATCH_BYTES", 1000)
    shape, count = (6, 7), 50
    written = np.random.default_rng(0).integers(0, most, (count, *shape))
    raw = RawFrames(tmp_path / "raw_0000", "codes", count, shape, most)
    for image in written:
        raw.slot[:] = image
        raw.kept()
    seen = np.zeros((count, *shape), np.int64)
    for tile in tiles_of(count, shape):
        seen[:, *tile.window] = raw.tile(tile).reshape(count, *tile.shape)
    np.testing.assert_array_equal(seen, written)
    np.testing.assert_array_equal(raw.image(13), written[13])
    assert raw.image(0).dtype == (np.uint16 if most < 65536 else np.uint32)


@pytest.mark.parametrize(("count", "shape"), [(1024, (1200, 1600)), (262_144, (48, 64)), (20, (3, 5))])
def test_tiles_cover_every_pixel_once_in_order_and_stay_small(count: int, shape: tuple[int, int]) -> None:
    order = np.arange(shape[0] * shape[1]).reshape(shape)
    tiles = list(tiles_of(count, shape))
    np.testing.assert_array_equal(np.concatenate([order[tile.window].ravel() for tile in tiles]), order.ravel())
    assert max(tile.shape[0] * tile.shape[1] for tile in tiles) * count <= raw_frames.TILE_NUMBERS


def test_a_folder_that_has_vanished_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "file"
    folder.write_bytes(b"")
    with pytest.raises(StorageError, match="cannot be written"):
        RawFrames(folder, "codes", 3, (4, 4), 4095)
