"""Gate settings (line time, delay, exposure), the limits of a camera's shutter, and rounding to them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NewType

from slopegate.core.rig.checks import require, require_finite, require_positive

CentreDelayUs = NewType("CentreDelayUs", float)
"""Trigger to the middle of the exposure of row coordinate 0: the convention of the model and of the interface."""

StartDelayUs = NewType("StartDelayUs", float)
"""Trigger to the start of the exposure of row coordinate 0: what sensors are told."""

MAX_TIME_US = 1e6
"""Largest exposure, delay (of either sign) and projector period: a second."""

MIN_PERIOD_US = 100.0
"""Shortest projector period: 10 000 frames a second."""

MIN_LINE_TIME_US, MAX_LINE_TIME_US = 1e-6, 1e6
"""Line times from far below the fastest sensor's to a second."""


@dataclass(frozen=True)
class GateSettings:
    """A gate: camera row r_c (continuous) is exposed during delay + r_c * line_time -+ exposure / 2, microseconds.

    This is the paper's centre convention (section III; model section 2): the delay is to the middle. Raises InputError
    for numbers outside the domain that the closed forms are proved for: line times from MIN_LINE_TIME_US to
    MAX_LINE_TIME_US, |delay| and exposure up to MAX_TIME_US.
    """

    line_time_us: float
    delay_us: CentreDelayUs
    exposure_us: float

    def __post_init__(self) -> None:
        require_positive("line_time_us", self.line_time_us)
        require_line_time("line_time_us", self.line_time_us)
        require_finite("delay_us", self.delay_us)
        low, high = -MAX_TIME_US, MAX_TIME_US
        require(low <= self.delay_us <= high, "delay_us", self.delay_us, f"from {low:.0f} to {high:.0f} us")
        require_positive("exposure_us", self.exposure_us)
        require(self.exposure_us <= MAX_TIME_US, "exposure_us", self.exposure_us, f"at most {MAX_TIME_US:.0f} us")

    @property
    def start_us(self) -> float:
        """Start of the exposure of row coordinate 0, to one rounding."""
        return self.delay_us - self.exposure_us / 2

    @property
    def end_us(self) -> float:
        """End of the exposure of row coordinate 0, to one rounding."""
        return self.delay_us + self.exposure_us / 2


def require_line_time(field: str, line_time_us: float) -> None:
    """Raise InputError unless a gate can have this line time."""
    allowed = f"from {MIN_LINE_TIME_US:g} to {MAX_LINE_TIME_US:.0f} us"
    require(MIN_LINE_TIME_US <= line_time_us <= MAX_LINE_TIME_US, field, line_time_us, allowed)


@dataclass(frozen=True)
class TriggerSettings:
    """The same gate in a sensor's own terms: when row coordinate 0 starts, and for how long each row is exposed."""

    line_time_us: float
    start_us: StartDelayUs
    exposure_us: float


def gate(line_time_us: float, delay_us: float, exposure_us: float) -> GateSettings:
    """A gate from plain numbers; the delay is to the centre of the exposure."""
    return GateSettings(line_time_us, CentreDelayUs(delay_us), exposure_us)


def to_trigger(settings: GateSettings) -> TriggerSettings:
    """Centre convention -> start convention: start = delay - exposure / 2, to one rounding."""
    return TriggerSettings(settings.line_time_us, StartDelayUs(settings.start_us), settings.exposure_us)


def from_trigger(trigger: TriggerSettings) -> GateSettings:
    """Start convention -> centre convention: delay = start + exposure / 2, to one rounding."""
    return gate(trigger.line_time_us, trigger.start_us + trigger.exposure_us / 2, trigger.exposure_us)


@dataclass(frozen=True)
class PixelClocks:
    """A camera whose line time is a number of clocks: line_time_us = clocks_per_line / clock_mhz, to one rounding."""

    clocks_per_line: float
    ladder_mhz: tuple[float, ...]

    def __post_init__(self) -> None:
        require_positive("clocks_per_line", self.clocks_per_line)
        rising = all(a < b for a, b in zip(self.ladder_mhz[:-1], self.ladder_mhz[1:], strict=True))
        require(
            len(self.ladder_mhz) > 0 and rising and self.ladder_mhz[0] > 0 and math.isfinite(self.ladder_mhz[-1]),
            "ladder_mhz",
            self.ladder_mhz,
            "a rising list of finite clocks above 0",
        )

    def line_time_us(self, clock_mhz: float) -> float:
        """Time from one camera row to the next at this clock."""
        require_positive("clock_mhz", clock_mhz)
        return self.clocks_per_line / clock_mhz

    def clock_mhz(self, line_time_us: float) -> float:
        """The clock that gives this line time, on the ladder or not."""
        require_positive("line_time_us", line_time_us)
        return self.clocks_per_line / line_time_us

    def nearest(self, line_time_us: float) -> float:
        """The line time on the ladder whose *clock* is nearest to the one asked for."""
        wanted = self.clock_mhz(line_time_us)
        return self.clocks_per_line / min(self.ladder_mhz, key=lambda clock: abs(clock - wanted))


