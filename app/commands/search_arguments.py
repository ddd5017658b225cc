"""The options of `slopegate search`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

from slopegate.app.commands.numbers import whole
from slopegate.core.search.state import DEFAULT_FRAMES, Method

MAX_FRAMES = 10_000


def add_search(commands: Any) -> None:
    """`slopegate search`."""
    parser = commands.add_parser(
        "search",
        help="the gate that shows a target, found from images alone",
        description="Finds the gate that shows a target, by what a camera sees of it: on the virtual bench, which\n"
        "never tells the search where anything is. Exit code 0 when it was found, 1 when not (with the reason).",
        epilog="examples:\n  slopegate search three_targets --target 120 220 530 820\n"
        "  slopegate search spot --method paper --json",
    )
    parser.add_argument("scene", metavar="SCENE", help="what to look at (see 'slopegate scenes' and 'render')")
    parser.add_argument(
        "--target",
        type=whole(0, 100_000),
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="the rectangle that shows the target: columns X0 to X1 and rows Y0 to Y1 of the image, in pixels, without "
        "X1 and Y1 themselves (default: the whole image)",
    )
    parser.add_argument(
        "--method",
        choices=get_args(Method),
        default="fast",
        help="fast (the default) cuts the scene and computes the gate; paper moves clock, delay and exposure in steps",
    )
    noise = parser.add_mutually_exclusive_group()
    noise.add_argument("--noise", action="store_true", help="with the camera's shot and read noise (the default)")
    noise.add_argument("--no-noise", action="store_false", dest="noise", help="a camera without noise")
    parser.set_defaults(noise=True)
    parser.add_argument(
        "--seed", type=whole(0, 2**63 - 1), default=0, metavar="N", help="the same number, the same search (0)"
    )
    limits = ", ".join(f"{frames} for {method}" for method, frames in DEFAULT_FRAMES.items())
    parser.add_argument(
        "--max-frames", type=whole(1, MAX_FRAMES), metavar="N", help=f"give up after so many frames ({limits})"
    )
    parser.add_argument("--rig", type=Path, metavar="R.toml", help="another rig than the default one (a TOML file)")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
    parser.set_defaults(run=("commands.search", "run_search_command"))
