"""The options of every command, and what each number may be."""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

from slopegate.app.commands.bench_arguments import add_bench
from slopegate.app.commands.capture_arguments import add_capture, add_export
from slopegate.app.commands.device_arguments import add_devices, add_doctor
from slopegate.app.commands.mask_arguments import add_depth, add_mask
from slopegate.app.commands.numbers import MAX_SAMPLES, metres, number, plane, positive, whole
from slopegate.app.commands.report import CommandError
from slopegate.app.commands.search_arguments import add_search
from slopegate.core.rig.settings import MAX_LINE_TIME_US, MAX_TIME_US, MIN_LINE_TIME_US

_ABOUT = """\
Slope disparity gating: a projector that scans its rows and a rolling-shutter camera below it record only light from a
slab of space. Three numbers set the slab: the pixel clock its tilt, the delay its distance, the exposure its thickness.

Without a command the window opens.
"""

_EXAMPLES = """\
examples:
  slopegate                                      open the window
  slopegate --camera video:0 --free-running      open it on the first webcam
  slopegate plan --tilt-deg 15 --distance-m 1.05 --thickness-m 0.1
                                                 which settings light a slab leaning back by 15 degrees, 10 cm thick?
  slopegate slab --clock-mhz 78 --delay-us 2028 --exposure-us 400
                                                 where is the slab of these settings?
  slopegate scenes                               what is there to look at?

'slopegate COMMAND --help' explains every number. Errors are one sentence on standard error, with exit code 2.
"""


_NO_SKIP = "leave nothing out: cast every ray, look at every pixel; slower, and the same picture"


