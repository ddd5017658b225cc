"""Compositing: the foreground's light over another background, and light that suits it.

The light of the foreground's slices is the foreground already weighed by its share of each pixel, so it is added as it
is. Relit by a picture of the new background's colours, through its own transport, it shows them in its gloss, too.
"""

from __future__ import annotations

import cv2
import numpy as np

from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.patterns import Raster

_SOFTNESS = 1 / 8
"""Standard deviation of the blur of a background's light, as a share of its width."""


def composite(foreground: Singles, alpha: Singles, background: Singles) -> Singles:
    """foreground + (1 - alpha) background, (H, W, 3) float32, linear.

    foreground (H, W, 3): the light of the foreground alone, weighed by alpha as slices have it; alpha (H, W), 0..1;
    background (H, W, 3) in the same unit. Raises InputError for sizes that differ.
    """
    for name, shape in (("alpha", (*alpha.shape, 3)), ("background", background.shape)):
        require(shape == foreground.shape, name, shape[:2], f"of the foreground's size {foreground.shape[:2]}")
    return (foreground + (1 - alpha[..., None]) * background).astype(np.float32)


def covering(picture: Singles, width: int, height: int) -> Singles:
    """The picture (h, w, 3) scaled so that it covers height x width and cut evenly at two sides."""
    rows, columns = picture.shape[:2]
    scale = max(width / columns, height / rows)
    size = max(width, round(columns * scale)), max(height, round(rows * scale))
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    scaled = cv2.resize(np.ascontiguousarray(picture, np.float32), size, interpolation=way)
    left, top = (size[0] - width) // 2, (size[1] - height) // 2
    return np.ascontiguousarray(scaled[top : top + height, left : left + width])


def surrounding_light(background: Singles, raster: Raster) -> Singles:
    """What the projector shows so that the foreground is lit as by this background (h, w, 3): a blurred copy of it.

    (raster height, raster width, 3) float32, its brightest value 1. Raises InputError for a black background.
    """
    small = covering(background, raster.width, raster.height)
    soft = cv2.GaussianBlur(small, (0, 0), _SOFTNESS * raster.width, borderType=cv2.BORDER_REPLICATE)
    brightest = float(soft.max())
    require(brightest > 0, "background", "black", "a picture with some light")
    return np.asarray(np.clip(soft / brightest, 0, 1), np.float32)
