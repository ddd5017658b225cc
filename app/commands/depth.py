"""`slopegate depth`: depth of every pixel, measured by moving the gate."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import asdict
from typing import Any

from slopegate.app.commands.report import (
    CommandError,
    finite,
    print_json,
    print_table,
    print_warnings,
    say_share_done,
    share_line_done,
)
from slopegate.app.commands.scene import opened
from slopegate.core.measure.sweep import DepthMap, DepthSweep, SweepSettings, depth_error
from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.files.depth_files import SUFFIXES, save_depth
from slopegate.drivers.files.durable import check_destination
from slopegate.drivers.stream.depth_run import frames_of, run_sweep


def run_depth(options: Namespace) -> int:
    """Sweep, say what it took and how far it is off, and write the map where asked to."""
    if options.out is not None:
        check_destination(options.out, SUFFIXES)
    rig, scene = opened(options)
    settings = SweepSettings(options.nearest_m, options.finest_rows, repeats=options.average)
    camera = VirtualCamera(rig, scene, rate_hz=None, seed=options.seed, noise=options.noise)
    camera.prepare(lambda share: True)
    camera.start()
    try:
        found = sweep_of(camera, rig, settings)
        buffers = camera.buffers
        assert buffers is not None
        error = depth_error(found, buffers.projector_row, buffers.inverse_depth)
    finally:
        camera.close()
    values: dict[str, Any] = {
        "scene": scene.name,
        "rig": rig.name,
        "noise": options.noise,
        "seed": options.seed,
        "sweep": asdict(settings),
        "frames": found.frames,
        "plain_frames": found.plain_frames,
        "known_share": float(found.known.mean()),
        "error": None if error is None else asdict(error),
        "warnings": ["something moves in this scene: what moved has no depth or a stale one"] if scene.moving else [],
        "file": None if options.out is None else str(options.out),
    }
    if options.out is not None:
        save_depth(options.out, rig, found, finite(values))
    if options.json:
        print_json(values)
    else:
        _print(values)
    return 0


def sweep_of(camera: VirtualCamera, rig: Rig, settings: SweepSettings) -> DepthMap:
    """Depth as a started camera sees it; the share done is shown on a terminal."""
    sweep = DepthSweep(rig, camera.info.black_count, settings)

    def told(now: DepthSweep) -> None:
        say_share_done(now.share_done)

    try:
        found = run_sweep(frames_of(camera), sweep, told)
    finally:
        share_line_done()
    if found is None:
        raise CommandError("the sweep was given up")
    return found


def _print(values: dict[str, Any]) -> None:
    print(f"{values['scene']} on {values['rig'] or 'this rig'}: depth from {values['frames']} settings of the gate")
    rows: list[tuple[str, float | str | None, str, str]] = [
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
    print_warnings(values["warnings"])
