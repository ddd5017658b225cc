"""Render buffers x gate -> linear light: weight * direct + exposure / period * ambient (model sections 3 and 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from slopegate.core import kernels
from slopegate.core.checks import require
from slopegate.core.edges import kernel_windows, make_planes
from slopegate.core.gate import RowWindows, row_windows
from slopegate.core.render import render
from slopegate.core.rig import Rig
from slopegate.core.scene import Scene
from slopegate.core.settings import GateSettings

Image = NDArray[np.float32]


def gated(projector_row: Image, direct: Image, ambient: Image, windows: RowWindows, exposure_periods: float) -> Image:
    """weight * direct + exposure_periods * ambient, float32 of direct's shape.

    projector_row (H, W); direct and ambient (H, W) or (H, W, 3). Raises ValueError on other shapes.
    """
    height, width = projector_row.shape
    require(direct.shape[:2] == (height, width), "direct", direct.shape, f"of {height} x {width} pixels")
    require(ambient.shape == direct.shape, "ambient", ambient.shape, f"of direct's shape {direct.shape}")
    # The channels of a pixel lie side by side, so a colour image is a grey one with every row value repeated.
    channels = direct.size // projector_row.size
    rows = np.repeat(projector_row, channels, axis=1)
    flat = (height, width * channels)
    planes = make_planes(rows, direct.reshape(flat), ambient.reshape(flat))
    out = np.empty(flat, np.float32)
    kernels.gate(planes, kernel_windows(windows), np.float32(exposure_periods), out)
    return out.reshape(direct.shape)


def integrate(rig: Rig, scene: Scene, settings: GateSettings, samples: int, time_s: float = 0.0) -> Image:
    """Radiance (H, W, 3) float32, each pixel the mean over samples x samples rays spread evenly over its area.

    Every ray is tested against the one window of the camera row that it belongs to. The unit is that of a fully lit
    frame: a gate of exactly one period gives direct + ambient. Raises ValueError when samples is below 1.
    """
    require(samples >= 1, "samples", samples, "a whole number of at least 1")
    windows = row_windows(rig, settings)
    periods = settings.exposure_us / rig.projector.period_us
    lens = rig.camera.lens
    total = np.zeros((lens.height, lens.width, 3), np.float32)
    for index in range(samples * samples):
        column, row = (index % samples + 0.5) / samples, (index // samples + 0.5) / samples
        buffers = render(rig, scene, time_s, (column, row))
        total += gated(buffers.projector_row, buffers.direct, buffers.ambient, windows, periods)
    total /= np.float32(samples * samples)
    return total
