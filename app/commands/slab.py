"""`slopegate slab`: where the slab of given settings lies."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from slopegate.app.commands.options import add_camera_of, add_rig, add_settings, describe
from slopegate.app.commands.report import (
    Row,
    hardware_warnings,
    print_json,
    print_table,
    print_warnings,
    slab_values,
    with_error,
)
from slopegate.app.rig_gates import OpenRig, open_rig
from slopegate.core.gating.gate import Slab
from slopegate.core.rig.settings import GateSettings


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Where the slab of given settings lies: tilt, distance, thickness and planes, straight ahead.\n"
        "Numbers are used as given, never rounded; a warning says what the camera would round.",
        epilog="example:\n  slopegate slab --clock-mhz 76 --delay-us 1853 --exposure-us 400",
    )
    add_settings(parser, required=True)
    add_camera_of(parser)
    add_rig(parser)


def run(options: Namespace) -> int:
    """Print the read-outs of a gate."""
    rig = rig_of(options)
    settings = rig.gate(
        delay_us=options.delay_us,
        exposure_us=options.exposure_us,
        clock_mhz=options.clock_mhz,
        line_time_us=options.line_time_us,
    )
    found = rig.slab(settings)
    warnings = [*hardware_warnings(rig, settings), *found.warnings]
    if options.json:
        print_json(slab_values(found) | {"warnings": warnings})
        return 0
    print(_heading(rig, settings))
    print_table(_rows(found))
    print_warnings(warnings)
    return 0


def rig_of(options: Namespace) -> OpenRig:
    """The rig, with the camera of the scene where that brings one."""
    if options.scene is None:
        return open_rig(options.rig)
    # Late: reading scenes loads numba, which figures alone do not need.
    from slopegate.app.commands.opening import opened

    return opened(options)


def _heading(rig: OpenRig, settings: GateSettings) -> str:
    clock = rig.clock_mhz(settings)
    speed = f"{clock:g} MHz" if clock is not None else f"{settings.line_time_us:g} us a line"
    times = f"delay {settings.delay_us:g} us, exposure {settings.exposure_us:g} us"
    return f"Gate on {rig.name or 'this rig'}: {speed}, {times}"


def _rows(found: Slab) -> list[Row]:
    whole = sum(window == found.windows_us[0] for window in found.windows_us)
    shown = found.windows_us if whole == 1 else found.windows_us[whole:]
    windows = ([f"{whole} periods"] if whole > 1 else []) + [f"{start:.1f} to {end:.1f}" for start, end in shown]

    def told(name: str) -> float | str | None:
        return with_error(getattr(found, name), found.error(name))

    return [
        ("tilt", told("tilt_deg"), "deg", "positive: the top leans away from the rig"),
        ("distance", told("distance_m"), "m", "to the centre plane, on the axis"),
        ("near", told("near_m"), "m", ""),
        ("far", told("far_m"), "m", "the slab never ends" if found.far_m is None else ""),
        ("thickness", told("thickness_m"), "m", "far minus near"),
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
