"""How commands speak: one JSON object, an aligned table, warnings and refusals; and gates and slabs as plain values."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from slopegate.app.session.durations import TimeLeft
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.plus_minus import plus_minus
from slopegate.core.rig.settings import PixelClocks

if TYPE_CHECKING:  # the help and the refusals need none of it, and are not to wait for it
    from slopegate.app.rig_gates import OpenRig
    from slopegate.core.calibration.compared import Compared
    from slopegate.core.gating.gate import Plane, Slab, SlabOrWhy
    from slopegate.core.gating.plan import Planned
    from slopegate.core.rig.settings import GateSettings

SAME = 1e-5
"""Relative difference of line times that typing a printed, rounded figure makes."""

MOST_DB = 200.0


Row = tuple[str, float | str | None, str, str]
"""Label, value, unit and remark."""


class CommandError(UserError):
    """The command cannot be done; the message is one sentence for the user."""


def print_json(values: dict[str, Any]) -> None:
    """One JSON object on standard output; numbers that are not finite become null, seconds are told to microseconds."""
    print(json.dumps(finite(values), indent=2, allow_nan=False))


def _to_microseconds(key: str, value: Any) -> Any:
    """A number of seconds, which its key tells, as clocks and frame rates know it; any other value as it is."""
    in_seconds = key.endswith(("seconds", "_s"))
    return round(value, 6) if in_seconds and isinstance(value, float) and math.isfinite(value) else value


def finite(value: Any) -> Any:
    """The same nested value with None for NaN and infinity, tuples as lists, and seconds to microseconds."""
    if isinstance(value, dict):
        return {key: finite(_to_microseconds(str(key), item)) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def decibels(psnr_db: float) -> float:
    """A PSNR for JSON, which has no infinity: at most MOST_DB, as of images that are equal."""
    return min(psnr_db, MOST_DB)


def print_table(rows: Sequence[Row]) -> None:
    """Rows, aligned; None is a dash."""
    shown = [(label, _number(value), unit, remark) for label, value, unit, remark in rows]
    widths = [max(len(row[column]) for row in shown) for column in range(3)]
    for label, value, unit, remark in shown:
        print(f"  {label:<{widths[0]}}  {value:>{widths[1]}} {unit:<{widths[2]}}  {remark}".rstrip())


def _number(value: float | str | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return f"{round(value, 4) + 0.0:.4f}" if abs(value) < 1e9 else f"{value:.6g}"  # no minus before a zero


def with_error(value: float | None, error: float | None) -> float | str | None:
    """What a table says of a value whose standard error may be known: the value itself where it is not."""
    return value if value is None or error is None else plus_minus(value, error)


def print_warnings(warnings: Iterable[str]) -> None:
    """On standard error, one line each."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


class ShareLine:
    """Says what is under way, the share of it that is done, 0..1, and the time left."""

    def __init__(self, what: str) -> None:
        self._what, self._left = what, TimeLeft()

    def __call__(self, share: float) -> None:
        left = self._left.text(share)
        say_line(f"{self._what} {100 * share:3.0f} %{', ' if left else ''}{left}")


say_share_done = ShareLine("rendering")


def hardware_warnings(rig: OpenRig, settings: GateSettings, then: str = "computed as asked") -> list[str]:
    """What the camera would round, and what is done `then`: most commands compute what was asked."""
    period = rig.period_us
    real = rig.rounded(settings)
    found = []
    if not math.isclose(real.line_time_us, settings.line_time_us, rel_tol=SAME):
        clock, nearest = rig.clock_mhz(settings), rig.clock_mhz(real)
        if clock is None:
            name, offer = f"line time {settings.line_time_us:g} us", f"{real.line_time_us:g} us"
        else:
            name, offer = f"pixel clock {clock:g} MHz", f"{nearest:g} MHz"
        found.append(f"the camera has no {name} (nearest: {offer}); {then}")
    moved = math.remainder(real.delay_us - settings.delay_us, period)
    delays = rig.rig.camera.shutter.delay_us
    if not delays.min <= settings.delay_us <= delays.max:
        found.append(
            f"the delay of {settings.delay_us:.7g} us is beyond the camera's range of {delays.min:g} to {delays.max:g} "
            f"us: it would get {real.delay_us:g} us, which is the same gate"
            + (f" to {abs(moved):.2g} us" if abs(moved) > 1e-6 else "")
            + f", for delays count modulo the projector's period of {period:g} us; {then}"
        )
    elif abs(moved) > 1e-6:
        found.append(f"the camera would round the delay by {moved:+.4g} us to {real.delay_us:g} us; {then}")
    if abs(real.exposure_us - settings.exposure_us) > 1e-6:
        found.append(
            f"the camera would make the exposure {real.exposure_us:g} us instead of {settings.exposure_us:g} us; {then}"
        )
    return found


