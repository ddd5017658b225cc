"""Phases: when what a camera pixel sees can be lit, less the time by which the shutter reaches its row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig.rig import Rig

_GRID = 17


def phase_range(rig: Rig, line_time_us: float, nearest_m: float) -> tuple[float, float]:
    """First and last phase, microseconds, at which anything from `nearest_m` to infinity can be lit and seen.

    Taken on a grid of rays; widened by two projector rows at either end for what lies between them.
    """
    lens = rig.camera.lens
    columns, rows = np.meshgrid(np.linspace(0, lens.width, _GRID), np.linspace(0.5, lens.height - 0.5, _GRID))
    ends = np.stack([lit_rows(rig, columns.ravel(), rows.ravel(), w) for w in (0.0, 1 / nearest_m)])
    last = rig.projector.lens.height
    # of a ray that leaves the projector's frame only the part inside is ever lit, of one beside it none
    seen = np.isfinite(ends).all(axis=0) & (ends.max(axis=0) > 0) & (ends.min(axis=0) < last)
    row_us = 1 / rig.projector.rows_per_us
    if not seen.any():
        return 0.0, row_us
    phases = np.clip(ends[:, seen], 0, last) * row_us - rows.ravel()[seen] * line_time_us
    return float(phases.min()) - 2 * row_us, float(phases.max()) + 2 * row_us


def lit_rows(
    rig: Rig, columns: NDArray[np.float64], rows: NDArray[np.float64], inverse_depth: float
) -> NDArray[np.float64]:
    """Projector rows (n,) of points at this inverse depth on these camera rays; NaN beside or behind the projector.

    As accurate as `Rig.to_projector`.
    """
    local = rig.camera_rays(columns, rows) @ rig.rotation.T
    local = local - inverse_depth * (rig.rotation @ np.array(rig.projector_offset_m))
    ahead = local[:, 2] > 1e-6
    depth = np.where(ahead, local[:, 2], 1.0)
    _, lit = rig.projector.lens.project(local[:, 0] / depth, local[:, 1] / depth)
    return np.where(ahead, lit, np.nan)
