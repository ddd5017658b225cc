"""Which projector row lights a point on a camera ray, and back from that row to depth.

Model section 3, for every rig: rotated projectors and distorted lenses included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slopegate.core.rig.arrays import Bools, Doubles, Singles
from slopegate.core.rig.rig import Rig, to_pixels

_BAND_ROWS = 128
"""Camera rows at a time, to bound the memory."""
_SECANT_STEPS = 8
_ROW_TOLERANCE = 1e-9
_LARGEST_STEP = 0.3
"""Largest change of y/z in one step: far outside its field a lens model's rows leap, and following them would leave all
numbers behind."""


def triangulate(rig: Rig, projector_row: Singles) -> Singles:
    """Projector rows (H, W), negative where unknown -> inverse depth (H, W) float32 in 1/m along the camera's axis.

    0 where the row is unknown or meets the pixel's ray nowhere in front of the camera. Good to the rounding of the
    result, 6e-8 relative, and to what `inverse_depth` states. What the rows' own float32 costs is more: half their last
    place over f_p b, 3.1e-7 / m for the check rig.
    """
    lens = rig.camera.lens
    shape = (lens.height, lens.width)
    if projector_row.shape != shape:
        raise ValueError(f"projector_row is of shape {projector_row.shape}, not of the camera's {shape}")
    found = np.zeros(shape, np.float32)
    for first in range(0, lens.height, _BAND_ROWS):
        band = slice(first, min(first + _BAND_ROWS, lens.height))
        rays = rig.camera_rays(lens.column_centres, lens.row_centres[band, None])
        wanted = projector_row[band].astype(np.float64)
        inverse, met = inverse_depth(rig, rays, wanted)
        found[band] = np.where((wanted >= 0) & met & (inverse > 0), inverse, 0.0)
    return found


def inverse_depth(rig: Rig, rays: Doubles, projector_rows: ArrayLike) -> tuple[Doubles, Bools]:
    """1/z in 1/m where camera rays (..., 3) with z = 1 meet continuous projector rows (...), broadcast; and whether.

    0 at infinity, negative behind the rig, NaN where a ray runs along the row's sheet of light. Ideal rig: to
    1e-15 (|y/z| + |kappa_p|) / b. On a camera ray the row is a ratio of two affine functions of 1/z, so a pinhole
    projector takes one division; a distorted one is followed to 1e-9 rows, and where it cannot be (`meeting_slope`) the
    number is the nearest that was come by and the ray is said not to meet its row.
    """
    at_infinity, change = to_projector_axes(rig, rays)
    rows = np.asarray(projector_rows, np.float64)
    wanted = np.broadcast_to(rows, np.broadcast_shapes(rays.shape[:-1], rows.shape))
    slope, met = meeting_slope(rig, at_infinity, change, wanted)
    return quotient(at_infinity[..., 1] - slope * at_infinity[..., 2], change[1] - slope * change[2], np.nan), met


def projector_rows(rig: Rig, rays: Doubles, inverse_depth: ArrayLike) -> Doubles:
    """Continuous projector rows that light points of camera rays (..., 3) with z = 1, at 1/z in 1/m (...), broadcast.

    The one law behind every row that the program computes: r_p = f_p y/z + c_p in the projector's axes, through its
    lens. NaN where the point is not in front of the projector; finite at infinity (inverse depth 0). Rows may lie
    outside the raster. As accurate as `Rig.to_projector`. `render.kernels` repeats it for speed.
    """
    at_infinity, change = to_projector_axes(rig, rays)
    w = np.asarray(inverse_depth, np.float64)
    return to_pixels(rig.projector.lens, at_infinity - w[..., None] * change)[1]


def to_projector_axes(rig: Rig, rays: Doubles) -> tuple[Doubles, Doubles]:
    """Camera rays (..., 3) along the projector's axes, and its offset (3,) from the camera along them.

    A ray's point at w = 1/z lies, as the projector sees it, in the direction ray - w offset.
    """
    return rays @ rig.rotation.T, rig.rotation @ np.array(rig.projector_offset_m)


def meeting_slope(rig: Rig, at_infinity: Doubles, change: Doubles, projector_rows: Doubles) -> tuple[Doubles, Bools]:
    """y/z in the projector (...) at which camera rays, `to_projector_axes`, meet projector rows (...), and whether.

    Exact to two roundings for a pinhole. Through a distorted lens the secant method brings it to within 1e-9 rows for
    distortions of up to a tenth of the radius; beyond, a lens model may turn round before it comes to a row.
    """
    lens = rig.projector.lens
    slope = (projector_rows - lens.cy) / lens.fy
    met = np.ones(slope.shape, np.bool_)
    if not lens.distorted:
        return slope, met
    steepness: Doubles | float = lens.fy
    before: tuple[Doubles, Doubles] | None = None
    for _ in range(_SECANT_STEPS):
        top, bottom = at_infinity[..., 1] - slope * at_infinity[..., 2], change[1] - slope * change[2]
        point = at_infinity - quotient(top, bottom)[..., None] * change
        in_front = point[..., 2] > 1e-6
        missing = projector_rows - lens.project(point[..., 0] / np.where(in_front, point[..., 2], 1.0), slope)[1]
        missing = np.where(in_front, missing, 0.0)
        met = np.abs(missing) < _ROW_TOLERANCE
        if met.all():
            break
        # The secant's slope, where it is believable: far outside the field a lens model may even turn round.
        if before is not None:
            steepness = quotient(before[1] - missing, slope - before[0])
            steepness = np.where(np.abs(steepness / lens.fy - 1) < 0.5, steepness, lens.fy)
        before = slope, missing
        slope = slope + np.clip(missing / steepness, -_LARGEST_STEP, _LARGEST_STEP)
    return slope, met


def quotient(top: Doubles, bottom: Doubles, otherwise: float = 0.0) -> Doubles:
    """top / bottom, broadcast, and `otherwise` where bottom is 0."""
    out: Doubles = np.full(np.broadcast_shapes(top.shape, bottom.shape), otherwise)
    np.divide(top, bottom, out=out, where=bottom != 0)
    return out


def depth_m(inverse_depth: Singles) -> Singles:
    """Metres along the camera's axis, NaN where the inverse depth is not positive."""
    depth = np.full_like(inverse_depth, np.nan)
    np.divide(1.0, inverse_depth, out=depth, where=inverse_depth > 0)
    return depth
