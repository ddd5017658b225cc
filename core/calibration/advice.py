"""What to do next while a rig is calibrated: where pictures lack corners, how to hold the chart, when it is enough.

The next pose is the one that tells most: every view adds what it knows of the rig's numbers (the fit's own derivatives
at the rig as it is believed to be), and of many poses in which both pictures show the whole chart that one is chosen
which shrinks the volume of what is still possible most (D-optimal design).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, Literal, Protocol

import cv2
import numpy as np

from slopegate.core.calibration.chart import Chart
from slopegate.core.calibration.chart_scene import ChartPose, held, seen_by_both
from slopegate.core.calibration.geometry import ChartView, Geometry, information
from slopegate.core.calibration.sight import MOST_BLUR_SHARE, MOST_SHIFT_PX
from slopegate.core.rig.arrays import Doubles, Ints
from slopegate.core.rig.rig import Rig, Vector3
from slopegate.core.rig.triangulate import inverse_depth, projector_rows
from slopegate.core.rig.uncertainty import spread

CELLS: Final = (8, 6)
"""Columns and rows of cells that a picture's coverage is counted in."""
CORNER_PX: Final = 0.3
"""Standard deviation of a corner's place that is expected."""
LEAST_SPACING_PX: Final = 10.0
"""Between corners in the camera's picture: nearer ones are not found well."""
MARGIN: Final = 0.03
"""Of a picture's width, that the chart stays away from its edges."""
DISTANCES: Final = (1.08, 1.4, 1.8)
"""Tried, as multiples of the least distance at which both pictures show the whole chart."""
PLACES: Final = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Of the camera's picture across and down, tried for the chart's middle."""
TILTS_DEG: Final = (-30.0, 0.0, 30.0)
"""Tried about both axes: more, and corners are found badly; less says little of the focal length."""
ENOUGH_VIEWS: Final = 8
ENOUGH_COVERED: Final = 0.5
"""Of the cells of the camera's picture."""
ENOUGH_ERROR: Final = 0.01 / 3
"""Standard error of distances, as a share: three of them are one percent."""
WELL_LIT: Final = 0.9
"""Of the corners that the camera sees, those that the projector lights in a view without a doubt."""
CLOSE: Final = 0.2
"""A chart is where it is wanted if its outline lies off by no more than this share of its width, on the average."""
CLOSE_DEG: Final = 15.0
"""And if it faces the same way to within this."""
NEXT_TO: Final = (0.08, 7.0, 0.05)
"""Differences of distance (share), tilt (degrees) and place (share of the distance) that are not worth a word."""

Light = Literal["green", "amber", "red"]


@dataclass(frozen=True)
class Judgement:
    """A traffic light, and why in a few words."""

    light: Light
    text: str


# Coverage


def coverage(points: Iterable[Doubles], size: tuple[int, int]) -> Ints:
    """How many of the points (N, 2) of all views lie in each cell of a picture of this width and height, `CELLS`."""
    count = np.zeros((CELLS[1], CELLS[0]), np.int32)
    for part in points:
        known = part[np.isfinite(part).all(axis=1)]
        inside = known[((known >= 0) & (known < size)).all(axis=1)]
        columns, rows = (inside * np.array(CELLS) / size).astype(int).T
        np.add.at(count, (rows, columns), 1)
    return count


def covered(count: Ints) -> float:
    """Share of the cells that have a point."""
    return float((count > 0).mean())


# How the chart is held


def outline_m(chart: Chart) -> Doubles:
    """The corners of the whole chart, outer squares included, in its own plane, (4, 3), clockwise from top left."""
    square, right, bottom = chart.square_m, chart.columns * chart.square_m, chart.rows * chart.square_m
    return np.array([(-square, -square, 0), (right, -square, 0), (right, bottom, 0), (-square, bottom, 0)], np.float64)


def candidates(rig: Rig, chart: Chart) -> list[ChartPose]:
    """Poses in which both pictures show the whole chart with a margin, near and far, in many places, tilted or not.

    There are none where the chart is too large or the pictures hardly overlap.
    """
    least = _least_distance_m(rig, chart)
    if least is None:
        return []
    lens, found = rig.camera.lens, []
    for factor, across, down in product(DISTANCES, PLACES, PLACES):
        x, y = lens.normalise(across * lens.width, down * lens.height)
        z = factor * least
        middle: Vector3 = (float(x) * z, float(y) * z, z)
        for tilt, yaw in product(TILTS_DEG, TILTS_DEG):
            pose = held(chart, middle, tilt, yaw)
            if _shows(rig, chart, pose):
                found.append(pose)
    return found


def _least_distance_m(rig: Rig, chart: Chart) -> float | None:
    """The least distance at which both pictures show all of the chart, somewhere, facing the camera."""
    lens, size = rig.camera.lens, max(chart.size_m)
    for distance in size * np.geomspace(0.3, 100, 120):
        z = float(distance)
        if lens.fx * chart.square_m / z < LEAST_SPACING_PX:
            return None
        for across, down in product(PLACES, PLACES):
            x, y = lens.normalise(across * lens.width, down * lens.height)
            if _shows(rig, chart, held(chart, (float(x) * z, float(y) * z, z))):
                return z
    return None


