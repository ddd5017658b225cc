"""Decodes TIFF pictures by what their tags say, or refuses them by the tag's name.

Read are grey (white or black as 0), RGB, palettes, CMYK and what JPEG makes of YCbCr; of any number of bits, in strips
or tiles, planar or not, with the compressions of COMPRESSIONS.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_checks import JPEG_SCAN, check_decoded, check_pixels, check_scans, damaged, turned
from slopegate.drivers.files.reading import decoding

Pixels = NDArray[Any]

COMPRESSIONS: Final = {
    1: "none",
    2: "CCITT RLE",
    3: "CCITT Group 3",
    4: "CCITT Group 4",
    5: "LZW",
    7: "JPEG",
    8: "Deflate",
    32773: "PackBits",
    32946: "Deflate",
    34887: "LERC",
    34925: "LZMA",
    34926: "ZSTD",
    34927: "WebP",
    34933: "PNG",
    50000: "ZSTD",
    50001: "WebP",
}
_JPEG: Final = 7
_BY_HEADER: Final = (34927, 34933, 50001)
"""Whose segments are pictures that Pillow knows."""
_LERC: Final = 34887
_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB, _PALETTE, _CMYK, _YCBCR, _DEPTH = 0, 1, 2, 3, 5, 6, 51177
_CHANNELS: Final = {_MIN_IS_WHITE: 1, _MIN_IS_BLACK: 1, _RGB: 3, _PALETTE: 1, _CMYK: 4, _YCBCR: 3, _DEPTH: 1}
_REDUCED, _MASK = 1, 4
_ASSOCIATED: Final = 1
_ORIENTATION, _INKS, _COLOUR_MAP = 274, 332, 320
_PREDICTORS: Final = {1, 2, 3}
_MAX_SEGMENTS: Final = 100_000
_MAX_PAGES: Final = 1000


def is_tiff(data: bytes) -> bool:
    """Whether the bytes begin as a TIFF or BigTIFF does."""
    return data[:4] in {b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"}


def decode_tiff(
    data: bytes, source: Path | str, turn_upright: bool = False, as_numbers: bool = False
) -> tuple[Pixels, Pixels | None, bytes]:
    """The only picture in a TIFF: (h, w) grey or (h, w, 3) RGB, black as 0; its alpha (h, w), or None; its ICC profile.

    Integers are spread over 8 or 16 bits. `as_numbers`: not so, the numbers as they were stored, for which white as 0
    and palettes are refused. Raises SceneError.
    """
    import tifffile

    with decoding(damaged(source)), tifffile.TiffFile(io.BytesIO(data)) as tiff:
        page = _only_page(tiff, source)
        _check(page, data, source)
        if as_numbers and int(page.photometric) in {_MIN_IS_WHITE, _PALETTE}:
            raise SceneError(f"{source} is a TIFF of {_named(page.photometric)}: a map must hold plain numbers")
        pixels = _channels_last(page, np.asarray(page.asarray()))
        values, alpha = _meant(page, pixels, source, as_numbers)
        orientation = page.tags.valueof(_ORIENTATION, 1) if turn_upright else 1
        inks = int(page.photometric) == _CMYK  # whose profile is not one of the colours that are made of them
        profile = b"" if inks else bytes(page.iccprofile or b"")
    return turned(values, orientation), None if alpha is None else turned(alpha, orientation), profile


def _only_page(tiff: Any, source: Path | str) -> Any:
    """The page that is neither a preview nor a mask of another."""
    found = []
    for index in range(_MAX_PAGES):
        try:
            page = tiff.pages[index]
        except IndexError:
            break
        if index == 0 or not int(page.subfiletype) & (_REDUCED | _MASK):
            found.append(page)
    whole = [page for page in found if not int(page.subfiletype) & (_REDUCED | _MASK)] or found[:1]
    stacked = tiff.is_imagej and int((tiff.imagej_metadata or {}).get("images", 1)) > 1
    if len(whole) > 1 or stacked:
        raise SceneError(f"{source} is a stack of pictures: a TIFF with a single picture is needed")
    return whole[0]


def _check(page: Any, data: bytes, source: Path | str) -> None:
    """Refuse what cannot be read as it is meant, and what would take too much memory or time."""
    width, height, samples = int(page.imagewidth), int(page.imagelength), int(page.samplesperpixel)
    check_pixels(source, width, height)
    if int(page.compression) not in COMPRESSIONS:
        known = ", ".join(dict.fromkeys(COMPRESSIONS.values()))
        raise SceneError(f"{source} is a TIFF with the compression {_named(page.compression)}: it must be {known}")
    if int(page.compression) == _JPEG and page.bitspersample != 8:
        raise SceneError(f"{source} is a TIFF of JPEG with {_named(page.bitspersample)} bits: it must have 8 bits")
    if int(page.predictor) not in _PREDICTORS:
        raise SceneError(f"{source} is a TIFF with the predictor {_named(page.predictor)}: it must have 1, 2 or 3")
    photometric = int(page.photometric)
    if photometric not in _CHANNELS or (photometric == _YCBCR and int(page.compression) != _JPEG):
        raise SceneError(
            f"{source} is a TIFF of the colours {_named(page.photometric)}: they must be grey, RGB, a palette, CMYK, or"
            " YCBCR compressed as JPEG"
        )
    if photometric == _CMYK and page.tags.valueof(_INKS, 1) != 1:
        raise SceneError(f"{source} is a TIFF of other inks than CMYK: their colours are not known")
    if page.dtype is None or page.dtype.kind not in "buif":
        kind = f"{page.bitspersample} bits and sample format {_named(page.sampleformat)}"
        raise SceneError(f"{source} is a TIFF of {kind}: samples must be whole numbers or floats")
    if int(page.imagedepth) != 1:
        raise SceneError(f"{source} is a TIFF of {page.imagedepth} planes in depth: a picture has one")
    spare = samples - _CHANNELS[photometric]
    named = page.extrasamples and _CHANNELS[photometric] > 1
    if spare < 0 or (spare > 1 and not named):
        raise SceneError(
            f"{source} is a TIFF of {samples} channels that are called {_named(page.photometric)}: which of them are"
            " the picture is not known"
        )
    check_decoded(source, width * height * samples * page.dtype.itemsize)
    _check_segments(page, data, source)


def _check_segments(page: Any, data: bytes, source: Path | str) -> None:
    wide, high = (page.tilewidth, page.tilelength) if page.is_tiled else (page.imagewidth, page.rowsperstrip)
    high = min(high, page.imagelength) if not page.is_tiled else high
    check_decoded(source, wide * high * int(page.samplesperpixel) * page.dtype.itemsize)
    if len(page.dataoffsets) > _MAX_SEGMENTS:
        raise SceneError(
            f"{source} is a TIFF in {len(page.dataoffsets)} pieces: at most {_MAX_SEGMENTS} strips or tiles are allowed"
        )
    if int(page.compression) == _JPEG:
        spans = zip(page.dataoffsets, page.databytecounts, strict=True)
        most = max((data[start : start + count].count(JPEG_SCAN) for start, count in spans), default=0)
        check_scans(source, most, max(int(page.imagewidth * page.imagelength), 1))
    for size in _own_sizes(page, data):  # a piece says by itself how large it is, and the decoder believes it
        if size[0] * size[1] > max(wide * high * int(page.samplesperpixel), 64 * 64):
            raise SceneError(
                f"{source} has a piece of {size[0]} x {size[1]} pixels where {wide} x {high} belong: it is damaged"
            )


def _own_sizes(page: Any, data: bytes) -> Iterator[tuple[int, int]]:
    """The sizes that pieces give themselves, where their compression does that."""
    from PIL import Image

    kind = int(page.compression)
    if kind not in {_JPEG, _LERC, *_BY_HEADER}:
        return
    for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        piece = data[offset : offset + count]
        if not piece:
            continue
        if kind == _JPEG:
            yield _jpeg_size(piece)
        elif kind == _LERC:
            yield _lerc_size(piece)
        else:
            with Image.open(io.BytesIO(piece), formats=("PNG", "WEBP")) as picture:
                yield picture.size


def _jpeg_size(piece: bytes) -> tuple[int, int]:
    """Width and height in the first frame header of a JPEG (ISO 10918-1, B.2.2)."""
    at = 2
    while True:
        marker, length = struct.unpack(">HH", piece[at : at + 4])
        if 0xFFC0 <= marker <= 0xFFCF and marker not in {0xFFC4, 0xFFC8, 0xFFCC}:
            height, width = struct.unpack(">HH", piece[at + 5 : at + 9])
            return width, height
        if marker < 0xFF01:
            raise ValueError("no frame header")
        at += 2 + length


def _lerc_size(piece: bytes) -> tuple[int, int]:
    """Width and height in the header of a Lerc2 blob; one of several channels in a pixel counts as wider."""
    if piece[:6] != b"Lerc2 ":
        raise ValueError("no Lerc2")
    version = struct.unpack("<i", piece[6:10])[0]
    height, width, channels = struct.unpack_from("<iii", piece, 14 if version >= 3 else 10)
    return int(width) * (max(channels, 1) if version >= 4 else 1), int(height)


def _channels_last(page: Any, pixels: Pixels) -> Pixels:
    """(h, w, channels), whichever way they were stored."""
    if "S" not in page.axes:
        return pixels.reshape(page.imagelength, page.imagewidth, 1)
    return np.moveaxis(pixels, page.axes.index("S"), 2)


def _meant(page: Any, pixels: Pixels, source: Path | str, as_numbers: bool) -> tuple[Pixels, Pixels | None]:
    """What stored pixels (h, w, channels) stand for, and their alpha."""
    photometric, count = int(page.photometric), _CHANNELS[int(page.photometric)]
    if not as_numbers and photometric != _PALETTE:
        pixels = _spread(page, pixels)
    colour = pixels[:, :, :count]
    alpha = pixels[:, :, count] if pixels.shape[2] > count else None
    if photometric == _PALETTE:
        return _looked_up(page, pixels[:, :, 0], source), alpha
    white = 1 if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max
    if photometric == _MIN_IS_WHITE:
        colour = white - colour
    if photometric == _CMYK:
        ink = colour.astype(np.float64) / white
        light = (1 - ink[:, :, :3]) * (1 - ink[:, :, 3:]) * white
        colour = (light if pixels.dtype.kind == "f" else np.rint(light)).astype(pixels.dtype)
    if alpha is not None and page.extrasamples and int(page.extrasamples[0]) == _ASSOCIATED and not as_numbers:
        clear = alpha.astype(np.float64)[:, :, None]
        whole = np.clip(colour / np.where(clear > 0, clear, 1) * white, 0, white)
        colour = (whole if pixels.dtype.kind == "f" else np.rint(whole)).astype(pixels.dtype)
    return colour[:, :, 0] if count == 1 else colour, alpha


def _spread(page: Any, pixels: Pixels) -> Pixels:
    """Unsigned numbers of up to 16 bits over all of 8 or of 16 bits, half floats as float32."""
    if pixels.dtype.kind == "f":
        return pixels.astype(np.float32) if pixels.dtype.itemsize < 4 else pixels
    bits = page.bitspersample
    if pixels.dtype.kind == "b":
        pixels, bits = pixels.astype(np.uint8), 1
    if not isinstance(bits, int) or pixels.dtype.kind == "i" or bits in {8, 16} or bits > 16:
        return pixels
    full = np.iinfo(pixels.dtype).max
    table = np.rint(np.arange(2**bits) * (full / (2**bits - 1))).astype(pixels.dtype)
    return np.asarray(table[np.minimum(pixels, 2**bits - 1)])


def _looked_up(page: Any, index: Pixels, source: Path | str) -> Pixels:
    """The colours (h, w, 3) uint8 of a palette."""
    table = np.asarray(page.tags.valueof(_COLOUR_MAP), np.uint16).reshape(3, -1).T
    if int(index.max(initial=0)) >= len(table):
        raise damaged(source)
    # Writers differ in the low byte of 16 bits, and old ones put 8 bits there.
    return (table if table.max() < 256 else table >> 8).astype(np.uint8)[index.astype(np.intp)]


def _named(value: Any) -> str:
    """What a tag's number is called."""
    return str(getattr(value, "name", None) or value)
