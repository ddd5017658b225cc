"""Sets the gate of a GenICam camera by its features, and finds out which gates it accepts. Knows no transport.

The names are those of the Standard Features Naming Convention, newer first. There is no standard one for the time from
row to row: a camera has a pixel clock (with the rig file's clocks_per_line), a vendor's line time, or neither.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Protocol

from slopegate.core.gating.gate import upright_line_time
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import (
    GateSettings,
    LineTimes,
    PixelClocks,
    ShutterLimits,
    StartDelayUs,
    Steps,
    TriggerSettings,
    from_trigger,
    quantise,
    to_trigger,
)
from slopegate.drivers.cameras.device_camera import FREE_RUNNING, trigger_delay
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.frame import Abilities, Ability, Modes, TriggerEdge

EXPOSURE: Final = ("ExposureTime", "ExposureTimeAbs")
DELAY: Final = ("TriggerDelay", "TriggerDelayAbs")
SHUTTER_MODE: Final = ("SensorShutterMode", "ShutterMode")
CLOCK: Final = "DeviceClockFrequency"
RATE: Final = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
RATE_SWITCH: Final = ("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled")
LINE_TIME: Final = ("LineTime", "SensorLineTime", "SensorLinePeriod")
ACTIVATION: Final = "TriggerActivation"
EDGES: Final[dict[TriggerEdge, str]] = {"rising": "RisingEdge", "falling": "FallingEdge"}
US_OF_UNIT: Final = {"us": 1.0, "ns": 1e-3, "ms": 1e3, "s": 1e6}


class Features(Protocol):
    """A camera's features by name. Raises CameraError for what the camera refuses, CameraGoneError when it is lost."""

    def has(self, name: str) -> bool:
        """Whether it can be read now."""
        ...

    def writable(self, name: str) -> bool:
        """Whether it can be written now."""
        ...

    def number(self, name: str) -> float:
        """The value of an integer or float feature."""
        ...

    def span(self, name: str) -> tuple[float, float, float]:
        """Smallest and largest value and increment; an increment of 0 is none."""
        ...

    def set_number(self, name: str, value: float) -> None:
        """Write an integer or float feature."""
        ...

    def is_on(self, name: str) -> bool:
        """The value of a boolean."""
        ...

    def switch(self, name: str, on: bool) -> None:
        """Write a boolean."""
        ...

    def unit(self, name: str) -> str:
        """Unit of a number as the camera states it; empty where it does not."""
        ...

    def choice(self, name: str) -> str:
        """The entry of an enumeration."""
        ...

    def choices(self, name: str) -> tuple[str, ...]:
        """The entries that can be chosen now."""
        ...

    def choose(self, name: str, entry: str) -> None:
        """Write an enumeration."""
        ...


@dataclass(frozen=True)
class Shutter:
    """Names of the features that make the gate; empty for what the camera lacks."""

    exposure: str
    delay: str
    line: str
    line_unit: float
    """Line feature's value times this: MHz of a clock, microseconds of a line time."""
    delay_span: tuple[float, float, float]
    limits: ShutterLimits
    can: Abilities


def first_of(names: Iterable[str], features: Features) -> str:
    """The first feature that can be written; empty where none can."""
    return next((name for name in names if features.has(name) and features.writable(name)), "")


def prepare(features: Features, triggered: bool) -> str:
    """Set rolling shutter, timed exposure and trigger. Returns why there is no trigger; empty when there is one."""
    mode = first_of(SHUTTER_MODE, features)
    if mode and "Rolling" in features.choices(mode):
        features.choose(mode, "Rolling")
    if first_of(["ExposureAuto"], features) and "Off" in features.choices("ExposureAuto"):
        features.choose("ExposureAuto", "Off")
    if first_of(["ExposureMode"], features) and "Timed" in features.choices("ExposureMode"):
        features.choose("ExposureMode", "Timed")
    if not features.has("TriggerMode"):
        return "The camera has no trigger input that this program knows how to switch on."
    if first_of(["TriggerSelector"], features) and "FrameStart" in features.choices("TriggerSelector"):
        features.choose("TriggerSelector", "FrameStart")
    if not triggered:
        features.choose("TriggerMode", "Off")
        return FREE_RUNNING
    lines = [entry for entry in features.choices("TriggerSource") if entry.startswith("Line")]
    if not lines:
        return "The camera's trigger can come from no input line."
    if features.choice("TriggerSource") not in lines:
        features.choose("TriggerSource", lines[0])
    if features.has(ACTIVATION) and EDGES["rising"] in features.choices(ACTIVATION):
        choose_edge(features, "rising")
    features.choose("TriggerMode", "On")
    return ""