class _Parser(ArgumentParser):
    """Options are never abbreviated, and refusals are one sentence."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=RawDescriptionHelpFormatter, **keywords)

    def error(self, message: str) -> NoReturn:
        raise CommandError(f"{message} (see '{self.prog} --help')")


def command_parser() -> ArgumentParser:
    """The parser of `slopegate`; it raises CommandError and sets `run` to (module, function)."""
    parser = _Parser(prog="slopegate", description=_ABOUT, epilog=_EXAMPLES)
    parser.add_argument("--version", action="version", version=f"slopegate {version('slopegate')}")
    parser.add_argument(
        "--open", dest="window_scene", metavar="SCENE", help="show this scene in the window (see 'slopegate scenes')"
    )
    parser.add_argument(
        "--rig", dest="window_rig", type=Path, metavar="R.toml", help="open the window with this rig (a TOML file)"
    )
    parser.add_argument(
        "--camera",
        dest="window_camera",
        metavar="FAMILY:WHERE",
        help="stream from this camera in the window (see 'slopegate devices'); video:FILE plays a file or a folder",
    )
    parser.add_argument(
        "--faults",
        dest="window_faults",
        metavar="FAULTS",
        help="let the virtual camera imitate a faulty rig: trigger, link, plug, all, or numbers such as "
        "missed=0.05,jitter_us=150",
    )
    parser.add_argument(
        "--free-running",
        dest="window_free",
        action="store_true",
        help="with --camera: let it run by itself instead of waiting for the projector's sync signal",
    )
    parser.add_argument("--no-skip", dest="window_skip", action="store_false", help=f"in the window, {_NO_SKIP}")
    parser.set_defaults(run=("commands.window", "run_window"))
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    for add in (
        _add_slab,
        _add_plan,
        _add_render,
        add_capture,
        add_export,
        add_search,
        add_mask,
        add_depth,
        add_bench,
        _add_scenes,
        _add_demo,
        add_devices,
        add_doctor,
    ):
        add(commands)
    return parser


def _add_slab(commands: Any) -> None:
    parser = commands.add_parser(
        "slab",
        help="where the slab of given settings lies",
        description="Where the slab of given settings lies: tilt, distance, thickness and planes, straight ahead.\n"
        "Numbers are used as given, never rounded; a warning says what the camera would round.",
        epilog="example:\n  slopegate slab --clock-mhz 76 --delay-us 1853 --exposure-us 400",
    )
    _add_gate(parser)
    _add_camera_of(parser)
    _add_common(parser)
    parser.set_defaults(run=("commands.geometry", "run_slab"))


def _add_plan(commands: Any) -> None:
    parser = commands.add_parser(
        "plan",
        help="the settings that give a wanted slab",
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
        type=plane,
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
    _add_camera_of(parser)
    _add_common(parser)
    parser.set_defaults(run=("commands.geometry", "run_plan"))


def _add_render(commands: Any) -> None:
    parser = commands.add_parser(
        "render",
        help="one gated image of a scene, into files",
        description="One gated image of a scene. What the file holds follows its suffix:\n"
        "  .npy .exr   the light itself, float32: a gate of exactly one projector period is the fully lit image, and\n"
        "              a white frontal surface 1 m from the projector is 1; with --noise, counts as float32\n"
        "  .tif .png   counts of a 12-bit camera, 0 to 4095 as 16-bit integers, with the settings inside",
        epilog="example:\n"
        "  slopegate render three_targets --clock-mhz 76 --delay-us 1853 --exposure-us 400 --out gated.png",
    )
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help="a shipped scene (see 'slopegate scenes'), a scene file (.toml), a mesh (.obj .ply .stl .glb) or a folder "
        "with photo, depth and intrinsics",
    )
    _add_gate(parser)
    parser.add_argument("--complement", action="store_true", help="record everything but the slab")
    _add_picture(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the image: .npy, .exr, .tif or .png")
    parser.add_argument(
        "--mask-out",
        type=Path,
        metavar="FILE",
        help="a .png, 255 where the gate records light of the projector, else 0",
    )
    parser.add_argument(
        "--depth-out",
        type=Path,
        metavar="FILE",
        help="a .npy, metres from the camera along its axis, NaN where unknown",
    )
    _add_common(parser)
    parser.set_defaults(run=("commands.render", "run_render"))


def _add_picture(parser: ArgumentParser) -> None:
    noise = parser.add_mutually_exclusive_group()
    noise.add_argument("--noise", action="store_true", help="with the camera's shot and read noise")
    noise.add_argument("--no-noise", action="store_false", dest="noise", help="without noise (the default)")
    parser.set_defaults(noise=False)
    parser.add_argument(
        "--seed",
        type=whole(0, 2**63 - 1),
        default=0,
        metavar="N",
        help="which noise: the same number, the same image (0)",
    )
    parser.add_argument(
        "--samples",
        type=whole(1, MAX_SAMPLES),
        default=1,
        metavar="N",
        help=f"rays a pixel along each axis, 1 to {MAX_SAMPLES}; 1 (the default) looks at pixel centres only",
    )
    parser.add_argument("--colour", action="store_true", help="red, green and blue instead of one luminance channel")
    parser.add_argument(
        "--time-s",
        type=number(0.0, 1e6, "a number from 0 to 1e6"),
        default=0.0,
        metavar="S",
        help="the instant of a moving scene, in seconds (0)",
    )
    parser.add_argument("--no-skip", dest="skip", action="store_false", help=_NO_SKIP)


def _add_scenes(commands: Any) -> None:
    parser = commands.add_parser(
        "scenes",
        help="list the scenes that ship with the program",
        description="The scenes that ship with the program; 'render' takes the first word of a line as SCENE.",
        epilog="example:\n  slopegate scenes",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
    parser.set_defaults(run=("commands.scenes", "run_scenes"))


def _add_demo(commands: Any) -> None:
    parser = commands.add_parser(
        "demo",
        help="a tour of the window that leaves pictures",
        description="Opens the window, shows what it can do, and leaves screenshots and captured images in a folder:\n"
        "each image as a .tif of the sensor's counts with the settings inside, and as a .png to look at.",
        epilog="example:\n  slopegate demo --out demo-output",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("demo-output"), metavar="FOLDER", help="where the pictures go (demo-output)"
    )
    parser.set_defaults(run=("commands.window", "run_demo"))


def _add_gate(parser: ArgumentParser) -> None:
    speed = parser.add_mutually_exclusive_group(required=True)
    speed.add_argument(
        "--clock-mhz",
        type=positive(1e6),
        metavar="C",
        help="pixel clock in MHz: sets the tilt (78 stands upright on the default rig, lower leans back)",
    )
    speed.add_argument(
        "--line-time-us",
        type=number(
            MIN_LINE_TIME_US, MAX_LINE_TIME_US, f"a number above 0, from {MIN_LINE_TIME_US:g} to {MAX_LINE_TIME_US:.0f}"
        ),
        metavar="L",
        help="instead of the clock: microseconds from one camera row to the next",
    )
    parser.add_argument(
        "--delay-us",
        type=number(-MAX_TIME_US, MAX_TIME_US, f"a number from {-MAX_TIME_US:.0f} to {MAX_TIME_US:.0f}"),
        required=True,
        metavar="D",
        help="delay in microseconds, from the projector's start to the middle of the exposure of row 0: sets the "
        "distance (shorter is farther; may be negative)",
    )
    parser.add_argument(
        "--exposure-us",
        type=positive(MAX_TIME_US),
        required=True,
        metavar="E",
        help="exposure of each row in microseconds: sets the thickness (longer is thicker)",
    )


def _add_camera_of(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--scene",
        metavar="SCENE",
        help="the scene to render later: a folder with photo and depth brings its own camera, which moves the delay",
    )


def _add_common(parser: ArgumentParser) -> None:
    parser.add_argument("--rig", type=Path, metavar="R.toml", help="another rig than the default one (a TOML file)")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
