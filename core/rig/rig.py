"""The rig: camera and projector, their lenses, where they stand and how they scan.

World axes as in OpenCV: x right, y down, z forward, metres. They are the camera's axes; the origin lies midway between
the two optical centres. Pixel coordinates are continuous: pixel or row k covers [k, k + 1), its centre is k + 0.5
(OpenCV's own, with pixel centres at whole numbers, are smaller by one half).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.calibration import Calibration
from slopegate.core.rig.checks import require, require_finite, require_positive
from slopegate.core.rig.patterns import Raster
from slopegate.core.rig.settings import MAX_TIME_US, MIN_PERIOD_US, ShutterLimits

Matrix3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
Vector3 = tuple[float, float, float]


def matrix3(rows: ArrayLike) -> Matrix3:
    """A matrix (3, 3) as plain numbers."""
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(rows, np.float64).tolist()
    return ((a, b, c), (d, e, f), (g, h, i))


IDENTITY: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)
_UNDISTORTED_PX = 1e-11
"""Until `project` leads back to within 1e-11 pixels; less is below a float64 step of a large raster."""


@dataclass(frozen=True)
class Lens:
    """A pinhole with OpenCV's distortion (k1 k2 p1 p2 [k3 [k4 k5 k6 [s1..s4 [tx ty]]]]) on a raster of pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            require(getattr(self, name) >= 1, name, getattr(self, name), "a whole number of at least 1")
        require_positive("fx", self.fx)
        require_positive("fy", self.fy)
        require_finite("cx", self.cx)
        require_finite("cy", self.cy)
        require(
            len(self.distortion) in DISTORTION_LENGTHS and all(map(math.isfinite, self.distortion)),
            "distortion",
            self.distortion,
            "0, 4, 5, 8, 12 or 14 finite numbers in OpenCV's order",
        )

    @property
    def distorted(self) -> bool:
        """Whether any distortion coefficient differs from zero."""
        return any(self.distortion)

    def resized(self, width: int, height: int) -> Lens:
        """The same lens with other pixels on a sensor of the same width; rows are cut or added at both ends."""
        scale = width / self.width
        middle = height / 2 + (self.cy - self.height / 2) * scale
        return Lens(width, height, self.fx * scale, self.fy * scale, self.cx * scale, middle, self.distortion)

    @property
    def column_centres(self) -> Doubles:
        """Column coordinates of the pixels' centres, (width,) float64."""
        return np.arange(self.width, dtype=np.float64) + 0.5

    @property
    def row_centres(self) -> Doubles:
        """Row coordinates of the pixels' centres, (height,) float64."""
        return np.arange(self.height, dtype=np.float64) + 0.5

    @property
    def matrix(self) -> Doubles:
        """The 3x3 camera matrix, float64, in continuous pixel coordinates."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def normalise(self, columns: ArrayLike, rows: ArrayLike) -> tuple[Doubles, Doubles]:
        """Pixel coordinates (any shape, broadcast) -> undistorted x/z and y/z, float64.

        Undistorted: to two roundings of (|pixel| + |principal point|) / focal length. Distorted: OpenCV's fixed-point
        iteration, which `project` takes back to within 1e-10 pixels wherever the distortion is one to one and mild
        (changes the radius by up to a third).
        """
        u, v = np.broadcast_arrays(np.asarray(columns, np.float64), np.asarray(rows, np.float64))
        if not self.distorted or not u.size:
            return (u - self.cx) / self.fx, (v - self.cy) / self.fy
        import cv2  # large, and only distorted lenses need it

        points = np.stack([u.ravel(), v.ravel()], axis=-1).reshape(-1, 1, 2)
        flat, until = np.eye(3), (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, _UNDISTORTED_PX)
        undistorted = cv2.undistortPoints(points, self.matrix, np.array(self.distortion), None, flat, flat, until)
        x, y = np.asarray(undistorted, np.float64).reshape(-1, 2).T.reshape(2, *u.shape)
        return x, y

    def project(self, x: ArrayLike, y: ArrayLike) -> tuple[Doubles, Doubles]:
        """Undistorted x/z and y/z (any shape, broadcast) -> pixel columns and rows, float64.

        To two roundings undistorted, ten through a distorted lens, each of the larger of the result and the principal
        point: 1e-12 pixels on a raster of 5000.
        """
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        if self.distorted:
            x, y = _bent(self.distortion, x, y)
        return x * self.fx + self.cx, y * self.fy + self.cy


def _bent(distortion: tuple[float, ...], x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
    """x/z and y/z as a lens bends them: OpenCV's model, ten times as fast as its `projectPoints`."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tilt_x, tilt_y = (*distortion, *[0.0] * 14)[:14]
    r2, twice_xy = x * x + y * y, 2 * x * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    if k4 or k5 or k6:
        radial = radial / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    bent_x = x * radial + p1 * twice_xy + p2 * (r2 + 2 * x * x)
    bent_y = y * radial + p1 * (r2 + 2 * y * y) + p2 * twice_xy
    if s1 or s2 or s3 or s4:
        bent_x, bent_y = bent_x + r2 * (s1 + r2 * s2), bent_y + r2 * (s3 + r2 * s4)
    if not tilt_x and not tilt_y:
        return bent_x, bent_y
    turn = _about_y(tilt_y) @ _about_x(tilt_x)
    onto = np.array([[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, 1.0]])
    tilted = np.stack([bent_x, bent_y, np.ones_like(bent_x)], axis=-1) @ (onto @ turn).T
    return tilted[..., 0] / tilted[..., 2], tilted[..., 1] / tilted[..., 2]


