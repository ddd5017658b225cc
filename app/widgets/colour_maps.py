"""Colours for grey images: ramps in which equal steps look equal, as words for the screen."""

from __future__ import annotations

from typing import Literal, get_args

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bytes, Words

ColourMap = Literal["grey", "inverted grey", "viridis", "inferno", "cividis"]
COLOUR_MAPS: tuple[ColourMap, ...] = get_args(ColourMap)

_OPENCV = {
    "viridis": cv2.COLORMAP_VIRIDIS,
    "inferno": cv2.COLORMAP_INFERNO,
    "cividis": cv2.COLORMAP_CIVIDIS,
}

SATURATED, DARK = 0xFFFF00FF, 0xFF00A0FF
"""Marks of pixels at the end of the camera's range and of those with hardly any light: in none of the ramps."""


def ramp(name: ColourMap) -> Words:
    """The 256 colours of a map from black to white level, (256,) 0xffRRGGBB."""
    steps = np.arange(256, dtype=np.uint8)
    if name in _OPENCV:
        rgb = cv2.applyColorMap(steps[:, None], _OPENCV[name]).reshape(256, 3)[:, ::-1]
        return _words(np.asarray(rgb, np.uint8))
    grey = steps if name == "grey" else steps[::-1]
    return _words(np.repeat(grey[:, None], 3, axis=1))


def _words(rgb: Bytes) -> Words:
    red, green, blue = rgb.astype(np.uint32).T
    return np.asarray(np.uint32(0xFF000000) | red << 16 | green << 8 | blue, np.uint32)
