"""`slopegate slab` and `slopegate plan`: settings to slab and back. Nothing here renders."""

from __future__ import annotations

import math
from argparse import Namespace
from typing import Any

import numpy as np
from slopegate.app.commands.report import CommandError, print_json, print_table, print_warnings
from slopegate.core.gating.gate import Plane, Slab, slab
from slopegate.core.gating.plan import Planned, plan_on_hardware, plan_plane_on_hardware
from slopegate.core.rig.axis import delay_offset_us
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import (
    MAX_LINE_TIME_US,
    MIN_LINE_TIME_US,
    GateSettings,
    LineTimes,
    PixelClocks,
    gate,
    quantise,
)
from slopegate.drivers.files.rig_files import load_rig

_SAME = 1e-5
"""Relative difference of line times that typing a printed, rounded figure makes."""


def run_slab(options: Namespace) -> int:
    """Print the read-outs of a gate."""
    rig = _rig(options)
    settings = asked_gate(options, rig)
    found = slab(rig, settings)
    warnings = [*hardware_warnings(rig, settings), *found.warnings]
    if options.json:
        print_json(slab_values(found) | {"warnings": warnings})
        return 0
    print(_heading(rig, settings))
    print_table(_slab_rows(found))
    print_warnings(warnings)
    return 0


def run_plan(options: Namespace) -> int:
    """Print the settings for a wanted slab."""
    rig = _rig(options)
    planned = _planned(options, rig)
    warnings = [*_plan_warnings(rig, planned), *_sideways(options), *planned.slab.warnings]
    offset_us = _offset_us(options, rig, planned)
    if options.json:
        found = {} if offset_us is None else {"delay_offset_us": offset_us}
        print_json(_plan_values(rig, planned) | found | {"warnings": warnings})
        return 0
    print(f"Settings for {rig.name or 'this rig'}, rounded to what its camera accepts")
    print_table(_plan_rows(rig, planned))
    if offset_us is not None:
        print(f"That target lit up at {options.found_delay_us:g} us, so in the rig file, under [shutter]:")
        print(f"  delay_offset_us = {offset_us:.1f}")
    print_warnings(warnings)
    return 0


def _rig(options: Namespace) -> Rig:
    """The rig, with the camera of the scene where that brings one."""
    if options.scene is None:
        return load_rig(options.rig)
    # Late: reading scenes loads numba, which figures alone do not need.
    from slopegate.app.commands.scene import opened

    return opened(options)[0]


def _planned(options: Namespace, rig: Rig) -> Planned:
    tilt_deg, distance_m, thickness_m = options.tilt_deg, options.distance_m, options.thickness_m
    if options.plane is None:
        if tilt_deg is None or distance_m is None:
            raise CommandError("--tilt-deg and --distance-m must both be given, or --plane instead of them")
        return plan_on_hardware(rig, tilt_deg, distance_m, thickness_m)
    if tilt_deg is not None or distance_m is not None:
        raise CommandError("--plane stands instead of --tilt-deg and --distance-m: give one or the other")
    a, b, c, d = options.plane
    length = math.hypot(a, b, c)
    if not 0 < length < math.inf:
        raise CommandError(f"--plane: {a:g},{b:g},{c:g},{d:g} must have a direction, its first three numbers not all 0")
    if b == c == 0:
        raise CommandError(f"--plane: {a:g},{b:g},{c:g},{d:g} faces exactly sideways: B and C must not both be 0")
    normal = (a / length, b / length, c / length)
    # The plane is given from the camera's centre, the model from the middle between the two.
    offset_m = float(np.dot(normal, rig.camera_centre_m)) - d / length
    return plan_plane_on_hardware(rig, normal, offset_m, thickness_m)


def _offset_us(options: Namespace, rig: Rig, planned: Planned) -> float | None:
    """What to write into the rig file, where the delay that lights the wanted plane is told."""
    if options.found_delay_us is None:
        return None
    if options.distance_m is None:
        raise CommandError("--found-delay-us goes with --tilt-deg and --distance-m of the target, not with --plane")
    return delay_offset_us(rig, planned.applied.line_time_us, options.distance_m, options.found_delay_us)


