"""What a capture looks like, as small 8-bit pictures for the screen."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from slopegate.core.measure.stack import Summary

Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]

BRIGHT_PERCENTILE = 99.7
DEPTH_PERCENTILES = (1.0, 99.0)
UNKNOWN = 24
"""Grey of pixels whose depth no slice tells."""


def white_level(total: Singles) -> float:
    """The light (counts) shown as white, common to all slices and their sum."""
    return max(float(np.percentile(total[::4, ::4], BRIGHT_PERCENTILE)), 1.0)


def shrunk(image: Singles, width: int) -> Singles:
    """The image (H, W[, 3]) averaged down to at most this width; smaller ones stay as they are."""
    if image.shape[1] <= width:
        return image
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def grey_picture(light: Singles, white: float, width: int) -> Bytes:
    """Light (H, W) in counts -> RGB (h, w, 3), by the sRGB curve."""
    grey = _srgb(shrunk(light, width) / np.float32(white))
    return np.repeat(grey[:, :, None], 3, axis=2)


def overlay_picture(summary: Summary, white: float, width: int) -> Bytes:
    """Every slice in a colour of its own, blue far and red near, one over the other: RGB (h, w, 3)."""
    return _srgb(shrunk(summary.overlay, width) / np.float32(white))


def depth_range(summary: Summary) -> tuple[float, float]:
    """Nearest and farthest depth (m) worth a colour; (0, 0) where none is known."""
    known = summary.inverse_depth[summary.inverse_depth > 0]
    if known.size == 0:
        return 0.0, 0.0
    far, near = np.percentile(known, DEPTH_PERCENTILES)
    return float(1 / near), float(1 / far)


def depth_picture(summary: Summary, width: int) -> Bytes:
    """Depth from blue (far) to red (near), equal steps of 1/z: RGB (h, w, 3)."""
    near, far = depth_range(summary)
    stride = max(1, -(-summary.inverse_depth.shape[1] // width))
    inverse = summary.inverse_depth[::stride, ::stride]  # neighbours of an edge have no depth in between
    if far <= 0:
        return np.full((*inverse.shape, 3), UNKNOWN, np.uint8)
    span = max(1 / near - 1 / far, 1e-9)
    level = np.clip((inverse - 1 / far) / span, 0, 1)
    steps = np.rint(16 + 223 * level).astype(np.uint8)
    coloured = cv2.applyColorMap(steps, cv2.COLORMAP_TURBO)[..., ::-1]
    return np.where((inverse > 0)[..., None], coloured, UNKNOWN).astype(np.uint8)


def _srgb(level: Singles) -> Bytes:
    """Linear 0..1 -> 8 bit (IEC 61966-2-1)."""
    clipped = np.clip(level, 0, 1)
    curve = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * curve), np.uint8)
