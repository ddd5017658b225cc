"""The fast search: half-period windows locate all keypoints at once, the closed form gives the gate.

Six steps, each a `state.Phase`:

1. Locate (`_cut`, `_Locate`): a window of half a period cuts the scene along a surface, and every keypoint tells on
   which side of it it lies (`evidence`). Each frame halves what is open about the target's plane.
2. Try (`_Try`): a gate along the plane must show what agrees with it, for planes can fit all cuts and yet be wrong.
3. Sharpen (`_Sharpen`): windows that begin a little later each tell how far behind the first one every keypoint lies.
4. Grow (`_Grow`): the thinnest gate along the plane, then thicker ones while they show many more keypoints.
5. Choose (`_Choose`): other clocks, where the gate also lights what is not the target.
6. Look (`whole`): is the target whole, or does more of it join on before and behind?

The plane gives clock, delay and exposure in closed form (model section 3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopegate.core.gating.gate import phase_us, rows_at_phase, upright_line_time
from slopegate.core.gating.plan import gate_around
from slopegate.core.rig.arrays import Counts, Doubles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.rig.spread import robust_deviation
from slopegate.core.search.evidence import (
    CandidatePlanes,
    Evidence,
    PlaneUnits,
    agreeing,
    best_cut,
    frame_of,
    unknown,
    vote,
)
from slopegate.core.search.keypoints import Keypoints, lit, lit_share
from slopegate.core.search.state import MIN_KEPT, SearchTask, State, enough
from slopegate.core.search.whole import ShownTarget, finish

# Locating the plane.
MAX_CUTS = 20
"""How often the scene is cut before the plane has to be good enough."""
SURE_ROWS = 1.2
"""The plane is known well enough when its projector rows are, to this standard deviation in the mean over keypoints."""
STALLED = (5.0, 0.8, 2)
"""Or when, below so many rows, so many cuts in a row did not bring it to this share of the best before."""
_STEEPEST = (0.25, 4.0)
"""Projector rows per camera row, as multiples of the upright gate's: beyond any gate that a camera can follow."""

# Trying and sharpening it.
TRY_ROWS = 2.0
"""How far the first gate along a plane reaches beyond it, to either side."""
CONFIRMED = 0.8
"""Share of the keypoints that agree with the plane which that first gate must show."""
SHARPEN_ROWS, MAX_SHARPEN = 2.0, 8
"""How far before and behind a flat target's plane it is looked for at last, and in how many frames at most."""

# The gates along it.
SPARE_ROWS = 0.3
"""How far the last gate reaches beyond a flat target."""
FLAT_ROWS = 1.0
"""A target whose keypoints scatter less about its plane is flat."""
THICKER_ROWS = (5.0, 10.0, 20.0)
"""The same for targets that are not flat, one tried after the other."""
BEYOND = 0.15
"""The target reaches farther than its keypoints by this share of their extent: ORB needs room about them."""
MAX_CLOCKS = 5
"""How many clocks next to the plane's own are tried."""
FULL, GAIN = 0.8, 0.15
"""A gate that shows less than the share FULL of the keypoints is made thicker, as long as that shows GAIN more."""
PURE, NEARLY = 0.97, 0.85
"""Other clocks are tried while less than the share PURE of the pixels that the gate lights are the target's, and taken
if they show the share NEARLY of its keypoints."""
CLEARLY = 2.0
"""Another clock must show so many times less beside the target than the thinnest gate does: along a floor that goes on
beyond the target none does, and a clock that is off would only lose the floor."""


@dataclass(frozen=True, eq=False)
class _TargetPlane:
    """What is known of the target's plane: the evidence, and the planes that fit it, in their own units."""

    evidence: Evidence
    frame: PlaneUnits
    planes: CandidatePlanes | None
    cuts: int = 0
    sharpest: float = np.inf
    idle: int = 0

    def vote(self, state: State) -> _TargetPlane:
        """The same with planes drawn anew from the evidence."""
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


def _weigh(state: State, evidence: Evidence, image: Counts, settings: GateSettings) -> tuple[State, Evidence]:
    """Take what a frame tells of each keypoint into the evidence, and note which ones it shows."""
    points, rig = state.points, state.task.rig
    assert points is not None
    periods = settings.exposure_us / rig.projector.period_us
    share = lit_share(points, image, periods)
    evidence = evidence.updated(rig, points.rows, settings, share, points.noise / points.direct)
    return replace(state, seen=lit(points, image, periods)), evidence


