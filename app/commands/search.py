"""`slopegate search`: the gate that shows a target, found from images alone."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, Any, get_args

from slopegate.app.commands.opening import opened
from slopegate.app.commands.options import add_noise, add_rectangle, add_rig, add_scene, describe, whole
from slopegate.app.commands.report import (
    Row,
    print_json,
    print_table,
    print_warnings,
    say_line,
    settings_values,
    slab_rows,
    slab_values,
)
from slopegate.core.search.state import DEFAULT_FRAMES, Method

if TYPE_CHECKING:
    from slopegate.app.api import OpenScene, SearchResult, SearchStep

NOT_FOUND = 1
MAX_FRAMES = 10_000


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Finds the gate that shows a target, by what a camera sees of it: on the virtual rig, which\n"
        "never tells the search where anything is. The fast method ends when the target is\n"
        "whole: when a thicker gate shows no more of it. Exit code 0 when it was found, 1 when not (with the reason)\n"
        "or only in part: then the gate that shows this part is given.",
        epilog="examples:\n  slopegate search three_targets --target 120 220 530 820\n"
        "  slopegate search spot --method paper --json",
    )
    add_scene(parser)
    add_rectangle(parser, "--target", "the rectangle that shows the target (default: the whole image): ")
    parser.add_argument(
        "--method",
        choices=get_args(Method),
        default="fast",
        help="fast (the default) cuts the scene and computes the gate; paper moves clock, delay and exposure in steps",
    )
    add_noise(parser, usual=True)
    limits = ", ".join(f"{frames} for {method}" for method, frames in DEFAULT_FRAMES.items())
    parser.add_argument(
        "--max-frames", type=whole(1, MAX_FRAMES), metavar="N", help=f"give up after so many frames ({limits})"
    )
    add_rig(parser)


def run(options: Namespace) -> int:
    """Search, and print what was found; 0 when the target was, else 1."""
    scene = opened(options)
    try:
        result = scene.search(
            None if options.target is None else tuple(options.target),
            method=options.method,
            max_frames=options.max_frames,
            noise=options.noise,
            seed=options.seed,
            watch=_say,
        )
    finally:
        say_line("")
    values = {"scene": scene.scene_name, "rig": scene.name, "method": options.method} | _values(scene, result)
    if scene.moving:
        values["warnings"].append("something moves in this scene: what moved during the search may have misled it")
    if options.json:
        print_json(values)
    else:
        _print(values)
    return 0 if result.outcome.found else NOT_FOUND


def _values(scene: OpenScene, result: SearchResult) -> dict[str, Any]:
    """Without a gate, `settings` and `slab` are None."""
    outcome = result.outcome
    found, slab, own = outcome.settings, outcome.slab, outcome.target
    return {
        "target": list(result.target),
        "found": outcome.found,
        "cause": outcome.cause,
        "reason": outcome.reason,
        "settings": None if found is None else settings_values(scene, found),
        "slab": None if slab is None else slab_values(slab),
        "target_tilt_deg": None if own is None else own.tilt_deg,
        "target_distance_m": None if own is None else own.distance_m,
        "keypoints_kept": outcome.kept,
        "keypoints_found": outcome.keypoints,
        "frames": outcome.frames,
        "max_frames": result.max_frames,
        "warnings": [] if slab is None else list(slab.warnings),
    }


def _print(values: dict[str, Any]) -> None:
    word = {"found": "found", "part": "part of it"}.get(values["cause"], "not found")
    print(f"{values['scene']}, {values['method']} search: {word}, {values['reason']}")
    rows: list[Row] = []
    settings, slab = values["settings"], values["slab"]
    if settings is not None and slab is not None:
        if settings["clock_mhz"] is not None:
            rows.append(("pixel clock", settings["clock_mhz"], "MHz", ""))
        rows += [
            ("line time", settings["line_time_us"], "us", ""),
            ("delay", settings["delay_us"], "us", ""),
            ("exposure", settings["exposure_us"], "us", ""),
            *slab_rows(slab),
        ]
    if values["target_tilt_deg"] is not None:
        rows += [
            ("target's tilt", values["target_tilt_deg"], "deg", "of its own plane: the clock comes in steps"),
            ("target's distance", values["target_distance_m"], "m", "where that plane meets the axis"),
        ]
    rows.append(("keypoints", f"{values['keypoints_kept']} of {values['keypoints_found']}", "", "kept"))
    rows.append(("frames", str(values["frames"]), "", f"of at most {values['max_frames']}"))
    print_table(rows)
    print_warnings(values["warnings"])


def _say(history: tuple[SearchStep, ...]) -> None:
    """How far the search is."""
    last = history[-1]
    say_line(f"frame {len(history):3d}: {last.doing}, {last.seen} keypoints")