def plan_warnings(rig: OpenRig, planned: Planned) -> list[str]:
    """Wishes that lie beyond the ends of what the camera accepts."""
    limits, exact = rig.rig.camera.shutter, planned.exact
    found = []
    if isinstance(limits.line, PixelClocks):
        low, high = limits.line.ladder_mhz[0], limits.line.ladder_mhz[-1]
        wanted, unit = limits.line.clock_mhz(exact.line_time_us), "MHz"
    else:
        low, high, wanted, unit = limits.line.min_us, limits.line.max_us, exact.line_time_us, "us a line"
    if not low * (1 - SAME) <= wanted <= high * (1 + SAME):
        found.append(f"this tilt needs {wanted:g} {unit} and the camera has {low:g} to {high:g}: see the residual")
    low, high = limits.exposure_us.min, limits.exposure_us.max
    if not low <= exact.exposure_us <= high:
        found.append(
            f"this thickness needs an exposure of {exact.exposure_us:g} us and the camera has {low:g} to {high:g} us: "
            "see the residual"
        )
    return found


def sideways(plane: tuple[float, ...] | None, thickness_m: float | None) -> list[str]:
    """How far to the sides a plane stays within half the thickness of a slab that cannot lean as it does.

    None: no plane was asked for, or no thickness.
    """
    if plane is None:
        return []
    a, b, c, _ = plane
    lean = math.asin(min(abs(a) / math.hypot(a, b, c), 1.0))
    if lean < math.radians(0.5):
        return []
    told = f"the plane leans sideways by {math.degrees(lean):.1f} degrees, which no gate can follow"
    if thickness_m is None:
        return [told]
    within_m = thickness_m / 2 / math.sin(lean)
    return [f"{told}: a slab this thin holds it up to {within_m:.2g} m left and right of the middle"]


def slab_values(found: Slab) -> dict[str, Any]:
    """The read-outs under the names of the command line's contract, without the warnings."""
    return {
        "line_time_us": found.line_time_us,
        "B": found.B,
        "tilt_deg": found.tilt_deg,
        "distance_m": found.distance_m,
        "near_m": found.near_m,
        "far_m": found.far_m,
        "thickness_m": found.thickness_m,
        "hinge_y_m": found.hinge_y_m,
        "planes": {name: _plane_values(getattr(found, name)) for name in ("near", "centre", "far")},
        "windows_us": found.windows_us,
        **error_values(found),
    }


def error_values(found: Slab) -> dict[str, Any]:
    """What is told beside the read-outs of a slab whose rig was calibrated; nothing of another."""
    return {} if found.errors is None else {"standard_errors": asdict(found.errors)}


def old_rig_values(found: Compared) -> dict[str, Any]:
    """What a calibration says of the rig before it: what moved, where its gates really stand, and both in words."""
    really = found.really
    gate = None if really is None else {key: getattr(really, key) for key in ("distance_m", "tilt_deg")}
    return {
        "moved": [one.name for one in found.moved],
        "turned": list(found.turned),
        "asked_distance_m": found.distance_m,
        "really": None if really is None or gate is None else gate | error_values(really),
        "sentences": list(found.sentences),
    }


def print_old_rig(sentences: Iterable[str]) -> None:
    """The same for people."""
    print("Against the rig before")
    for sentence in sentences:
        print(f"  {sentence}")


def read_out_values(found: SlabOrWhy) -> dict[str, Any]:
    """A gate's slab as `slab`, None where it has none, and then the reason as `no_slab`."""
    return {"slab": None if found.slab is None else slab_values(found.slab), "no_slab": found.why or None}


def _plane_values(plane: Plane) -> dict[str, Any]:
    return {"A": plane.A, "normal": plane.normal, "offset_m": plane.offset_m}


def settings_values(rig: OpenRig, settings: GateSettings) -> dict[str, Any]:
    """A gate under the names of the options that make it."""
    return {
        "clock_mhz": rig.clock_mhz(settings),
        "line_time_us": settings.line_time_us,
        "delay_us": float(settings.delay_us),
        "exposure_us": settings.exposure_us,
    }


def slab_rows(read: dict[str, Any] | None) -> list[Row]:
    """The three numbers of `slab_values` that people want first; without a slab that there is none."""
    if read is None:
        return [("slab", None, "", "this gate is no slab of space")]
    errors = read.get("standard_errors", {})
    rows = (
        ("tilt", "tilt_deg", "deg", "positive: the top leans away from the rig"),
        ("distance", "distance_m", "m", "to the centre plane, on the axis"),
        ("thickness", "thickness_m", "m", ""),
    )
    return [(name, with_error(read[key], errors.get(key)), unit, remark) for name, key, unit, remark in rows]


def say_line(text: str) -> None:
    """What is under way, on one line of standard error that the next one replaces; "" takes it away.

    Silent for programs.
    """
    if sys.stderr.isatty():
        print(f"\r{text[:78]:<78}" if text else "\r" + " " * 78 + "\r", end="", file=sys.stderr, flush=True)
