"""The fast search: half-period windows locate all keypoints at once, the closed form gives the gate.

Every frame halves what is open about the target's plane, wherever its keypoints are: a window of half a period cuts the
scene along a surface, and each keypoint tells on which side of it it lies (core.evidence). The plane gives clock, delay
and exposure (model section 3). A few frames along it then find how thick the target is, and the last one proves it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from slopegate.core.evidence import Evidence, Frame, Planes, agreeing, best_cut, frame_of, unknown, vote
from slopegate.core.keypoints import Counts, Keypoints, lit, lit_share, visible
from slopegate.core.region import gate_around
from slopegate.core.search_state import State, Task, enough, level_line_time, projector_rows
from slopegate.core.settings import GateSettings

Floats = NDArray[np.float64]

MAX_CUTS = 20
SURE_ROWS = 1.2
"""The plane is known well enough when its projector rows are, to this standard deviation in the mean over keypoints."""
STALLED = (5.0, 0.8, 2)
"""Or when, below so many rows, so many cuts in a row did not bring it to this share of the best before."""
BEYOND = 0.15
"""The target reaches farther than its keypoints by this share of their extent: ORB needs room about them."""
THICKER_ROWS = (2.0, 5.0, 10.0, 20.0)
"""How far the gate reaches beyond the plane, tried one after the other while that shows more keypoints."""
GAIN = 0.02
"""Share of the keypoints by which a thicker gate must show more."""
_STEEPEST = (0.25, 4.0)
"""Projector rows per camera row, as multiples of the upright gate's: beyond any gate that a camera can follow."""


def start(state: State) -> State:
    """Begin to cut."""
    task, points = state.task, state.points
    assert points is not None
    projector = task.rig.projector
    level = projector.lens.fy / task.rig.camera.lens.fy
    slope = (_STEEPEST[0] * level, _STEEPEST[1] * level)
    frame = frame_of(points.columns, points.rows, slope, 2 * level)
    evidence = unknown(projector_rows(task.rig, points, 0.0), projector.lens.height)
    return _cut(state, _Plane(evidence, frame, None))


@dataclass(frozen=True, eq=False)
class _Plane:
    """What is known of the target's plane."""

    evidence: Evidence
    frame: Frame
    planes: Planes | None
    cuts: int = 0
    sharpest: float = np.inf
    idle: int = 0

    def vote(self, state: State) -> _Plane:
        """With planes that fit the evidence."""
        assert state.points is not None
        rng = np.random.default_rng((state.task.seed, state.frames))
        return replace(self, planes=vote(self.evidence, self.places(state.points), self.frame, self.planes, rng))

    def places(self, points: Keypoints) -> Floats:
        """Where the keypoints are, in the planes' units."""
        return self.frame.places(points.columns, points.rows)

    @property
    def mean(self) -> Floats:
        """The plane, (3,)."""
        assert self.planes is not None
        return self.planes.mean()


@dataclass(frozen=True, eq=False)
class _Locate:
    plane: _Plane
    doing: str = "locating"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        state, evidence = _weigh(state, self.plane.evidence, image, settings)
        return _cut(state, replace(self.plane, evidence=evidence, cuts=self.plane.cuts + 1))


@dataclass(frozen=True, eq=False)
class _Thicken:
    """The gate along the plane, with `reach` rows to spare on either side."""

    plane: _Plane
    reach: int
    before: int
    """Keypoints that the thinner gate showed."""
    doing: str = "finding the thickness"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        state, evidence = _weigh(state, self.plane.evidence, image, settings)
        assert state.seen is not None
        count = int(state.seen.sum())
        plane = replace(self.plane, evidence=evidence).vote(state)
        gained = count - self.before >= GAIN * len(state.seen)
        if gained and self.reach + 1 < len(THICKER_ROWS):
            return _Thicken(plane, self.reach + 1, count).go(state)
        reach = self.reach if gained else self.reach - 1
        return state.asking(_Prove(plane), _along(state, plane, THICKER_ROWS[reach]))

    def go(self, state: State) -> State:
        """Ask for this gate."""
        return state.asking(self, _along(state, self.plane, THICKER_ROWS[self.reach]))


