"""Linear light as screens show it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Doubles


def srgb_curve(level: NDArray[Any]) -> Doubles:
    """Linear light, 0 black to 1 white, of any shape -> 0..1 on the sRGB curve (IEC 61966-2-1); the rest is clipped."""
    clipped = np.clip(level, 0.0, 1.0)
    return np.asarray(np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055), np.float64)
