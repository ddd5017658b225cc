"""Options that several commands share, and numbers as options take them."""

from __future__ import annotations

import math
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from slopegate.core.light.part import PARTS, PartName
from slopegate.core.rig.settings import MAX_LINE_TIME_US, MAX_TIME_US, MIN_LINE_TIME_US, GateSettings

if TYPE_CHECKING:
    from argparse import _ActionsContainer

    from slopegate.app.rig_gates import OpenRig

MIN_METRES, MAX_METRES = 1e-6, 1e6
NO_SKIP = "leave nothing out: cast every ray, look at every pixel; slower, and the same picture"


def is_number(text: str) -> bool:
    """Whether Python reads this text as a number, NaN and infinity included."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def number(low: float, high: float, allowed: str, above: bool = False) -> Callable[[str], float]:
    """A finite number from `low` to `high`, above `low` where so told."""

    def parse(text: str) -> float:
        if not is_number(text):
            raise ArgumentTypeError(f"{text!r} is not a number")
        value = float(text)
        if not math.isfinite(value) or not low <= value <= high or (above and value == low):
            raise ArgumentTypeError(f"{text} must be {allowed}")
        return value

    return parse


def whole(low: int, high: int) -> Callable[[str], int]:
    """A whole number from `low` to `high`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise ArgumentTypeError(f"{text!r} is not a whole number") from None
        if not low <= value <= high:
            raise ArgumentTypeError(f"{text} must be a whole number from {low} to {high}")
        return value

    return parse


def positive(high: float) -> Callable[[str], float]:
    """A number above 0, at most `high`."""
    return number(0.0, high, f"a number above 0, at most {high:.0f}", above=True)


def metres() -> Callable[[str], float]:
    """A distance in metres."""
    return number(MIN_METRES, MAX_METRES, f"a number from {MIN_METRES:g} to {MAX_METRES:.0f}")


def far_metres(text: str) -> float:
    """A distance in metres, or infinity."""
    return math.inf if text.strip().lower() in ("inf", "infinity") else metres()(text)


def describe(parser: ArgumentParser, *, description: str, epilog: str) -> None:
    """What stands above and below the options in the command's help."""
    parser.description, parser.epilog = description, epilog


def add_json(parser: ArgumentParser) -> None:
    """`--json`."""
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")


def add_rig(parser: ArgumentParser) -> None:
    """`--rig` and `--json`."""
    parser.add_argument(
        "--rig",
        type=Path,
        metavar="RIG",
        help="another rig than the default one: a rig file (.toml), or beside, which ships: the projector beside the "
        "camera, so that gates select epipolar light and no distance",
    )
    add_json(parser)


def add_scene(parser: ArgumentParser) -> None:
    """The scene that a command looks at."""
    parser.add_argument("scene", metavar="SCENE", help="what to look at (see 'slopegate scenes' and 'render')")


def add_camera_of(parser: ArgumentParser) -> None:
    """The scene whose camera counts."""
    parser.add_argument(
        "--scene",
        metavar="SCENE",
        help="the scene to render later: a folder with photo and depth brings its own camera, which moves the delay",
    )


def add_rectangle(container: _ActionsContainer, name: str, what: str, required: bool = False) -> None:
    """Four whole numbers that are a rectangle of the image; `what` begins its help."""
    container.add_argument(
        name,
        type=whole(0, 100_000),
        nargs=4,
        required=required,
        metavar=("X0", "Y0", "X1", "Y1"),
        help=f"{what}columns X0 to X1 and rows Y0 to Y1 of the image, in pixels, without X1 and Y1 themselves",
    )


def add_noise(parser: ArgumentParser, usual: bool) -> None:
    """`--noise`, `--no-noise` and `--seed`."""
    noise = parser.add_mutually_exclusive_group()
    with_it, without = (" (the default)", "") if usual else ("", " (the default)")
    noise.add_argument("--noise", action="store_true", help=f"with the camera's shot and read noise{with_it}")
    noise.add_argument("--no-noise", action="store_false", dest="noise", help=f"without noise{without}")
    parser.set_defaults(noise=usual)
    parser.add_argument(
        "--seed",
        type=whole(0, 2**63 - 1),
        default=0,
        metavar="N",
        help="which noise: the same number, the same result (0)",
    )


