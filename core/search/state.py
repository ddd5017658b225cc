"""The state of a search: everything it knows between an `ask` and a `tell`, frozen, with how it may end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from slopegate.core.gating.gate import Slab, slab_if_any
from slopegate.core.rig.arrays import Bools, Counts, Singles
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, gate, quantise
from slopegate.core.rig.spread import robust_deviation
from slopegate.core.search.keypoints import Keypoints, Rectangle

Method = Literal["fast", "paper"]
METHODS: tuple[Method, ...] = ("fast", "paper")

Cause = Literal["found", "part", "too few keypoints", "not lit", "no plane", "not seen", "frames used up", "cancelled"]

MIN_KEYPOINTS = 24
"""Fewer are no target: chance alone and a bit of clutter could outvote them."""
MIN_KEPT = 12
KEPT_SHARE = 0.25
"""A plane with fewer of the keypoints than either of these is not worth a gate."""
FOUND_SHARE = 0.5
"""A gate that shows less of the keypoints has not found the target: most of it lies elsewhere."""
WHOLE_SHARE = 0.8
"""A gate that shows this share of the keypoints shows the target whole. Some are always lost: to noise, and where they
lie on what is beside the target."""
MAX_KEYPOINTS = 500
STRIDE = 2
"""Only every so many'th pixel, either way, is looked at where lit pixels are counted."""
NOISY = 5.0
"""A pixel is lit when it stands above what is dark by so many standard deviations."""
MIN_SIDE = 16

DEFAULT_FRAMES: dict[Method, int] = {"fast": 48, "paper": 400}


@dataclass(frozen=True)
class SearchTask:
    """The target of a search, the rig, the method and the limits."""

    rig: Rig
    method: Method
    target: Rectangle
    black_count: float
    max_frames: int
    seed: int = 0

    def __post_init__(self) -> None:
        x0, y0, x1, y1 = self.target
        lens = self.rig.camera.lens
        inside = min(x0, y0) >= 0 and x1 <= lens.width and y1 <= lens.height
        require(
            inside and x1 - x0 >= MIN_SIDE and y1 - y0 >= MIN_SIDE,
            "target",
            self.target,
            f"x0 y0 x1 y1 within the image of {lens.width} x {lens.height} pixels and at least {MIN_SIDE} pixels "
            "wide and high",
        )
        require(self.method in METHODS, "method", self.method, " or ".join(METHODS))
        require(self.max_frames >= 1, "max_frames", self.max_frames, "a whole number of at least 1")

    @property
    def everywhere(self) -> bool:
        """Whether the target is the whole image, so that nothing lies beside it."""
        lens = self.rig.camera.lens
        return self.target == (0, 0, lens.width, lens.height)

    def applied(self, line_time_us: float, delay_us: float, exposure_us: float) -> GateSettings:
        """A gate as the hardware makes it."""
        asked = gate(line_time_us, delay_us, exposure_us)
        return quantise(self.rig.camera.shutter, asked, self.rig.projector.period_us)

    def window(self, line_time_us: float, start_us: float, length_us: float) -> GateSettings:
        """The gate whose exposure of row coordinate 0 begins at `start_us`, as the hardware makes it."""
        return self.applied(line_time_us, start_us + length_us / 2, length_us)


@dataclass(frozen=True)
class SearchStep:
    """One frame of the history."""

    doing: str
    settings: GateSettings
    seen: int
    """Keypoints seen in it."""


@dataclass(frozen=True)
class Outcome:
    """How a search ended."""

    cause: Cause
    reason: str
    """One sentence."""
    settings: GateSettings | None
    """The gate that shows the target or, where the cause is "part", a part of it; else None."""
    slab: Slab | None
    target: Slab | None
    """The target's own plane as far as the method knows it, before the clock was rounded to one that the camera has."""
    kept: int
    """Keypoints that this gate shows."""
    keypoints: int
    frames: int

    @property
    def found(self) -> bool:
        """Whether there is a gate, and it shows the target whole."""
        return self.cause == "found"