def choose_edge(features: Features, edge: TriggerEdge) -> None:
    """Let this edge of the trigger start the frames."""
    features.choose(ACTIVATION, EDGES[edge])


def edges_of(features: Features, no_trigger: str) -> Ability:
    """Whether the edge can be chosen; `no_trigger` is the answer of `prepare`."""
    if no_trigger:
        return Ability(no_trigger)
    offered = features.choices(ACTIVATION) if first_of([ACTIVATION], features) else ()
    missing = [entry for entry in EDGES.values() if entry not in offered]
    return Ability(f"The camera's {ACTIVATION} does not offer {missing[0]}." if missing else "")


def set_rate(features: Features, modes: Modes, rate_hz: float | None) -> tuple[Modes, Ability]:
    """Set the frame rate of a camera that runs by itself: None leaves it as it is, infinite is as fast as it can.

    Returns the modes with the rates read back and offered, and whether the rate can be chosen.
    """
    rate, switch = next((name for name in RATE if features.has(name)), ""), first_of(RATE_SWITCH, features)
    if not rate or not (switch or first_of([rate], features)):
        return modes, Ability("The camera has no frame rate that can be set.")
    if rate_hz is not None:
        if first_of(["AcquisitionFrameRateAuto"], features) and "Off" in features.choices("AcquisitionFrameRateAuto"):
            features.choose("AcquisitionFrameRateAuto", "Off")
        if switch:
            features.switch(switch, not math.isinf(rate_hz))
    limited = not switch or features.is_on(switch)
    low, high, _ = features.span(rate)
    if rate_hz is not None and limited:
        features.set_number(rate, min(max(rate_hz, low), high))
    now_hz = features.number(rate) if limited else math.inf
    return replace(modes, rate_hz=now_hz, rates_hz=(low, high)), Ability()


def probe(features: Features, rig: Rig, no_trigger: str) -> Shutter | None:
    """Find the gates that the camera and the rig file both allow; None for a camera whose exposure cannot be set.

    `no_trigger` is the answer of `prepare`. Raises CameraError when the two allow nothing in common.
    """
    exposure = first_of(EXPOSURE, features)
    if not exposure:
        return None
    limits = rig.camera.shutter
    exposure_us = _common(limits.exposure_us, features.span(exposure))
    delay = first_of(DELAY, features) if not no_trigger else ""
    delay_span = features.span(delay) if delay else (0.0, 0.0, 0.0)
    line, unit, allowed, no_line = _line(features, rig)
    no_delay = no_trigger or "The camera has no trigger delay; a sync board or delay generator can delay its trigger."
    can = Abilities(
        Ability(no_line),
        Ability("" if delay else no_delay),
        Ability(),
        Ability(no_trigger),
        Ability(_no_rows(features, delayed=bool(delay or no_trigger))),
    )
    limits = replace(limits, line=allowed, exposure_us=exposure_us)
    return Shutter(exposure, delay, line, unit, delay_span, limits, can)


def apply(
    features: Features, shutter: Shutter, period_us: float, settings: GateSettings, first_row: int = 0
) -> GateSettings:
    """Write a gate in the order in which each number limits the next, and read it back.

    The trigger delay is that of `first_row`, the first one that is read. Raises InputError, before anything is written,
    for a delay that the camera's trigger delay does not reach.
    """
    wanted = to_trigger(quantise(shutter.limits, settings, period_us))
    wanted = replace(wanted, start_us=StartDelayUs(wanted.start_us + first_row * wanted.line_time_us))
    delay_us, turns = _delay(shutter, period_us, wanted)
    line_us = wanted.line_time_us
    if shutter.line:
        line_us = _set_line(features, shutter, line_us)
    features.set_number(shutter.exposure, wanted.exposure_us)
    exposure_us = features.number(shutter.exposure)
    if exposure_us != wanted.exposure_us:
        # the middle stays where it was asked for, but for a delay at the very end of its range
        middle = replace(wanted, exposure_us=exposure_us, start_us=_start(wanted, exposure_us))
        with suppress(InputError):
            delay_us, turns = _delay(shutter, period_us, middle)
    if shutter.delay:
        features.set_number(shutter.delay, delay_us)
        delay_us = features.number(shutter.delay)
    start_us = delay_us - shutter.limits.delay_offset_us - turns * period_us - first_row * line_us
    return from_trigger(TriggerSettings(line_us, StartDelayUs(start_us), exposure_us))


