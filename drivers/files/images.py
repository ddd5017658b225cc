"""Pictures on disk, each with the settings that made it inside where the format has room for them.

| suffix | pixels | settings |
| --- | --- | --- |
| .npy | any numeric array | no room |
| .exr | float32 (H, W) or (H, W, 3) | header attribute `slopegate` |
| .tif .tiff | uint8, uint16 or float32, (H, W) or (H, W, 3) | ImageDescription |
| .png | uint8 or uint16, (H, W) or (H, W, 3) | iTXt chunk `slopegate` |

Colour is RGB. A file appears whole or not at all: it is written beside its place and then renamed.
"""

from __future__ import annotations

import json
import secrets
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig.checks import InputError, UserError

SETTINGS_KEY = "slopegate"
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_HEADER_BYTES = 8 + 4 + 4 + 13 + 4

Array = NDArray[Any]


class ImageError(UserError):
    """A picture cannot be written or read; the message is one sentence that names the file."""


def check_destination(path: Path, suffixes: Sequence[str]) -> None:
    """Raise ImageError now for what would fail after a long computation: suffix, folder, permission."""
    if path.suffix.lower() not in suffixes:
        raise ImageError(f"{path} has the suffix {path.suffix!r}: it must be one of {', '.join(suffixes)}")
    if path.is_dir():
        raise ImageError(f"{path} is a folder: name a file")
    if not path.parent.is_dir():
        raise ImageError(f"{path}: there is no folder {path.parent}")
    try:
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise ImageError(f"{path}: the folder cannot be written to ({error.strerror or error})") from None


def save_image(path: Path, array: Array, metadata: Mapping[str, Any] | None = None) -> None:
    """Write an (H, W) or (H, W, 3) array (see the table above), replacing the file whole.

    `metadata` must be fit for JSON without NaN. Raises ImageError, and leaves what was there before.
    """
    suffix = path.suffix.lower()
    check_destination(path, tuple(_WRITERS))
    allowed, writer = _WRITERS[suffix]
    shaped = array.size > 0 and (array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3))
    if allowed and not (shaped and array.dtype.name in allowed):
        raise ImageError(
            f"{path}: a {suffix} file holds {' or '.join(allowed)} pixels of shape (H, W) or (H, W, 3), "
            f"not {array.dtype.name} of shape {array.shape}"
        )
    text = "" if metadata is None else json.dumps(metadata, allow_nan=False)
    _write_whole(path, lambda part: writer(part, array, text))


def read_settings(path: Path) -> dict[str, Any]:
    """The settings inside a TIFF, PNG or EXR file; ImageError where there are none."""
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise ImageError(f"{path} has the suffix {path.suffix!r}: settings are kept in {', '.join(_READERS)}")
    if not path.is_file():
        raise ImageError(f"{path}: there is no such file")
    try:
        found = json.loads(reader(path))
    except (OSError, ValueError, KeyError, struct.error, RuntimeError, zlib.error) as error:
        raise ImageError(f"{path} holds no settings of this program ({str(error) or type(error).__name__})") from None
    if not isinstance(found, dict):
        raise ImageError(f"{path} holds no settings of this program")
    return found


def _write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a file of another name in the same folder, then give it its own."""
    part = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix.lower()}")
    try:
        write(part)
        part.replace(path)
    except (OSError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise ImageError(f"{path} cannot be written ({reason})") from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _write_npy(path: Path, array: Array, _text: str) -> None:
    np.save(path, array, allow_pickle=False)


def _write_exr(path: Path, array: Array, text: str) -> None:
    import OpenEXR

    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if text:
        header[SETTINGS_KEY] = text
    channels = {"Y" if array.ndim == 2 else "RGB": np.ascontiguousarray(array)}
    with OpenEXR.File(header, channels) as image:
        image.write(str(path))


def _write_tiff(path: Path, array: Array, text: str) -> None:
    import tifffile

    photometric = "rgb" if array.ndim == 3 else "minisblack"
    tifffile.imwrite(
        path, array, photometric=photometric, description=text or None, metadata=None, software="slopegate"
    )


def _write_png(path: Path, array: Array, text: str) -> None:
    import cv2

    pixels = array[..., ::-1] if array.ndim == 3 else array
    done, encoded = cv2.imencode(".png", np.ascontiguousarray(pixels))
    if not done:
        raise RuntimeError("OpenCV could not encode it")
    data = encoded.tobytes()
    if text:
        data = data[:_PNG_HEADER_BYTES] + _itxt(text) + data[_PNG_HEADER_BYTES:]
    path.write_bytes(data)


def _itxt(text: str) -> bytes:
    """An uncompressed iTXt chunk, which unlike tEXt holds any Unicode (PNG specification, 11.3.3.4)."""
    body = b"iTXt" + SETTINGS_KEY.encode("latin-1") + b"\0\0\0\0\0" + text.encode("utf-8")
    return struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))


def _read_exr(path: Path) -> str:
    import OpenEXR

    with OpenEXR.File(str(path), header_only=True) as image:
        return str(image.header()[SETTINGS_KEY])


def _read_tiff(path: Path) -> str:
    import tifffile

    with tifffile.TiffFile(path) as image:
        return str(image.pages.first.description)


def _read_png(path: Path) -> str:
    for kind, body in _png_chunks(path.read_bytes()):
        if kind == b"iTXt" and body.startswith(SETTINGS_KEY.encode("latin-1") + b"\0"):
            return body.split(b"\0", 5)[5].decode("utf-8")
    raise KeyError(SETTINGS_KEY)


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    if not data.startswith(_PNG_SIGNATURE):
        raise InputError("not a PNG file")
    at = len(_PNG_SIGNATURE)
    while at + 8 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        at += 12 + length


_COUNTS = ("uint8", "uint16")
_WRITERS: dict[str, tuple[tuple[str, ...], Callable[[Path, Array, str], None]]] = {
    ".npy": ((), _write_npy),
    ".tif": ((*_COUNTS, "float32"), _write_tiff),
    ".tiff": ((*_COUNTS, "float32"), _write_tiff),
    ".png": (_COUNTS, _write_png),
    ".exr": (("float32",), _write_exr),
}
_READERS: dict[str, Callable[[Path], str]] = {
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".png": _read_png,
    ".exr": _read_exr,
}
