"""Both lenses and the pose between them from views of a chart, with the uncertainty of every number.

The fit is OpenCV's `stereoCalibrate`: the least sum of squared distances in both pictures. Its standard errors come
from the fit's own derivatives and from how far the corners really lie off, view by view (the "sandwich" of least
squares: camera and projector corners err differently, and one corner's two errors belong together).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import ArrayLike

from slopegate.core.calibration.chart_scene import pose_of
from slopegate.core.calibration.normal import scaled_inverse
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.checks import InputError, require
from slopegate.core.rig.rig import Lens, Matrix3, Rig, Vector3, matrix3

LEAST_VIEWS: Final = 3
LEAST_CORNERS: Final = 8
"""In a view: fewer do not hold its pose and add something."""
LEAST_TILT_DEG: Final = 8.0
"""Views whose charts all face the same way, to within this, leave focal length and distance undecided."""
ONE_PLACE: Final = 0.02
"""Of their distance, within which charts count as held in one place."""
OUTLIER: Final = 3.0
"""A view is named where its held-out error is this many times the median of the others'."""
_HALF: Final = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])
"""OpenCV counts pixel centres from 0."""
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-12)


@dataclass(frozen=True, eq=False)
class ChartView:
    """One pose of the chart: its points (N, 3) in metres, where camera and projector see them, both (N, 2) pixels."""

    name: str
    points_m: Doubles
    camera: Doubles
    projector: Doubles


@dataclass(frozen=True)
class ViewError:
    """How well a view fits: rms distances in pixels, and that of the projector's points where the fit did not see it.

    `held_out_px` is NaN where too few views are left without it.
    """

    name: str
    corners: int
    camera_px: float
    projector_px: float
    held_out_px: float
    distance_m: float
    tilt_deg: float

    @property
    def rms_px(self) -> float:
        """Over both pictures."""
        return math.sqrt((self.camera_px**2 + self.projector_px**2) / 2)


