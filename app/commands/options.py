"""Options that several commands share, and numbers as options take them."""

from __future__ import annotations

import math
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.report import CommandError, plan_warnings, sideways
from slopegate.core.light.part import PARTS, PartName
from slopegate.core.rig.settings import MAX_LINE_TIME_US, MAX_TIME_US, MIN_LINE_TIME_US, GateSettings

if TYPE_CHECKING:
    from argparse import _ActionsContainer

    from slopegate.app.rig_gates import OpenRig
    from slopegate.core.gating.plan import Planned

MIN_METRES, MAX_METRES = 1e-6, 1e6
MAX_SETTLE_FRAMES = 60
MAX_TRANSFER_US = 1e7
MAX_SEED = 2**63 - 1
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
        allowed = f"a whole number from {low} to {high}"
        try:
            value = int(text)
        except ValueError:  # also for more digits than Python reads
            raise ArgumentTypeError(f"{text!r} must be {allowed}") from None
        if not low <= value <= high:
            raise ArgumentTypeError(f"{text} must be {allowed}")
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


def add_overwrite(parser: ArgumentParser) -> None:
    """`--overwrite`."""
    parser.add_argument("--overwrite", action="store_true", help="replace what is there; without it that is refused")


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


def add_screen(container: _ActionsContainer, when: str) -> None:
    """The screen that is a camera's projector: `--screen`, `--settle-frames`, `--transfer-us`; `when` it is covered."""
    container.add_argument(
        "--screen",
        metavar="NAME",
        help=f"the screen that is the projector, by the desktop's name such as HDMI-1: a window covers it {when}; a "
        "wrong name is answered with the screens that there are",
    )
    container.add_argument(
        "--settle-frames",
        type=whole(0, MAX_SETTLE_FRAMES),
        metavar="N",
        help="frames of the screen to wait until a pattern is certainly on the wall (2)",
    )
    container.add_argument(
        "--transfer-us",
        type=number(0.0, MAX_TRANSFER_US, f"a number from 0 to {MAX_TRANSFER_US:.0f}"),
        metavar="U",
        help="how long a frame may be on its way from the camera to this program (50000)",
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
        type=whole(0, MAX_SEED),
        default=0,
        metavar="N",
        help="which noise: the same number, the same result (0)",
    )


