"""The options of `slopegate capture` and `slopegate export`."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError
from pathlib import Path
from typing import Any

from slopegate.app.commands.numbers import is_number, metres, number, positive, whole
from slopegate.core.rig.settings import MAX_LINE_TIME_US, MAX_TIME_US, MIN_LINE_TIME_US
from slopegate.drivers.captures.export import FORMATS
from slopegate.drivers.captures.limits import MAX_FRAMES, MAX_SLICES

MAX_WAIT_S = 1e6
BOARD_SETTINGS = ("output", "width_us", "inverted", "trigger_rising", "trigger_level_v", "dialect", "baud")


def add_capture(commands: Any) -> None:
    """`slopegate capture`."""
    parser = commands.add_parser(
        "capture",
        help="record a scene, or what a camera sees, slice by slice into a folder",
        description="Records slice by slice: a scene on the virtual bench, or what a camera sees that the projector\n"
        "triggers. Each slice is on the disk before the next begins; --resume goes on where a capture stopped. Of a\n"
        "scene the slices cover all that the projector lights, unless a range is given; how far a camera sees is not\n"
        "known, so it needs a range or a list of delays. A camera that vanishes ends the capture; what it took stays.",
        epilog="examples:\n  slopegate capture three_targets --out my_capture\n"
        "  slopegate capture table --near-m 0.6 --far-m 1.4 --count 8 --frames 4 --dark --out my_capture\n"
        "  slopegate capture table --out my_capture --resume\n"
        "  slopegate capture --camera ueye:4103123456 --rig R.toml --near-m 0.6 --far-m 1.4 --out my_capture",
    )
    parser.add_argument(
        "scene", metavar="SCENE", nargs="?", help="what to record (see 'slopegate scenes' and 'render')"
    )
    _add_camera(parser)
    _add_slices(parser)
    parser.add_argument("--frames", type=whole(1, MAX_FRAMES), metavar="N", help="frames to average for each slice (1)")
    parser.add_argument(
        "--dark",
        action="store_true",
        help="take a dark frame first, with the lens covered; on a camera by you, who are asked to and press Enter",
    )
    parser.add_argument(
        "--skip-empty",
        action="store_true",
        help="look through several slices at once first and leave out those without light (takes a dark frame)",
    )
    parser.add_argument("--no-noise", action="store_false", dest="noise", help="of a scene: a camera without noise")
    parser.add_argument(
        "--seed", type=whole(0, 2**63 - 1), metavar="N", help="which noise: the same number, the same frames (0)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the capture's own folder")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="take what is missing from the capture in DIR, with the same scene or camera, rig and board",
    )
    parser.add_argument("--rig", type=Path, metavar="R.toml", help="another rig than the default one (a TOML file)")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
    parser.set_defaults(run=("commands.capture", "run_capture"))


def _add_camera(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--camera",
        metavar="FAMILY:WHERE",
        help="instead of a SCENE: record what this camera sees (see 'slopegate devices'); --rig must describe it",
    )
    parser.add_argument(
        "--pixel-format",
        metavar="NAME",
        help="with --camera: such as Mono12p, by the camera's own name (default: 12 bits, or what is nearest)",
    )
    parser.add_argument(
        "--wait-s",
        type=positive(MAX_WAIT_S),
        metavar="S",
        help="with --camera: stop after so long without a frame (10); a camera that is back by then goes on",
    )
    parser.add_argument(
        "--board",
        metavar="serial:PORT",
        help="with --camera: let the sync board or delay generator at this serial port make the delay",
    )
    parser.add_argument(
        "--board-settings",
        type=_board_settings,
        metavar="NAME=VALUE,...",
        help=f"of the board's pulses: {', '.join(BOARD_SETTINGS[:5])}; or dialect and baud, which are found by asking",
    )


def _add_slices(parser: ArgumentParser) -> None:
    speed = parser.add_mutually_exclusive_group()
    speed.add_argument(
        "--clock-mhz", type=positive(1e6), metavar="C", help="pixel clock: the tilt of every slice (default: upright)"
    )
    speed.add_argument(
        "--line-time-us",
        type=number(
            MIN_LINE_TIME_US, MAX_LINE_TIME_US, f"a number from {MIN_LINE_TIME_US:g} to {MAX_LINE_TIME_US:.0f}"
        ),
        metavar="L",
        help="instead of the clock: microseconds from one camera row to the next",
    )
    parser.add_argument("--near-m", type=metres(), metavar="Z", help="where the slices begin, straight ahead")
    parser.add_argument("--far-m", type=_far, metavar="Z", help="where they end; inf for infinity")
    parser.add_argument(
        "--count",
        type=whole(1, MAX_SLICES),
        metavar="N",
        help="how many (16, or as many as the camera's exposure lets)",
    )
    parser.add_argument(
        "--spacing",
        choices=("delay", "depth"),
        help="slices equally long in delay (the default) or equally thick in depth",
    )
    parser.add_argument(
        "--delays-us",
        type=_delays,
        metavar="D,D,...",
        help="instead of a range: one slice per delay, with --exposure-us; they need not meet",
    )
    parser.add_argument("--exposure-us", type=positive(MAX_TIME_US), metavar="E", help="exposure of --delays-us")


def add_export(commands: Any) -> None:
    """`slopegate export`."""
    parser = commands.add_parser(
        "export",
        help="a capture in the formats of other programs",
        description="Writes a capture in the format of other programs:\n"
        + "\n".join(f"  {name:<9} {item.what}" for name, item in FORMATS.items()),
        epilog="example:\n  slopegate export my_capture --format ome-tiff --out slices.ome.tif",
    )
    able = " and ".join(name for name, item in FORMATS.items() if item.subtracts_dark)
    parser.add_argument("capture", type=Path, metavar="IN", help="the folder of a capture")
    parser.add_argument("--format", choices=FORMATS, required=True, help="what to write")
    parser.add_argument("--out", type=Path, required=True, metavar="OUT", help="the file, or the new folder")
    parser.add_argument("--subtract-dark", action="store_true", help=f"{able}: subtract the dark frame")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
    parser.set_defaults(run=("commands.export", "run_export"))


def _far(text: str) -> float:
    return float("inf") if text.strip().lower() in ("inf", "infinity") else metres()(text)


def _board_settings(text: str) -> dict[str, str]:
    found = {}
    for part in text.split(","):
        name, equals, value = (word.strip() for word in part.partition("="))
        if name not in BOARD_SETTINGS or not (equals and value):
            raise ArgumentTypeError(f"{part!r} must be NAME=VALUE with one of the names {', '.join(BOARD_SETTINGS)}")
        found[name] = value
    return found


def _delays(text: str) -> tuple[float, ...]:
    parts = text.split(",")
    if len(parts) > MAX_SLICES:
        raise ArgumentTypeError(f"{len(parts)} delays are too many: there must be at most {MAX_SLICES}")
    for part in parts:
        if not (is_number(part) and abs(float(part)) <= MAX_TIME_US):
            raise ArgumentTypeError(
                f"{part!r} must be a number from {-MAX_TIME_US:.0f} to {MAX_TIME_US:.0f}, with commas in between"
            )
    return tuple(map(float, parts))