def _along(state: State, plane: _TargetPlane, reach: float) -> tuple[GateSettings, ...]:
    """Gates that hold the plane where its keypoints are, and `reach` projector rows before and behind: thinnest first.

    One a clock, of the clocks next to the plane's own: on a coarse ladder the nearest need not be the thinnest.
    """
    task = state.task
    exact, nearest = plane.line_time_us(task), task.rig.camera.shutter.line.nearest
    near = sorted({nearest(exact * (1 + step)) for step in (-0.06, -0.04, -0.02, 0.0, 0.02, 0.04, 0.06)})
    gates = [_around(state, plane, line_time) for line_time in near]
    beyond = 2 * reach / task.rig.projector.rows_per_us
    gates.sort(key=lambda gate: gate.exposure_us)
    return tuple(task.applied(g.line_time_us, float(g.delay_us), g.exposure_us + beyond) for g in gates[:MAX_CLOCKS])


def _around(state: State, plane: _TargetPlane, line_time_us: float | None = None) -> GateSettings:
    """The thinnest gate that holds the plane where its keypoints are; None for the plane's own line time."""
    task, points = state.task, state.points
    assert points is not None
    on = agreeing(plane.evidence, plane.mean @ plane.places(points).T)
    columns, rows = _with_rim(task, points.only(on) if on.any() else points)
    ahead = plane.mean @ plane.frame.places(columns, rows).T
    line_time = plane.line_time_us(task) if line_time_us is None else line_time_us
    # `gate_around` takes whole camera rows and adds the half itself.
    return gate_around(task.rig, rows - 0.5, ahead, line_time, keep=1.0)


def _with_rim(task: SearchTask, points: Keypoints) -> tuple[Doubles, Doubles]:
    """The keypoints and four points a little beyond them, but not beyond the target."""
    x0, y0, x1, y1 = task.target
    columns, rows = points.columns, points.rows
    left, right = np.clip(_wider(columns), x0, x1)
    top, bottom = np.clip(_wider(rows), y0, y1)
    column, row = np.median(columns), np.median(rows)
    return np.append(columns, [left, right, column, column]), np.append(rows, [row, row, top, bottom])


def _wider(values: Doubles) -> Doubles:
    """Least and greatest value, moved out by the share BEYOND of their distance, (2,)."""
    low, high = float(values.min()), float(values.max())
    return np.array([low - BEYOND * (high - low), high + BEYOND * (high - low)])


def start(state: State) -> State:
    """Begin: nothing is known of the plane, so cut."""
    task, points = state.task, state.points
    assert points is not None
    projector = task.rig.projector
    level = projector.lens.fy / task.rig.camera.lens.fy
    slope = (_STEEPEST[0] * level, _STEEPEST[1] * level)
    frame = frame_of(points.columns, points.rows, slope, 2 * level)
    evidence = unknown(points.projector_rows(task.rig, 0.0), projector.lens.height)
    return _cut(state, _TargetPlane(evidence, frame, None))


def _cut(state: State, plane: _TargetPlane) -> State:
    """Vote, then ask for the next cut, or go on when the plane is known."""
    task, points = state.task, state.points
    assert points is not None
    plane = plane.vote(state)
    assert plane.planes is not None
    where = plane.places(points)
    on = agreeing(plane.evidence, plane.mean @ where.T)
    unsure = float(plane.planes.spread(where[on] if on.any() else where).mean())
    idle = plane.idle + 1 if STALLED[0] > unsure > STALLED[1] * plane.sharpest else 0
    # More cuts cannot help a plane that stays as unsure as it is; trying it costs one frame.
    alone = int(on.sum()) < enough(len(points))
    if (alone or (unsure > SURE_ROWS and idle < STALLED[2])) and plane.cuts < MAX_CUTS:
        line_time = upright_line_time(task.rig)
        begin_us = best_cut(task.rig, plane.planes, plane.evidence, where, points.rows, line_time)
        plane = replace(plane, sharpest=min(unsure, plane.sharpest), idle=idle)
        return state.asking(_Locate(plane), task.window(line_time, begin_us, task.rig.projector.period_us / 2))
    if alone:
        reason = f"only {int(on.sum())} of the target's {len(points)} keypoints lie on one plane"
        return state.ending("no plane", reason)
    return state.asking(_Try(plane, int(on.sum())), _along(state, plane, TRY_ROWS)[0])


