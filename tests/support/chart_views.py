"""A hidden camera and projector, and what they see of a chart: as points, and as pictures under Gray code.

Written by itself, with one ray a sample and no use of the program's renderer: what it draws is checked against nothing
but geometry.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from slopegate.core.calibration.chart import Chart
from slopegate.core.calibration.codes import CodeOrder, white_last
from slopegate.core.calibration.geometry import ChartView
from slopegate.core.rig.patterns import Raster, gray_code
from slopegate.core.rig.rig import Lens, Matrix3
from slopegate.core.rig.rig import Rig as _Rig

Pose = tuple[np.ndarray, np.ndarray]
"""Rotation vector and shift of a chart, seen from the camera."""

EDGE = 0.02
"""Of a picture, that the chart's corners keep free."""


@dataclass(frozen=True)
class HiddenPair:
    """A camera and a projector whose numbers a calibration has to find."""

    camera: Lens
    projector: Lens
    turn: np.ndarray
    offset_m: np.ndarray

    @property
    def values(self) -> np.ndarray:
        """In the order of `GEOMETRY`."""
        lenses = [np.array([one.fx, one.fy, one.cx, one.cy, *one.distortion]) for one in (self.camera, self.projector)]
        return np.concatenate([*lenses, self.turn, self.offset_m])

    def rig(self, base: _Rig) -> _Rig:
        """A rig with these lenses and this pose."""
        x, y, z = self.offset_m.tolist()
        (a, b, c), (d, e, f), (g, h, i) = cv2.Rodrigues(self.turn)[0].tolist()
        turned: Matrix3 = ((a, b, c), (d, e, f), (g, h, i))
        return replace(
            base,
            camera=replace(base.camera, lens=self.camera),
            projector=replace(base.projector, lens=self.projector),
            projector_offset_m=(x, y, z),
            projector_rotation=turned,
        )


def hidden_pair(seed: int, camera: tuple[int, int] = (640, 480), projector: tuple[int, int] = (512, 384)) -> HiddenPair:
    """A pair by its seed: lenses with distortion, the projector 10 cm or so above, turned down a little."""
    rng = np.random.default_rng(seed)
    lenses = []
    for width, height in (camera, projector):
        focal = width * rng.uniform(1.1, 1.5)
        bent = (*rng.uniform([-0.15, -0.1], 0.1), *rng.uniform(-0.002, 0.002, 2), 0.0)
        middle = np.array([width, height]) * (0.5 + rng.uniform(-0.02, 0.02, 2))
        numbers = [focal, focal * rng.uniform(0.99, 1.01), *middle.tolist()]
        lenses.append(Lens(width, height, *map(float, numbers), tuple(map(float, bent))))
    turn = np.array([rng.uniform(0.0, 0.12), *rng.uniform(-0.05, 0.05, 2)])
    offset = np.array([rng.uniform(-0.02, 0.02), -rng.uniform(0.08, 0.15), rng.uniform(-0.02, 0.02)])
    return HiddenPair(lenses[0], lenses[1], turn, offset)


def poses(pair: HiddenPair, chart: Chart, count: int, seed: int, most_tilt_deg: float = 40.0) -> list[Pose]:
    """Poses in which both see the whole chart, each tilted another way."""
    rng = np.random.default_rng(seed)
    found: list[Pose] = []
    while len(found) < count:
        tilt, way = np.radians(rng.uniform(15.0, most_tilt_deg)), 2 * np.pi * (len(found) + rng.uniform()) / count
        about = np.array([np.cos(way), np.sin(way), 0.0]) * tilt
        turn = cv2.composeRT(about, np.zeros(3), np.array([0, 0, rng.uniform(-0.3, 0.3)]), np.zeros(3))[0].ravel()
        far = max(chart.size_m) * pair.camera.fx / pair.camera.width * rng.uniform(1.1, 2.2)
        aside = far * np.array([*rng.uniform(-0.3, 0.3, 2), 1.0])
        shift = aside - cv2.Rodrigues(turn)[0] @ chart.points_m.mean(axis=0)
        pose = (turn, shift)
        sizes = [np.array([one.width, one.height]) for one in (pair.camera, pair.projector)]
        inside = [
            (points > EDGE * size) & (points < (1 - EDGE) * size)
            for size, points in zip(sizes, seen(pair, chart.points_m, pose), strict=True)
        ]
        if all(one.all() for one in inside):
            found.append(pose)
    return found


