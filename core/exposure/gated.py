"""Linear light of a gate: weight * direct + exposure / period * ambient (model sections 3 and 4)."""

from __future__ import annotations

import numpy as np

from slopegate.core.exposure import kernels
from slopegate.core.exposure.edges import kernel_windows, make_planes
from slopegate.core.gating.gate import RowWindows
from slopegate.core.rig.arrays import Singles


def gated(
    projector_row: Singles,
    direct: Singles,
    ambient: Singles,
    windows: RowWindows,
    exposure_periods: float,
    skip: bool = True,
) -> Singles:
    """Linear light of a gate: weight * direct + exposure_periods * ambient, float32 of direct's shape.

    projector_row (H, W); direct and ambient (H, W) or (H, W, 3). skip False: look at every pixel, whether the gate can
    light it or not. Raises ValueError on other shapes.
    """
    height, width = projector_row.shape
    if direct.shape[:2] != (height, width) or ambient.shape != direct.shape:
        raise ValueError(
            f"direct {direct.shape} or ambient {ambient.shape} do not fit {height} x {width} projector rows"
        )
    # The channels of a pixel lie side by side, so a colour image is a grey one with every row value repeated.
    channels = direct.size // projector_row.size
    rows = np.repeat(projector_row, channels, axis=1)
    flat = (height, width * channels)
    planes = make_planes(rows, direct.reshape(flat), ambient.reshape(flat), skip)
    out = np.empty(flat, np.float32)
    kernels.gate(planes, kernel_windows(windows), np.float32(exposure_periods), out)
    return out.reshape(direct.shape)
