"""A TIFF file that grows frame by frame and can be opened at every moment, also after the process was killed.

A page's pixels and its directory are written first; only then four bytes of the page before are set to point to it.
Until then no reader knows of the page, so none sees half of one. tifffile links a page before its pixels are there, and
would leave a frame of noughts behind. What is written are plain grey pages, uncompressed, of a classic little-endian
TIFF: ImageJ, Fiji, napari, MATLAB, OpenCV, Pillow and tifffile read them.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.drivers.files.durable import StorageError, reason

MAX_BYTES: Final = 2_000_000_000
"""Of one file: some readers count with 31 bits."""
_HEADER: Final = struct.pack("<2sHI", b"II", 42, 0)
_SHORT, _LONG, _TEXT = 3, 4, 2
_TAGS: Final = 10
_DIRECTORY_BYTES: Final = 2 + 12 * _TAGS + 4
Pixels = Bytes | Counts
Made = TypeVar("Made")


class TiffStack:
    """Pages (H, W) uint8 or uint16, each with a text, added to a new file. Raises StorageError."""

    def __init__(self, path: Path) -> None:
        """The file must not be there yet."""
        self.path = path
        self._link = len(_HEADER) - 4
        self.bytes = len(_HEADER)
        """Of the file, up to the end of its last whole page."""
        self._file = self._try(lambda: path.open("xb", buffering=0))
        self._put(0, _HEADER)

    def room_for(self, pixels: Pixels, text: bytes) -> bool:
        """Whether this page would still fit into the file."""
        return self.bytes + pixels.nbytes + len(text) + 256 <= MAX_BYTES

    def add(self, pixels: Pixels, text: bytes) -> None:
        """Add a page with an ASCII text. When this returns, the page survives the end of the process."""
        data = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<")).data.cast("B")
        at_pixels = self.bytes
        tail, at_directory, at_link = _directory(pixels, text + b"\0", at_pixels)
        try:
            self._put(at_pixels, data)
            self._put(at_pixels + pixels.nbytes, tail)
            self._put(self._link, struct.pack("<I", at_directory))
        except StorageError:
            self._cut()
            raise
        self._link = at_link
        self.bytes = at_pixels + pixels.nbytes + len(tail)

    def sync(self) -> None:
        """Force what has been added to the disk, so that it survives a power failure, too."""
        self._try(lambda: os.fsync(self._file.fileno()))

    def close(self) -> None:
        """Close the file. Harmless when closed."""
        self._try(self._file.close)

    def _put(self, place: int, data: bytes | memoryview) -> None:
        def put() -> None:
            self._file.seek(place)
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) or 0 :]

        self._try(put)

    def _cut(self) -> None:
        """Take away what was written of a page that did not fit."""
        with suppress(OSError):  # no page points there: it is waste, and no error
            self._file.truncate(self.bytes)

    def _try(self, act: Callable[[], Made]) -> Made:
        try:
            return act()
        except OSError as error:
            raise StorageError(reason(self.path, error)) from None


class Page(NamedTuple):
    """Where a page's pixels (H, W) and its text are in a file."""

    path: Path
    shape: tuple[int, int]
    bits: int
    at_pixels: int
    at_text: int
    text_bytes: int

    def pixels(self) -> NDArray[Any]:
        """The pixels (H, W) uint8 or uint16. Raises StorageError."""
        dtype = np.dtype(np.uint8) if self.bits == 8 else np.dtype("<u2")
        height, width = self.shape
        data = self._read(self.at_pixels, height * width * dtype.itemsize)
        return np.frombuffer(data, dtype).reshape(self.shape)

    def text(self) -> str:
        """The text. Raises StorageError."""
        return self._read(self.at_text, self.text_bytes).rstrip(b"\0").decode("ascii", "replace")

    def _read(self, place: int, count: int) -> bytes:
        try:
            with self.path.open("rb") as file:
                file.seek(place)
                data = file.read(count)
        except OSError as error:
            raise StorageError(f"{self.path} cannot be read ({error.strerror or error})") from None
        if len(data) < count:
            raise damaged(self.path)
        return data


def pages_of(path: Path) -> list[Page]:
    """The pages of a file that `TiffStack` has written, also while it is being written. Raises StorageError.

    The directories alone are read: a file of thousands of frames is looked through in milliseconds.
    """
    found = []
    try:
        with path.open("rb") as file:
            header = file.read(len(_HEADER))
            if len(header) < len(_HEADER) and header == _HEADER[: len(header)]:
                return []  # its process was killed before the first page
            if header[:4] != _HEADER[:4]:
                raise damaged(path)
            at, before = struct.unpack("<I", header[4:])[0], 0
            while at:
                size = os.fstat(file.fileno()).st_size  # anew: what is pointed to may have been added just now
                if not before < at <= size - _DIRECTORY_BYTES:  # pages stand in order, so none is met twice
                    raise damaged(path)
                file.seek(at)
                directory = file.read(_DIRECTORY_BYTES)
                found.append(_page(path, directory, size))
                before, at = at, struct.unpack_from("<I", directory, _DIRECTORY_BYTES - 4)[0]
    except OSError as error:
        raise StorageError(f"{path} cannot be read ({error.strerror or error})") from None
    except struct.error:
        raise damaged(path) from None
    return found


def _page(path: Path, directory: bytes, size: int) -> Page:
    """The page of a directory. Raises StorageError for one that is not as `_directory` makes them."""
    entries = [struct.unpack_from("<HHII", directory, 2 + 12 * index) for index in range(_TAGS)]
    tags = {number: value for number, _, _, value in entries}
    counts = {number: count for number, _, count, _ in entries}
    known = directory[:2] == struct.pack("<H", _TAGS) and {256, 257, 258, 259, 270, 273} <= tags.keys()
    if not known or tags[259] != 1 or tags[258] not in (8, 16):
        raise damaged(path)
    page = Page(path, (tags[257], tags[256]), tags[258], tags[273], tags[270], counts[270])
    if page.at_pixels + tags[257] * tags[256] * tags[258] // 8 > size or page.at_text + page.text_bytes > size:
        raise damaged(path)
    return page


def damaged(path: Path) -> StorageError:
    """What is said of a file that is not as it was written."""
    return StorageError(f"{path} is damaged or cannot be read")


def _directory(pixels: Pixels, text: bytes, at_pixels: int) -> tuple[bytes, int, int]:
    """What stands behind a page's pixels, where in the file its directory begins, and where its link to the next is."""
    height, width = pixels.shape
    at_text = at_pixels + pixels.nbytes
    pad = -(at_text + len(text)) % 2
    at_directory = at_text + len(text) + pad
    tags = (
        (256, _LONG, 1, width),
        (257, _LONG, 1, height),
        (258, _SHORT, 1, 8 * pixels.itemsize),
        (259, _SHORT, 1, 1),  # uncompressed
        (262, _SHORT, 1, 1),  # black is zero
        (270, _TEXT, len(text), at_text),
        (273, _LONG, 1, at_pixels),
        (277, _SHORT, 1, 1),
        (278, _LONG, 1, height),
        (279, _LONG, 1, pixels.nbytes),
    )
    entries = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    body = text + b"\0" * pad + struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0)
    return body, at_directory, at_pixels + pixels.nbytes + len(body) - 4