def _shows(rig: Rig, chart: Chart, pose: ChartPose) -> bool:
    """Whether both pictures show the whole chart, its corners far enough apart."""
    both = seen_by_both(rig, pose.placed(outline_m(chart)))
    for points, lens in zip(both, (rig.camera.lens, rig.projector.lens), strict=True):
        margin = MARGIN * lens.width
        inside = (points >= margin) & (points <= np.array([lens.width, lens.height]) - margin)
        if not inside.all():  # NaN is not inside either
            return False
    columns, rows = (chart.columns + 1, chart.rows + 1)
    sides = np.hypot(*(both[0] - np.roll(both[0], 1, axis=0)).T)
    return bool((sides / np.array([rows, columns, rows, columns])).min() >= LEAST_SPACING_PX)


def next_pose(rig: Rig, chart: Chart, taken: Sequence[ChartPose]) -> ChartPose | None:
    """How to hold the chart next, where these poses were taken; None where no pose is seen whole by both.

    `rig`: as it is believed to be.
    """
    poses = candidates(rig, chart)
    if not poses:
        return None
    known = _prior(rig)
    for pose in taken:
        known = known + _information(rig, chart, pose)
    told = np.stack([_information(rig, chart, pose) for pose in poses])
    scale = 1 / np.sqrt(np.diag(known))
    _, gain = np.linalg.slogdet((known + told) * np.outer(scale, scale))
    return poses[int(np.argmax(gain))]


def _information(rig: Rig, chart: Chart, pose: ChartPose) -> Doubles:
    """What a view tells, (24, 24): the chart's outer corners and middle stand for all of them."""
    columns, rows = (np.unique(np.linspace(0, count - 1, 4).round()) for count in (chart.columns, chart.rows))
    flat = chart.points_m[(rows[:, None] * chart.columns + columns[None, :]).ravel().astype(int)]
    turn = np.asarray(cv2.Rodrigues(np.array(pose.rotation))[0], np.float64).ravel()
    share = chart.count / len(flat)
    return information(rig, flat, turn, np.array(pose.shift_m)) * share / CORNER_PX**2


def _prior(rig: Rig) -> Doubles:
    """One over the variances of what a data sheet tells: focal lengths to a tenth, and so on, (24, 24)."""
    lenses = (rig.camera.lens, rig.projector.lens)
    wide = [
        value
        for lens in lenses
        for value in (0.1 * lens.fx, 0.1 * lens.fy, 0.1 * lens.width, 0.1 * lens.height, 0.3, 0.5, 0.01, 0.01, 0.5)
    ]
    wide += [0.1] * 3 + [0.2 * rig.baseline_m] * 3
    return np.diag(np.array(wide) ** -2.0)


def is_there(rig: Rig, chart: Chart, now: ChartPose, wanted: ChartPose) -> bool:
    """Whether the chart is held about as wanted, by its outline in the camera's picture and by where it faces."""
    here, there = (seen_by_both(rig, pose.placed(outline_m(chart)))[0] for pose in (now, wanted))
    width = float(np.hypot(*(there[1] - there[0])))
    # upside down a checkerboard looks the same
    off = min(float(np.hypot(*(np.roll(here, turn, axis=0) - there).T).mean()) for turn in (0, 2))
    normals = np.array([np.array(pose.rotation)[:, 2] for pose in (now, wanted)])
    turned = math.degrees(math.acos(min(1.0, max(-1.0, float(normals[0] @ normals[1])))))
    return math.isfinite(off) and off <= CLOSE * width and turned <= CLOSE_DEG


def hint(chart: Chart, now: ChartPose | None, wanted: ChartPose) -> str:
    """In plain words how to get from here to the pose wanted, or where that is, for a chart that is not seen."""
    there = _Stance.of(chart, wanted)
    if now is None:
        return f"Hold the chart {there.z:.2f} m away {there.place}, {there.tilted}."
    here = _Stance.of(chart, now)
    far, turn, aside = NEXT_TO
    ways = (
        (there.z - here.z, far * here.z, "nearer", "farther away"),
        (there.x - here.x, aside * there.z, "to the left", "to the right"),
        (there.y - here.y, aside * there.z, "up", "down"),
    )
    moves = [
        f"{100 * abs(gap):.0f} cm {more if gap > 0 else less}" for gap, least, less, more in ways if abs(gap) > least
    ]
    said = [f"Move it {_listed(moves)}"] if moves else []
    if max(abs(there.right_away - here.right_away), abs(there.top_away - here.top_away)) > turn:
        said.append(f"{'and hold it' if moves else 'Hold it'} {there.tilted}")
    return f"{', '.join(said)}." if said else "Here: hold it still."