@dataclass(frozen=True, eq=False)
class Geometry:
    """A calibrated pair.

    `covariance` (24, 24) float64 is of `GEOMETRY`. `rms_px` over both pictures as OpenCV counts it, then each one's.
    residuals: of each view, found minus fitted, (N, 4) camera column and row, projector column and row.
    """

    camera: Lens
    projector: Lens
    rotation: Matrix3
    offset_m: Vector3
    covariance: Doubles
    rms_px: float
    camera_rms_px: float
    projector_rms_px: float
    views: tuple[ViewError, ...]
    residuals: tuple[Doubles, ...] = ()

    @property
    def values(self) -> Doubles:
        """What `covariance` is of, (24,) float64."""
        turned = cv2.Rodrigues(np.array(self.rotation))[0].ravel()
        return np.concatenate([_numbers(self.camera), _numbers(self.projector), turned, self.offset_m])

    @property
    def standard_errors(self) -> Doubles:
        """Of `values`, (24,) float64."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def outliers(self) -> tuple[str, ...]:
        """Names of the views that do not fit the others, the worst first."""
        return outliers(self.views)


Size = tuple[int, int]
"""Width and height in pixels."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """What OpenCV found: matrices and distortions, the projector's R and T, and each view's pose."""

    matrices: tuple[Doubles, Doubles]
    distortions: tuple[Doubles, Doubles]
    turned: Doubles
    moved: Doubles
    poses: tuple[tuple[Doubles, Doubles], ...]
    rms_px: float


def calibrate(views: Sequence[ChartView], camera: Size, projector: Size, held_out: bool = True) -> Geometry:
    """Fit lenses and pose to views of the chart; camera and projector are the sizes of their pictures.

    held_out: also fit without each view, to see how well the others tell it. Raises InputError where views are too few
    or all look at the chart from one side.
    """
    _check(views)
    fit = _fit(views, camera, projector)
    _check_tilts(fit, views, camera)
    residuals = [_residuals(fit, view, pose) for view, pose in zip(views, fit.poses, strict=True)]
    told = held_out and len(views) > LEAST_VIEWS
    missed = [_held_out(views, number, camera, projector) if told else np.nan for number in range(len(views))]
    errors = tuple(
        _view_error(view, pose, residual, out)
        for view, pose, residual, out in zip(views, fit.poses, residuals, missed, strict=True)
    )
    joined = np.concatenate(residuals)
    rotation = np.asarray(cv2.Rodrigues(fit.turned)[0], np.float64)
    offset = -rotation.T @ fit.moved.ravel()
    return Geometry(
        camera=_lens(camera, fit.matrices[0], fit.distortions[0]),
        projector=_lens(projector, fit.matrices[1], fit.distortions[1]),
        rotation=matrix3(rotation),
        offset_m=(float(offset[0]), float(offset[1]), float(offset[2])),
        covariance=_covariance(fit, views, residuals),
        rms_px=fit.rms_px,
        camera_rms_px=_rms(joined[:, :2]),
        projector_rms_px=_rms(joined[:, 2:]),
        views=errors,
        residuals=tuple(residuals),
    )


def with_scale_error(geometry: Geometry, share: float) -> Geometry:
    """The same where the chart's own lengths are known to this share only (one standard error).

    A chart that is too large makes all lengths too large and changes no angle: only the offset is less sure, along
    itself.
    """
    covariance = geometry.covariance.copy()
    offset = np.array(geometry.offset_m)
    covariance[21:, 21:] += share**2 * np.outer(offset, offset)
    return replace(geometry, covariance=covariance)


def outliers(views: Sequence[ViewError]) -> tuple[str, ...]:
    """Names of the views whose held-out error is far above that of the others, the worst first.

    One that is wrong spoils what the others expect of each other: only of the first it is sure.
    """
    known = np.array([view.held_out_px for view in views])
    if not np.isfinite(known).all() or len(known) <= LEAST_VIEWS:
        return ()
    usual = [OUTLIER * np.median(np.delete(known, number)) for number in range(len(known))]
    far = [number for number in range(len(known)) if known[number] > usual[number]]
    return tuple(views[number].name for number in sorted(far, key=lambda number: -known[number]))


def _check(views: Sequence[ChartView]) -> None:
    allowed = f"at least {LEAST_VIEWS}, each from another side"
    require(len(views) >= LEAST_VIEWS, "number of views that can be used", len(views), allowed)
    for view in views:
        require(
            len(view.points_m) >= LEAST_CORNERS,
            f"number of corners in {view.name}",
            len(view.points_m),
            f"at least {LEAST_CORNERS} that both camera and projector see",
        )


def _check_tilts(fit: _Fit, views: Sequence[ChartView], camera: Size) -> None:
    """Parallel charts fit a longer lens at a longer distance as well as a shorter one."""
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn, _ in fit.poses])
    apart = np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1)))
    if float(apart.max()) < LEAST_TILT_DEG:
        turns, shifts = _plain_poses(views, camera)
        far = np.linalg.norm(shifts - shifts.mean(axis=0), axis=1).max()
        same = " and in one place" if far < ONE_PLACE * np.linalg.norm(shifts.mean(axis=0)) else ""
        raise InputError(
            f"all {len(views)} views show the chart at one angle{same}, {_tilted(turns[:, :, 2].mean(axis=0))}: tilt "
            "it by 20 to 45 degrees, each time another way"
        )


def _plain_poses(views: Sequence[ChartView], camera: Size) -> tuple[Doubles, Doubles]:
    """Rotations (N, 3, 3) and shifts (N, 3) of charts that leave a lens open: by the plainest one that fits, with its
    axis in the middle of the picture. Its focal length is all that a single angle tells.
    """
    width, height = camera
    plain = np.array([[width, 0.0, (width - 1) / 2], [0.0, width, (height - 1) / 2], [0.0, 0.0, 1.0]])
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    )  # fmt: skip
    flat = [view.points_m.astype(np.float32) for view in views]
    seen = [(view.camera - 0.5).astype(np.float32) for view in views]
    *_, turns, shifts = cv2.calibrateCamera(flat, seen, camera, plain, np.zeros(5), flags=flags)
    return np.stack([cv2.Rodrigues(turn)[0] for turn in turns]), np.stack([_flat(shift) for shift in shifts])


def _tilted(normal: Doubles) -> str:
    """How a chart of this normal is tilted, in words: in all, and by its edges."""
    across, down, along = normal.tolist()
    edges = (
        ("right" if across < 0 else "left", math.degrees(math.atan2(abs(across), along))),
        ("top" if down > 0 else "bottom", math.degrees(math.atan2(abs(down), along))),
    )
    away = [f"its {edge} edge {angle:.0f}" for edge, angle in edges if angle >= 1]
    tilt = math.degrees(math.atan2(math.hypot(across, down), along))
    return f"tilted by {tilt:.0f} degrees ({' and '.join(away)} away from the camera)" if away else "facing the camera"


def _fit(views: Sequence[ChartView], camera: Size, projector: Size) -> _Fit:
    flat = [view.points_m.astype(np.float32) for view in views]
    # OpenCV counts pixel centres from 0
    seen, lit = (
        [(points - 0.5).astype(np.float32) for points in side]
        for side in ([view.camera for view in views], [view.projector for view in views])
    )
    try:
        _, first, first_bent, *_ = cv2.calibrateCamera(flat, seen, camera, np.eye(3), np.zeros(5))
        _, second, second_bent, *_ = cv2.calibrateCamera(flat, lit, projector, np.eye(3), np.zeros(5))
        found = cv2.stereoCalibrateExtended(
            flat, seen, lit, first, first_bent, second, second_bent, camera, np.eye(3), np.zeros(3),
            flags=cv2.CALIB_USE_INTRINSIC_GUESS, criteria=_STOP,
        )  # fmt: skip
    except cv2.error:
        raise InputError(
            "the views do not fit together: no lens sees the chart's points where they were found"
        ) from None
    rms, first, first_bent, second, second_bent, rotation, moved, _, _, turns, shifts, _ = found
    poses = tuple((_flat(turn), _flat(shift)) for turn, shift in zip(turns, shifts, strict=True))
    turned = _flat(cv2.Rodrigues(np.asarray(rotation))[0])
    matrices = (np.asarray(first, np.float64), np.asarray(second, np.float64))
    return _Fit(matrices, (_five(first_bent), _five(second_bent)), turned, _flat(moved), poses, float(rms))


def _flat(values: ArrayLike) -> Doubles:
    return np.asarray(values, np.float64).ravel()


def _five(distortion: ArrayLike) -> Doubles:
    return _flat(distortion)[:5]


def _project(fit: _Fit, side: int, points_m: Doubles, turn: Doubles, shift: Doubles) -> tuple[Doubles, Doubles]:
    """Pixels (N, 2) of points in one picture and their derivatives (2 N, 15): by turn, shift, f, c and distortion."""
    pixels, slopes = cv2.projectPoints(points_m, turn, shift, fit.matrices[side], fit.distortions[side])
    return np.asarray(pixels, np.float64).reshape(-1, 2) + 0.5, np.asarray(slopes, np.float64)


def _residuals(fit: _Fit, view: ChartView, pose: tuple[Doubles, Doubles]) -> Doubles:
    """Found minus fitted, (N, 4): camera column and row, projector column and row."""
    own, _ = _project(fit, 0, view.points_m, *pose)
    moved = cv2.composeRT(*pose, fit.turned, fit.moved)
    other, _ = _project(fit, 1, view.points_m, _flat(moved[0]), _flat(moved[1]))
    return np.concatenate([view.camera - own, view.projector - other], axis=1)


def _slopes(fit: _Fit, points_m: Doubles, pose: tuple[Doubles, Doubles]) -> tuple[Doubles, Doubles]:
    """Derivatives of a view's pixels (N, 4, ...): by the 24 parameters of the fit (T in place of the offset), and by
    the view's own pose (6)."""
    count = len(points_m)
    _, own = _project(fit, 0, points_m, *pose)
    turn, shift, *chain = cv2.composeRT(*pose, fit.turned, fit.moved)
    _, other = _project(fit, 1, points_m, _flat(turn), _flat(shift))
    by_turn, by_shift = other[:, :3], other[:, 3:6]
    # chain: d turn by (turn 1, shift 1, turn 2, shift 2), then d shift by the same
    through = [by_turn @ chain[k] + by_shift @ chain[4 + k] for k in range(4)]
    shared, local = np.zeros((count, 4, 24)), np.zeros((count, 4, 6))
    shared[:, :2, :9] = own[:, 6:15].reshape(count, 2, 9)
    shared[:, 2:, 9:18] = other[:, 6:15].reshape(count, 2, 9)
    shared[:, 2:, 18:21], shared[:, 2:, 21:24] = (part.reshape(count, 2, 3) for part in through[2:])
    local[:, :2] = own[:, :6].reshape(count, 2, 6)
    local[:, 2:, :3], local[:, 2:, 3:] = (part.reshape(count, 2, 3) for part in through[:2])
    return shared, local


