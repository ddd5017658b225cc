"""`slopegate bake`: prepares the indirect light of a scene, so that it is there when the scene is opened."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import asdict

from slopegate.app.commands.opening import noisier, opened
from slopegate.app.commands.options import add_bake, add_rig, add_scene, describe
from slopegate.app.commands.report import (
    CommandError,
    print_json,
    print_table,
    print_warnings,
    say_line,
    say_share_done,
)


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Traces the light that goes between surfaces, and several times through fog, once for all gates\n"
        "of a scene, and keeps it in the cache folder. The window and 'render' find it there; what they lack they\n"
        "bake themselves. A bake that is stopped goes on where it was.",
        epilog="example:\n  slopegate bake cornell_fog --error 0.5",
    )
    add_scene(parser)
    add_bake(parser)
    parser.add_argument(
        "--patterns",
        action="store_true",
        help="for light under patterns, which 'transport acquire' and 'render --pattern' ask for: by parts of the "
        "projector's columns too, and coarser in the picture",
    )
    add_rig(parser)


def run(options: Namespace) -> int:
    """Bake, and say what it took and how good it is."""
    scene = opened(options)
    if not scene.needs_bake({"indirect"}):
        raise CommandError(f"{scene.scene_name} has no surfaces for light to go between: there is nothing to bake")
    try:
        report = scene.bake(
            paths=options.paths,
            error_percent=options.error_percent,
            patterns=options.patterns,
            progress=say_share_done,
        )
    finally:
        say_line("")
    print_warnings(noisier(options, report))
    if options.json:
        print_json(asdict(report))
        return 0
    print(f"{scene.scene_name}: {'found in the cache' if report.cached else 'baked'}")
    print_table(
        [
            ("seconds", report.seconds, "s", ""),
            ("paths", str(report.paths), "", "a cell of the grid that indirect light is kept in"),
            (
                "noise",
                report.error_percent,
                "%",
                "of the fully lit image's mean, over 4 x 4 pixels, where a gate records all twice",
            ),
            ("memory", report.memory_bytes / 1e6, "MB", "at most, beside the image's planes"),
        ]
    )
    return 0
