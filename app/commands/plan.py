"""`slopegate plan`: the settings that give a wanted slab."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any

from slopegate.app.commands.options import add_camera_of, add_rig, add_slab, describe, number, planned_slab
from slopegate.app.commands.report import (
    CommandError,
    Row,
    error_values,
    plan_warnings,
    print_json,
    print_table,
    print_warnings,
    settings_values,
    sideways,
    with_error,
)
from slopegate.app.commands.slab import rig_of
from slopegate.app.rig_gates import OpenRig
from slopegate.core.gating.plan import Planned
from slopegate.core.rig.axis import delay_offset_us
from slopegate.core.rig.settings import MAX_TIME_US


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="The settings that give a wanted slab, rounded to what the camera accepts,\n"
        "and what the rounding costs.",
        epilog="examples:\n  slopegate plan --tilt-deg 15 --distance-m 1.05 --thickness-m 0.1\n"
        "  slopegate plan --plane=0,-0.82,-0.57,0.46 --thickness-m 0.02 --scene my_capture",
    )
    add_slab(parser, required=True)
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
    planned = planned_slab(options, rig, options.thickness_m)
    warnings = [*plan_warnings(rig, planned), *sideways(options.plane, options.thickness_m), *planned.slab.warnings]
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
        "achieved": {
            "tilt_deg": got.tilt_deg,
            "distance_m": got.distance_m,
            "thickness_m": got.thickness_m,
            **error_values(got),
        },
        "residual": {
            "tilt_deg": planned.residual_tilt_deg,
            "distance_m": planned.residual_distance_m,
            "thickness_m": planned.residual_thickness_m,
        },
    }


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
        ("tilt", with_error(got.tilt_deg, got.error("tilt_deg")), "deg", off(planned.residual_tilt_deg, "deg")),
        (
            "distance",
            with_error(got.distance_m, got.error("distance_m")),
            "m",
            off(planned.residual_distance_m, "m"),
        ),
        (
            "thickness",
            with_error(got.thickness_m, got.error("thickness_m")),
            "m",
            off(planned.residual_thickness_m, "m"),
        ),
    ]
