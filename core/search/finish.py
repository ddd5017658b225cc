"""The end of the fast search: how thick the gate must be, and with which clock it shows the least beside the target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from slopegate.core.rig.settings import GateSettings
from slopegate.core.search.keypoints import Counts, lit, visible
from slopegate.core.search.plane import MAX_CUTS, Plane, along, around, weigh
from slopegate.core.search.state import STRIDE, State, enough

FULL, GAIN = 0.8, 0.15
"""A gate that shows less than the share FULL of the keypoints is made thicker, as long as that shows GAIN more."""
PURE, NEARLY = 0.97, 0.85
"""Other clocks are tried while less than the share PURE of the pixels that the gate lights are the target's, and taken
if they show the share NEARLY of its keypoints."""
CLEARLY = 2.0
"""Another clock must show so many times less beside the target than the thinnest gate does: along a floor that goes on
beyond the target none does, and a clock that is off would only lose the floor."""


@dataclass(frozen=True, eq=False)
class Grow:
    """The gate along the plane, the thinnest first, then thicker while that shows many more keypoints."""

    plane: Plane
    reaches: tuple[float, ...]
    again: Callable[[State, Plane], State]
    """What to do with the plane when its gates show too little."""
    gates: tuple[GateSettings, ...] = ()
    """Those of the present thickness, one for each clock."""
    level: int = 0
    lit: int = 0
    best: Answer | None = None
    others: tuple[GateSettings, ...] = ()
    """Those of the best answer's thickness but for its own."""
    doing: str = "checking"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        """See `search_state.Phase`."""
        state, evidence = weigh(state, self.plane.evidence, image, settings)
        assert state.seen is not None
        count, total = int(state.seen.sum()), len(state.seen)
        after = replace(self, plane=replace(self.plane, evidence=evidence), level=self.level + 1)
        if self.level == 0 or count - self.lit >= GAIN * total:
            after = replace(after, best=_answer(state, image, settings), others=self.gates[1:], lit=count)
            if count < FULL * total and after.level < len(self.reaches):
                return after.go(state)
        return after.end(state)

    def go(self, state: State) -> State:
        """Ask for the next thickness."""
        gates = along(state, self.plane, self.reaches[self.level])
        return state.asking(replace(self, gates=gates), gates[0])

    def end(self, state: State) -> State:
        """On with the best gate so far; once more from the start when that shows too little."""
        best = self.best
        assert best is not None
        if best.count < enough(len(best.kept)) and self.plane.cuts < MAX_CUTS:
            return self.again(state, replace(self.plane, planes=None))
        return _choose(state, around(state, self.plane), (best,), self.others)


@dataclass(frozen=True, eq=False)
class _Choose:
    """Gates of other clocks that hold the same plane, where the best so far also shows what is not the target."""

    exact: GateSettings
    """The plane's own gate, of a clock that the camera may not have."""
    answers: tuple[Answer, ...]
    others: tuple[GateSettings, ...]
    doing: str = "choosing the clock"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        periods = settings.exposure_us / state.task.rig.projector.period_us
        assert state.points is not None
        state = replace(state, seen=lit(state.points, image, periods))
        answers = (*self.answers, _answer(state, image, settings))
        return _choose(state, self.exact, answers, self.others[1:])


@dataclass(frozen=True, eq=False)
class Answer:
    """A gate, the keypoints that it shows (K,), and the share of the pixels it lights that are the target's."""

    settings: GateSettings
    kept: NDArray[np.bool_]
    purity: float

    @property
    def spill(self) -> float:
        """Pixels beside the target over those of the target."""
        return 1 / max(self.purity, 1e-6) - 1

    @property
    def count(self) -> int:
        """Keypoints that it shows."""
        return int(self.kept.sum())


def _answer(state: State, image: Counts, settings: GateSettings) -> Answer:
    task = state.task
    assert state.points is not None
    assert state.dark is not None
    periods = settings.exposure_us / task.rig.projector.period_us
    recorded = state.dark.lit(image, task.black_count, periods)
    x0, y0, x1, y1 = (-(-edge // STRIDE) for edge in task.target)
    inside, every = int(recorded[y0:y1, x0:x1].sum()), int(recorded.sum())
    return Answer(settings, visible(state.points, image, periods), inside / max(every, 1))


def _choose(state: State, exact: GateSettings, answers: tuple[Answer, ...], others: tuple[GateSettings, ...]) -> State:
    """Ask for another clock's gate, or end with the purest of those that show nearly all that any of them shows."""
    thinnest = answers[0]
    good = [answer for answer in answers if answer.count >= NEARLY * thinnest.count]
    if others and max(answer.purity for answer in good) < PURE:
        return state.asking(_Choose(exact, answers, others), others[0])
    best = max(good, key=lambda answer: answer.purity)
    if thinnest.spill < CLEARLY * best.spill + (1 - PURE):
        best = thinnest
    return replace(state, seen=best.kept).judged(best.settings, best.count, exact)
