"""Whether a calibration that somebody gives fits the corners that were found: the honest test of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from slopegate.core.calibration.chart_scene import pose_of, seen_by_both
from slopegate.core.calibration.geometry import ChartView
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig

WORSE: Final = 5.0
"""A calibration contradicts the views where it misses their corners by this many times as much as the fit to them."""
LEAST_PX: Final = 1.0
"""And by at least so much: nothing that is set by whole pixels sees less."""


@dataclass(frozen=True)
class Misfit:
    """By how much a rig misses corners that were found, root mean squares in pixels.

    epipolar_px: how far the projector's corners lie off the lines on which the camera's corners put them, whatever
    their distance. camera_px: off the chart as the camera's lens sees it at its best pose. projector_px: off where the
    chart at that pose is in the projector's picture; lengths count here too.
    """

    epipolar_px: float
    camera_px: float
    projector_px: float

    def contradicts(self, fitted: Misfit) -> bool:
        """Whether a rig that misses by this cannot be the one whose fit misses by `fitted`."""
        pairs = (
            (self.epipolar_px, fitted.epipolar_px),
            (self.camera_px, fitted.camera_px),
            (self.projector_px, fitted.projector_px),
        )
        return any(own > max(LEAST_PX, WORSE * best) for own, best in pairs)


def misfit(rig: Rig, views: Sequence[ChartView]) -> Misfit:
    """By how much the rig misses the corners of these views."""
    off = [np.concatenate(parts) for parts in zip(*(_view(rig, view) for view in views), strict=True)]
    return Misfit(*(_rms(part) for part in off))


def _view(rig: Rig, view: ChartView) -> tuple[Doubles, Doubles, Doubles]:
    """Distances of a view's corners (N,) from the epipolar lines, and in the camera's and the projector's picture."""
    pose = pose_of(rig.camera.lens, view.points_m, view.camera)
    if pose is None:
        nothing = np.full(len(view.points_m), np.inf)
        return _epipolar(rig, view), nothing, nothing
    places = seen_by_both(rig, pose.placed(view.points_m))
    missed = [np.hypot(*(place - found).T) for place, found in zip(places, (view.camera, view.projector), strict=True)]
    return _epipolar(rig, view), missed[0], missed[1]


def _epipolar(rig: Rig, view: ChartView) -> Doubles:
    """Distances (N,) in the projector's undistorted pixels."""
    seen, lit = (
        np.stack([*lens.normalise(points[:, 0], points[:, 1]), np.ones(len(points))], axis=-1)
        for lens, points in ((rig.camera.lens, view.camera), (rig.projector.lens, view.projector))
    )
    lens = rig.projector.lens
    # the plane of both centres and the camera's ray, seen from the projector
    lines = np.cross(np.array(rig.projector_offset_m), seen) @ rig.rotation.T
    return np.asarray(
        np.abs((lines * lit).sum(axis=-1)) / np.hypot(lines[:, 0] / lens.fx, lines[:, 1] / lens.fy), np.float64
    )


def _rms(distances: Doubles) -> float:
    """Infinite where a point is not in the picture at all."""
    return float(np.sqrt((distances**2).mean())) if np.isfinite(distances).all() else float("inf")
