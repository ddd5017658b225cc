"""Decodes pictures from bytes with all their bits, whatever writer made them.

By what the bytes say, not by a file's suffix: PNG, JPEG, WebP, BMP, GIF, TGA, PNM, JPEG 2000, DDS and TIFF. Size, kind
and number of pages are looked at before anything is decoded. What cannot be read as it was meant is refused by name.
"""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Singles
from slopegate.drivers.files.colour_profiles import as_srgb, linear_by_gamma
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_checks import JPEG_SCAN, check_pixels, check_scans, damaged, turned
from slopegate.drivers.files.reading import decoding
from slopegate.drivers.files.tiff_decoding import decode_tiff, is_tiff

_PILLOW: Final = ("PNG", "JPEG", "WEBP", "BMP", "DIB", "GIF", "TGA", "PPM", "JPEG2000", "DDS")
"""Not its readers that start other programs (EPS) or are hardly tried."""
_PNG: Final = b"\x89PNG\r\n\x1a\n"
_PNG_END: Final = b"IEND\xaeB`\x82"
_FULL_SCALE: Final = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}


@dataclass(frozen=True, eq=False)
class DecodedPicture:
    """The numbers in a picture, as they were stored."""

    values: NDArray[Any]
    """(h, w) grey, or (h, w, 3) red, green and blue."""
    alpha: NDArray[Any] | None = None
    """(h, w) of the same type, 0 where nothing is seen."""
    profile: bytes = b""
    """An ICC profile that says which colours the numbers mean; empty for sRGB."""
    gamma: float = 0.0
    """Of a PNG that says so: numbers are light to this power. 0: sRGB."""

    @property
    def opacity(self) -> Singles | None:
        """Alpha as shares (h, w) float32, 0..1; None where all is opaque."""
        if self.alpha is None:
            return None
        return np.asarray(self.alpha / np.float32(full_scale(self.alpha)), np.float32)


def decode_colour(data: bytes, source: Path | str, turn_upright: bool = False, always_srgb: bool = False) -> Singles:
    """A photo or texture as linear RGB (h, w, 3) float32, 0..1.

    Grey becomes three equal channels. Integers hold sRGB, or what the picture's own ICC profile or gamma says unless
    they are `always_srgb`; floats hold linear light. `turn_upright`: as its EXIF orientation says. Raises SceneError,
    which begins with `source`.
    """
    picture = decode_picture(data, source, turn_upright)
    pixels = picture.values
    if pixels.dtype in _FULL_SCALE and not always_srgb:
        if picture.profile:
            pixels = as_srgb(source, pixels, picture.profile)
        elif (linear := linear_by_gamma(pixels, picture.gamma)) is not None:
            pixels = linear
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    return linear_rgb(source, pixels)


def decode_picture(
    data: bytes, source: Path | str, turn_upright: bool = False, as_numbers: bool = False
) -> DecodedPicture:
    """The numbers in a picture: grey and colour of up to 16 bits, palettes as colours. Raises SceneError.

    `as_numbers`: those of a map, which nothing may change: see `decode_tiff`.
    """
    if is_tiff(data):
        return DecodedPicture(*decode_tiff(data, source, turn_upright, as_numbers))
    with decoding(damaged(source)):
        if data.startswith(_PNG) and _PNG_END not in data:
            raise damaged(source)
        if as_numbers and not data.startswith(_PNG):  # what a lossy format leaves of numbers is none
            raise damaged(source)
        if as_numbers and data[24] < 8:
            raise SceneError(f"{source} is a PNG of {data[24]} bits: a map must have 8 or 16")
        if data.startswith(_PNG) and data[24] == 16:
            return _deep_png(data, source, turn_upright)
        return _by_pillow(data, source, turn_upright)