def asked_gate(options: Namespace, rig: Rig) -> GateSettings:
    """The gate that the options name, unrounded."""
    line = rig.camera.shutter.line
    line_time_us = options.line_time_us
    if line_time_us is None:
        if isinstance(line, LineTimes):
            raise CommandError("--clock-mhz: the camera of this rig has no pixel clock, give --line-time-us instead")
        line_time_us = line.line_time_us(options.clock_mhz)
        if not MIN_LINE_TIME_US <= line_time_us <= MAX_LINE_TIME_US:
            raise CommandError(
                f"--clock-mhz: {options.clock_mhz:g} MHz makes a line of {line_time_us:g} us, and it must be from "
                f"{MIN_LINE_TIME_US:g} to {MAX_LINE_TIME_US:.0f} us"
            )
    return gate(line_time_us, options.delay_us, options.exposure_us)


def clock_mhz(rig: Rig, line_time_us: float) -> float | None:
    """The pixel clock of this line time; None for a camera that has none."""
    line = rig.camera.shutter.line
    return line.clock_mhz(line_time_us) if isinstance(line, PixelClocks) else None


def hardware_warnings(rig: Rig, settings: GateSettings) -> list[str]:
    """What the camera would round. The commands compute what was asked, and say so."""
    period = rig.projector.period_us
    real = quantise(rig.camera.shutter, settings, period)
    found = []
    if not math.isclose(real.line_time_us, settings.line_time_us, rel_tol=_SAME):
        clock, nearest = clock_mhz(rig, settings.line_time_us), clock_mhz(rig, real.line_time_us)
        if clock is None:
            name, offer = f"line time {settings.line_time_us:g} us", f"{real.line_time_us:g} us"
        else:
            name, offer = f"pixel clock {clock:g} MHz", f"{nearest:g} MHz"
        found.append(f"the camera has no {name} (nearest: {offer}); computed as asked")
    moved = math.remainder(real.delay_us - settings.delay_us, period)
    delays = rig.camera.shutter.delay_us
    if not delays.min <= settings.delay_us <= delays.max:
        found.append(
            f"the delay of {settings.delay_us:.7g} us is beyond the camera's range of {delays.min:g} to {delays.max:g} "
            f"us: it would get {real.delay_us:g} us, which is the same gate"
            + (f" to {abs(moved):.2g} us" if abs(moved) > 1e-6 else "")
            + f", for delays count modulo the projector's period of {period:g} us; computed as asked"
        )
    elif abs(moved) > 1e-6:
        found.append(f"the camera would round the delay by {moved:+.4g} us to {real.delay_us:g} us; computed as asked")
    if abs(real.exposure_us - settings.exposure_us) > 1e-6:
        found.append(
            f"the camera would make the exposure {real.exposure_us:g} us instead of {settings.exposure_us:g} us; "
            "computed as asked"
        )
    return found


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
    }


def _plane_values(plane: Plane) -> dict[str, Any]:
    return {"A": plane.A, "normal": plane.normal, "offset_m": plane.offset_m}


def _settings_values(rig: Rig, settings: GateSettings) -> dict[str, Any]:
    return {
        "clock_mhz": clock_mhz(rig, settings.line_time_us),
        "line_time_us": settings.line_time_us,
        "delay_us": settings.delay_us,
        "exposure_us": settings.exposure_us,
    }


def _plan_values(rig: Rig, planned: Planned) -> dict[str, Any]:
    got = planned.slab
    return _settings_values(rig, planned.applied) | {
        "exact": _settings_values(rig, planned.exact),
        "achieved": {"tilt_deg": got.tilt_deg, "distance_m": got.distance_m, "thickness_m": got.thickness_m},
        "residual": {
            "tilt_deg": planned.residual_tilt_deg,
            "distance_m": planned.residual_distance_m,
            "thickness_m": planned.residual_thickness_m,
        },
    }


