"""`slopegate search`: the gate that shows a target, found from images alone."""

from __future__ import annotations

import sys
from argparse import Namespace
from typing import Any

from slopegate.app.commands.geometry import clock_mhz, slab_values
from slopegate.app.commands.report import print_json, print_table, print_warnings
from slopegate.app.commands.scene import opened
from slopegate.core.rig.rig import Rig
from slopegate.core.search.search import begin
from slopegate.core.search.state import Outcome, State
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.stream.search_run import run_on_camera

NOT_FOUND = 1


def run_search_command(options: Namespace) -> int:
    """Search, and print what was found; 0 when something was, else 1."""
    rig, scene = opened(options)
    target = None if options.target is None else tuple(options.target)
    camera = VirtualCamera(rig, scene, rate_hz=None, seed=options.seed, noise=options.noise)
    state = begin(rig, target, options.method, camera.info.black_count, options.max_frames, options.seed)
    camera.prepare(lambda share: True)
    camera.start()
    try:
        state = run_on_camera(camera, state, _say)
    finally:
        camera.close()
        _unsay()
    outcome = state.outcome
    assert outcome is not None
    values = {"scene": scene.name, "rig": rig.name} | search_values(rig, state, outcome)
    if scene.moving:
        values["warnings"].append("something moves in this scene: what moved during the search may have misled it")
    if options.json:
        print_json(values)
    else:
        _print(values)
    return 0 if outcome.found else NOT_FOUND


def search_values(rig: Rig, state: State, outcome: Outcome) -> dict[str, Any]:
    """A search's end as plain values; without a gate, `settings` and `slab` are None."""
    found, slab, own = outcome.settings, outcome.slab, outcome.target
    return {
        "method": state.task.method,
        "target": list(state.task.target),
        "found": outcome.found,
        "cause": outcome.cause,
        "reason": outcome.reason,
        "settings": None
        if found is None
        else {
            "clock_mhz": clock_mhz(rig, found.line_time_us),
            "line_time_us": found.line_time_us,
            "delay_us": found.delay_us,
            "exposure_us": found.exposure_us,
        },
        "slab": None if slab is None else slab_values(slab),
        "target_tilt_deg": None if own is None else own.tilt_deg,
        "target_distance_m": None if own is None else own.distance_m,
        "keypoints_kept": outcome.kept,
        "keypoints_found": outcome.keypoints,
        "frames": outcome.frames,
        "max_frames": state.task.max_frames,
        "warnings": [] if slab is None else list(slab.warnings),
    }


def _print(values: dict[str, Any]) -> None:
    word = "found" if values["found"] else "not found"
    print(f"{values['scene']}, {values['method']} search: {word}, {values['reason']}")
    rows: list[tuple[str, float | str | None, str, str]] = []
    settings, slab = values["settings"], values["slab"]
    if settings is not None and slab is not None:
        if settings["clock_mhz"] is not None:
            rows.append(("pixel clock", settings["clock_mhz"], "MHz", ""))
        rows += [
            ("line time", settings["line_time_us"], "us", ""),
            ("delay", settings["delay_us"], "us", ""),
            ("exposure", settings["exposure_us"], "us", ""),
            ("tilt", slab["tilt_deg"], "deg", "positive: the top leans away from the rig"),
            ("distance", slab["distance_m"], "m", "to the centre plane, on the axis"),
            ("thickness", slab["thickness_m"], "m", ""),
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


def _say(state: State) -> None:
    """On a terminal, how far the search is."""
    if sys.stderr.isatty():
        last = state.history[-1]
        print(
            f"\rframe {state.frames:3d}: {last.doing}, {last.seen} keypoints      ", end="", file=sys.stderr, flush=True
        )


def _unsay() -> None:
    if sys.stderr.isatty():
        print("\r" + " " * 60 + "\r", end="", file=sys.stderr, flush=True)
