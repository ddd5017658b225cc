"""A chart held before a rig, as a scene: what the bench calibrates with, and where its corners are by the lenses' law.

A live frame looks at one place of each pixel. A printed edge would then lie on pixels' borders, half a pixel off, so
the print holds what a pixel sees of it: each of its texels is the mean over the area of a pixel about it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import ArrayLike

from slopegate.core.calibration.chart import Chart, picture
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.checks import require_finite
from slopegate.core.rig.rig import Lens, Matrix3, Rig, Vector3, matrix3, to_pixels
from slopegate.core.scene.scene import Mesh, Scene, Sphere
from slopegate.core.scene.shapes import Finish, quad, turn

WHITE: Final = 0.8
"""Albedo of paper, and of the wall."""
BLACK: Final = 0.04
"""Albedo of printed black."""
TEXELS: Final = 8.0
"""Of the print, along a pixel."""
MOST_TEXELS: Final = 8_000_000
WALL_DEG: Final = 25.0
"""By how much the wall is turned away from the camera's ray along it."""
_FINE: Final = 9
"""Places along a texel, by which the area of a pixel is drawn."""


@dataclass(frozen=True)
class ChartPose:
    """Where a chart is: a point p of its own (`Chart.points_m`) is at rotation p + shift_m in the camera's axes."""

    rotation: Matrix3
    shift_m: Vector3

    def __post_init__(self) -> None:
        for value in self.shift_m:
            require_finite("shift_m", value)

    def placed(self, points_m: Doubles) -> Doubles:
        """Points (..., 3) of the chart in the camera's axes."""
        return np.asarray(points_m @ np.array(self.rotation).T + np.array(self.shift_m), np.float64)


def held(
    chart: Chart, middle_m: Vector3, tilt_deg: float = 0.0, yaw_deg: float = 0.0, roll_deg: float = 0.0
) -> ChartPose:
    """The pose of a chart whose middle is at `middle_m` in the camera's axes, turned as `shapes.turn` says."""
    return about(chart, middle_m, turn(tilt_deg, yaw_deg, roll_deg))


def about(chart: Chart, middle_m: ArrayLike, rotation: Doubles) -> ChartPose:
    """The pose of a chart whose middle is at `middle_m` (3,) in the camera's axes, turned by `rotation` (3, 3)."""
    x, y, z = (np.asarray(middle_m, np.float64) - rotation @ chart.points_m.mean(axis=0)).tolist()
    return ChartPose(matrix3(rotation), (x, y, z))


def pose_of(lens: Lens, points_m: Doubles, pixels: Doubles) -> ChartPose | None:
    """How a chart is held whose points (N, 3) a camera with this lens sees at pixels (N, 2); None where they tell none.

    Pixels are continuous columns and rows: OpenCV is given the lens's matrix in the same.
    """
    try:
        known, turned, moved = cv2.solvePnP(points_m, pixels, lens.matrix, np.array(lens.distortion))
    except cv2.error:
        return None
    turned, shift = np.asarray(turned, np.float64).ravel(), np.asarray(moved, np.float64).ravel()
    if not known or not np.isfinite([*turned, *shift]).all() or shift[2] <= 0:
        return None
    x, y, z = shift.tolist()
    return ChartPose(matrix3(cv2.Rodrigues(turned)[0]), (x, y, z))


def seen_by_both(rig: Rig, points_m: Doubles) -> tuple[Doubles, Doubles]:
    """Where camera and projector see points (N, 3) given in the camera's axes: pixels (N, 2) each, continuous columns
    and rows; NaN behind a lens.
    """
    lit = (points_m - np.array(rig.projector_offset_m)) @ rig.rotation.T
    camera, projector = to_pixels(rig.camera.lens, points_m), to_pixels(rig.projector.lens, lit)
    return np.stack(camera[:2], axis=-1), np.stack(projector[:2], axis=-1)


def chart_scene(
    rig: Rig, chart: Chart, pose: ChartPose, *, margin: float = 1.0, wall: bool = False, ambient: float = 0.0
) -> Scene:
    """The chart on a flat white board before a rig, `margin` squares wider than its squares on every side.

    wall: a white wall stands at its right side, towards the rig, so that each lights the other; interreflection is then
    asked for. ambient: as of `Scene`.
    """
    objects: list[Mesh | Sphere] = [_board(rig, chart, pose, margin)]
    if wall:
        objects.append(_wall(rig, chart, pose, margin))
    return Scene(f"Chart {chart}", objects=tuple(objects), ambient=ambient, indirect=wall)


