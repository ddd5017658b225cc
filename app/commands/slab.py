"""`slopegate slab`: where the slab of given settings lies."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any, Final

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

BEND_DEPTHS: Final = (0.5, 2.0)
"""Between which shares of its distance a slab's bend is told: where no scene says what depths matter."""


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Where the slab of given settings lies: tilt, distance, thickness and planes, straight ahead;\n"
        "of a rig that is turned or whose lenses distort also how the slab is turned to the side and bent.\n"
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
    shape = _shape(rig, settings, found)
    if options.json:
        print_json(slab_values(found) | shape | {"warnings": warnings})
        return 0
    print(_heading(rig, settings))
    rows = _rows(found)
    print_table([*rows[:1], *_shape_rows(found, shape), *rows[1:]] if shape else rows)
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


def _shape(rig: OpenRig, settings: GateSettings, found: Slab) -> dict[str, Any]:
    """What a slab is besides a plane that faces ahead: nothing of an ideal rig, whose slabs all are that.

    bend_m is None where the slab is not seen between the depths beside it.
    """
    if rig.rig.is_ideal:
        return {}
    from slopegate.core.gating.slab_mesh import bend_m

    depths_m = None if found.distance_m is None else [share * found.distance_m for share in BEND_DEPTHS]
    bend = None if depths_m is None else bend_m(rig.rig, settings, *depths_m)
    return {"turn_deg": found.turn_deg, "bend_m": bend, "bend_depths_m": depths_m}


def _shape_rows(found: Slab, shape: dict[str, Any]) -> list[Row]:
    depths_m = shape["bend_depths_m"]
    between = "" if depths_m is None else f" between {depths_m[0]:.3g} and {depths_m[1]:.3g} m"
    return [
        ("turned", with_error(found.turn_deg, found.error("turn_deg")), "deg", "positive: its right side is nearer"),
        ("bend", shape["bend_m"], "m", f"how far it leaves its plane, at most, in the picture{between}"),
    ]


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