@dataclass(frozen=True, eq=False)
class _Prove:
    plane: _Plane
    doing: str = "checking"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        assert state.points is not None
        periods = settings.exposure_us / state.task.rig.projector.period_us
        seen = visible(state.points, image, periods)
        state, evidence = _weigh(state, self.plane.evidence, image, settings)
        state = replace(state, seen=seen)
        if int(seen.sum()) >= enough(len(seen)) or self.plane.cuts >= MAX_CUTS:
            return state.judged(settings, int(seen.sum()))
        # The planes were wrong about this gate; with what it told, they vote again.
        return _cut(state, _Plane(evidence, self.plane.frame, None, self.plane.cuts))


def _weigh(state: State, evidence: Evidence, image: Counts, settings: GateSettings) -> tuple[State, Evidence]:
    points, rig = state.points, state.task.rig
    assert points is not None
    periods = settings.exposure_us / rig.projector.period_us
    share = lit_share(points, image, periods)
    evidence = evidence.updated(rig, points.rows, settings, share, points.noise / points.direct)
    return replace(state, seen=lit(points, image, periods)), evidence


def _cut(state: State, plane: _Plane) -> State:
    """Vote, then ask for the next cut, or go on when the plane is known."""
    task, points = state.task, state.points
    assert points is not None
    plane = plane.vote(state)
    assert plane.planes is not None
    where = plane.places(points)
    on = agreeing(plane.evidence, plane.mean @ where.T)
    unsure = float(plane.planes.spread(where[on] if on.any() else where).mean())
    idle = plane.idle + 1 if STALLED[0] > unsure > STALLED[1] * plane.sharpest else 0
    if unsure > SURE_ROWS and idle < STALLED[2] and plane.cuts < MAX_CUTS:
        line_time = level_line_time(task.rig)
        begin_us = best_cut(task.rig, plane.planes, where, points.rows, line_time)
        plane = replace(plane, sharpest=min(unsure, plane.sharpest), idle=idle)
        return state.asking(_Locate(plane), task.window(line_time, begin_us, task.rig.projector.period_us / 2))
    if int(on.sum()) < enough(len(points)):
        reason = f"only {int(on.sum())} of the target's {len(points)} keypoints lie on one plane"
        return state.ending("no plane", reason)
    return _Thicken(plane, 0, 0).go(state)


def _along(state: State, plane: _Plane, reach: float) -> GateSettings:
    """The thinnest gate that holds the plane where its keypoints are and `reach` projector rows before and behind."""
    task, points = state.task, state.points
    assert points is not None
    on = agreeing(plane.evidence, plane.mean @ plane.places(points).T)
    chosen = points.only(on) if on.any() else points
    columns, rows = _with_rim(task, chosen)
    ahead = plane.mean @ plane.frame.places(columns, rows).T
    exact = float(plane.mean[1]) / plane.frame.half_height / task.rig.projector.rows_per_us
    nearest = task.rig.camera.shutter.line.nearest
    near = {nearest(exact * (1 + step)) for step in (-0.03, -0.015, 0.0, 0.015, 0.03)}
    gates = [gate_around(task.rig, rows - 0.5, ahead, line_time, keep=1.0) for line_time in sorted(near)]
    thin = min(gates, key=lambda gate: gate.exposure_us)
    beyond = 2 * reach / task.rig.projector.rows_per_us
    return task.applied(thin.line_time_us, float(thin.delay_us), thin.exposure_us + beyond)


def _with_rim(task: Task, points: Keypoints) -> tuple[Floats, Floats]:
    """The keypoints and four points a little beyond them, but not beyond the target."""
    x0, y0, x1, y1 = task.target
    columns, rows = points.columns, points.rows
    left, right = np.clip(_wider(columns), x0, x1)
    top, bottom = np.clip(_wider(rows), y0, y1)
    column, row = np.median(columns), np.median(rows)
    return np.append(columns, [left, right, column, column]), np.append(rows, [row, row, top, bottom])


def _wider(values: Floats) -> Floats:
    low, high = float(values.min()), float(values.max())
    return np.array([low - BEYOND * (high - low), high + BEYOND * (high - low)])