@dataclass(frozen=True, eq=False)
class _Locate:
    """One more cut of the scene by a window of half a period."""

    plane: _TargetPlane
    doing: str = "locating"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        state, evidence = _weigh(state, self.plane.evidence, image, settings)
        return _cut(state, replace(self.plane, evidence=evidence, cuts=self.plane.cuts + 1))


@dataclass(frozen=True, eq=False)
class _Try:
    """A first gate along the plane: planes can fit all cuts so far and yet be wrong."""

    plane: _TargetPlane
    expected: int
    """Keypoints that agree with the plane."""
    doing: str = "trying the plane"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        state, evidence = _weigh(state, self.plane.evidence, image, settings)
        assert state.seen is not None
        plane = replace(self.plane, evidence=evidence, cuts=self.plane.cuts + 1)
        if int(state.seen.sum()) < CONFIRMED * self.expected and plane.cuts < MAX_CUTS:
            return _cut(state, plane)
        return _sharpen(state, plane.vote(state))


def _sharpen(state: State, plane: _TargetPlane) -> State:
    """Windows that begin from before to behind the target, a projector row apart or up to a seventh of its depth."""
    points, speed = state.points, state.task.rig.projector.rows_per_us
    assert points is not None
    thin = _along(state, plane, SPARE_ROWS)[0]
    where = plane.places(points)
    on = agreeing(plane.evidence, plane.mean @ where.T)
    late = phase_us(state.task.rig, thin.line_time_us, points.rows[on], plane.mean @ where[on].T)
    first, last = float(late.min()) - SHARPEN_ROWS / speed, float(late.max()) + SHARPEN_ROWS / speed
    count = min(max(int(np.ceil((last - first) * speed)) + 1, 2), MAX_SHARPEN)
    starts = tuple(float(start) for start in np.linspace(first, last, count))
    return _Sharpen(plane, thin.line_time_us, starts, np.zeros(len(points))).go(state)


@dataclass(frozen=True, eq=False)
class _Sharpen:
    """Windows of half a period along a flat target, each beginning a little later: the sum of a keypoint's lit shares
    is how far behind the first one it lies, in steps."""

    plane: _TargetPlane
    line_time_us: float
    starts_us: tuple[float, ...]
    sums: Doubles
    """(K,), of the windows so far."""
    done: int = 0
    doing: str = "sharpening"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        points, projector = state.points, state.task.rig.projector
        assert points is not None
        share = lit_share(points, image, settings.exposure_us / projector.period_us)
        after = replace(self, sums=self.sums + np.clip(share, 0.0, 1.0), done=self.done + 1)
        state = replace(state, seen=lit(points, image, settings.exposure_us / projector.period_us))
        if after.done < len(self.starts_us):
            return after.go(state)
        plane, reach = after.refit(points, state.task.rig)
        return _Grow(plane, (reach, *THICKER_ROWS)).go(state)

    def go(self, state: State) -> State:
        """Ask for the next window."""
        half = state.task.rig.projector.period_us / 2
        return state.asking(self, state.task.window(self.line_time_us, self.starts_us[self.done], half))

    def refit(self, points: Keypoints, rig: Rig) -> tuple[_TargetPlane, float]:
        """The plane by least squares without outliers, and how many rows its keypoints scatter about it."""
        step_us = self.starts_us[1] - self.starts_us[0]
        phases = self.starts_us[0] + (self.sums - 0.5) * step_us
        rows = rows_at_phase(rig, self.line_time_us, points.rows, phases)
        where = self.plane.places(points)
        # A keypoint lit in all windows or in none lies beyond them, nobody knows how far.
        use = (self.sums > 0.25) & (self.sums < len(self.starts_us) - 0.25)
        mean, scatter = self.plane.mean, TRY_ROWS
        for _ in range(4):
            if int(use.sum()) < MIN_KEPT:
                return self.plane, TRY_ROWS
            mean = np.asarray(np.linalg.lstsq(where[use], rows[use], rcond=None)[0], np.float64)
            off = rows - where @ mean
            scatter = robust_deviation(off[use], about=0.0)
            use &= np.abs(off) < 3 * max(scatter, 0.3)
        sharp = replace(self.plane, planes=CandidatePlanes(mean[None, :], np.ones(1)))
        # Steps between the windows scatter even a flat target, by up to a third of a step.
        relief = np.sqrt(max(scatter**2 - (0.35 * step_us * rig.projector.rows_per_us) ** 2, 0.0))
        return sharp, min(SPARE_ROWS + 2 * float(relief), TRY_ROWS)


