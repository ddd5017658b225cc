"""A film to look at, of a recording: smaller, 8 bits, brightened, and never longer than is quickly made."""

from __future__ import annotations

import io
import math
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from slopegate.core.rig.arrays import Bytes
from slopegate.drivers.captures.film import PREVIEWS, FilmFolder
from slopegate.drivers.files.durable import write_durably

MAX_WIDTH: Final = 640
MAX_FRAMES: Final = 600
"""Of longer recordings every second frame, or every third ... is shown, at the same pace."""
MAX_WEBP_FRAMES: Final = 200
MAX_HZ: Final = 60.0
_LOOKED_AT: Final = 12
"""Frames that the brightness is taken from."""
NO_CODEC: Final = "no preview: neither OpenCV's MPEG-4 nor Pillow's WebP is here"


def write_preview(folder: FilmFolder, going_on: Callable[[], bool] = lambda: True) -> str:
    """Write `preview.mp4`, or `preview.webp` where there is no MPEG-4; what stands in the way, or nothing.

    `going_on` is asked before every frame; when it says no, there is no preview. Raises StorageError.
    """
    count = len(folder)
    if not count:
        return "no preview: there are no frames"
    for name, most, encode in ((PREVIEWS[0], MAX_FRAMES, _mp4), (PREVIEWS[1], MAX_WEBP_FRAMES, _webp)):
        stride = max(math.ceil(count / most), math.ceil(folder.rate_hz / MAX_HZ))
        data = encode(_frames(folder, stride, going_on), folder.rate_hz / stride)
        if not going_on():
            return "no preview: it was stopped"
        if data:
            write_durably(folder.path / name, data)
            return ""
    return NO_CODEC


def _frames(folder: FilmFolder, stride: int, going_on: Callable[[], bool]) -> Iterator[Bytes]:
    """Grey pictures (h, w) of even size, brightened alike by a square root: what is dim shows."""
    import cv2

    height, width = folder.shape
    scale = min(1.0, MAX_WIDTH / width)
    size = (max(2, round(width * scale) // 2 * 2), max(2, round(height * scale) // 2 * 2))
    picked = np.linspace(0, len(folder) - 1, min(_LOOKED_AT, len(folder))).astype(int)
    sample = np.stack([folder.frame(int(number))[::4, ::4] for number in picked])
    low, high = np.percentile(sample, (1.0, 99.9))
    levels = np.arange(folder.manifest.camera.max_count + 1)
    table = np.sqrt(np.clip((levels - low) / max(high - low, 1.0), 0, 1)) * 255
    table = np.rint(table).astype(np.uint8)
    for number in range(0, len(folder), stride):
        if not going_on():
            return
        seen = table[np.minimum(folder.frame(number), levels[-1])]
        yield np.asarray(cv2.resize(seen, size, interpolation=cv2.INTER_AREA), np.uint8)


def _mp4(frames: Iterator[Bytes], rate_hz: float) -> bytes:
    """MPEG-4 by OpenCV; empty where its wheel cannot."""
    import cv2

    first = next(frames, None)
    if first is None:
        return b""
    with tempfile.TemporaryDirectory() as made:
        path = Path(made) / "preview.mp4"
        code = cv2.VideoWriter.fourcc(*"mp4v")
        paced = round(max(rate_hz, 1.0), 1)  # MPEG-4 has no finer paces
        writer = cv2.VideoWriter(str(path), code, paced, first.shape[::-1], isColor=False)
        try:
            if not writer.isOpened():
                return b""
            writer.write(first)
            for frame in frames:
                writer.write(frame)
        finally:
            writer.release()
        return path.read_bytes()


def _webp(frames: Iterator[Bytes], rate_hz: float) -> bytes:
    """Animated WebP by Pillow; empty where it cannot."""
    from PIL import Image, features

    if not features.check("webp"):
        return b""
    pictures = [Image.fromarray(frame) for frame in frames]
    if not pictures:
        return b""
    data = io.BytesIO()
    milliseconds = max(1, round(1000 / rate_hz))
    pictures[0].save(data, "WEBP", save_all=True, append_images=pictures[1:], duration=milliseconds, loop=0)
    return data.getvalue()
