"""`slopegate plan`: the settings that give a wanted slab."""

from __future__ import annotations

import math
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from typing import Any

from slopegate.app.commands.options import add_camera_of, add_rig, describe, is_number, metres, number
from slopegate.app.commands.report import (
    SAME,
    CommandError,
    Row,
    print_json,
    print_table,
    print_warnings,
    settings_values,
)
from slopegate.app.commands.slab import rig_of
from slopegate.app.rig_gates import OpenRig
from slopegate.core.gating.plan import Planned
from slopegate.core.rig.axis import delay_offset_us
from slopegate.core.rig.settings import MAX_TIME_US, PixelClocks


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="The settings that give a wanted slab, rounded to what the camera accepts,\n"
        "and what the rounding costs.",
        epilog="examples:\n  slopegate plan --tilt-deg 15 --distance-m 1.05 --thickness-m 0.1\n"
        "  slopegate plan --plane=0,-0.82,-0.57,0.46 --thickness-m 0.02 --scene my_capture",
    )
    tilt = number(-90.0, 90.0, "a number between -90 and 90")
    parser.add_argument(
        "--tilt-deg", type=tilt, metavar="T", help="tilt in degrees: 0 upright, positive with the top leaning away"
    )
    parser.add_argument(
        "--distance-m",
        type=metres(),
        metavar="Z",
        help="distance to the middle of the slab, in metres, straight ahead",
    )
    parser.add_argument(
        "--plane",
        type=_plane,
        metavar="A,B,C,D",
        help="instead of tilt and distance: the plane A x + B y + C z + D = 0 in metres from the camera (x right, "
        "y down, z forward), as fitted to a measured scene",
    )
    parser.add_argument(
        "--thickness-m",
        type=metres(),
        required=True,
        metavar="H",
        help="thickness in metres, straight ahead; with --plane, across the plane",
    )
    parser.add_argument(
        "--found-delay-us",
        type=number(-MAX_TIME_US, MAX_TIME_US, "a delay within a second"),
        metavar="D",
        help="the delay at which a flat target there lit up on the real rig: prints the rig file's delay_offset_us too",
    )
    add_camera_of(parser)
    add_rig(parser)


def run(options: Namespace) -> int:
    """Print the settings for a wanted slab."""
    rig = rig_of(options)
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


def _planned(options: Namespace, rig: OpenRig) -> Planned:
    tilt_deg, distance_m = options.tilt_deg, options.distance_m
    if options.plane is None:
        if tilt_deg is None or distance_m is None:
            raise CommandError("--tilt-deg and --distance-m must both be given, or --plane instead of them")
        return rig.plan(tilt_deg, distance_m, options.thickness_m)
    if tilt_deg is not None or distance_m is not None:
        raise CommandError("--plane stands instead of --tilt-deg and --distance-m: give one or the other")
    return rig.plan_plane(options.plane, options.thickness_m)


def _offset_us(options: Namespace, rig: OpenRig, planned: Planned) -> float | None:
    """What to write into the rig file, where the delay that lights the wanted plane is told."""
    if options.found_delay_us is None:
        return None
    if options.distance_m is None:
        raise CommandError("--found-delay-us goes with --tilt-deg and --distance-m of the target, not with --plane")
    return delay_offset_us(rig.rig, planned.applied.line_time_us, options.distance_m, options.found_delay_us)


def _plan_values(rig: OpenRig, planned: Planned) -> dict[str, Any]:
    got = planned.slab
    return settings_values(rig, planned.applied) | {
        "exact": settings_values(rig, planned.exact),
        "achieved": {"tilt_deg": got.tilt_deg, "distance_m": got.distance_m, "thickness_m": got.thickness_m},
        "residual": {
            "tilt_deg": planned.residual_tilt_deg,
            "distance_m": planned.residual_distance_m,
            "thickness_m": planned.residual_thickness_m,
        },
    }


def _plan_warnings(rig: OpenRig, planned: Planned) -> list[str]:
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


def _plan_rows(rig: OpenRig, planned: Planned) -> list[Row]:
    exact, applied, got = planned.exact, planned.applied, planned.slab
    clock, exact_clock = rig.clock_mhz(applied), rig.clock_mhz(exact)

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


def _plane(text: str) -> tuple[float, float, float, float]:
    """Four coefficients with commas between them."""
    parts = text.split(",")
    if len(parts) != 4 or not all(is_number(part) and math.isfinite(float(part)) for part in parts):
        raise ArgumentTypeError(f"{text!r} must be four finite numbers with commas between them")
    a, b, c, d = map(float, parts)
    return a, b, c, d
