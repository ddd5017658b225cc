"""What one does without slices to cut out a foreground: the baselines that a matte from slices is compared with."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from slopegate.core.rig.arrays import Bytes, Singles
from slopegate.core.rig.checks import require, require_rectangle

GREEN_DEG: Final = (75.0, 165.0)
"""Hues of a green screen, degrees of the colour circle."""
_HUE_RAMP_DEG: Final = 10.0
_RAMP: Final = 0.1
_ROUNDS: Final = 5


def hsv_key(
    photo: Bytes,
    hues_deg: tuple[float, float] = GREEN_DEG,
    least_saturation: float = 0.3,
    least_value: float = 0.08,
) -> Singles:
    """Keying by colour: the matte (H, W) float32 of a photo (H, W, 3) uint8 sRGB before a screen of these hues.

    0 where a colour's hue lies in the range and it is saturated and bright enough; 1 from 10 degrees or 0.1 beyond.
    """
    hue, saturation, value = cv2.split(cv2.cvtColor(photo.astype(np.float32) / 255, cv2.COLOR_RGB2HSV))
    low, high = hues_deg
    inside = np.minimum(hue - low, high - hue) / _HUE_RAMP_DEG + 1
    screen = np.minimum(inside, (saturation - least_saturation) / _RAMP + 1)
    screen = np.minimum(screen, (value - least_value) / _RAMP + 1)
    return np.asarray(1 - np.clip(screen, 0, 1), np.float32)


def grab_cut(photo: Bytes, box: tuple[int, int, int, int]) -> Singles:
    """GrabCut (Rother, Kolmogorov and Blake 2004): the matte (H, W) float32, 0 or 1, of a photo (H, W, 3) uint8.

    box: x0, y0, x1, y1 around the foreground, which a user draws; what lies outside is background. Equal calls give
    equal mattes. Raises InputError for a box that does not lie inside or leaves nothing outside.
    """
    height, width = photo.shape[:2]
    require_rectangle("box", box, width, height)
    x0, y0, x1, y1 = box
    require((x1 - x0, y1 - y0) != (width, height), "box", box, "smaller than the photo, for something must lie outside")
    mask = np.zeros((height, width), np.uint8)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(1)
    ordered = np.ascontiguousarray(photo[..., ::-1])
    cv2.grabCut(ordered, mask, (x0, y0, x1 - x0, y1 - y0), *models, _ROUNDS, cv2.GC_INIT_WITH_RECT)
    return np.asarray((mask == cv2.GC_FGD) | (mask == cv2.GC_PR_FGD), np.float32)


def clean_plate(photo: Singles, plate: Singles, low: float, high: float) -> Singles:
    """Difference from a picture without the foreground: the matte (H, W) float32 of light (H, W, 3), linear.

    0 where no colour differs by more than `low`, 1 from `high` on. Shadows that the foreground casts differ, too.
    """
    require(0 <= low < high, "low", low, f"at least 0 and below high ({high:g})")
    require(photo.shape == plate.shape, "plate", plate.shape, f"of the photo's shape {photo.shape}")
    apart = np.abs(photo - plate).max(axis=2)
    return np.asarray(np.clip((apart - low) / (high - low), 0, 1), np.float32)
