"""Image files with the settings that made them inside, where the format has room for them.

| suffix | pixels | settings |
| --- | --- | --- |
| .npy | any numeric array | no room |
| .exr | float32 (H, W) or (H, W, 3) | header attribute `slopegate` |
| .tif .tiff | uint8, uint16 or float32, (H, W) or (H, W, 3) | ImageDescription |
| .png | uint8 or uint16, (H, W) or (H, W, 3) | iTXt chunk `slopegate` |

Colour is RGB. The settings are JSON.
"""

from __future__ import annotations

import errno
import json
import struct
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from slopegate.core.exposure.shown import srgb_curve
from slopegate.core.rig.arrays import Bytes
from slopegate.drivers.files.durable import StorageError, check_destination, replacing

SETTINGS_KEY = "slopegate"
LINEAR_SUFFIXES: Final = (".npy", ".exr")
"""Of files that hold light as it is, float32."""
VIEWER_SUFFIX: Final = ".png"
"""Of pictures to look at."""
_PNG_HEADER_BYTES = 8 + 4 + 4 + 13 + 4

Array = NDArray[Any]


def save_image(path: Path, array: Array, metadata: Mapping[str, Any] | None = None) -> None:
    """Write an (H, W) or (H, W, 3) array (see the table above), replacing the file whole.

    `metadata` must be fit for JSON without NaN. Raises StorageError, and leaves what was there before.
    """
    check_destination(path, tuple(_WRITERS))
    suffix = path.suffix.lower()
    allowed, _ = _WRITERS[suffix]
    shaped = array.size > 0 and (array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3))
    if allowed and not (shaped and array.dtype.name in allowed):
        raise StorageError(
            f"{path}: a {suffix} file holds {' or '.join(allowed)} pixels of shape (H, W) or (H, W, 3), "
            f"not {array.dtype.name} of shape {array.shape}"
        )
    with replacing(path) as part:
        write_image(part, suffix, array, metadata)


def write_image(path: Path, suffix: str, array: Array, metadata: Mapping[str, Any] | None = None) -> None:
    """Write an image in the format of `suffix`, for callers that are `replacing` a file or folder. Raises OSError."""
    _, writer = _WRITERS[suffix]
    writer(path, array, "" if metadata is None else json.dumps(metadata, allow_nan=False))


def srgb8(level: Array) -> Bytes:
    """Linear light, 0 black to 1 white, as 8 bits to look at: the sRGB curve (IEC 61966-2-1); the rest is clipped."""
    return np.asarray(np.rint(255 * srgb_curve(level)), np.uint8)


def shares8(shares: Array) -> Bytes:
    """Shares 0..1, such as a matte's, as 8 bits: 255 is all."""
    return np.asarray(np.rint(255 * shares), np.uint8)


def _write_npy(path: Path, array: Array, _text: str) -> None:
    with path.open("xb") as stream:
        np.save(stream, array, allow_pickle=False)


def _write_exr(path: Path, array: Array, text: str) -> None:
    write_layers(path, {"Y" if array.ndim == 2 else "RGB": array}, text)


def write_layers(path: Path, planes: Mapping[str, Array], text: str) -> None:
    """Write an OpenEXR file of several layers, each (H, W) float32, or (H, W, 3) where its name ends in RGB.

    `text` are the settings as JSON. For callers that are `replacing` a file or folder. Raises OSError.
    """
    import OpenEXR

    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if text:
        header[SETTINGS_KEY] = text
    channels = {name: np.ascontiguousarray(plane) for name, plane in planes.items()}
    with OpenEXR.File(header, channels) as image:
        try:
            image.write(str(path))
        except RuntimeError:  # the library's word for a disk that is full or gone
            raise OSError(errno.EIO, "the disk is full, or cannot be written any more") from None


def _write_tiff(path: Path, array: Array, text: str) -> None:
    import tifffile

    photometric = "rgb" if array.ndim == 3 else "minisblack"
    tifffile.imwrite(
        path, array, photometric=photometric, description=text or None, metadata=None, software="slopegate"
    )


def _write_png(path: Path, array: Array, text: str) -> None:
    import cv2  # Pillow writes no colour of 16 bits

    pixels = array[..., ::-1] if array.ndim == 3 else array
    done, encoded = cv2.imencode(".png", np.ascontiguousarray(pixels))
    assert done
    data = encoded.tobytes()
    if text:
        data = data[:_PNG_HEADER_BYTES] + _itxt(text) + data[_PNG_HEADER_BYTES:]
    path.write_bytes(data)


def _itxt(text: str) -> bytes:
    """An uncompressed iTXt chunk, which unlike tEXt holds any Unicode (PNG specification, 11.3.3.4)."""
    body = b"iTXt" + SETTINGS_KEY.encode("latin-1") + b"\0\0\0\0\0" + text.encode("utf-8")
    return struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))


_COUNTS = ("uint8", "uint16")
_WRITERS: dict[str, tuple[tuple[str, ...], Callable[[Path, Array, str], None]]] = {
    ".npy": ((), _write_npy),
    ".tif": ((*_COUNTS, "float32"), _write_tiff),
    ".tiff": ((*_COUNTS, "float32"), _write_tiff),
    ".png": (_COUNTS, _write_png),
    ".exr": (("float32",), _write_exr),
}
