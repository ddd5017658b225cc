"""The paper's search (section VI-B), as the baseline: clock up, then delay, then exposure, one small step a frame.

    "We then set the delay and exposure to minimum values, t_d = 1 us, t_e = 0.1 ms. [...] (1) Increase pixel clock
    until a keypoint of the object is visible in the scene, (2) change the delay to maximize new keypoints to be
    captured or until already visible keypoints are lost, (3) increase the exposure to maximize the number of
    keypoints."

Open in the text, and chosen here: the clock starts at the lowest; delay and exposure move by 0.1 ms, the width of the
window; the delay goes up while it gains, else down; a count has stopped rising after three steps without a new best.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings, LineTimes
from slopegate.core.search.keypoints import visible
from slopegate.core.search.state import SearchTask, State

FIRST_DELAY_US = 1.0
FIRST_EXPOSURE_US = 100.0
STEP_US = 100.0
PATIENCE = 3
LINE_TIME_STEPS = 64
"""Of a camera whose line time is set directly: as many steps as the paper's camera has clocks, or so."""


def start(state: State) -> State:
    """Begin at the lowest clock."""
    lines = line_times(state.task)
    return state.asking(_Clock(lines, 0), state.task.applied(lines[0], FIRST_DELAY_US, FIRST_EXPOSURE_US))


def line_times(task: SearchTask) -> tuple[float, ...]:
    """All line times from the longest (lowest clock) to the shortest."""
    line = task.rig.camera.shutter.line
    if isinstance(line, LineTimes):
        ratio = line.min_us / line.max_us
        steps = (line.nearest(line.max_us * ratio ** (k / (LINE_TIME_STEPS - 1))) for k in range(LINE_TIME_STEPS))
        return tuple(sorted(set(steps), reverse=True))
    return tuple(line.line_time_us(clock) for clock in line.ladder_mhz)


def _look(state: State, image: Counts, settings: GateSettings) -> tuple[State, int]:
    """The state with the keypoints that this frame shows, and how many there are."""
    assert state.points is not None
    periods = settings.exposure_us / state.task.rig.projector.period_us
    seen = visible(state.points, image, periods)
    return replace(state, seen=seen), int(seen.sum())


@dataclass(frozen=True)
class _Clock:
    """Step 1: raise the clock until a keypoint shows."""

    lines: tuple[float, ...]
    at: int
    doing: str = "raising the clock"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        state, count = _look(state, image, settings)
        if count > 0:
            return _Delay(settings, count, settings, 1, 0).move(state)
        if self.at + 1 == len(self.lines):
            return state.ending("not seen", "no pixel clock shows any keypoint at the shortest delay and exposure")
        wish = state.task.applied(self.lines[self.at + 1], FIRST_DELAY_US, FIRST_EXPOSURE_US)
        return state.asking(replace(self, at=self.at + 1), wish)


@dataclass(frozen=True)
class _Delay:
    """Step 2: move the delay while that gains keypoints, up at first, then down from the best."""

    best: GateSettings
    most: int
    last: GateSettings
    direction: int
    idle: int
    turned: bool = False
    doing: str = "moving the delay"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        state, count = _look(state, image, settings)
        if count > self.most:
            return replace(self, best=settings, most=count, last=settings, idle=0).move(state)
        moved = replace(self, last=settings, idle=self.idle + 1)
        if moved.idle < PATIENCE:
            return moved.move(state)
        # Up first; when that no longer gains, once down from the best.
        if not self.turned:
            return replace(self, last=self.best, direction=-self.direction, idle=0, turned=True).move(state)
        return _Exposure(self.best, self.most, self.best, 0).move(state)

    def move(self, state: State) -> State:
        """Ask for the next delay."""
        delay = float(self.last.delay_us) + self.direction * STEP_US
        return state.asking(self, state.task.applied(self.last.line_time_us, delay, self.last.exposure_us))


@dataclass(frozen=True)
class _Exposure:
    """Step 3: raise the exposure while that gains keypoints."""

    best: GateSettings
    most: int
    last: GateSettings
    idle: int
    doing: str = "raising the exposure"

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        state, count = _look(state, image, settings)
        if count > self.most:
            return replace(self, best=settings, most=count, last=settings, idle=0).move(state)
        return replace(self, last=settings, idle=self.idle + 1).move(state)

    def move(self, state: State) -> State:
        """Ask for the next exposure, or end."""
        exposure = self.last.exposure_us + STEP_US
        if self.idle == PATIENCE or exposure >= state.task.rig.projector.period_us:
            return state.judged(self.best, self.most)
        return state.asking(self, state.task.applied(self.last.line_time_us, float(self.last.delay_us), exposure))