def _about_x(angle: float) -> Doubles:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])


def _about_y(angle: float) -> Doubles:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])


_BENT_SIDE = 16
"""Points that a side of a distorted field of view is drawn with."""

MAX_BLUR_PX = 20.0
"""Blur that a rig may have: beyond it the picture shows nothing that a gate could be set by."""


def require_blur(blur_px: float) -> None:
    """Raise InputError unless a lens can have this blur."""
    require(0 <= blur_px <= MAX_BLUR_PX, "blur_px", blur_px, f"from 0 to {MAX_BLUR_PX:g} pixels")


@dataclass(frozen=True)
class RigProjector:
    """A scanning projector: it lights row r at the instant r / rows_per_us, again in every frame period.

    `blur_px`: standard deviation in pixels of the Gaussian that its lens makes of a point.
    """

    lens: Lens
    period_us: float
    active_fraction: float = 0.92
    blur_px: float = 0.0

    def __post_init__(self) -> None:
        require_positive("period_us", self.period_us)
        allowed = f"from {MIN_PERIOD_US:.0f} to {MAX_TIME_US:.0f} us"
        require(MIN_PERIOD_US <= self.period_us <= MAX_TIME_US, "period_us", self.period_us, allowed)
        require(0 < self.active_fraction <= 1, "active_fraction", self.active_fraction, "above 0 and at most 1")
        require_blur(self.blur_px)

    @property
    def raster(self) -> Raster:
        """Its pixels."""
        return Raster(self.lens.width, self.lens.height)

    @property
    def rows_per_us(self) -> float:
        """Scan speed v_p while lit, to two roundings; the rest of the period is blanking."""
        return self.lens.height / (self.active_fraction * self.period_us)

    @property
    def period_rows(self) -> float:
        """The frame period as a number of rows, blanking included."""
        return self.period_us * self.rows_per_us


@dataclass(frozen=True)
class RigCamera:
    """A rolling-shutter camera: its lens, what its shutter accepts, and its blur as in `RigProjector`."""

    lens: Lens
    shutter: ShutterLimits
    blur_px: float = 0.0

    def __post_init__(self) -> None:
        require_blur(self.blur_px)


@dataclass(frozen=True)
class Rig:
    """A camera and the projector above it.

    `projector_offset_m` is the projector's optical centre seen from the camera's, in camera axes: (0, -b, 0) for the
    ideal rig. `projector_rotation` turns camera axes into projector axes (identity for the ideal rig).
    """

    camera: RigCamera
    projector: RigProjector
    projector_offset_m: Vector3
    projector_rotation: Matrix3 = IDENTITY
    name: str = ""
    calibration: Calibration | None = field(default=None, compare=False)
    """How well these numbers are known, where they were calibrated."""

    def __post_init__(self) -> None:
        offset = np.array(self.projector_offset_m)
        require(
            offset.shape == (3,) and bool(np.isfinite(offset).all()) and bool(np.linalg.norm(offset) > 0),
            "projector_offset_m",
            self.projector_offset_m,
            "three finite numbers, not all 0",
        )
        rotation = np.array(self.projector_rotation)
        proper = rotation.shape == (3, 3) and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        require(
            bool(proper and np.linalg.det(rotation) > 0),
            "projector_rotation",
            self.projector_rotation,
            "a rotation matrix (orthonormal to 1e-6, determinant +1)",
        )

    @property
    def baseline_m(self) -> float:
        """Distance between the two optical centres."""
        return math.hypot(*self.projector_offset_m)

    @property
    def is_ideal(self) -> bool:
        """Whether the closed forms of model section 3 hold: unrotated, projector straight above, no distortion."""
        x, y, z = self.projector_offset_m
        straight = x == 0 and z == 0 and y < 0 and self.projector_rotation == IDENTITY
        return straight and not (self.camera.lens.distorted or self.projector.lens.distorted)

    @property
    def is_opposed(self) -> bool:
        """Whether the projector draws its rows the other way than the camera reads its own."""
        return self.projector_rotation[1][1] < 0

    @cached_property
    def camera_centre_m(self) -> Doubles:
        """The camera's optical centre in world coordinates, (3,) float64."""
        return -0.5 * np.array(self.projector_offset_m)

    @cached_property
    def projector_centre_m(self) -> Doubles:
        """The projector's optical centre in world coordinates, (3,) float64."""
        return 0.5 * np.array(self.projector_offset_m)

    @cached_property
    def rotation(self) -> Doubles:
        """Camera (world) axes -> projector axes, (3, 3) float64."""
        return np.array(self.projector_rotation)

    def camera_rays(self, columns: ArrayLike, rows: ArrayLike) -> Doubles:
        """Directions (..., 3) float64 with z = 1, in world axes, of the rays from the camera through these pixels.

        As accurate as `Lens.normalise`.
        """
        x, y = self.camera.lens.normalise(columns, rows)
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def to_camera(self, points_m: ArrayLike) -> tuple[Doubles, Doubles, Doubles]:
        """World points (..., 3) -> camera column, row and depth; NaN pixels where the depth is not positive.

        Pixels to 4 roundings of focal length * |point| / depth plus the principal point. Points at infinity have no
        world coordinates: `axis.scanners` takes a direction and an inverse distance instead.
        """
        return to_pixels(self.camera.lens, np.asarray(points_m, np.float64) - self.camera_centre_m)

    def to_projector(self, points_m: ArrayLike) -> tuple[Doubles, Doubles, Doubles]:
        """World points (..., 3) -> projector column, row and depth; NaN pixels where the depth is not positive.

        As accurate as `to_camera`, with 4 more roundings for the turn.
        """
        local = (np.asarray(points_m, np.float64) - self.projector_centre_m) @ self.rotation.T
        return to_pixels(self.projector.lens, local)


