"""Reads and makes the TIFF files of a capture: a grey image with JSON in its description."""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from slopegate.core.rig.arrays import Counts, Words
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.reading import decoding

Sums = Counts | Words

_COMPRESSIONS: Final = {1, 5, 8, 32773, 32946, 34925, 50000}
"""None, which is how slices are written, and those that lose nothing and unpack to no more than there is room for."""


def crc32_of(pixels: Sums) -> int:
    """Checksum of the pixels, row by row, little-endian."""
    return zlib.crc32(np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<")).data)


def tiff_bytes(pixels: Sums, description: str, software: str) -> memoryview:
    """A grey TIFF file of (H, W) pixels with this description, as bytes."""
    import tifffile

    data = io.BytesIO()
    with tifffile.TiffWriter(data, byteorder="<") as writer:
        writer.write(pixels, photometric="minisblack", description=description, metadata=None, software=software)
    return data.getbuffer()


def read_tiff(path: Path, shape: tuple[int, int]) -> Sums:
    """The pixels (H, W) of a file, which must have this shape: that is looked at before anything is decoded.

    Raises StorageError.
    """

    def pixels(image: Any) -> Sums:
        check_slice(path, image.pages.first, shape)
        return np.ascontiguousarray(image.pages.first.asarray())

    return with_tiff(path, pixels)


def check_slice(path: Path, page: Any, shape: tuple[int, int]) -> None:
    """Raise StorageError unless a page holds grey numbers of this shape, in pieces that are no larger."""
    found = tuple(int(side) for side in page.shape)
    if found != shape or page.dtype not in (np.uint16, np.uint32):
        size = " x ".join(str(side) for side in reversed(found))
        raise StorageError(
            f"{path} has {size} pixels of {page.dtype}: the capture's images have {shape[1]} x {shape[0]} of 16 or 32"
            " bits"
        )
    piece = page.tilewidth * page.tilelength if page.is_tiled else 0
    if int(page.compression) not in _COMPRESSIONS or piece > max(4 * shape[0] * shape[1], 1 << 20):
        raise StorageError(f"{path} is not stored as a capture's images are: it is of another program")


def read_facts(path: Path) -> dict[str, Any]:
    """The JSON in a file's description. Raises StorageError."""
    return with_tiff(path, lambda image: dict(json.loads(str(image.pages.first.description))))


Found = TypeVar("Found")


def with_tiff(path: Path, use: Callable[[Any], Found]) -> Found:
    """What `use` finds in the opened file. Raises StorageError."""
    import tifffile

    with decoding(StorageError(f"{path} is damaged or cannot be read")), tifffile.TiffFile(path) as image:
        return use(image)
