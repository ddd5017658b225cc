"""Linear light as 8-bit pictures for the screen."""

from __future__ import annotations

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.drivers.files.images import srgb8

BRIGHT_PERCENTILE = 99.7


def white_level(light: Singles) -> float:
    """The light of an image (H, W[, 3]) to be shown as white; 1 for a black one."""
    level = float(np.percentile(light[::4, ::4], BRIGHT_PERCENTILE))
    return level if level > 0 else 1.0


def shrunk(image: Singles, width: int) -> Singles:
    """The image (H, W[, 3]) averaged down to at most this width; smaller ones stay as they are."""
    if image.shape[1] <= width:
        return image
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def peaks(image: Singles, width: int) -> Singles:
    """The image (H, W) brought down to at most this width so that a single bright pixel stays as bright."""
    step = -(-image.shape[1] // width)
    rows = np.maximum.reduceat(image, np.arange(0, image.shape[0], step), axis=0)
    return np.asarray(np.maximum.reduceat(rows, np.arange(0, image.shape[1], step), axis=1), np.float32)


def grey_picture(light: Singles, white: float, width: int) -> Bytes:
    """Light (H, W) -> RGB (h, w, 3) of at most this width, by the sRGB curve."""
    return np.repeat(srgb8(shrunk(light, width) / np.float32(white))[:, :, None], 3, axis=2)


def colour_picture(light: Singles, white: float, width: int) -> Bytes:
    """Light (H, W, 3) -> RGB (h, w, 3) of at most this width, by the sRGB curve."""
    return srgb8(shrunk(light, width) / np.float32(white))


def shown_picture(shown: Bytes, width: int) -> Bytes:
    """A picture to look at, (H, W) or (H, W, 3), as RGB (h, w, 3) of at most this width."""
    colours = shown if shown.ndim == 3 else np.repeat(shown[:, :, None], 3, axis=2)
    return np.asarray(np.rint(shrunk(colours.astype(np.float32), width)), np.uint8)


def peaks_picture(light: Singles, width: int) -> Bytes:
    """Light (H, W) -> RGB (h, w, 3) with its brightest pixel white, however few are lit."""
    seen = peaks(light, width)
    most = float(seen.max(initial=0.0))
    return np.repeat(srgb8(seen / np.float32(most if most > 0 else 1.0))[:, :, None], 3, axis=2)