def seen(pair: HiddenPair, points_m: np.ndarray, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Where camera and projector see points of the chart (N, 3): both (N, 2), continuous pixels."""
    local = points_m @ cv2.Rodrigues(pose[0])[0].T + pose[1]
    other = (local - pair.offset_m) @ cv2.Rodrigues(pair.turn)[0].T
    return tuple(
        np.stack(lens.project(at[:, 0] / at[:, 2], at[:, 1] / at[:, 2]), axis=-1)
        for lens, at in ((pair.camera, local), (pair.projector, other))
    )  # type: ignore[return-value]


def point_view(
    pair: HiddenPair, chart: Chart, pose: Pose, name: str, rng: Any, camera_px: float = 0.04, projector_px: float = 0.08
) -> ChartView:
    """A view whose points are off by noise of these standard deviations in each coordinate."""
    own, lit = seen(pair, chart.points_m, pose)
    return ChartView(
        name, chart.points_m, own + rng.normal(0, camera_px, own.shape), lit + rng.normal(0, projector_px, lit.shape)
    )


@dataclass(frozen=True)
class Look:
    """How a chart looks: blur of both lenses as standard deviations in their pixels, light, noise and indirect light.

    bounced: share of the projector's light that comes round by another surface, spread over `bounce_px` of its pixels
    and mirrored, so that it arrives where the code says something else. white: counts of white paper fully lit.
    """

    camera_blur_px: float = 0.6
    projector_blur_px: float = 0.5
    white: float = 180.0
    ambient: float = 8.0
    bounced: float = 0.0
    bounce_px: float = 20.0
    noise: bool = True
    full_scale: int = 255


_SAMPLES = 3
"""Rays a pixel, along each side."""
_STEPS = 32
"""Values of a pattern that are kept for each of its pixels."""
OUTSIDE = -1
"""The last value of a pattern: no light."""


def pictures(
    pair: HiddenPair, chart: Chart, pose: Pose, rng: np.random.Generator, look: Look | None = None
) -> np.ndarray:
    """What the camera takes under `white_last` of the projector's raster: (frames, H, W) uint8, uint16 above 255."""
    look = look or Look()
    paper, places = _traced(pair, chart, pose)
    height, width = pair.camera.height, pair.camera.width
    order, raster = code_of(pair), Raster(pair.projector.width, pair.projector.height)
    frames = np.empty((order.count, height, width), np.uint8 if look.full_scale == 255 else np.uint16)
    for number, (axis, pattern) in enumerate(_patterns(raster)):
        light = _light(pattern, look.projector_blur_px)[places[axis]]
        light[places[1 - axis] == OUTSIDE] = 0
        if look.bounced:
            light += np.float32(look.bounced) * _light(pattern[::-1], look.bounce_px)[places[axis]]
        counts = (look.white * light + look.ambient) * paper
        image = cv2.resize(counts, (width, height), interpolation=cv2.INTER_AREA)
        image = cv2.GaussianBlur(image, (0, 0), look.camera_blur_px)
        if look.noise:
            image = image + rng.normal(0, 1, image.shape) * np.sqrt(0.01 * look.full_scale / 255 * image + 0.5)
        frames[number] = np.clip(np.rint(image), 0, look.full_scale)
    return frames


def code_of(pair: HiddenPair) -> CodeOrder:
    """How `pictures` orders its frames."""
    return white_last(Raster(pair.projector.width, pair.projector.height))


def _patterns(raster: Raster) -> list[tuple[int, np.ndarray]]:
    """Axis (0 columns, 1 rows) and values along it, 0..1, of every frame."""
    found = []
    for axis, name in enumerate(("columns", "rows")):
        bits = code_bits(raster)[axis]
        for bit in range(bits):
            whole = gray_code(raster, name, bit)  # type: ignore[arg-type]
            line = (whole[0] if axis == 0 else whole[:, 0]) / 255.0
            found += [(axis, line), (axis, 1 - line)]
    return [*found, (0, np.ones(raster.width)), (0, np.zeros(raster.width))]


def code_bits(raster: Raster) -> tuple[int, int]:
    """Of columns and rows."""
    return white_last(raster).bits


def _light(pattern: np.ndarray, blur_px: float) -> np.ndarray:
    """The pattern at the middle of `_STEPS` steps a pixel, blurred, and 0 behind its end."""
    fine = np.repeat(pattern, _STEPS).astype(np.float32)
    if blur_px:
        fine = cv2.GaussianBlur(fine[None], (0, 0), blur_px * _STEPS)[0]
    return np.append(fine, np.float32(0))


@lru_cache(maxsize=1)
def _rays(lens: Lens) -> np.ndarray:
    """Directions of all samples, (rows, columns, 3)."""
    rows, columns = (np.arange(n * _SAMPLES) for n in (lens.height, lens.width))
    x, y = lens.normalise((columns[None, :] + 0.5) / _SAMPLES, (rows[:, None] + 0.5) / _SAMPLES)
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def _traced(pair: HiddenPair, chart: Chart, pose: Pose) -> tuple[np.ndarray, list[np.ndarray]]:
    """Reflectance (rows, columns) of what every sample sees, and its step along the columns and rows of patterns."""
    rays = _rays(pair.camera)
    rotation = cv2.Rodrigues(pose[0])[0]
    normal = rotation[:, 2]
    points = rays * ((normal @ pose[1]) / (rays @ normal))[..., None]
    flat = (points - pose[1]) @ rotation[:, :2] / chart.square_m
    across, down = np.floor(flat[..., 0]).astype(int) + 1, np.floor(flat[..., 1]).astype(int) + 1
    dark = (across + down) % 2 == 0
    on = (across >= 0) & (across <= chart.columns) & (down >= 0) & (down <= chart.rows)
    sheet = (across >= -1) & (across <= chart.columns + 1) & (down >= -1) & (down <= chart.rows + 1)
    paper = np.where(on, np.where(dark, 0.08, 0.9), np.where(sheet, 0.9, 0.02))
    other = (points - pair.offset_m) @ cv2.Rodrigues(pair.turn)[0].T
    lens = pair.projector
    bent = _bent(lens, other[..., 0] / other[..., 2], other[..., 1] / other[..., 2])
    places = [
        np.where((at >= 0) & (at < size), np.floor(at * _STEPS), OUTSIDE).astype(np.int32)
        for at, size in zip(bent, (lens.width, lens.height), strict=True)
    ]
    return paper.astype(np.float32), places


def _bent(lens: Lens, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of undistorted x/z and y/z, by the textbook."""
    k1, k2, p1, p2, k3 = lens.distortion
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    across = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    down = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
    return lens.fx * across + lens.cx, lens.fy * down + lens.cy