def _listed(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


@dataclass(frozen=True)
class _Stance:
    """A pose as people would tell it: the middle in metres, and edges that are turned away, degrees."""

    x: float
    y: float
    z: float
    right_away: float
    top_away: float

    @classmethod
    def of(cls, chart: Chart, pose: ChartPose) -> _Stance:
        x, y, z = pose.placed(chart.points_m.mean(axis=0)).tolist()
        # by the normal: which edge is the right one is told in the picture, however the chart is rolled
        across, down, along = np.array(pose.rotation)[:, 2].tolist()
        return cls(x, y, z, math.degrees(math.atan2(-across, along)), math.degrees(math.atan2(down, along)))

    @property
    def place(self) -> str:
        """Where in the camera's picture it is, in words."""
        far = 0.12 * self.z
        down = "upper" if self.y < -far else "lower" if self.y > far else ""
        across = "left" if self.x < -far else "right" if self.x > far else ""
        if not (down or across):
            return "in the middle of the picture"
        return f"in the {' '.join(filter(None, (down, across)))} part of the picture"

    @property
    def tilted(self) -> str:
        """How it is turned, in words."""
        edges = [
            f"its {one if angle > 0 else other} edge {abs(angle):.0f}\u00b0"
            for angle, one, other in ((self.right_away, "right", "left"), (self.top_away, "top", "bottom"))
            if abs(angle) > NEXT_TO[1]
        ]
        return f"with {' and '.join(edges)} away from the camera" if edges else "facing the camera"


# How good it is


class JudgedView(Protocol):
    """What a view's traffic light follows from: what is kept of a `ChartSight`."""

    @property
    def name(self) -> str:
        """Begins each fault."""
        ...

    @property
    def view(self) -> ChartView | None:
        """None where too little was found."""
        ...

    @property
    def faults(self) -> tuple[str, ...]:
        """A sentence for each thing that is wrong."""
        ...

    @property
    def shift_px(self) -> float:
        """How far the chart moved."""
        ...

    @property
    def edge_px(self) -> float:
        """Width of its edges."""
        ...

    @property
    def lit_share(self) -> float:
        """Share of its corners that the projector lights."""
        ...


def view_verdict(sight: JudgedView, outlier: bool = False) -> Judgement:
    """The traffic light of one view: red is left out of the fit, or ought to be."""
    if sight.faults:
        return Judgement("red", sight.faults[0].removeprefix(f"{sight.name}: "))
    if sight.view is None or outlier:
        few, apart = "too few of its corners are lit by the projector", "it does not fit the others: something moved"
        return Judgement("red", few if sight.view is None else apart)
    doubts = {
        f"the projector lights {100 * sight.lit_share:.0f} % of the corners": sight.lit_share < WELL_LIT,
        f"it moved a little, by {sight.shift_px:.2f} pixels": sight.shift_px > MOST_SHIFT_PX / 2,
        "it is a little blurred": sight.edge_px > 0.7 * MOST_BLUR_SHARE * _spacing_px(sight.view.camera),
    }
    for text, doubtful in doubts.items():
        if doubtful:
            return Judgement("amber", text)
    return Judgement("green", f"{len(sight.view.points_m)} corners")


def _spacing_px(corners: Doubles) -> float:
    """Pixels between corners (N, 2), from the area that they cover."""
    across, down = np.ptp(corners, axis=0)
    return float(np.sqrt(across * down / len(corners)))


def distance_error(rig: Rig, points_m: Doubles) -> float:
    """Standard error of distances that this rig triangulates at points (N, 3) in the camera's axes, as a share of them,
    the median of all; infinite for a rig without a calibration.
    """
    rays = points_m / points_m[:, 2:]
    rows = projector_rows(rig, rays, 1 / points_m[:, 2])
    columns, lines = rig.camera.lens.project(rays[:, 0], rays[:, 1])

    def depths(one: Rig, _late_us: float) -> Doubles:
        # the same pixels look along other rays through another lens
        inverse, _ = inverse_depth(one, one.camera_rays(columns, lines), rows)
        return np.asarray(1 / inverse, np.float64)

    error = spread(rig, depths)
    return math.inf if error is None else float(np.median(error / points_m[:, 2]))


def verdict(views: int, count: Ints, geometry: Geometry | None, error: float) -> Judgement:
    """The traffic light of all views together. `count`: the coverage of the camera's picture; error: of distances."""
    if geometry is None:
        return Judgement("red", f"{views} good {'view' if views == 1 else 'views'}: no result yet")
    told, share = f"{views} views, distances to {100 * error:.2g} % (one standard error)", covered(count)
    if error > 3 * ENOUGH_ERROR:
        return Judgement("red", f"{told}: go on, with the chart tilted to all sides")
    wishes = {
        f"{told}; {' and '.join(geometry.outliers)} may be left out": bool(geometry.outliers),
        f"{told}: a few more, until three standard errors are within 1 %": error > ENOUGH_ERROR,
        f"{told}: take {ENOUGH_VIEWS}, so that one that is wrong shows itself": views < ENOUGH_VIEWS,
        f"{told}; corners cover {100 * share:.0f} % of the camera's picture, half is better": share < ENOUGH_COVERED,
    }
    for text, missing in wishes.items():
        if missing:
            return Judgement("amber", text)
    return Judgement("green", f"{told}: enough")