def add_scene_noise(parser: ArgumentParser) -> None:
    """`--no-noise` and `--seed` of commands that take a scene or a camera; None: no seed was given."""
    parser.add_argument("--no-noise", action="store_false", dest="noise", help="of a scene: a camera without noise")
    parser.add_argument(
        "--seed", type=whole(0, MAX_SEED), metavar="N", help="which noise: the same number, the same frames (0)"
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


def add_settings(container: _ActionsContainer, required: bool, exposure: bool = True) -> None:
    """A gate as the camera takes it; `exposure` False: without its exposure."""
    add_speed(
        container,
        required,
        "pixel clock in MHz: sets the tilt (78 stands upright on the default rig, lower leans back)",
    )
    container.add_argument(
        "--delay-us",
        type=number(-MAX_TIME_US, MAX_TIME_US, f"a number from {-MAX_TIME_US:.0f} to {MAX_TIME_US:.0f}"),
        required=required,
        metavar="D",
        help="delay in microseconds, from the projector's start to the middle of the exposure of row 0: sets the "
        "distance (shorter is farther; may be negative)",
    )
    if exposure:
        container.add_argument(
            "--exposure-us",
            type=positive(MAX_TIME_US),
            required=required,
            metavar="E",
            help="exposure of each row in microseconds: sets the thickness (longer is thicker)",
        )


def add_slab(container: _ActionsContainer, thickness: bool = True, required: bool = False) -> None:
    """A gate by where its slab lies; `thickness` False: without its thickness, which else may be `required`."""
    container.add_argument(
        "--tilt-deg",
        type=number(-90.0, 90.0, "a number between -90 and 90"),
        metavar="T",
        help="tilt in degrees: 0 upright, positive with the top leaning away",
    )
    container.add_argument(
        "--distance-m",
        type=metres(),
        metavar="Z",
        help="distance to the middle of the slab, in metres, straight ahead",
    )
    container.add_argument(
        "--plane",
        type=plane,
        metavar="A,B,C,D",
        help="instead of tilt and distance: the plane A x + B y + C z + D = 0 in metres from the camera (x right, "
        "y down, z forward), as fitted to a measured scene",
    )
    if thickness:
        container.add_argument(
            "--thickness-m",
            type=metres(),
            required=required,
            metavar="H",
            help="thickness in metres, straight ahead; with --plane, across the plane",
        )


def add_gate_name(container: _ActionsContainer) -> None:
    """`--gate`."""
    container.add_argument(
        "--gate",
        metavar="NAME",
        help="a gate of the scene or of your own by its name, as in the window; a wrong name is answered with a list",
    )


def add_gate(container: _ActionsContainer, exposure: bool = True) -> None:
    """A gate by its settings, its slab or its name; `exposure` False: without exposure and thickness."""
    add_settings(container, False, exposure)
    add_slab(container, exposure)
    add_gate_name(container)


@dataclass(frozen=True)
class AskedGate:
    """The gate that options ask for; with `complement` everything but it is wanted."""

    settings: GateSettings
    complement: bool = False
    warnings: tuple[str, ...] = ()
    """How the camera's gate differs from the slab that was asked for."""

    def sent(self, rig: OpenRig) -> GateSettings:
        """What the camera is told: the gate, or its complement, as it can make it."""
        return rig.rounded(rig.complement(self.settings) if self.complement else self.settings)


SPEED = ("clock_mhz", "line_time_us")
SLAB = ("tilt_deg", "distance_m", "plane", "thickness_m")
GATE = (*SPEED, "delay_us", "exposure_us", *SLAB, "gate")
"""Every option that says something of a gate, as argparse names it."""
_ANY_THICKNESS_M = 0.1


def asked_gate(options: Namespace, rig: OpenRig) -> AskedGate:
    """The gate of `add_gate`'s options: settings as they are given, slabs as the camera makes them.

    Where the command has no exposure, the gate has any. Raises CommandError for options that contradict each other,
    are too few, or name no gate.
    """
    exposure, slab = hasattr(options, "exposure_us"), given(options, SLAB)
    settings = given(options, (*SPEED, "delay_us", "exposure_us"))
    refuse_mixed(options, settings, slab)
    if options.gate is not None:
        return gate_named(options.gate, rig)
    if slab:
        return _slab_gate(options, rig, exposure)
    if len(settings) < 2 + exposure:
        ways = "--tilt-deg and --distance-m, --plane, or --gate"
        by_settings = "--clock-mhz and --delay-us"
        if exposure:
            by_settings = "--clock-mhz, --delay-us and --exposure-us"
            ways = "--tilt-deg, --distance-m and --thickness-m, --plane and --thickness-m, or --gate"
        alone = f"{' and '.join(map(flag, settings))} alone is no gate: " if settings else ""
        raise CommandError(f"{alone}give {by_settings}, or instead {ways}")
    return AskedGate(
        rig.gate(
            delay_us=options.delay_us,
            exposure_us=options.exposure_us if exposure else rig.everything_lit.exposure_us,
            clock_mhz=options.clock_mhz,
            line_time_us=options.line_time_us,
        )
    )


def _slab_gate(options: Namespace, rig: OpenRig, exposure: bool) -> AskedGate:
    if not exposure:
        planned = planned_slab(options, rig, _ANY_THICKNESS_M)
        return AskedGate(rig.rounded(planned.exact), warnings=tuple(sideways(options.plane, None)))
    if options.thickness_m is None:
        raise CommandError(f"{flag(given(options, SLAB)[0])} needs --thickness-m, too: the two ends of the slab")
    planned = planned_slab(options, rig, options.thickness_m)
    leaning = sideways(options.plane, options.thickness_m)
    return AskedGate(planned.applied, warnings=(*plan_warnings(rig, planned), *leaning))


@dataclass(frozen=True)
class Shape:
    """What all slices of a sweep have in common; None is left open."""

    clock_mhz: float | None
    line_time_us: float | None
    exposure_us: float | None = None
    """How long, and so how thick, a slice is at most."""

    @property
    def speed(self) -> dict[str, Any]:
        """The tilt, as the API takes it."""
        return {"clock_mhz": self.clock_mhz, "line_time_us": self.line_time_us}


def slices_shape(options: Namespace, rig: OpenRig) -> Shape:
    """Tilt and thickness of slices, of the options of `add_speed`, `add_slab` and `add_gate_name`.

    A slab without a thickness, and a clock, set the tilt alone. Raises CommandError as `asked_gate` does.
    """
    slab = given(options, SLAB)
    refuse_mixed(options, given(options, SPEED), slab)
    if options.gate is not None:
        named = gate_named(options.gate, rig).settings
        return Shape(None, named.line_time_us, named.exposure_us)
    if not slab:
        return Shape(options.clock_mhz, options.line_time_us)
    found = planned_slab(options, rig, options.thickness_m or _ANY_THICKNESS_M).applied
    return Shape(None, found.line_time_us, None if options.thickness_m is None else found.exposure_us)


def planned_slab(options: Namespace, rig: OpenRig, thickness_m: float) -> Planned:
    """The gate of `add_slab`'s options, exact and as the camera makes it. Raises CommandError where they are none."""
    tilt_deg, distance_m = options.tilt_deg, options.distance_m
    if options.plane is None:
        if tilt_deg is None or distance_m is None:
            raise CommandError("--tilt-deg and --distance-m must both be given, or --plane instead of them")
        return rig.plan(tilt_deg, distance_m, thickness_m)
    if tilt_deg is not None or distance_m is not None:
        raise CommandError("--plane stands instead of --tilt-deg and --distance-m: give one or the other")
    from slopegate.core.gating.plan import PlaneError  # numpy comes with it, which --help does without

    try:
        return rig.plan_plane(options.plane, thickness_m)
    except PlaneError as error:
        typed = ",".join(f"{one:.15g}" for one in options.plane)
        raise CommandError(f"--plane {typed}: it must be {error.allowed}") from None


def named_gates(rig: OpenRig) -> dict[str, AskedGate]:
    """The gates that `--gate` finds, by name: the scene's own, the user's own, and the one that lights everything."""
    from slopegate.app.session.my_gates import MyGates, my_gates_path

    mine, _ = MyGates(my_gates_path()).presets(rig.rig)
    found = {"Everything lit": AskedGate(rig.rounded(rig.everything_lit))}
    scene = getattr(rig, "scene", None)  # a rig alone has none
    own = () if scene is None else scene.gates
    return {preset.name: AskedGate(preset.settings, preset.complement) for preset in (*mine, *own)} | found


def gate_named(name: str, rig: OpenRig) -> AskedGate:
    """The gate of this name, however it is capitalised. Raises CommandError with the names that there are."""
    known = named_gates(rig)
    found = known.get(name) or {key.casefold(): gate for key, gate in known.items()}.get(name.strip().casefold())
    if found is None:
        raise CommandError(f"--gate: there is no gate {name!r}, only {', '.join(map(repr, known))}")
    return found


def given(options: Namespace, names: Sequence[str]) -> list[str]:
    """Those of these options that the command has and that were given."""
    return [name for name in names if getattr(options, name, None) is not None]


def flag(name: str) -> str:
    """The option as it is typed."""
    return f"--{name.replace('_', '-')}"


def refuse_mixed(options: Namespace, settings: Sequence[str], slab: Sequence[str]) -> None:
    """Raise CommandError where a gate is given in two ways; `settings`, `slab`: the options given of either."""
    ways = [flag(group[0]) for group in (settings, slab, given(options, ("gate",))) if group]
    if len(ways) > 1:
        raise CommandError(f"{ways[0]} and {ways[1]} contradict each other: give a gate in one way")


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


def plane(text: str) -> tuple[float, float, float, float]:
    """Four coefficients with commas between them."""
    parts = text.split(",")
    if len(parts) != 4 or not all(is_number(part) and math.isfinite(float(part)) for part in parts):
        raise ArgumentTypeError(f"{text!r} must be four finite numbers with commas between them")
    a, b, c, d = map(float, parts)
    return a, b, c, d
