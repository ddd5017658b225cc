"""Numba loops that turn a scene's radiance into what a sensor's planes hold."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from slopegate.core.exposure.kernels import Pixels

Singles = NDArray[np.float32]


@njit(cache=True, nogil=True)
def luminance(rgb: Singles, weights: Singles, out: Singles) -> None:
    """out (h, w) = the weighted sum of the channels of rgb (h, w, 3), from the first to the last."""
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[k, j] = rgb[k, j, 0] * weights[0] + rgb[k, j, 1] * weights[1] + rgb[k, j, 2] * weights[2]


@njit(cache=True, nogil=True)
def to_steps(values: Singles, scale: np.float32, top: int, left: int, out: Pixels) -> None:
    """Write values (h, w) times scale, rounded and cut at 65535, into `out` from row `top` and column `left` on."""
    most = np.float32(65535)
    for k in range(values.shape[0]):
        for j in range(values.shape[1]):
            out[top + k, left + j] = np.uint16(min(np.rint(values[k, j] * scale), most))
