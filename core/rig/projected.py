"""What a picture on the projector sends to places of its raster.

A picture is the share of its full light that each of the projector's pixels sends, (raster height, raster width)
float32, 0..1. A place at row r and column c belongs to the pixel (floor(r), floor(c)).
"""

from __future__ import annotations

import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.patterns import Raster


@njit(cache=True, nogil=True)
def look_up(picture: Singles, row: Singles, column: Singles, out: Singles) -> None:
    """out (P,) = what the picture (h, w) sends to rows and columns (P,); 0 where the row is negative."""
    for i in range(out.shape[0]):
        r = row[i]
        out[i] = picture[np.int64(r), np.int64(column[i])] if r >= 0 else np.float32(0)


def shares(picture: Singles, row: Singles, column: Singles) -> Singles:
    """What a picture (h, w) sends to projector rows and columns of one shape, float32; 0 where they are negative."""
    out = np.empty(row.shape, np.float32)
    flat = np.ascontiguousarray(row).reshape(-1), np.ascontiguousarray(column).reshape(-1)
    look_up(picture, *flat, out.reshape(-1))
    return out


def check_picture_of(picture: Singles, raster: Raster) -> None:
    """Raise ValueError unless this is a picture of a projector's raster."""
    if picture.shape != (raster.height, raster.width) or picture.dtype != np.float32:
        raise ValueError(f"a picture {picture.dtype} {picture.shape} is not one of a projector of {raster} pixels")