def _no_rows(features: Features, delayed: bool) -> str:
    """Why fewer rows cannot be read; empty when they can."""
    if not all(first_of([name], features) for name in ("OffsetY", "Height")):
        return "The camera has no region of interest that can be set."
    return "" if delayed else "The camera has no trigger delay to make up for rows that are left out."


def _delay(shutter: Shutter, period_us: float, wanted: TriggerSettings) -> tuple[float, int]:
    if not shutter.delay:
        return 0.0, 0
    return trigger_delay(shutter.delay_span, wanted.start_us + shutter.limits.delay_offset_us, period_us)


def _start(wanted: TriggerSettings, exposure_us: float) -> StartDelayUs:
    return StartDelayUs(wanted.start_us + (wanted.exposure_us - exposure_us) / 2)


def _common(rig: Steps, span: tuple[float, float, float]) -> Steps:
    low, high = max(rig.min, span[0]), min(rig.max, span[1])
    if low > high:
        raise CameraError(
            f"the rig file allows exposures from {rig.min:g} to {rig.max:g} us, "
            f"the camera from {span[0]:g} to {span[1]:g} us: they have none in common"
        )
    return Steps(low, high, max(rig.step, span[2]))


def _line(features: Features, rig: Rig) -> tuple[str, float, PixelClocks | LineTimes, str]:
    """Feature, its unit, what it may be set to, and why it cannot be set (empty when it can)."""
    line = rig.camera.shutter.line
    if isinstance(line, PixelClocks):
        if first_of(["DeviceClockSelector"], features) and "Sensor" in features.choices("DeviceClockSelector"):
            features.choose("DeviceClockSelector", "Sensor")
        if first_of([CLOCK], features):
            low, high, _ = features.span(CLOCK)
            unit = 1.0 if features.unit(CLOCK) == "MHz" else 1e-6  # hertz by the convention
            ladder = tuple(mhz for mhz in line.ladder_mhz if low * unit <= mhz <= high * unit)
            if ladder:
                return CLOCK, unit, PixelClocks(line.clocks_per_line, ladder), ""
            reason = (
                f"The camera's clock goes from {low * unit:g} to {high * unit:g} MHz, beyond the rig file's ladder."
            )
            return "", 0.0, _fixed(rig), reason
    else:
        name = first_of(LINE_TIME, features)
        unit = US_OF_UNIT.get(features.unit(name), 0.0) if name else 0.0
        if unit:
            low, high, step = (part * unit for part in features.span(name))
            low, high = max(low, line.min_us), min(high, line.max_us)
            if low <= high:
                return name, unit, LineTimes(low, high, max(step, line.step_us)), ""
    allowed = _fixed(rig)
    wanted = "pixel clock" if isinstance(line, PixelClocks) else "line time"
    reason = f"The camera has no {wanted} that can be set; {allowed.min_us:.4g} us from row to row are assumed."
    return "", 0.0, allowed, reason


def _fixed(rig: Rig) -> LineTimes:
    """A rig file's only line time, or else the one nearest to an upright gate (B = 1)."""
    line_us = upright_line_time(rig)
    return LineTimes(line_us, line_us, line_us)


def _set_line(features: Features, shutter: Shutter, line_us: float) -> float:
    """Write the clock or line time if it differs; returns the line time read back, microseconds."""
    line = shutter.limits.line
    wanted = line.clock_mhz(line_us) if isinstance(line, PixelClocks) else line_us
    if not math.isclose(features.number(shutter.line) * shutter.line_unit, wanted, rel_tol=1e-9):
        features.set_number(shutter.line, wanted / shutter.line_unit)
    got = features.number(shutter.line) * shutter.line_unit
    if got <= 0:
        raise CameraError(f"the camera reads back {got:g} for {shutter.line}")
    return line.line_time_us(got) if isinstance(line, PixelClocks) else got
