"""Pictures and maps as scenes use them: looked at before they are decoded, refused in one sentence."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from slopegate.drivers.scene_error import SceneError

MAX_PIXELS = 25_000_000
MAX_FILE_BYTES = 400_000_000
COLOUR_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff")
MAP_SUFFIXES = (".png", ".tif", ".tiff", ".npy", ".exr", ".pfm")

_INTEGER_FULL_SCALE = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}


def read_plain(path: Path, limit_bytes: int = MAX_FILE_BYTES) -> bytes:
    """All bytes of an ordinary file that is neither empty nor larger than the limit."""
    try:
        if not path.exists():
            raise SceneError(f"{path} is missing")
        if not path.is_file():
            raise SceneError(f"{path} is not an ordinary file")
        size = path.stat().st_size
        if size == 0:
            raise SceneError(f"{path} is empty (0 bytes)")
        if size > limit_bytes:
            raise SceneError(f"{path} has {size / 1e6:.0f} MB: at most {limit_bytes / 1e6:.0f} MB are allowed")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise SceneError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error


def read_colour(path: Path, turn_upright: bool = True) -> NDArray[np.float32]:
    """A photo or texture as (h, w, 3) float32 linear RGB, 0..1; integer files hold sRGB, float files linear light."""
    if path.suffix.lower() not in COLOUR_SUFFIXES:
        raise SceneError(f"{path} is no picture that can be read: it must be one of {', '.join(COLOUR_SUFFIXES)}")
    data = read_plain(path)
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
    image = _decode(path, data, flags if turn_upright else flags | cv2.IMREAD_IGNORE_ORIENTATION)
    return linear_rgb(path, image[:, :, ::-1])


def linear_rgb(path: Path, srgb: NDArray[Any]) -> NDArray[np.float32]:
    """(h, w, 3) sRGB of 8 or 16 bits -> linear float32 0..1 (IEC 61966-2-1); floats are linear already."""
    full = _INTEGER_FULL_SCALE.get(srgb.dtype)
    if full is None:
        linear = np.ascontiguousarray(srgb, np.float32)
        if not np.isfinite(linear).all() or linear.min() < 0 or linear.max() > 1:
            raise SceneError(f"{path} has values outside 0..1: a picture of floats must hold linear light in 0..1")
        return linear
    value = np.arange(full + 1) / full
    table = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return np.asarray(table[srgb], np.float32)


def read_map(path: Path) -> NDArray[Any]:
    """A depth or disparity map as a 2D array of the file's own numbers: png, tif, npy, exr, pfm."""
    data = read_plain(path)
    suffix = path.suffix.lower()
    if suffix == ".npy":
        values = _read_npy(path, data)
    elif suffix == ".exr":
        values = _read_exr(path)
    elif suffix in MAP_SUFFIXES:
        values = _decode(path, data, cv2.IMREAD_UNCHANGED)
    else:
        raise SceneError(f"{path} is no map that can be read: it must be one of {', '.join(MAP_SUFFIXES)}")
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[:, :, 0]
    if values.ndim != 2 or not values.size or values.dtype.kind not in "uif":
        raise SceneError(f"{path} has shape {values.shape} and type {values.dtype}: one plane of numbers is needed")
    return values


def check_pixels(path: Path, width: int, height: int) -> None:
    """Refuse a picture of more pixels than this program decodes."""
    if width * height > MAX_PIXELS:
        raise SceneError(
            f"{path} has {width} x {height} pixels ({width * height / 1e6:.0f} megapixels): at most"
            f" {MAX_PIXELS / 1e6:.0f} megapixels are allowed"
        )


def _decode(path: Path, data: bytes, flags: int) -> NDArray[Any]:
    check_pixels(path, *_header_size(path, data))
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise SceneError(f"{path} cannot be decoded: it is damaged, cut short, or no picture of its suffix")
    return np.asarray(image)


def _header_size(path: Path, data: bytes) -> tuple[int, int]:
    """Width and height as the file's header states them, before any pixel is decoded."""
    pfm = re.match(rb"P[Ff]\s+(\d{1,9})\s+(\d{1,9})\s", data[:100])
    if pfm:
        return int(pfm[1]), int(pfm[2])
    from PIL import Image

    limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None  # its own limit warns, ours refuses
        with Image.open(io.BytesIO(data)) as picture:
            width, height = picture.size
            return width, height
    except Exception as error:  # decoders of damaged files raise whatever they stumble over
        raise SceneError(f"{path} cannot be decoded: it is damaged, cut short, or no picture of its suffix") from error
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _read_npy(path: Path, data: bytes) -> NDArray[Any]:
    try:
        stream = io.BytesIO(data)
        version = np.lib.format.read_magic(stream)
        reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape = reader(stream)[0]
        check_pixels(path, *([*shape, 1, 1][:2]))
        return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
    except (ValueError, EOFError, OSError) as error:
        raise SceneError(f"{path} cannot be decoded: it is no NumPy array of plain numbers, or cut short") from error


def _read_exr(path: Path) -> NDArray[Any]:
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as header:
            low, high = header.header()["dataWindow"]
        check_pixels(path, int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            name = next((name for name in ("Z", "Y", "depth") if name in channels), next(iter(sorted(channels)), ""))
            return np.array(channels[name].pixels)
    except SceneError:
        raise
    except Exception as error:  # the library raises bare RuntimeError, ValueError, KeyError for damaged files
        raise SceneError(f"{path} cannot be decoded: it is damaged, cut short, or no EXR image") from error
