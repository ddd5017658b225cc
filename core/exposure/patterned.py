"""Direct light under a picture that the projector shows: every surface point has the light of its own projector pixel.

A picture is the share of its full light that each of the projector's pixels sends, (raster height, raster width)
float32, 0..1. A point at projector row r and column c is lit by the pixel at (floor(r), floor(c)): the look-up is
exact, and so are the edges of the picture.

A projector with a blurred lens lays the light of each pixel over its neighbours. There the picture is blurred first,
each point having the mean of the pixels around it that lie in the raster. A gate's window, too, has soft edges there
(`blur`), and each is taken by itself: where a window's edge and a change of the picture from row to row lie within the
blur of each other, the light is that of the two as if they did not depend on each other. Pictures that are even along
their columns are exact.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from slopegate.core.exposure.blur import blurred
from slopegate.core.exposure.kernels import Pixels
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.rig import Rig


@njit(cache=True, nogil=True)
def _look_up(picture: Singles, row: Singles, column: Singles, out: Singles) -> None:
    """out (P,) = what the picture (h, w) shows at projector rows and columns (P,); 0 where the row is negative."""
    for i in range(out.shape[0]):
        r = row[i]
        out[i] = picture[np.int64(r), np.int64(column[i])] if r >= 0 else np.float32(0)


@njit(cache=True, nogil=True)
def to_patterned_steps(
    values: Singles, row: Singles, column: Singles, picture: Singles, scale: np.float32, out: Pixels
) -> None:
    """`kernels.to_steps` of values (H, W), each times what the picture (h, w) shows at its projector row and column."""
    most = np.float32(65535)
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            r = row[k, j]
            share = picture[np.int32(r), np.int32(column[k, j])] if r >= 0 else np.float32(0)
            out[k, j] = np.uint16(np.int32(np.rint(min(values[k, j] * share * scale, most))))


def shares(picture: Singles, projector_row: Singles, projector_column: Singles) -> Singles:
    """What a picture (h, w) shows at projector rows and columns of one shape; 0 where they are negative."""
    out = np.empty(projector_row.shape, np.float32)
    flat = np.ascontiguousarray(projector_row).reshape(-1), np.ascontiguousarray(projector_column).reshape(-1)
    _look_up(picture, *flat, out.reshape(-1))
    return out


def patterned(direct: Singles, projector_row: Singles, projector_column: Singles, picture: Singles | None) -> Singles:
    """Direct light (H, W) or (H, W, C), as with all on, under a picture; None: all on, the array itself."""
    if picture is None:
        return direct
    found = shares(picture, projector_row, projector_column)
    return direct * (found if direct.ndim == 2 else found[..., None])


def thrown(rig: Rig, picture: Singles) -> Singles:
    """A picture as the projector's lens throws it: itself unless the lens is blurred."""
    return blurred(picture, rig.projector.blur_px)


def check_pattern(picture: Singles, raster: Raster) -> None:
    """Raise ValueError unless this is a picture of a projector's raster."""
    if picture.shape != (raster.height, raster.width) or picture.dtype != np.float32:
        raise ValueError(f"a picture {picture.dtype} {picture.shape} is not one of a projector of {raster} pixels")
