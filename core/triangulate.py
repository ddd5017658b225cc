"""From the projector row that lights a pixel back to its depth (model section 3, real rigs included)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from slopegate.core.checks import require
from slopegate.core.rig import Rig

Singles = NDArray[np.float32]

_BAND_ROWS = 128
_CORRECTIONS = 12
"""Newton steps for a distorted projector lens: each gains a factor of the distortion's slope."""


def triangulate(rig: Rig, projector_row: Singles) -> Singles:
    """Projector rows (H, W), negative where unknown -> inverse depth (H, W) float32 in 1/m along the camera's axis.

    0 where the row is unknown or meets the pixel's ray nowhere in front of the camera. On one camera ray the projector
    row is a ratio of two affine functions of inverse depth, so an undistorted projector lens needs one division: good
    to the rounding of the result, 6e-8 relative, and for the ideal rig 1e-15 (|y/z| + |kappa_p|) / b beside. What the
    rows' own float32 costs is more: half their last place over f_p b, 3.1e-7 / m for the check rig.
    """
    lens = rig.camera.lens
    shape = (lens.height, lens.width)
    require(projector_row.shape == shape, "projector_row", projector_row.shape, f"of the camera's shape {shape}")
    found = np.zeros(shape, np.float32)
    columns = np.arange(lens.width) + 0.5
    for first in range(0, lens.height, _BAND_ROWS):
        band = slice(first, min(first + _BAND_ROWS, lens.height))
        rows = np.arange(band.start, band.stop)[:, None] + 0.5
        wanted = projector_row[band].astype(np.float64)
        inverse = _on_rays(rig, rig.camera_rays(columns[None, :], rows), wanted)
        found[band] = np.where((wanted >= 0) & (inverse > 0), inverse, 0.0)
    return found


def _on_rays(rig: Rig, rays: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse depth at which each ray (..., 3) meets its projector row; 0 where there is none."""
    at_infinity, change = rays @ rig.rotation.T, rig.rotation @ np.array(rig.projector_offset_m)
    lens = rig.projector.lens
    slope = (wanted - lens.cy) / lens.fy
    inverse = _inverse_depth(at_infinity, change, slope)
    for _ in range(_CORRECTIONS if lens.distorted else 0):
        point = at_infinity - inverse[..., None] * change
        depth = np.where(point[..., 2] > 1e-6, point[..., 2], 1.0)
        _, row = lens.project(point[..., 0] / depth, point[..., 1] / depth)
        slope = slope + (wanted - row) / lens.fy
        inverse = _inverse_depth(at_infinity, change, slope)
    return inverse


def _inverse_depth(
    at_infinity: NDArray[np.float64], change: NDArray[np.float64], slope: NDArray[np.float64]
) -> NDArray[np.float64]:
    top = at_infinity[..., 1] - slope * at_infinity[..., 2]
    bottom = change[1] - slope * change[2]
    inverse = np.zeros_like(top)
    np.divide(top, bottom, out=inverse, where=bottom != 0)
    return inverse


def depth_m(inverse_depth: Singles) -> Singles:
    """Metres along the camera's axis, NaN where the inverse depth is not positive."""
    depth = np.full_like(inverse_depth, np.nan)
    np.divide(1.0, inverse_depth, out=depth, where=inverse_depth > 0)
    return depth