def _plan_warnings(rig: Rig, planned: Planned) -> list[str]:
    """Wishes that lie beyond the ends of what the camera accepts."""
    limits, exact = rig.camera.shutter, planned.exact
    found = []
    if isinstance(limits.line, PixelClocks):
        low, high = limits.line.ladder_mhz[0], limits.line.ladder_mhz[-1]
        wanted, unit = limits.line.clock_mhz(exact.line_time_us), "MHz"
    else:
        low, high, wanted, unit = limits.line.min_us, limits.line.max_us, exact.line_time_us, "us a line"
    if not low * (1 - _SAME) <= wanted <= high * (1 + _SAME):
        found.append(f"this tilt needs {wanted:g} {unit} and the camera has {low:g} to {high:g}: see the residual")
    low, high = limits.exposure_us.min, limits.exposure_us.max
    if not low <= exact.exposure_us <= high:
        found.append(
            f"this thickness needs an exposure of {exact.exposure_us:g} us and the camera has {low:g} to {high:g} us: "
            "see the residual"
        )
    return found


def _sideways(options: Namespace) -> list[str]:
    """How far to the sides a plane stays within half the thickness of a slab that cannot lean as it does."""
    if options.plane is None:
        return []
    a, b, c, _ = options.plane
    lean = math.asin(min(abs(a) / math.hypot(a, b, c), 1.0))
    if lean < math.radians(0.5):
        return []
    within_m = options.thickness_m / 2 / math.sin(lean)
    return [
        f"the plane leans sideways by {math.degrees(lean):.1f} degrees, which no gate can follow: a slab this thin "
        f"holds it up to {within_m:.2g} m left and right of the middle"
    ]


def _heading(rig: Rig, settings: GateSettings) -> str:
    clock = clock_mhz(rig, settings.line_time_us)
    speed = f"{clock:g} MHz" if clock is not None else f"{settings.line_time_us:g} us a line"
    times = f"delay {settings.delay_us:g} us, exposure {settings.exposure_us:g} us"
    return f"Gate on {rig.name or 'this rig'}: {speed}, {times}"


def _slab_rows(found: Slab) -> list[tuple[str, float | str | None, str, str]]:
    whole = sum(window == found.windows_us[0] for window in found.windows_us)
    shown = found.windows_us if whole == 1 else found.windows_us[whole:]
    windows = ([f"{whole} periods"] if whole > 1 else []) + [f"{start:.1f} to {end:.1f}" for start, end in shown]
    return [
        ("tilt", found.tilt_deg, "deg", "positive: the top leans away from the rig"),
        ("distance", found.distance_m, "m", "to the centre plane, on the axis"),
        ("near", found.near_m, "m", ""),
        ("far", found.far_m, "m", "the slab never ends" if found.far_m is None else ""),
        ("thickness", found.thickness_m, "m", "far minus near"),
        (
            "hinge height",
            None if found.hinge_y_m is None else -found.hinge_y_m,
            "m",
            "upright planes never meet" if found.hinge_y_m is None else "all planes of this clock meet there",
        ),
        ("line time", found.line_time_us, "us", "from one camera row to the next"),
        ("B", found.B, "", "projector rows per camera row; 1 is upright"),
        ("exposed", " + ".join(windows), "us", "row 0, modulo the projector's period"),
    ]


def _plan_rows(rig: Rig, planned: Planned) -> list[tuple[str, float | str | None, str, str]]:
    exact, applied, got = planned.exact, planned.applied, planned.slab
    clock, exact_clock = clock_mhz(rig, applied.line_time_us), clock_mhz(rig, exact.line_time_us)

    def off(residual: float | None, unit: str) -> str:
        if residual is None:
            return ""
        form = "+.4f" if abs(residual) < 1e9 else "+.6g"
        return f"{residual:{form}} {unit} from what was asked"

    return [
        ("pixel clock", clock, "MHz", "" if exact_clock is None else f"exact {exact_clock:.4f}"),
        ("line time", applied.line_time_us, "us", f"exact {exact.line_time_us:.4f}"),
        ("delay", float(applied.delay_us), "us", f"exact {exact.delay_us:.4f}"),
        ("exposure", applied.exposure_us, "us", f"exact {exact.exposure_us:.4f}"),
        ("tilt", got.tilt_deg, "deg", off(planned.residual_tilt_deg, "deg")),
        ("distance", got.distance_m, "m", off(planned.residual_distance_m, "m")),
        ("thickness", got.thickness_m, "m", off(planned.residual_thickness_m, "m")),
    ]
