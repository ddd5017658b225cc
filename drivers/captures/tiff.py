"""Reads and makes the TIFF files of a capture: a grey image with JSON in its description."""

from __future__ import annotations

import io
import json
import logging
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from slopegate.core.rig.arrays import Counts, Words
from slopegate.drivers.files.durable import StorageError
from slopegate.drivers.files.reading import decoding

Sums = Counts | Words


def crc32_of(pixels: Sums) -> int:
    """Checksum of the pixels, row by row, little-endian."""
    return zlib.crc32(np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<")).data)


def steps_per_count(frames: int, max_count: int) -> int:
    """How many steps of a 16-bit plane make one count: the number of frames if their sum fits, which keeps it exact.

    Otherwise the largest whole number for which full scale fits; the mean is then rounded to the nearest step.
    """
    return min(frames, 65535 // max_count)


def tiff_bytes(pixels: Sums, description: str, software: str) -> memoryview:
    """A grey TIFF file of (H, W) pixels with this description, as bytes."""
    import tifffile

    data = io.BytesIO()
    with tifffile.TiffWriter(data, byteorder="<") as writer:
        writer.write(pixels, photometric="minisblack", description=description, metadata=None, software=software)
    return data.getbuffer()


def read_tiff(path: Path) -> Sums:
    """The pixels (H, W) of a file. Raises StorageError."""
    return _with_tiff(path, lambda image: np.ascontiguousarray(image.pages.first.asarray()))


def read_facts(path: Path) -> dict[str, Any]:
    """The JSON in a file's description. Raises StorageError."""
    return _with_tiff(path, lambda image: dict(json.loads(str(image.pages.first.description))))


Found = TypeVar("Found")


def _with_tiff(path: Path, use: Callable[[Any], Found]) -> Found:
    """What `use` finds in the opened file. Raises StorageError."""
    import tifffile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # it tells of damage by raising, too
    with decoding(StorageError(f"{path} is damaged or cannot be read")), tifffile.TiffFile(path) as image:
        return use(image)
