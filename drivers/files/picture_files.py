"""Reads pictures, depth maps and disparity maps. Their size is checked before they are decoded."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Bools, Singles
from slopegate.core.rig.blocks import on_raster
from slopegate.core.rig.patterns import LIT, Raster
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.exr_decoding import read_exr_depth, read_exr_picture
from slopegate.drivers.files.npy_headers import promised
from slopegate.drivers.files.picture_checks import check_pixels, damaged
from slopegate.drivers.files.picture_decoding import DecodedPicture, decode_colour, decode_picture, full_scale
from slopegate.drivers.files.reading import decoding, read_plain

TIFF_SUFFIXES = (".tif", ".tiff")
COLOUR_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", *TIFF_SUFFIXES)
MAP_SUFFIXES = (".png", *TIFF_SUFFIXES, ".npy", ".exr", ".pfm")

_PFM_HEADER_BYTES = 4096
_PFM = re.compile(
    rb"P([fF])GAP(\d{1,9})GAP(\d{1,9})GAP([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?)(?:\r\n|\s)".replace(
        b"GAP", rb"(?:\s|#[^\n]*\n)+"
    )
)
"""Which kind, width, height and scale; comments as in its elder sisters PGM and PPM."""


def read_colour(path: Path, turn_upright: bool = True) -> Singles:
    """A photo or texture as (h, w, 3) float32 linear RGB, 0..1. Integer files hold sRGB, float files linear light.

    `turn_upright`: turn it as its EXIF orientation says. A photo that belongs to a depth map must stay as it is.
    """
    _check_suffix(path)
    return decode_colour(read_plain(path), path, turn_upright)


def read_raw(path: Path, turn_upright: bool = False) -> NDArray[Any]:
    """The numbers in a picture file, (h, w) or (h, w, 3), without its alpha. Palettes become RGB."""
    _check_suffix(path)
    return _pixels(path, turn_upright).values


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in COLOUR_SUFFIXES:
        raise SceneError(f"{path} is no picture that can be read: it must be one of {', '.join(COLOUR_SUFFIXES)}")


def read_map(path: Path) -> NDArray[Any]:
    """A depth or disparity map (png, tif, npy, exr, pfm): the numbers in the file, as a 2D array."""
    readers = {".npy": _read_npy, ".exr": _read_exr, ".pfm": _read_pfm}
    suffix = path.suffix.lower()
    if suffix not in MAP_SUFFIXES:
        raise SceneError(f"{path} is no map that can be read: it must be one of {', '.join(MAP_SUFFIXES)}")
    values = readers[suffix](path) if suffix in readers else _pixels(path, as_numbers=True).values
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[:, :, 0]
    if values.ndim != 2 or not values.size or values.dtype.kind not in "uif":
        raise SceneError(f"{path} has shape {values.shape} and type {values.dtype}: one plane of numbers is needed")
    return values


def read_shares(path: Path) -> Singles:
    """A picture (h, w) float32 of shares, 0 where it is black to 1 where it is white; no curve is applied to it.

    Of colours their mean counts. Floats outside 0..1 are refused.
    """
    pixels = read_raw(path)
    if pixels.ndim == 3:
        pixels = pixels.mean(axis=2).astype(pixels.dtype)
    shares = np.ascontiguousarray(pixels / np.float32(full_scale(pixels)), np.float32)
    if shares.ndim != 2 or not (np.isfinite(shares) & (shares >= 0) & (shares <= 1)).all():
        raise SceneError(f"{path} has values outside 0..1 or no plane of numbers: a picture of shares is needed")
    return shares


def read_pattern(path: Path, raster: Raster, colours: bool = False) -> Singles:
    """What a projector is to show, from an 8-bit PNG of its size or of any grid up to it: v means v / 255 of the light.

    Spread over the raster's pixels, (height, width) float32, or (height, width, 3) of a picture in colour where
    `colours` allows it. Other depths and larger pictures are refused.
    """
    allowed = "a pattern is a PNG of 8 bits" if colours else "a pattern is a grey PNG of 8 bits"
    if path.suffix.lower() != ".png":
        raise SceneError(f"{path} is no PNG: {allowed}")
    pixels = _pixels(path).values
    if pixels.dtype != np.uint8:
        raise SceneError(f"{path} has 16 bits a channel: {allowed}")
    if pixels.ndim == 3 and (pixels == pixels[:, :, :1]).all():
        pixels = pixels[:, :, 0]
    if pixels.ndim == 3 and not colours:
        raise SceneError(f"{path} has colours: {allowed}")
    height, width = pixels.shape[:2]
    if width > raster.width or height > raster.height:
        raise SceneError(
            f"{path} has {width} x {height} pixels: a pattern has at most the {raster} pixels of the projector"
        )
    return on_raster(np.asarray(pixels / np.float32(LIT), np.float32), raster)


def read_region(path: Path) -> Bools:
    """A mask (h, w) from a picture: true where it is brighter than half of its maximum and not transparent.

    Takes pictures of 1, 8 or 16 bits, grey, RGB, RGBA or with a palette, and whatever `read_map` reads.
    """
    picture = _pixels(path) if path.suffix.lower() in COLOUR_SUFFIXES else DecodedPicture(read_map(path))
    values = picture.values
    seen = values if values.ndim == 2 else values.max(axis=2)
    white = np.asarray(seen > seen.max() / 2)
    opacity = picture.opacity
    return white if opacity is None else white & (opacity > 0.5)


def read_luminance(path: Path) -> NDArray[Any]:
    """The numbers in a picture (png, tif, npy, exr and the like) as one plane (h, w), grey ones in the file's type.

    Numbers are not changed: those of a camera or of a renderer are linear light, and a photo's stay as they are. Colour
    becomes luminance (REC 709), float32; alpha is left out.
    """
    suffix = path.suffix.lower()
    if suffix == ".exr":
        values = read_exr_picture(read_plain(path), path)
    elif suffix == ".npy":
        values = _read_npy(path)
    else:
        values = read_raw(path)
    grey = values.ndim == 2 or (values.ndim == 3 and values.shape[2] == 1)
    colour = values.ndim == 3 and values.shape[2] in {3, 4}
    if not (grey or colour) or not values.size or values.dtype.kind not in "uif":
        raise SceneError(f"{path} has shape {values.shape} and type {values.dtype}: one picture is needed")
    if grey:
        return values.reshape(values.shape[:2])
    from slopegate.core.exposure.sensor import REC709  # late: it brings numba

    return np.asarray(values[:, :, :3].astype(np.float32) @ np.array(REC709, np.float32))


def _pixels(path: Path, turn_upright: bool = False, as_numbers: bool = False) -> DecodedPicture:
    return decode_picture(read_plain(path), path, turn_upright, as_numbers)


def _read_npy(path: Path) -> NDArray[Any]:
    data = read_plain(path)
    with decoding(damaged(path)):
        shape, size_bytes = promised(io.BytesIO(data))
        height, width = ([*shape, 1, 1])[:2]
        check_pixels(path, width, height)
        if size_bytes > len(data):  # room would be made for what the header promises
            raise damaged(path)
        return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))


def _read_pfm(path: Path) -> NDArray[Any]:
    """One channel of a PFM file, whose scale gives the order of the bytes; its size is not applied.

    Whoever writes a scale other than 1 means it in different ways, and most readers leave it alone.
    """
    data = read_plain(path)
    header = _PFM.match(data[:_PFM_HEADER_BYTES])
    if header is None or float(header[4]) == 0:
        raise damaged(path)
    if header[1] == b"F":
        raise SceneError(f"{path} is a PFM of three channels (PF): a map must have one (Pf)")
    width, height = int(header[2]), int(header[3])
    check_pixels(path, width, height)
    size_bytes = 4 * width * height
    body = data[header.end() :]
    if len(body) != size_bytes:
        raise SceneError(f"{path} has {len(body)} bytes of pixels: {width} x {height} pixels need {size_bytes}")
    rows = np.frombuffer(body, "<f4" if header[4].startswith(b"-") else ">f4").reshape(height, width)
    return rows[::-1].astype(np.float32)


def _read_exr(path: Path) -> NDArray[Any]:
    return read_exr_depth(read_plain(path), path)