class Phase(Protocol):
    """One step of a method: what it does with the frame that the state asked for."""

    @property
    def doing(self) -> str:
        """In a few words, for people."""
        ...

    def tell(self, state: State, image: Counts, settings: GateSettings) -> State:
        """The state after this frame, with `frames` already counted."""
        ...


@dataclass(frozen=True, eq=False)
class Dark:
    """Every `STRIDE`th pixel of a frame that only ambient light reached, above black, and its noise per pixel."""

    light: Singles
    periods: float
    noise: float

    @staticmethod
    def of(image: Counts, black_count: float, periods: float) -> Dark:
        """From the frame and its exposure in projector periods."""
        light = image[::STRIDE, ::STRIDE].astype(np.float32) - np.float32(black_count)
        # neighbours differ by noise, but for the few across which the scene's own light changes
        noise = robust_deviation(np.diff(light, axis=1), about=0.0) / np.sqrt(2)
        return Dark(light, periods, max(noise, 0.5))

    def lit(self, image: Counts, black_count: float, periods: float) -> Bools:
        """Which of those pixels the projector's light reaches in a frame of this exposure."""
        light = image[::STRIDE, ::STRIDE] - np.float32(black_count)
        return np.asarray(light > self.light * np.float32(periods / self.periods) + np.float32(NOISY * self.noise))


@dataclass(frozen=True, eq=False)
class State:
    """Everything that a search knows. `wish` is the gate to be asked for next, None at the end."""

    task: SearchTask
    phase: Phase
    wish: GateSettings | None
    points: Keypoints | None = None
    seen: Bools | None = None
    """Which keypoints the last frame showed."""
    dark: Dark | None = None
    frames: int = 0
    history: tuple[SearchStep, ...] = ()
    outcome: Outcome | None = None

    def asking(self, phase: Phase, wish: GateSettings) -> State:
        """Go on with this phase and gate."""
        return replace(self, phase=phase, wish=wish)

    def ending(
        self,
        cause: Cause,
        reason: str,
        settings: GateSettings | None = None,
        kept: int = 0,
        exact: GateSettings | None = None,
    ) -> State:
        """No more frames. `exact` is the gate before rounding."""
        read_out, target = (
            None if gate is None else slab_if_any(self.task.rig, gate).slab for gate in (settings, exact)
        )
        total = 0 if self.points is None else len(self.points)
        outcome = Outcome(cause, reason, settings, read_out, target, kept, total, self.frames)
        return replace(self, wish=None, outcome=outcome)

    def judged(
        self, settings: GateSettings, kept: int, exact: GateSettings | None = None, *, complete: bool = False
    ) -> State:
        """End with this gate if it shows enough keypoints.

        Fewer than make a target whole are only a part of it, unless it is known to be `complete`.
        """
        total = 0 if self.points is None else len(self.points)
        needed = max(MIN_KEPT, math.ceil(FOUND_SHARE * total))
        if kept >= needed:
            reason = f"the gate shows {kept} of {total} keypoints"
            if complete or kept >= WHOLE_SHARE * total:
                return self.ending("found", reason, settings, kept, exact)
            hint = "; a rectangle about one object would say which is meant" if self.task.everywhere else ""
            return self.ending("part", reason + hint, settings, kept, exact)
        reason = (
            f"the best gate shows only {kept} of {total} keypoints, and {needed} are needed: "
            f"line time {settings.line_time_us:.3f}, delay {settings.delay_us:.0f} and "
            f"exposure {settings.exposure_us:.0f} \u00b5s"
        )
        return self.ending("not seen", reason, None, kept)


def enough(total: int) -> int:
    """How many of `total` keypoints a plane must hold to be worth a gate."""
    return max(MIN_KEPT, round(KEPT_SHARE * total))