def linear_rgb(source: Path | str, srgb: NDArray[Any]) -> Singles:
    """Linear float32 0..1 from (h, w, 3) sRGB of 8 or 16 bits (IEC 61966-2-1). Floats are linear already."""
    full = _FULL_SCALE.get(srgb.dtype)
    if full is None and srgb.dtype.kind != "f":
        raise SceneError(f"{source} holds {srgb.dtype} numbers: a colour picture has 8 or 16 bits, or floats")
    if full is None:
        linear = np.ascontiguousarray(srgb, np.float32)
        if not np.isfinite(linear).all() or linear.min() < 0 or linear.max() > 1:
            raise SceneError(f"{source} has values outside 0..1: a picture of floats must hold linear light in 0..1")
        return linear
    value = np.arange(full + 1) / full
    table = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return np.asarray(table[srgb], np.float32)


def full_scale(values: NDArray[Any]) -> float:
    """What stands for white, or for opaque, in pixels of this type: 1 in floats."""
    return float(_FULL_SCALE.get(values.dtype, 1))


def _deep_png(data: bytes, source: Path | str, turn_upright: bool) -> DecodedPicture:
    """16 bits a channel, of which Pillow keeps 8 in colours."""
    import imagecodecs

    check_pixels(source, *struct.unpack(">II", data[16:24]))
    pixels = np.asarray(imagecodecs.png_decode(data))
    profile, gamma, orientation = _said(data, turn_upright)
    return _split(turned(pixels, orientation), profile, gamma)


def _by_pillow(data: bytes, source: Path | str, turn_upright: bool) -> DecodedPicture:
    from PIL import Image, ImageOps

    Image.MAX_IMAGE_PIXELS = None  # its own limit warns, ours refuses
    with Image.open(io.BytesIO(data), formats=_PILLOW) as picture:
        check_pixels(source, *picture.size)
        if picture.format in {"JPEG", "MPO"}:
            check_scans(source, data.count(JPEG_SCAN), picture.width * picture.height)
        frames = getattr(picture, "n_frames", 1)
        if frames > 1 and picture.format != "MPO":  # whose first is the photo, and the others its previews
            raise SceneError(f"{source} is an animation of {frames} pictures: a single picture is needed")
        picture.load()
        upright = ImageOps.exif_transpose(picture) if turn_upright else picture
        said = (b"", 0.0) if picture.mode == "CMYK" else _meaning(picture.info)
        if upright.mode.startswith("I"):  # 16 bits, which a conversion would clip
            return DecodedPicture(np.asarray(upright).astype(np.uint16), None, *said)
        if upright.has_transparency_data:
            grey = upright.mode in {"LA", "La"}
            return _split(np.asarray(upright.convert("LA" if grey else "RGBA")), *said)
        if upright.mode == "1":
            upright = upright.convert("L")
        plain = upright if upright.mode in {"L", "RGB", "F"} else upright.convert("RGB")
        return DecodedPicture(np.asarray(plain), None, *said)


def _meaning(info: dict[str | tuple[int, int], Any]) -> tuple[bytes, float]:
    """Profile and gamma of a picture: a profile counts before a PNG's word that it is sRGB, that before its gamma."""
    profile = bytes(info.get("icc_profile") or b"")
    return profile, 0.0 if profile or "srgb" in info else float(info.get("gamma", 0.0))


def _split(pixels: NDArray[Any], profile: bytes, gamma: float) -> DecodedPicture:
    """Pixels (h, w) or (h, w, channels) with the alpha that two and four channels end with."""
    if pixels.ndim == 2:
        return DecodedPicture(pixels, None, profile, gamma)
    if pixels.shape[2] == 2:
        return DecodedPicture(pixels[:, :, 0], pixels[:, :, 1], profile, gamma)
    alpha = pixels[:, :, 3] if pixels.shape[2] == 4 else None
    return DecodedPicture(pixels[:, :, :3], alpha, profile, gamma)


def _said(data: bytes, turn_upright: bool) -> tuple[bytes, float, int]:
    """What a PNG says of itself: profile, gamma, and which way is up where that is asked for."""
    from PIL import Image

    with Image.open(io.BytesIO(data), formats=("PNG",)) as picture:
        meaning = _meaning(picture.info)  # of what stands before the pixels: the orientation may be behind them
        return *meaning, int(picture.getexif().get(0x0112, 1)) if turn_upright else 1
