"""A uEye's timing, in the vendor's order: clock, frame rate, exposure, each range read anew; then the trigger delay."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from typing import Final

from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks, ShutterLimits
from slopegate.drivers.cameras.ueye_api import Ueye
from slopegate.drivers.contract.camera import CameraError

CLOCK_NUMBER, CLOCK_LIST, CLOCK_GET, CLOCK_SET = 1, 2, 5, 6
EXPOSURE_RANGE, EXPOSURE_GET, EXPOSURE_SET = 6, 7, 12
GET_DELAY, GET_MIN_DELAY, GET_MAX_DELAY, GET_DELAY_STEP = 0x8000, 0x8001, 0x8002, 0x8003
ROOM: Final = 1.05
"""A frame that is not triggered takes this much longer than its exposure, at least."""


def shutter_limits(api: Ueye, rig: Rig) -> tuple[ShutterLimits, PixelClocks]:
    """The rig file's limits with those of its clocks that the camera has. Raises CameraError when that is none."""
    limits, line = rig.camera.shutter, rig.camera.shutter.line
    if not isinstance(line, PixelClocks):
        raise CameraError(f"{api.name} has pixel clocks: the rig file must give clocks_per_line and ladder_mhz")
    count = api.ask("PixelClock", CLOCK_NUMBER, ctypes.c_uint)[0]
    offered = api.ask("PixelClock", CLOCK_LIST, ctypes.c_uint, count)
    ladder = tuple(mhz for mhz in line.ladder_mhz if mhz in offered)
    if not ladder:
        raise CameraError(f"{api.name} has the clocks {offered} MHz, and none of them is on the rig file's ladder")
    clocks = PixelClocks(line.clocks_per_line, ladder)
    return replace(limits, line=clocks), clocks


def set_shutter(api: Ueye, clock_mhz: int, exposure_us: float, rate_hz: float | None) -> float:
    """Set clock, frame rate and exposure of a stopped camera; returns the exposure in microseconds that it has now."""
    api.tell("PixelClock", CLOCK_SET, ctypes.c_uint(clock_mhz))
    got = api.ask("PixelClock", CLOCK_GET, ctypes.c_uint)[0]
    if got != clock_mhz:
        raise CameraError(f"{api.name} was told a pixel clock of {clock_mhz} MHz and has {got} MHz")
    shortest_s, longest_s, step_s = ctypes.c_double(), ctypes.c_double(), ctypes.c_double()
    api.call("GetFrameTimeRange", shortest_s, longest_s, step_s)
    frame_s = max(shortest_s.value, ROOM * exposure_us * 1e-6, 0.0 if rate_hz is None else 1 / rate_hz)
    api.call("SetFrameRate", 1 / min(frame_s, longest_s.value), ctypes.c_double())
    low_ms, high_ms, _ = api.ask("Exposure", EXPOSURE_RANGE, ctypes.c_double, 3)
    api.tell("Exposure", EXPOSURE_SET, ctypes.c_double(min(max(exposure_us * 1e-3, low_ms), high_ms)))
    return float(api.ask("Exposure", EXPOSURE_GET, ctypes.c_double)[0]) * 1e3


def delay_span(api: Ueye) -> tuple[float, float, float]:
    """Smallest and largest trigger delay and its step, microseconds. The answers are the function's return values."""
    low, high, step = (
        float(api.ueye.is_SetTriggerDelay(api.handle, what)) for what in (GET_MIN_DELAY, GET_MAX_DELAY, GET_DELAY_STEP)
    )
    return low, high, step


def set_delay(api: Ueye, delay_us: float) -> float:
    """Set the trigger delay; what the camera reads back, microseconds."""
    api.call("SetTriggerDelay", round(delay_us))
    return float(api.ueye.is_SetTriggerDelay(api.handle, GET_DELAY))
