"""The automatic search for the gate that shows a target, as pure ask and tell (section VI-B of the paper).

    state = begin(rig, target)
    while (settings := ask(state)) is not None:
        state = tell(state, image_made_with(settings), settings)
    state.outcome  # a gate or none, and the reason

Both methods begin alike: two fully lit frames give the keypoints that repeat, and one gate beyond infinity, where
nothing can be, tells how much of their light is ambient. Then the module `fast` or `paper` goes on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slopegate.core.gating.gate import phase_us, upright_line_time
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.axis import require_slabs
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.search import fast as search_fast
from slopegate.core.search import paper as search_paper
from slopegate.core.search.keypoints import NOISE_SIGMAS, Keypoints, Rectangle, detect, repeated, without_ambient
from slopegate.core.search.state import (
    DEFAULT_FRAMES,
    MAX_KEYPOINTS,
    MIN_KEYPOINTS,
    Dark,
    Method,
    SearchStep,
    SearchTask,
    State,
)

_BEYOND_ROWS = 2.0
"""How far the gate beyond infinity keeps off it."""


def begin(
    rig: Rig,
    target: Rectangle | None = None,
    method: Method = "fast",
    black_count: float = 0.0,
    max_frames: int | None = None,
    seed: int = 0,
) -> State:
    """A search that has not seen anything yet; `target` None is the whole image.

    Raises InputError for a target outside the image or smaller than 16 x 16 pixels, and for a rig whose gates are no
    slabs (`axis.no_slabs`).
    """
    require_slabs(rig)
    whole = (0, 0, rig.camera.lens.width, rig.camera.lens.height)
    frames = DEFAULT_FRAMES[method] if max_frames is None else max_frames
    task = SearchTask(rig, method, target or whole, black_count, frames, seed)
    return State(task, _First(), task.window(upright_line_time(rig), 0.0, rig.projector.period_us))


def ask(state: State) -> GateSettings | None:
    """The gate of the next frame, as the hardware has it; None at the end, when `state.outcome` is there."""
    return state.wish


def tell(state: State, image: Counts, settings: GateSettings) -> State:
    """The state after a frame (H, W) uint16 in counts, which was made with these settings.

    Raises InputError for an image of another size, RuntimeError for a search that has ended.
    """
    lens = state.task.rig.camera.lens
    require(image.shape == (lens.height, lens.width), "image", image.shape, f"of {lens.height} x {lens.width} pixels")
    if state.wish is None:
        raise RuntimeError("the search has ended: it takes no more frames")
    doing = state.phase.doing
    after = state.phase.tell(replace(state, frames=state.frames + 1), image, settings)
    seen = 0 if after.seen is None else int(after.seen.sum())
    after = replace(after, history=(*after.history, SearchStep(doing, settings, seen)))
    if after.wish is not None and after.frames >= state.task.max_frames:
        return after.ending("frames used up", f"the target was not found within {after.frames} frames")
    return after


def cancelled(state: State) -> State:
    """The same search, ended by the user; one that has ended stays as it is."""
    return state if state.wish is None else state.ending("cancelled", "the search was cancelled")


@dataclass(frozen=True)
class _First:
    """The first fully lit frame: keypoints are detected in it."""

    doing: str = "fully lit"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        points = detect(image, state.task.black_count, state.task.target, MAX_KEYPOINTS)
        if len(points) < MIN_KEYPOINTS:
            return _too_few(replace(state, points=points), "")
        every = np.ones(len(points), bool)
        return replace(state, points=points, seen=every).asking(_Second(image.copy()), settings)


@dataclass(frozen=True, eq=False)
class _Second:
    """The second one: keypoints that it does not show again are let go, and noise is measured."""

    first: Counts
    doing: str = "fully lit again"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        assert state.points is not None
        points = repeated(state.points, self.first, image)
        state = replace(state, points=points, seen=np.ones(len(points), bool))
        if len(points) < MIN_KEYPOINTS:
            return _too_few(state, " that a second frame shows again")
        return state.asking(_Beyond(), _beyond_infinity(state.task, points))


@dataclass(frozen=True)
class _Beyond:
    """A gate beyond infinity: what it shows is ambient light."""

    doing: str = "ambient light only"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        assert state.points is not None
        periods = settings.exposure_us / state.task.rig.projector.period_us
        points = without_ambient(state.points, image, periods)
        # Where ambient light rules, a gate changes too little to be told from noise.
        points = points.only(points.direct > np.maximum(NOISE_SIGMAS * points.noise, 0.1 * points.ambient))
        dark = Dark.of(image, state.task.black_count, periods)
        state = replace(state, points=points, seen=np.zeros(len(points), bool), dark=dark)
        if len(points) < MIN_KEYPOINTS:
            reason = f"the projector lights only {len(points)} of the target's keypoints: {MIN_KEYPOINTS} are needed"
            return state.ending("not lit", reason)
        return search_fast.start(state) if state.task.method == "fast" else search_paper.start(state)


def _too_few(state: State, which: str) -> State:
    count = 0 if state.points is None else len(state.points)
    reason = f"the target has only {count} keypoints{which}: {MIN_KEYPOINTS} are needed"
    return state.ending("too few keypoints", reason)


def _beyond_infinity(task: SearchTask, points: Keypoints) -> GateSettings:
    """A window that ends before light from infinity arrives: a quarter of a period, in which nothing in front can be.

    Light of the frame before would have to come from something nearer than any target: from 17 cm on the check rig.
    """
    rig, line_time = task.rig, upright_line_time(task.rig)
    infinity = phase_us(rig, line_time, points.rows, points.projector_rows(rig, 0.0) - _BEYOND_ROWS)
    length = rig.projector.period_us / 4
    return task.window(line_time, float(np.nanmin(infinity)) - length, length)