def _edges(chart: Chart, margin: float) -> tuple[Doubles, Doubles, Doubles]:
    """The board's upper left corner, its right and its down, in the chart's own axes."""
    width, height = chart.size_m
    beyond = margin * chart.square_m
    corner = np.array([-chart.square_m - beyond, -chart.square_m - beyond, 0.0])
    return corner, np.array([width + 2 * beyond, 0.0, 0.0]), np.array([0.0, height + 2 * beyond, 0.0])


def _board(rig: Rig, chart: Chart, pose: ChartPose, margin: float) -> Mesh:
    rotation = np.array(pose.rotation)
    corner, right, down = _edges(chart, margin)
    start = pose.placed(corner) + rig.camera_centre_m
    return quad("chart", start, rotation @ right, rotation @ down, Finish(texture=_print(rig, chart, pose, margin)))


def _print(rig: Rig, chart: Chart, pose: ChartPose, margin: float) -> Singles:
    """The board's albedo (h, w, 3), as pixels of the rig's camera see it from this pose."""
    footprint = _footprint_m(rig, chart, pose)
    squares = (chart.columns + 1 + 2 * margin) * (chart.rows + 1 + 2 * margin)
    pixel_m = float(np.linalg.norm(footprint, axis=0).min())
    square_px = min(TEXELS * chart.square_m / pixel_m, (MOST_TEXELS / squares) ** 0.5)
    square = max(8, round(square_px))
    sharp = picture(chart, square, round(margin * square)).astype(np.float32) / np.float32(255)
    taps = _taps(footprint * (square / chart.square_m))
    seen = cv2.filter2D(sharp, -1, taps, borderType=cv2.BORDER_REPLICATE)
    albedo = np.float32(BLACK) + np.float32(WHITE - BLACK) * seen
    return np.ascontiguousarray(np.broadcast_to(albedo[..., None], (*albedo.shape, 3)))


def _footprint_m(rig: Rig, chart: Chart, pose: ChartPose) -> Doubles:
    """What a pixel's column and row are long on the chart, in its middle: (2, 2) metres, a column each."""
    middle, step = chart.points_m.mean(axis=0), 0.1 * chart.square_m
    around = middle + step * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    column, row, _ = to_pixels(rig.camera.lens, pose.placed(around))
    by_chart = np.array([[column[0] - column[1], column[2] - column[3]], [row[0] - row[1], row[2] - row[3]]])
    return np.asarray(np.linalg.inv(by_chart / (2 * step)), np.float64)


def _taps(sides: Doubles) -> Singles:
    """The parallelogram about 0 with these sides, a column each, in texels: shares of its area, of sum 1."""
    reach = np.ceil(np.abs(sides).sum(axis=1) / 2 + 0.5).astype(int)
    fine = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    across, down = (np.arange(-far, far + 1)[:, None] + fine for far in reach)
    x, y = np.meshgrid(across.ravel(), down.ravel())
    inside = np.abs(np.linalg.inv(sides) @ np.stack([x.ravel(), y.ravel()])).max(axis=0) < 0.5
    shares = inside.reshape(len(down), _FINE, len(across), _FINE).mean(axis=(1, 3))
    if shares.sum() == 0:
        shares[shares.shape[0] // 2, shares.shape[1] // 2] = 1
    return np.asarray(shares / shares.sum(), np.float32)


def _wall(rig: Rig, chart: Chart, pose: ChartPose, margin: float) -> Mesh:
    """A wall from the board's right side towards the rig, turned away from both lenses' views of the board."""
    corner, right, down = _edges(chart, margin)
    rotation = np.array(pose.rotation)
    middle = pose.placed(corner + 1.02 * right + down / 2)
    toward = -middle / np.linalg.norm(middle)
    aside = rotation[:, 0] - (rotation[:, 0] @ toward) * toward
    aside /= np.linalg.norm(aside)
    along = np.cos(np.radians(WALL_DEG)) * toward + np.sin(np.radians(WALL_DEG)) * aside
    high = 1.5 * (rotation @ down)
    start = middle - high / 2 + rig.camera_centre_m
    return quad("wall", start, float(right[0]) * along, high, Finish((WHITE, WHITE, WHITE)))