def _free_slopes(fit: _Fit, points_m: Doubles, pose: tuple[Doubles, Doubles]) -> Doubles:
    """Derivatives (4 N, 24) of a view's pixels by the fit's parameters, without what the view's own pose takes up."""
    shared, local = _slopes(fit, points_m, pose)
    flat, own = shared.reshape(-1, 24), local.reshape(-1, 6)
    return np.asarray(flat - own @ np.linalg.lstsq(own, flat, rcond=None)[0], np.float64)


def information(rig: Rig, points_m: Doubles, turn: Doubles, shift: Doubles) -> Doubles:
    """What a view of these points (N, 3), held so, tells of the rig: (24, 24), to be divided by a corner's variance.

    `turn` (3,) is a rotation vector and `shift` (3,) metres in camera axes. The inverse of the sum over views is the
    covariance of both lenses, the projector's rotation and its translation (in place of its centre).
    """
    matrices = (rig.camera.lens.matrix - _HALF, rig.projector.lens.matrix - _HALF)
    distortions = (_numbers(rig.camera.lens)[4:], _numbers(rig.projector.lens)[4:])
    turned = _flat(cv2.Rodrigues(rig.rotation)[0])
    fit = _Fit(matrices, distortions, turned, -rig.rotation @ np.array(rig.projector_offset_m), (), 0.0)
    free = _free_slopes(fit, points_m, (turn, shift))
    return np.asarray(free.T @ free, np.float64)