def to_pixels(lens: Lens, local: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Points (..., 3) in a lens's own axes -> column, row and depth (...); NaN pixels where the depth is not positive.

    Only the direction of a point counts, so it may be scaled: (x/z, y/z, 1) - w centre stands for one at z = 1/w and
    stays finite at infinity.
    """
    depth = local[..., 2]
    safe = np.where(depth > 0, depth, np.nan)
    column, row = lens.project(local[..., 0] / safe, local[..., 1] / safe)
    return column, row, depth


def camera_view(rig: Rig, depth_m: float) -> Doubles:
    """The camera's centre and the corners of its view at a depth, clockwise from top left, (5, 3) metres."""
    return _view(rig.camera.lens, rig.camera_centre_m, np.eye(3), depth_m)


def projector_view(rig: Rig, depth_m: float) -> Doubles:
    """The projector's centre and the corners of its view at a depth along its own axis, (5, 3) metres."""
    return _view(rig.projector.lens, rig.projector_centre_m, rig.rotation, depth_m)


def camera_rim(rig: Rig, depth_m: float) -> Doubles:
    """The rim of the camera's view at a depth, clockwise from top left, (4, N, 3) metres: N points a side, of which the
    first is its corner and number N / 2 its middle. Distorted lenses bend it.
    """
    return _rim(rig.camera.lens, rig.camera_centre_m, np.eye(3), depth_m)


def projector_rim(rig: Rig, depth_m: float) -> Doubles:
    """The rim of the projector's view at a depth along its own axis, as `camera_rim`."""
    return _rim(rig.projector.lens, rig.projector_centre_m, rig.rotation, depth_m)


def _view(lens: Lens, centre: Doubles, rotation: Doubles, depth_m: float) -> Doubles:
    return np.concatenate([centre[None], _rim(lens, centre, rotation, depth_m)[:, 0]])


def _rim(lens: Lens, centre: Doubles, rotation: Doubles, depth_m: float) -> Doubles:
    on = np.arange(_BENT_SIDE if lens.distorted else 2) / (_BENT_SIDE if lens.distorted else 2)
    zero, one = np.zeros_like(on), np.ones_like(on)
    columns = np.stack([on, one, 1 - on, zero]) * lens.width
    rows = np.stack([zero, on, one, 1 - on]) * lens.height
    x, y = lens.normalise(columns, rows)
    return np.asarray(centre + np.stack([x, y, np.ones_like(x)], axis=-1) * depth_m @ rotation, np.float64)


def ideal_rig(
    camera: RigCamera,
    projector: RigProjector,
    baseline_m: float,
    name: str = "",
) -> Rig:
    """The projector `baseline_m` straight above the camera, both looking along +z (section III of the paper)."""
    require_positive("baseline_m", baseline_m)
    return Rig(camera, projector, (0.0, -baseline_m, 0.0), IDENTITY, name)


def half_turned(lens: Lens) -> Lens:
    """The lens of the raster turned by half a turn: normalised (-x, -y) meet pixel (width - column, height - row).

    What is odd in x and y keeps its coefficients (radial distortion), what is even changes sign: tangential, thin prism
    and tilt.
    """
    flipped = tuple(-value if place in (2, 3) or place >= 8 else value for place, value in enumerate(lens.distortion))
    return replace(lens, cx=lens.width - lens.cx, cy=lens.height - lens.cy, distortion=flipped)
