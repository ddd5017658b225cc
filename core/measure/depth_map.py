"""What a depth sweep finds, and how far it is from the truth where that is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig.triangulate import depth_m

Singles = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class DepthMap:
    """What a sweep found; arrays (H, W) float32."""

    projector_row: Singles
    """Continuous projector row that lights the pixel, -1 where unknown."""
    inverse_depth: Singles
    """1/z in 1/m along the camera's axis, 0 where unknown."""
    disparity_rows: Singles
    """Projector rows by which the light comes later than from infinity on the axis, NaN where unknown; f_p b / z at
    B = 1 of the ideal rig."""
    frames: int
    """Settings measured, the two of all light and of none included."""
    plain_frames: int
    """What a sweep in equal steps takes for the same range and resolution."""
    resolution_rows: float
    """Width of the intervals of projector rows that pixels were sorted into."""

    @property
    def depth_m(self) -> Singles:
        """Metres along the camera's axis, NaN where unknown."""
        return depth_m(self.inverse_depth)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where there is a depth, (H, W) bool."""
        return self.inverse_depth > 0


@dataclass(frozen=True)
class DepthError:
    """A depth map against the truth."""

    known_share: float
    """Of the pixels that the projector lights, those with a depth."""
    median_mm: float
    rms_mm: float
    p95_mm: float
    """95th percentile of the absolute error."""
    wrong_share: float
    """Of the pixels with a depth, those off by more than a whole interval."""


def depth_error(found: DepthMap, projector_row: Singles, inverse_depth: Singles) -> DepthError | None:
    """Compare with what `render.Buffers` holds, (H, W) each; None where no lit pixel has a depth."""
    lit = (projector_row >= 0) & (inverse_depth > 0)
    both = lit & found.known
    if not both.any():
        return None
    away_mm = 1000 * np.abs(1 / found.inverse_depth[both].astype(np.float64) - 1 / inverse_depth[both])
    median_mm, p95_mm = np.percentile(away_mm, (50, 95))
    rows = np.abs(found.projector_row[both] - projector_row[both])
    return DepthError(
        known_share=float(np.count_nonzero(both) / np.count_nonzero(lit)),
        median_mm=float(median_mm),
        rms_mm=float(np.sqrt(np.mean(away_mm**2))),
        p95_mm=float(p95_mm),
        wrong_share=float(np.mean(rows > found.resolution_rows)),
    )