def add_speed(parser: _ActionsContainer, required: bool, clock_help: str) -> None:
    """`--clock-mhz` and `--line-time-us`, of which one may be given."""
    allowed = f"a number from {MIN_LINE_TIME_US:g} to {MAX_LINE_TIME_US:.0f}"
    speed = parser.add_mutually_exclusive_group(required=required)
    speed.add_argument("--clock-mhz", type=positive(1e6), metavar="C", help=clock_help)
    speed.add_argument(
        "--line-time-us",
        type=number(MIN_LINE_TIME_US, MAX_LINE_TIME_US, allowed),
        metavar="L",
        help="instead of the clock: microseconds from one camera row to the next",
    )


def add_clock_and_delay(parser: ArgumentParser) -> None:
    """What sets a gate's tilt and distance."""
    add_speed(
        parser,
        True,
        "pixel clock in MHz: sets the tilt (78 stands upright on the default rig, lower leans back)",
    )
    parser.add_argument(
        "--delay-us",
        type=number(-MAX_TIME_US, MAX_TIME_US, f"a number from {-MAX_TIME_US:.0f} to {MAX_TIME_US:.0f}"),
        required=True,
        metavar="D",
        help="delay in microseconds, from the projector's start to the middle of the exposure of row 0: sets the "
        "distance (shorter is farther; may be negative)",
    )


def add_gate(parser: ArgumentParser) -> None:
    """The three numbers of a gate."""
    add_clock_and_delay(parser)
    parser.add_argument(
        "--exposure-us",
        type=positive(MAX_TIME_US),
        required=True,
        metavar="E",
        help="exposure of each row in microseconds: sets the thickness (longer is thicker)",
    )


def parts_list(text: str) -> frozenset[PartName]:
    """Names of parts of the light, separated by commas; `all` is every one of them."""
    if text == "all":
        return frozenset(PARTS)
    names = [name.strip() for name in text.split(",")]
    wrong = [name for name in names if name not in PARTS]
    if wrong:
        raise ArgumentTypeError(f"{wrong[0]!r} is no part of the light: it must be all, or some of {','.join(PARTS)}")
    return frozenset(name for name in PARTS if name in names)


def add_bake(parser: ArgumentParser) -> None:
    """How good the bake of the indirect light must be: `--paths` or `--error`."""
    good = parser.add_mutually_exclusive_group()
    good.add_argument(
        "--paths",
        type=whole(1, 1_000_000),
        metavar="N",
        help="paths of light followed for each cell of the indirect light's grid, instead of an error",
    )
    good.add_argument(
        "--error",
        dest="error_percent",
        type=number(0.01, 100.0, "a number from 0.01 to 100 (percent)"),
        metavar="PERCENT",
        help="noise of the indirect light over 4 x 4 pixels where a gate records everything twice, in percent of the "
        "mean of the image that records everything once (1); at most 2048 paths are followed for it",
    )


def add_parts(parser: ArgumentParser) -> None:
    """Which light counts: `--parts`, `--max-order` and the bake's options."""
    parser.add_argument(
        "--parts",
        type=parts_list,
        metavar="LIST",
        help=f"the light that counts: all, or some of {','.join(PARTS)}; the default is direct, ambient and what the "
        "scene holds: fog brings airlight, scatter and indirect, skin subsurface, indirect = true interreflection "
        "(the window calls scatter fog blur, subsurface under skin, and ambient room light)",
    )
    parser.add_argument(
        "--max-order",
        type=whole(1, 1000),
        metavar="N",
        help="only light that changed direction at most N times (1: direct and airlight); the default is all that "
        "matters",
    )
    add_bake(parser)


def asked_gate(options: Namespace, rig: OpenRig) -> GateSettings:
    """The gate of `add_gate`'s options, unrounded."""
    return rig.gate(
        delay_us=options.delay_us,
        exposure_us=options.exposure_us,
        clock_mhz=options.clock_mhz,
        line_time_us=options.line_time_us,
    )