@dataclass(frozen=True, eq=False)
class _Grow:
    """The gate along the plane, the thinnest first, then thicker while that shows many more keypoints."""

    plane: _TargetPlane
    reaches: tuple[float, ...]
    gates: tuple[GateSettings, ...] = ()
    """The gates of the present thickness, one for each clock."""
    level: int = 0
    lit: int = 0
    best: ShownTarget | None = None
    best_level: int = 0
    others: tuple[GateSettings, ...] = ()
    """The other clocks' gates of the best answer's thickness."""
    doing: str = "checking"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        """See `state.Phase`."""
        state, evidence = _weigh(state, self.plane.evidence, image, settings)
        assert state.seen is not None
        count, total = int(state.seen.sum()), len(state.seen)
        after = replace(self, plane=replace(self.plane, evidence=evidence), level=self.level + 1)
        # Thicker only for many more keypoints: every row of thickness lets in what stands before and behind.
        if self.level == 0 or count - self.lit >= GAIN * total:
            best = ShownTarget.of(state, image, settings)
            after = replace(after, best=best, best_level=self.level, others=self.gates[1:], lit=count)
            if count < FULL * total and after.level < len(self.reaches):
                return after.go(state)
        return after.end(state)

    def go(self, state: State) -> State:
        """Ask for the next thickness."""
        gates = _along(state, self.plane, self.reaches[self.level])
        return state.asking(replace(self, gates=gates), gates[0])

    def end(self, state: State) -> State:
        """Go on with the best gate so far; cut again when it shows too little."""
        best = self.best
        assert best is not None
        if best.count < enough(len(best.kept)) and self.plane.cuts < MAX_CUTS:
            return _cut(state, replace(self.plane, planes=None))
        flat = self.reaches[0] < FLAT_ROWS and self.best_level == 0
        return _choose(state, _Choose(_around(state, self.plane), (best,), self.others, flat))


def _choose(state: State, choice: _Choose) -> State:
    """Ask for another clock's gate, or end with the purest of those that show nearly all that any of them shows."""
    answers, others = choice.answers, choice.others
    thinnest = answers[0]
    good = [answer for answer in answers if answer.count >= NEARLY * thinnest.count]
    pure = {answer: answer.purity(state.task) for answer in good}
    if others and max(pure.values()) < PURE:
        return state.asking(choice, others[0])
    # The thinnest gate stays unless another clock is clearly better: it rejects most of all other light.
    best = max(good, key=pure.__getitem__)
    if _spill(pure[thinnest]) < CLEARLY * _spill(pure[best]) + (1 - PURE):
        best = thinnest
    return finish(state, best, choice.flat, choice.exact)


def _spill(purity: float) -> float:
    """Lit pixels beside the target over those of the target."""
    return 1 / max(purity, 1e-6) - 1


@dataclass(frozen=True, eq=False)
class _Choose:
    """Gates of other clocks that hold the same plane, where the best so far also shows what is not the target."""

    exact: GateSettings
    """The plane's own gate, of a clock that the camera may not have."""
    answers: tuple[ShownTarget, ...]
    others: tuple[GateSettings, ...]
    flat: bool
    """Whether the target's keypoints lie on its plane."""
    doing: str = "choosing the clock"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        periods = settings.exposure_us / state.task.rig.projector.period_us
        assert state.points is not None
        state = replace(state, seen=lit(state.points, image, periods))
        answers = (*self.answers, ShownTarget.of(state, image, settings))
        return _choose(state, replace(self, answers=answers, others=self.others[1:]))
