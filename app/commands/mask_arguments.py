"""The options of `slopegate mask` and `slopegate depth`."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from slopegate.app.commands.numbers import MAX_METRES, number, whole

MAX_ROWS = 64.0
MAX_FRAMES = 1000


def add_mask(commands: Any) -> None:
    """`slopegate mask`."""
    parser = commands.add_parser(
        "mask",
        help="the gate that keeps or hides a region of the image",
        description="The gate, or the complement of one, that keeps or hides a region of the image best: the best\n"
        "delay and exposure of every pixel clock, and how well it does, predicted and counted in frames of the\n"
        "virtual camera. Exit code 0 when the overlap is good (0.5 or more), 1 when even the nearest gate's is not.",
        epilog="examples:\n  slopegate mask three_targets --region 120 220 530 820\n"
        "  slopegate mask table --region-png painted.png --hide --measured --json",
    )
    parser.add_argument("scene", metavar="SCENE", help="what to look at (see 'slopegate scenes' and 'render')")
    region = parser.add_mutually_exclusive_group(required=True)
    region.add_argument(
        "--region",
        type=whole(0, 100_000),
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="columns X0 to X1 and rows Y0 to Y1 of the image, in pixels, without X1 and Y1 themselves",
    )
    region.add_argument(
        "--region-png",
        type=Path,
        metavar="FILE",
        help="a picture of the image's size, grey or colour, white where the region is: any colour above half of the "
        "brightest; what is transparent is not of the region",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--keep", action="store_false", dest="hide", help="keep the region, mask the rest (the default)")
    what.add_argument("--hide", action="store_true", dest="hide", help="mask the region, keep the rest")
    parser.set_defaults(hide=False)
    parser.add_argument(
        "--measured", action="store_true", help="with depth from a sweep of the gate instead of the scene's own"
    )
    parser.add_argument(
        "--mask-out",
        type=Path,
        metavar="FILE",
        help="a .png, 255 where the gate records light of the projector, else 0",
    )
    _add_camera(parser)
    parser.set_defaults(run=("commands.mask", "run_mask"))


def add_depth(commands: Any) -> None:
    """`slopegate depth`."""
    parser = commands.add_parser(
        "depth",
        help="depth of every pixel, measured by moving the gate",
        description="Measures depth as a camera would: a coarse-to-fine sweep of the delay that leaves intervals\n"
        "without light alone. Says how many settings it took, what a plain sweep takes, and how far it is off.",
        epilog="examples:\n  slopegate depth three_targets --out depth.npy\n"
        "  slopegate depth spot --out spot.ply --finest-rows 0.5 --no-noise --json",
    )
    parser.add_argument("scene", metavar="SCENE", help="what to look at (see 'slopegate scenes' and 'render')")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="metres in .npy, .exr or .tif (NaN where unknown), millimetres in .png (0 where unknown), points in .ply",
    )
    parser.add_argument(
        "--nearest-m",
        type=number(0.01, MAX_METRES, f"a number from 0.01 to {MAX_METRES:.0f}"),
        default=0.3,
        metavar="Z",
        help="nothing nearer than this is looked for, in metres (0.3)",
    )
    parser.add_argument(
        "--finest-rows",
        type=number(0.01, MAX_ROWS, f"a number from 0.01 to {MAX_ROWS:.0f}"),
        default=1.0,
        metavar="R",
        help="projector rows that are told apart (1)",
    )
    parser.add_argument(
        "--average", type=whole(1, MAX_FRAMES), default=1, metavar="N", help="frames averaged for each setting (1)"
    )
    _add_camera(parser)
    parser.set_defaults(run=("commands.depth", "run_depth"))


def _add_camera(parser: ArgumentParser) -> None:
    noise = parser.add_mutually_exclusive_group()
    noise.add_argument("--noise", action="store_true", help="with the camera's shot and read noise (the default)")
    noise.add_argument("--no-noise", action="store_false", dest="noise", help="a camera without noise")
    parser.set_defaults(noise=True)
    parser.add_argument(
        "--seed",
        type=whole(0, 2**63 - 1),
        default=0,
        metavar="N",
        help="which noise: the same number, the same noise (0)",
    )
    parser.add_argument("--rig", type=Path, metavar="R.toml", help="another rig than the default one (a TOML file)")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, nothing else")
