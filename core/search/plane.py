"""The target's plane as the fast search knows it, and the gates along it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from slopegate.core.gating.plan import gate_around
from slopegate.core.rig.arrays import Counts, Doubles
from slopegate.core.rig.settings import GateSettings
from slopegate.core.search.evidence import CandidatePlanes, Evidence, PlaneUnits, agreeing, vote
from slopegate.core.search.keypoints import Keypoints, lit, lit_share
from slopegate.core.search.state import SearchTask, State

MAX_CUTS = 20
"""How often the scene is cut before the plane has to be good enough."""
BEYOND = 0.15
"""The target reaches farther than its keypoints by this share of their extent: ORB needs room about them."""
MAX_CLOCKS = 5


@dataclass(frozen=True, eq=False)
class TargetPlane:
    """What is known of the target's plane."""

    evidence: Evidence
    frame: PlaneUnits
    planes: CandidatePlanes | None
    cuts: int = 0
    sharpest: float = np.inf
    idle: int = 0

    def vote(self, state: State) -> TargetPlane:
        """With planes that fit the evidence."""
        assert state.points is not None
        rng = np.random.default_rng((state.task.seed, state.frames))
        return replace(self, planes=vote(self.evidence, self.places(state.points), self.frame, self.planes, rng))

    def places(self, points: Keypoints) -> Doubles:
        """Where the keypoints are, in the planes' units."""
        return self.frame.places(points.columns, points.rows)

    def line_time_us(self, task: SearchTask) -> float:
        """The line time of gates that lean as the plane does."""
        return float(self.mean[1]) / self.frame.half_height / task.rig.projector.rows_per_us

    @property
    def mean(self) -> Doubles:
        """The plane, (3,)."""
        assert self.planes is not None
        return self.planes.mean()


def weigh(state: State, evidence: Evidence, image: Counts, settings: GateSettings) -> tuple[State, Evidence]:
    """Take what a frame tells of each keypoint into the evidence, and note which ones it shows."""
    points, rig = state.points, state.task.rig
    assert points is not None
    periods = settings.exposure_us / rig.projector.period_us
    share = lit_share(points, image, periods)
    evidence = evidence.updated(rig, points.rows, settings, share, points.noise / points.direct)
    return replace(state, seen=lit(points, image, periods)), evidence


def along(state: State, plane: TargetPlane, reach: float) -> tuple[GateSettings, ...]:
    """Gates that hold the plane where its keypoints are, and `reach` projector rows before and behind: thinnest first.

    Of the clocks next to the plane's own.
    """
    task = state.task
    exact, nearest = plane.line_time_us(task), task.rig.camera.shutter.line.nearest
    near = sorted({nearest(exact * (1 + step)) for step in (-0.06, -0.04, -0.02, 0.0, 0.02, 0.04, 0.06)})
    gates = [around(state, plane, line_time) for line_time in near]
    beyond = 2 * reach / task.rig.projector.rows_per_us
    gates.sort(key=lambda gate: gate.exposure_us)
    return tuple(task.applied(g.line_time_us, float(g.delay_us), g.exposure_us + beyond) for g in gates[:MAX_CLOCKS])


def around(state: State, plane: TargetPlane, line_time_us: float | None = None) -> GateSettings:
    """The thinnest gate that holds the plane where its keypoints are; None for the plane's own line time."""
    task, points = state.task, state.points
    assert points is not None
    on = agreeing(plane.evidence, plane.mean @ plane.places(points).T)
    columns, rows = with_rim(task, points.only(on) if on.any() else points)
    ahead = plane.mean @ plane.frame.places(columns, rows).T
    line_time = plane.line_time_us(task) if line_time_us is None else line_time_us
    return gate_around(task.rig, rows - 0.5, ahead, line_time, keep=1.0)


def with_rim(task: SearchTask, points: Keypoints) -> tuple[Doubles, Doubles]:
    """The keypoints and four points a little beyond them, but not beyond the target."""
    x0, y0, x1, y1 = task.target
    columns, rows = points.columns, points.rows
    left, right = np.clip(_wider(columns), x0, x1)
    top, bottom = np.clip(_wider(rows), y0, y1)
    column, row = np.median(columns), np.median(rows)
    return np.append(columns, [left, right, column, column]), np.append(rows, [row, row, top, bottom])


def _wider(values: Doubles) -> Doubles:
    low, high = float(values.min()), float(values.max())
    return np.array([low - BEYOND * (high - low), high + BEYOND * (high - low)])
