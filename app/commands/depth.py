"""`slopegate depth`: depth of every pixel, measured by moving the gate."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from pathlib import Path
from typing import Any

from slopegate.app.commands.opening import opened
from slopegate.app.commands.options import (
    MAX_METRES,
    add_noise,
    add_overwrite,
    add_rig,
    add_scene,
    describe,
    number,
    whole,
)
from slopegate.app.commands.report import (
    Row,
    finite,
    print_json,
    print_table,
    print_warnings,
    say_line,
    say_share_done,
)
from slopegate.drivers.files.durable import check_destination

MAX_ROWS = 64.0
MAX_FRAMES = 1000


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Measures depth as a camera would: a coarse-to-fine sweep of the delay that leaves intervals\n"
        "without light alone. Says how many settings it took, what a plain sweep takes, and how far it is off.",
        epilog="examples:\n  slopegate depth three_targets --out depth.npy\n"
        "  slopegate depth spot --out spot.ply --finest-rows 0.5 --no-noise --json",
    )
    add_scene(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="metres in .npy, .exr or .tif (NaN where unknown), millimetres in .png (0 where unknown), points in .ply",
    )
    parser.add_argument(
        "--scene-out",
        type=Path,
        metavar="DIR",
        help="a folder with photo, depth, intrinsics and this rig, which opens as a scene",
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
    add_overwrite(parser)
    add_noise(parser, usual=True)
    add_rig(parser)


def run(options: Namespace) -> int:
    """Sweep, say what it took and how far it is off, and write the map where asked to."""
    from slopegate.app.session.twin import keep_twin
    from slopegate.core.measure.sweep import SweepSettings
    from slopegate.drivers.files.depth_files import SUFFIXES, save_depth
    from slopegate.drivers.scenes.twin_files import check_twin

    if options.out is not None:
        check_destination(options.out, SUFFIXES, overwrite=options.overwrite)
    if options.scene_out is not None:
        check_twin(options.scene_out, options.overwrite)
    scene = opened(options)
    settings = SweepSettings(options.nearest_m, options.finest_rows, repeats=options.average)
    try:
        measured = scene.measure_depth(
            nearest_m=options.nearest_m,
            finest_rows=options.finest_rows,
            average=options.average,
            noise=options.noise,
            seed=options.seed,
            progress=say_share_done,
        )
    finally:
        say_line("")
    found, error = measured.map, measured.error
    values: dict[str, Any] = {
        "scene": scene.scene_name,
        "rig": scene.name,
        "noise": options.noise,
        "seed": options.seed,
        "sweep": asdict(settings),
        "frames": found.frames,
        "plain_frames": found.plain_frames,
        "known_share": float(found.known.mean()),
        "error": None if error is None else asdict(error),
        "warnings": ["something moves in this scene: what moved has no depth or a stale one"] if scene.moving else [],
        "file": None if options.out is None else str(options.out),
        "scene_folder": None if options.scene_out is None else str(options.scene_out),
    }
    if options.out is not None:
        save_depth(options.out, scene.rig, found, finite(values))
    if options.scene_out is not None:
        gates = scene.scene.gates
        keep_twin(options.scene_out, scene.rig, found, "mono12", scene.scene_name, gates, options.overwrite)
    if options.json:
        print_json(values)
    else:
        _print(values)
    return 0


def _print(values: dict[str, Any]) -> None:
    print(f"{values['scene']} on {values['rig'] or 'this rig'}: depth from {values['frames']} settings of the gate")
    rows: list[Row] = [
        ("settings", str(values["frames"]), "", f"a sweep in equal steps takes {values['plain_frames']}"),
        ("known", 100 * values["known_share"], "%", "of all pixels"),
    ]
    error = values["error"]
    if error is not None:
        rows += [
            ("of the lit", 100 * error["known_share"], "%", ""),
            ("median error", error["median_mm"], "mm", ""),
            ("rms error", error["rms_mm"], "mm", ""),
            ("95 % below", error["p95_mm"], "mm", ""),
            ("wrong", 100 * error["wrong_share"], "%", "off by more than the resolution"),
        ]
    print_table(rows)
    if values["file"] is not None:
        print(f"  map: {values['file']}")
    if values["scene_folder"] is not None:
        print(f"  scene: {values['scene_folder']}")
    print_warnings(values["warnings"])
