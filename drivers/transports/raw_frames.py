"""Frames of one stage of a slice on the disk: Zarr 3, uncompressed, written pattern by pattern and read in tiles."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from slopegate.core.rig.arrays import Counts, Words
from slopegate.drivers.files.durable import StorageError, reason

TILE_NUMBERS: Final = 1 << 25
"""Numbers of a tile, patterns times pixels: 128 MB as float32, and two tiles are decoded at a time."""
_BATCH_BYTES: Final = 1 << 26
"""Frames that are collected before they are written, twice: one lot is filled while the other is written."""
_MOST_PATTERNS: Final = 4096


@dataclass(frozen=True)
class Tile:
    """A rectangle of pixels, first and one past the last; either whole rows, or a piece of one."""

    rows: tuple[int, int]
    columns: tuple[int, int]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.rows[1] - self.rows[0], self.columns[1] - self.columns[0]

    @property
    def window(self) -> tuple[slice, slice]:
        """What cuts it out of an image."""
        return slice(*self.rows), slice(*self.columns)


def tiles_of(count: int, shape: tuple[int, int]) -> Iterator[Tile]:
    """Tiles for stacks of `count` patterns that cover an image (H, W), in the order of its pixels."""
    height, width = shape
    tall, wide = _tile_size(count, shape)
    for row in range(0, height, tall):
        for column in range(0, width, wide):
            yield Tile((row, min(row + tall, height)), (column, min(column + wide, width)))


def _tile_size(count: int, shape: tuple[int, int]) -> tuple[int, int]:
    pixels = max(TILE_NUMBERS // count, 1)
    return (min(pixels // shape[1], shape[0]), shape[1]) if pixels >= shape[1] else (1, pixels)


class RawFrames:
    """Sums of the frames of each pattern, (patterns, H, W). Fill `slot`, then call `kept`, pattern by pattern.

    Writing goes on in a thread of its own; its StorageError comes out of the next call.
    """

    def __init__(self, folder: Path, name: str, count: int, shape: tuple[int, int], most: int) -> None:
        """most: the largest sum there can be. What stood there before is removed. Raises StorageError."""
        import zarr

        self.count, self.shape = count, shape
        self._path = folder / name
        dtype = np.uint16 if most <= np.iinfo(np.uint16).max else np.uint32
        frame_bytes = shape[0] * shape[1] * np.dtype(dtype).itemsize
        batch = min(max(_BATCH_BYTES // frame_bytes, 16), _MOST_PATTERNS, count)
        try:
            shutil.rmtree(self._path, ignore_errors=True)
            if not folder.exists():
                zarr.create_group(store=str(folder), zarr_format=3)
            self._array: Any = zarr.create_array(
                store=str(self._path),
                shape=(count, *shape),
                chunks=(batch, *_tile_size(count, shape)),
                dtype=dtype,
                compressors=None,
                dimension_names=("pattern", "y", "x"),
                zarr_format=3,
            )
        except OSError as error:
            raise StorageError(reason(self._path, error)) from None
        self._lots: list[Any] = [np.empty((batch, *shape), dtype) for _ in range(2 if batch < count else 1)]
        self._writer = ThreadPoolExecutor(1, "slopegate-raw")
        self._writing: Future[None] | None = None
        self._done = 0

    @property
    def slot(self) -> Counts | Words:
        """Where the sum of the next pattern's frames goes, (H, W) uint16, or uint32 where it may not fit."""
        image: Counts | Words = self._lots[0][self._done % len(self._lots[0])]
        return image

    def kept(self) -> None:
        """The slot is filled. Raises StorageError."""
        self._done += 1
        batch = len(self._lots[0])
        if self._done % batch == 0 or self._done == self.count:
            self._wait()
            first = (self._done - 1) // batch * batch
            self._writing = self._writer.submit(self._write, first, self._lots[0][: self._done - first])
            self._lots.reverse()
            if self._done == self.count:
                self._wait()
                self.close()

    def tile(self, tile: Tile) -> Counts | Words:
        """Sums of one tile, (patterns, pixels), when all are kept. Raises StorageError. From any thread."""
        return self._read(slice(None), *tile.window).reshape(self.count, -1)

    def image(self, number: int) -> Counts | Words:
        """Sums of one pattern (H, W), when all are kept. Raises StorageError."""
        return self._read(number, slice(None), slice(None))

    def close(self) -> None:
        """Let the memory go. Harmless when closed."""
        self._writer.shutdown()
        self._lots = []

    def _read(self, *window: int | slice) -> Counts | Words:
        try:
            found: Counts | Words = self._array[window]
        except OSError as error:
            raise StorageError(f"{self._path} cannot be read ({error.strerror or error})") from None
        return found

    def _wait(self) -> None:
        if self._writing is not None:
            self._writing.result()
            self._writing = None

    def _write(self, first: int, frames: Any) -> None:
        try:
            self._array[first : first + len(frames)] = frames
        except OSError as error:
            raise StorageError(reason(self._path, error)) from None
