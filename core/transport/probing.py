"""Probing: which entries of a light transport matrix a gate records, as an operator that is never a matrix.

Of the transport T of a scene, from projector pixels to camera pixels, a gate records Pi * T, entry by entry, and under
a pattern p the image i = (Pi * T) p (the paper's equations 11 and 12). Pi depends on rows alone. With N rows in camera
and projector, swept at one speed again and again without a pause, delay t_d and exposure t_e in whole rows,

    Pi[c, r] = how many k of 0 .. t_e - 1 have r = c + t_d - k (mod N).

That is the convention `equations`: by the paper's equations 7 and 8, camera row c is open while projector row c + t_d
is lit, so the first row of Pi(1, 1) begins 0 1 0 0 0. The matrices that the paper prints begin 0 0 0 0 1: they are the
transposes, r = c - t_d + k, here `printed`. A gate of the program, whose delay is that of the middle of the exposure,
is the convention `equations` at a delay of t_d - (t_e - 1) / 2 rows.

Pi for all delays adds up to t_e in every entry, so slices that tile the delays add up to T itself. For images of H x W
pixels and patterns of R x C, every entry of Pi is a block of W x C equal ones, and T is an array (H, W, R, C).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Indices
from slopegate.core.rig.checks import require

Convention = Literal["equations", "printed"]


@dataclass(frozen=True)
class Probing:
    """Pi for a delay and an exposure in whole rows, of a sweep of `rows` rows that begins anew when it ends."""

    rows: int
    delay: int
    exposure: int
    convention: Convention = "equations"

    def __post_init__(self) -> None:
        require(self.rows >= 1, "rows", self.rows, "a whole number of at least 1")
        require(self.exposure >= 0, "exposure", self.exposure, "a whole number of at least 0")

    def weights(self, camera_row: Indices | int, projector_row: Indices | int) -> Indices:
        """Entries of Pi for rows from 0, int64, of arrays that are broadcast to each other."""
        ahead = np.asarray(projector_row, np.int64) - np.asarray(camera_row, np.int64)
        if self.convention == "printed":
            ahead = -ahead
        # The k that reach this row are (delay - ahead) mod rows and every `rows` further one.
        turns, rest = divmod(self.exposure, self.rows)
        return np.asarray(turns + ((self.delay - ahead) % self.rows < rest), np.int64)

    def probed(self, transport: NDArray[Any], first_row: int = 0) -> NDArray[Any]:
        """Pi * T for T (H, W, R, C), whose camera rows count from `first_row`; of T's type."""
        mask = self._of(transport, first_row)
        return np.asarray(transport * mask[:, None, :, None].astype(transport.dtype))

    def image(self, transport: NDArray[Any], pattern: NDArray[Any], first_row: int = 0) -> NDArray[Any]:
        """(Pi * T) p, (H, W), for T (H, W, R, C), whose camera rows count from `first_row`, and p (R, C).

        Of the type of T p. Works row by row, so that large T is given in pieces of any height.
        """
        found = [
            np.tensordot(row, weight[:, None] * pattern, axes=2)
            for row, weight in zip(transport, self._of(transport, first_row), strict=True)
        ]
        return np.stack(found)

    def adjoint(self, transport: NDArray[Any], image: NDArray[Any], first_row: int = 0) -> NDArray[Any]:
        """(Pi * T)' i, (R, C), for an image (H, W): what of the projector these pixels see.

        Those of pieces of T add up.
        """
        found = np.zeros(transport.shape[2:], np.result_type(transport, image))
        for row, line, weight in zip(transport, image, self._of(transport, first_row), strict=True):
            found += weight[:, None] * np.tensordot(line, row, axes=1)
        return found

    def _of(self, transport: NDArray[Any], first_row: int) -> Indices:
        """Pi for the rows of a piece of T, (H, R)."""
        height, _, rows, _ = transport.shape
        return self.weights(first_row + np.arange(height)[:, None], np.arange(rows)[None, :])
