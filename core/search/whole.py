"""The end of a search: does the gate show the target whole?

A gate that shows most keypoints may still cut something off where there are none. So it is made thicker by a step, and
what then comes to light within the target is counted. Nothing much: what the gate shows ends there, and is whole. More:
the gate grows step by step, towards the rig and away from it, as far as more of the target joins on. It stops at a gap
in depth, and where what comes to light lies beside the target: that is what surrounds it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from slopegate.core.gating.gate import slab_if_any
from slopegate.core.rig.arrays import Bools, Counts
from slopegate.core.rig.settings import GateSettings
from slopegate.core.search.keypoints import visible
from slopegate.core.search.state import STRIDE, WHOLE_SHARE, SearchTask, State

GAINED = 0.03
"""What a thicker gate must show more of the target, over what the gate shows of it."""
CLEAN = 0.5
"""Of what comes to light, the share that must lie inside the target; else it is what surrounds it."""
GAP = 0.35
"""A gap in depth that ends an object, as a share of the width or height that its keypoints take ..."""
LEAST_ROWS = 3.0
"""... and at least so many projector rows."""
MAX_STEPS = 12
"""How often the gate may grow on either side."""

MORE_KEYPOINTS = 0.01
"""Or the share of the target's keypoints that must come to light with it, where the target is not flat."""

Side = Literal["near", "far"]


@dataclass(frozen=True, eq=False)
class ShownTarget:
    """A gate and what its frame shows: keypoints (K,), and which of every `STRIDE`th pixel is lit by the projector."""

    settings: GateSettings
    kept: Bools
    pixels: Bools

    @staticmethod
    def of(state: State, image: Counts, settings: GateSettings) -> ShownTarget:
        """From the frame (H, W) of this gate."""
        assert state.points is not None
        assert state.dark is not None
        periods = settings.exposure_us / state.task.rig.projector.period_us
        pixels = state.dark.lit(image, state.task.black_count, periods)
        return ShownTarget(settings, visible(state.points, image, periods), pixels)

    @property
    def count(self) -> int:
        """Keypoints that it shows."""
        return int(self.kept.sum())

    def inside(self, task: SearchTask) -> int:
        """Lit pixels of the target."""
        return int(self.pixels[in_target(task)].sum())

    def purity(self, task: SearchTask) -> float:
        """Share of the lit pixels that are the target's."""
        return self.inside(task) / max(int(self.pixels.sum()), 1)

    def joins(self, task: SearchTask, before: ShownTarget, flat: bool) -> bool:
        """Whether what it shows and the one before does not is of the target, which may be flat, and worth while."""
        more = self.pixels & ~before.pixels
        inside, every = int(more[in_target(task)].sum()), int(more.sum())
        # Where the target is the whole image, nothing lies beside it: then only what has keypoints counts.
        clean = not task.everywhere and inside >= CLEAN * every
        # A floor that the target stands on comes to light with it; a flat target has no more keypoints there.
        busy = not flat and self.count >= before.count + MORE_KEYPOINTS * len(self.kept)
        return (clean or busy) and inside >= GAINED * before.inside(task)


def in_target(task: SearchTask) -> tuple[slice, slice]:
    """The target among every `STRIDE`th pixel."""
    x0, y0, x1, y1 = (-(-edge // STRIDE) for edge in task.target)
    return slice(y0, y1), slice(x0, x1)


def finish(state: State, shown: ShownTarget, flat: bool, exact: GateSettings) -> State:
    """End with this gate if it shows the target whole; else look what joins on. `exact`: the gate before rounding."""
    if flat and shown.count >= WHOLE_SHARE * len(shown.kept):
        return _end(state, shown, exact, ended=True)
    return _Look(shown, flat, exact, _step_us(state, shown)).go(state)


def _end(state: State, shown: ShownTarget, exact: GateSettings, ended: bool) -> State:
    """End with this gate; `ended`: whether nothing more joins on to what it shows."""
    # What a rectangle holds besides may well be what surrounds the target. In a whole image there is nothing beside
    # it: keypoints that do not join on are another part of what was asked for.
    complete = ended and not state.task.everywhere
    return replace(state, seen=shown.kept).judged(shown.settings, shown.count, exact, complete=complete)


def _step_us(state: State, shown: ShownTarget) -> float:
    """How far a thicker gate reaches beyond this one: over the gap that would end an object of this size."""
    rig, lens = state.task.rig, state.task.rig.camera.lens
    assert state.points is not None
    kept = state.points.only(shown.kept)
    size = max(float(np.ptp(kept.columns)) / lens.fx, float(np.ptp(kept.rows)) / lens.fy) if len(kept) else 0.0
    # To first order, a gap is worth its share of the disparity, in projector rows.
    slab = slab_if_any(rig, shown.settings).slab
    w = 0.0 if slab is None else max(slab.inverse_distance_per_m, 0.0)
    rows = GAP * size * w * rig.baseline_m * rig.projector.lens.fy
    return max(rows, LEAST_ROWS) / rig.projector.rows_per_us


def _thicker(task: SearchTask, settings: GateSettings, near_us: float, far_us: float) -> GateSettings:
    """The gate, with so much more light before and after it: light from farther away comes first."""
    exposure_us = min(settings.exposure_us + near_us + far_us, task.rig.projector.period_us)
    return task.window(settings.line_time_us, settings.start_us - far_us, exposure_us)


@dataclass(frozen=True, eq=False)
class _Look:
    """A gate that reaches beyond the one found on both sides: is anything missing?"""

    shown: ShownTarget
    flat: bool
    exact: GateSettings
    step_us: float
    doing: str = "looking for more of it"

    def go(self, state: State) -> State:
        """Ask for it."""
        return state.asking(self, _thicker(state.task, self.shown.settings, self.step_us, self.step_us))

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        """See `state.Phase`."""
        more = ShownTarget.of(state, image, settings)
        state = replace(state, seen=more.kept)
        if not more.joins(state.task, self.shown, self.flat):
            return _end(state, self.shown, self.exact, ended=True)
        return _Join(self.shown, self.flat, self.exact, self.step_us, "near").go(state)


@dataclass(frozen=True, eq=False)
class _Join:
    """One step more on one side, as long as that shows more of the target."""

    shown: ShownTarget
    flat: bool
    exact: GateSettings
    step_us: float
    side: Side
    steps: int = 0
    ended: bool = True
    """Whether the side that was looked at first came to an end."""
    doing: str = "joining on"

    def go(self, state: State) -> State:
        """Ask for the next step."""
        near_us, far_us = (self.step_us, 0.0) if self.side == "near" else (0.0, self.step_us)
        return state.asking(self, _thicker(state.task, self.shown.settings, near_us, far_us))

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        """See `state.Phase`."""
        more = ShownTarget.of(state, image, settings)
        state = replace(state, seen=more.kept)
        joined = more.joins(state.task, self.shown, self.flat)
        if joined and self.steps + 1 < MAX_STEPS:
            return replace(self, shown=more, steps=self.steps + 1).go(state)
        shown = more if joined else self.shown
        if self.side == "near":
            return replace(self, shown=shown, side="far", steps=0, ended=not joined).go(state)
        return _end(state, shown, self.exact, self.ended and not joined)