@dataclass(frozen=True)
class LineTimes:
    """A camera whose line time is set directly, in steps."""

    min_us: float
    max_us: float
    step_us: float

    def __post_init__(self) -> None:
        for name in ("min_us", "max_us", "step_us"):
            require_positive(name, getattr(self, name))
        require(self.min_us <= self.max_us, "max_us", self.max_us, f"at least min_us ({self.min_us:g})")

    def nearest(self, line_time_us: float) -> float:
        """The settable line time nearest to the one asked for."""
        require_positive("line_time_us", line_time_us)
        return Steps(self.min_us, self.max_us, self.step_us).nearest(line_time_us)


@dataclass(frozen=True)
class Steps:
    """A range of values min, min + step, ... up to max; each min + count * step to two roundings."""

    min: float
    max: float
    step: float

    def nearest(self, value: float) -> float:
        """The settable value nearest to the one asked for."""
        count = round((min(max(value, self.min), self.max) - self.min) / self.step)
        count = min(count, math.floor((self.max - self.min) / self.step + 1e-9))
        return float(self.min + count * self.step)


@dataclass(frozen=True)
class ShutterLimits:
    """What a camera accepts: line time by ladder or by step, delay and exposure in microseconds.

    Delays are centre delays; one outside the range is moved by whole projector periods first, which changes nothing
    about the gate. Raises InputError for ranges that reach beyond MAX_TIME_US.
    """

    line: PixelClocks | LineTimes
    delay_us: Steps
    exposure_us: Steps
    delay_offset_us: float = 0.0
    """A camera's own trigger delay is to be this much longer than the model's start: fitted per rig."""

    def __post_init__(self) -> None:
        require_finite("delay_offset_us", self.delay_offset_us)
        allowed = f"within {-MAX_TIME_US:.0f} to {MAX_TIME_US:.0f} us"
        for name in ("delay_us", "exposure_us"):
            steps: Steps = getattr(self, name)
            require(-MAX_TIME_US <= steps.min <= steps.max <= MAX_TIME_US, name, (steps.min, steps.max), allowed)
        require(abs(self.delay_offset_us) <= MAX_TIME_US, "delay_offset_us", self.delay_offset_us, allowed)


@dataclass(frozen=True)
class Residual:
    """What rounding to the hardware changed: applied minus asked, microseconds."""

    line_time_us: float
    delay_us: float
    exposure_us: float


def turns_into(low_us: float, high_us: float, time_us: float, period_us: float) -> int:
    """How many whole periods to add to a time that is to lie from low_us to high_us: as few as do it, 0 for none.

    Where the range is shorter than a period the time may end up beyond its other end.
    """
    if time_us < low_us:
        return math.ceil((low_us - time_us) / period_us)
    return -math.ceil((time_us - high_us) / period_us) if time_us > high_us else 0


def quantise(limits: ShutterLimits, settings: GateSettings, period_us: float) -> GateSettings:
    """The gate that the hardware can do, nearest to the one asked for, each number by itself.

    A delay is moved by whole periods in float64: to 1e-10 us within MAX_TIME_US, before it is rounded to its step.
    """
    turns = turns_into(limits.delay_us.min, limits.delay_us.max, settings.delay_us, period_us)
    delay = settings.delay_us + turns * period_us
    return replace(
        settings,
        line_time_us=limits.line.nearest(settings.line_time_us),
        delay_us=CentreDelayUs(limits.delay_us.nearest(delay)),
        exposure_us=limits.exposure_us.nearest(settings.exposure_us),
    )


def residual(applied: GateSettings, asked: GateSettings) -> Residual:
    """What rounding changed: applied minus asked."""
    return Residual(
        applied.line_time_us - asked.line_time_us,
        applied.delay_us - asked.delay_us,
        applied.exposure_us - asked.exposure_us,
    )
