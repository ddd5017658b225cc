"""Unpacks GenICam's pixel formats (PFNC names) into counts."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Bytes, Counts
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.frame import PixelFormat

Packing = Literal["none", "lsb", "gigevision"]
_NAME = re.compile(r"(Mono|BayerRG|BayerGR|BayerGB|BayerBG)(8|10|12|14|16)(p|Packed)?")
_DEPTHS = (12, 14, 10, 16, 8)
"""From the best: 12 bits are what the sensors of this trade have; 16 is mostly 12 in twice the room."""


@dataclass(frozen=True)
class PixelLayout:
    """How the pixels of an image lie in memory, one row right after the other."""

    name: str
    kind: str
    """mono, bayer_rg, bayer_gr, bayer_gb or bayer_bg."""
    bits: int
    packing: Packing

    @property
    def pixel_format(self) -> PixelFormat:
        """Format of the unpacked counts."""
        return cast(PixelFormat, f"{self.kind}{self.bits}")

    @property
    def max_count(self) -> int:
        """The largest count."""
        return int(2**self.bits) - 1

    def bytes_of(self, pixels: int) -> int:
        """Bytes of an image of so many pixels."""
        if self.packing == "lsb":
            return (pixels * self.bits + 7) // 8
        if self.packing == "gigevision":
            return (pixels * 12 + 7) // 8
        return pixels * (1 if self.bits == 8 else 2)


def layout_of(name: str) -> PixelLayout | None:
    """The layout that a PFNC name stands for; None for colours, depths and packings that are not known."""
    found = _NAME.fullmatch(name)
    if found is None:
        return None
    kind = "mono" if found[1] == "Mono" else f"bayer_{found[1][-2:].lower()}"
    bits = int(found[2])
    packing: Packing = {None: "none", "p": "lsb", "Packed": "gigevision"}[found[3]]  # type: ignore[assignment]
    if (packing == "lsb" and bits in (8, 16)) or (packing == "gigevision" and bits not in (10, 12)):
        return None
    return PixelLayout(name, kind, bits, packing)


def readable(names: Iterable[str]) -> tuple[str, ...]:
    """The formats of these that `unpack` knows, grey ones first, then by bits."""
    known = [layout for layout in map(layout_of, names) if layout is not None]
    known.sort(key=lambda layout: (layout.kind != "mono", layout.kind, layout.bits, layout.packing))
    return tuple(layout.name for layout in known)


def best_layout(names: Iterable[str], present: str) -> PixelLayout | None:
    """The best of the formats on offer: of the kind in use now if that is known, else grey, else a mosaic.

    Packed formats come before padded ones of the same depth, for they are the lighter on the wire.
    """
    known = [layout for layout in map(layout_of, names) if layout is not None]
    now = layout_of(present)

    def rank(layout: PixelLayout) -> tuple[bool, bool, int, bool]:
        other = now is not None and layout.kind != now.kind
        return other, layout.kind != "mono", _DEPTHS.index(layout.bits), layout.packing == "none"

    return min(known, key=rank, default=None)


def bits_of(code: int) -> int:
    """How many bits a pixel takes, from the 32-bit number of its format (PFNC and GigE Vision); 0 for other numbers."""
    return (code >> 16) & 0xFF if code >> 24 in (1, 2) else 0


def without_padding(data: Bytes, shape: tuple[int, int], bits: int, padding: int) -> Bytes:
    """The bytes of an image, one row right after the other: `data` itself, or a copy where `padding` bytes end a row.

    `shape` is (rows, pixels a row) as the frame itself says, `bits` are those of a pixel. How much data came says
    nothing of the rows, for more may lie behind the image. Raises CameraError.
    """
    if not padding:
        return data
    height, width = shape
    whole, left = divmod(width * bits, 8)
    needed = (height - 1) * (whole + padding) + whole  # behind the last row it may be missing
    if left:
        raise CameraError(f"rows of {width} pixels of {bits} bits are padded, but end within a byte")
    if len(data) < needed:
        raise CameraError(f"a frame of {height} rows of {whole} bytes and {padding} between came with {len(data)}")
    rows = np.lib.stride_tricks.as_strided(data, (height, whole), (whole + padding, 1), writeable=False)
    return np.ascontiguousarray(rows).reshape(-1)


def unpack(data: Bytes, layout: PixelLayout, out: Counts) -> None:
    """Write the counts of an image into `out` (H, W) uint16, C-contiguous.

    `data` holds the bytes (bytes_of(H W),) or more. Raises CameraError, with `out` as it was, when there are fewer.
    """
    flat, size = out.reshape(-1), layout.bytes_of(out.size)
    data = data[:size]
    if data.size < size:
        rows, columns = out.shape
        raise CameraError(f"a {layout.name} image of {columns} x {rows} needs {size} bytes: {data.size} came")
    if layout.packing == "lsb":
        _unpack_lsb(data, layout.bits, flat)
    elif layout.packing == "gigevision":
        _unpack_gigevision(data, layout.bits, flat)
    elif layout.bits == 8:
        flat[:] = data
    else:
        flat[:] = data.view("<u2") if data.flags.aligned and data.ctypes.data % 2 == 0 else data.copy().view("<u2")


@njit(cache=True, nogil=True)
def _unpack_lsb(data: Any, bits: Any, out: Any) -> None:
    """Pixel i is bits [i * bits, (i + 1) * bits) of the stream, lowest bit first."""
    held = np.int64(0)
    count = 0
    at = 0
    mask = (1 << bits) - 1
    for i in range(out.size):
        while count < bits:
            held |= np.int64(data[at]) << count
            count += 8
            at += 1
        out[i] = held & mask
        held >>= bits
        count -= bits


@njit(cache=True, nogil=True)
def _unpack_gigevision(data: Any, bits: Any, out: Any) -> None:
    """Two pixels in three bytes: the high eight bits of each, between them a byte with the low bits of both."""
    low = bits - 8
    mask = (1 << low) - 1
    for i in range(out.size):
        third = (i // 2) * 3
        if i % 2 == 0:
            out[i] = (np.int64(data[third]) << low) | (data[third + 1] & mask)
        else:
            out[i] = (np.int64(data[third + 2]) << low) | ((data[third + 1] >> 4) & mask)
