"""Direct light under a picture that the projector shows: every surface point has the light of its own projector pixel.

The look-up (`rig.projected`) is exact, and so are the edges of the picture.

A projector with a blurred lens lays the light of each pixel over its neighbours. There the picture is blurred first,
each point having the mean of what lies around it in the raster, and looked up straight between the middles of its
pixels. Of a pixel's full light that errs, at the edge of a block, by at most 8 % (0.5 pixels of blur), 2.5 % (1) or
1.1 % (2), root mean square 1.6, 0.6 and 0.2 %. A gate's window has soft edges there, too (`blur`), and each is taken by
itself: where a window ends within the blur of a change of the picture from row to row, the light is as if the two did
not depend on each other, at most a quarter of the full light off.
"""

from __future__ import annotations

import cv2
import numpy as np

from slopegate.core.compiled.kept import njit
from slopegate.core.exposure.blur import blurred
from slopegate.core.exposure.kernels import Pixels
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.projected import shares


@njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"}, error_model="numpy")
def to_patterned_steps(
    values: Singles, row: Singles, column: Singles, picture: Singles, scale: np.float32, out: Pixels
) -> None:
    """`kernels.to_steps` of values (H, W), each times what the picture (h, w) sends to its projector row and column.

    Where the row is negative the values must be 0.
    """
    most, none, width = np.float32(65535), np.float32(0), np.int32(picture.shape[1])
    pixels = picture.reshape(-1)
    for k in range(out.shape[0]):
        for j in range(np.uint64(out.shape[1])):
            # Without a branch: what is unlit is 0 times any pixel. Unsigned, so that no index is tested.
            r, c = np.int32(max(row[k, j], none)), np.int32(max(column[k, j], none))
            light = values[k, j] * pixels[np.uint32(r * width + c)] * scale
            out[k, j] = np.uint16(np.int32(np.rint(min(light, most))))


def patterned(
    direct: Singles,
    projector_row: Singles,
    projector_column: Singles,
    picture: Singles | None,
    blur_px: float = 0.0,
) -> Singles:
    """Direct light (H, W) or (H, W, C), as with all on, under a picture; None: all on, the array itself.

    blur_px: that of the projector's lens.
    """
    if picture is None:
        return direct
    if blur_px > 0:
        # A look-up between pixels spreads by 1 / 6 of a pixel's square, and a pixel is 1 / 12 of it wide already.
        found = _soft_shares(blurred(picture, max(blur_px**2 - 1 / 12, 0.0) ** 0.5), projector_row, projector_column)
    else:
        found = shares(picture, projector_row, projector_column)
    return direct * (found if direct.ndim == 2 else found[..., None])


def _soft_shares(soft: Singles, row: Singles, column: Singles) -> Singles:
    """What a blurred picture sends to rows and columns (H, W), straight between the middles of its pixels."""
    half = np.float32(0.5)
    found = cv2.remap(soft, column - half, row - half, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(row >= 0, found, np.float32(0))