def _covariance(fit: _Fit, views: Sequence[ChartView], residuals: Sequence[Doubles]) -> Doubles:
    """Covariance (24, 24) of `GEOMETRY`: each view's pose is eliminated, its residuals give its own noise.

    Least squares shrinks residuals by as many as it fits numbers: the noise is scaled up by the degrees of freedom.
    """
    size = 24
    normal, middle = np.zeros((size, size)), np.zeros((size, size))
    equations = 4 * sum(map(len, residuals))
    freedom = equations / max(1, equations - size - 6 * len(views))
    for view, pose, missed in zip(views, fit.poses, residuals, strict=True):
        free = _free_slopes(fit, view.points_m, pose)
        normal += free.T @ free
        noise = freedom * missed.T @ missed / len(missed)
        rows = free.reshape(-1, 4, size)
        middle += np.einsum("nip,ij,njq->pq", rows, noise, rows)
    inverse = scaled_inverse(normal)
    return _of_offset(fit, inverse @ middle @ inverse)


def _of_offset(fit: _Fit, covariance: Doubles) -> Doubles:
    """The covariance with the projector's centre -R' T in place of T."""
    rotation, by_turn = cv2.Rodrigues(fit.turned)
    change = np.eye(24)
    # (3, 9) derivatives of R row by row -> of -R' T
    for axis in range(3):
        change[21:, 18 + axis] = -by_turn[axis].reshape(3, 3).T @ fit.moved
    change[21:, 21:] = -rotation.T
    return change @ covariance @ change.T


def _held_out(views: Sequence[ChartView], number: int, camera: Size, projector: Size) -> float:
    """Rms distance of a view's projector points from where a fit without it expects them, pixels."""
    view = views[number]
    fit = _fit([*views[:number], *views[number + 1 :]], camera, projector)
    pose = pose_of(_lens(camera, fit.matrices[0], fit.distortions[0]), view.points_m, view.camera)
    if pose is None:
        return np.inf
    turn = _flat(cv2.Rodrigues(np.array(pose.rotation))[0])
    return _rms(_residuals(fit, view, (turn, np.array(pose.shift_m)))[:, 2:])


def _view_error(view: ChartView, pose: tuple[Doubles, Doubles], residual: Doubles, held_out_px: float) -> ViewError:
    rotation = cv2.Rodrigues(pose[0])[0]
    middle = rotation @ view.points_m.mean(axis=0) + pose[1]
    tilt = np.degrees(np.arccos(min(1.0, abs(float(rotation[2, 2])))))
    camera_px, projector_px = _rms(residual[:, :2]), _rms(residual[:, 2:])
    return ViewError(
        view.name, len(residual), camera_px, projector_px, float(held_out_px), float(middle[2]), float(tilt)
    )


def _rms(offsets: Doubles) -> float:
    """Root of the mean squared distance, as OpenCV counts it."""
    return float(np.sqrt((offsets**2).sum(axis=1).mean()))


def _lens(size: Size, matrix: Doubles, distortion: Doubles) -> Lens:
    fx, fy, cx, cy = (float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Lens(*size, fx, fy, cx + 0.5, cy + 0.5, tuple(map(float, distortion)))


def _numbers(lens: Lens) -> Doubles:
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, *(*lens.distortion, 0, 0, 0, 0, 0)[:5]])
