"""Settings in words, the same wherever the window shows them."""

from __future__ import annotations

from slopegate.core.rig import Rig
from slopegate.core.settings import GateSettings, PixelClocks


def number(value: float, digits: int = 3) -> str:
    """At most this many decimals, without trailing zeros."""
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def line_text(rig: Rig, line_time_us: float) -> str:
    """The line time in the camera's own terms."""
    line = rig.camera.shutter.line
    if isinstance(line, PixelClocks):
        return f"{number(line.clock_mhz(line_time_us))} MHz"
    return f"line {number(line_time_us)} \u00b5s"


def gate_text(settings: GateSettings) -> str:
    """Delay and exposure."""
    return f"delay {number(float(settings.delay_us))} \u00b5s, exposure {number(settings.exposure_us)} \u00b5s"
