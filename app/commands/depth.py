"""`slopegate depth`: depth of every pixel, measured by moving the gate."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.capture import add_camera, check_subject
from slopegate.app.commands.opening import opened
from slopegate.app.commands.options import (
    MAX_METRES,
    add_noise,
    add_overwrite,
    add_rig,
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

if TYPE_CHECKING:
    from slopegate.core.measure.depth_errors import DepthErrors
    from slopegate.core.measure.sweep import DepthError, DepthMap, SweepSettings
    from slopegate.core.rig.rig import Rig
    from slopegate.core.scene.scene import Preset

MAX_ROWS = 64.0
MAX_FRAMES = 1000


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Measures depth as a camera would: a coarse-to-fine sweep of the delay that leaves intervals\n"
        "without light alone. Says how many settings it took, what a plain sweep takes, and how far it is off.",
        epilog="examples:\n  slopegate depth three_targets --out depth.npy\n"
        "  slopegate depth spot --out spot.ply --finest-rows 0.5 --no-noise --json\n"
        "  slopegate depth --camera ueye:4103123456 --rig R.toml --scene-out bench",
    )
    parser.add_argument(
        "scene", metavar="SCENE", nargs="?", help="what to measure (see 'slopegate scenes' and 'render')"
    )
    add_camera(parser)
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
    parser.set_defaults(seed=None)
    add_rig(parser)


@dataclass(frozen=True, eq=False)
class _Swept:
    """A finished sweep, and of what."""

    name: str
    rig: Rig
    pixel_format: str
    found: DepthMap
    error: DepthError | None
    errors: DepthErrors | None
    gates: tuple[Preset, ...] = ()
    moving: bool = False


def run(options: Namespace) -> int:
    """Sweep, say what it took and how far it is off, and write what was asked for."""
    from slopegate.app.session.twin import keep_twin
    from slopegate.core.measure.sweep import SweepSettings
    from slopegate.drivers.files.depth_files import SUFFIXES, error_file, save_depth
    from slopegate.drivers.scenes.twin_files import check_twin

    check_subject(options)
    if options.out is not None:
        check_destination(options.out, SUFFIXES, overwrite=options.overwrite)
    if options.scene_out is not None:
        check_twin(options.scene_out, options.overwrite)
    settings = SweepSettings(options.nearest_m, options.finest_rows, repeats=options.average)
    try:
        swept = _of_scene(options) if options.camera is None else _of_camera(options, settings)
    finally:
        say_line("")
    found, error = swept.found, swept.error
    values: dict[str, Any] = {
        "scene": swept.name,
        "rig": swept.rig.name,
        "noise": options.noise,
        "seed": options.seed,
        "sweep": asdict(settings),
        "frames": found.frames,
        "plain_frames": found.plain_frames,
        "known_share": float(found.known.mean()),
        "error": None if error is None else asdict(error),
        "warnings": ["something moves in this scene: what moved has no depth or a stale one"] if swept.moving else [],
        "file": None if options.out is None else str(options.out),
        "scene_folder": None if options.scene_out is None else str(options.scene_out),
    }
    errors = swept.errors
    if errors is not None:
        beside = None if options.out is None else error_file(options.out)
        values["standard_error"] = _medians(errors) | {"file": None if beside is None else str(beside)}
    if options.out is not None:
        save_depth(options.out, swept.rig, found, finite(values), errors_m=None if errors is None else errors.total_m)
    if options.scene_out is not None:
        form, name = swept.pixel_format, swept.name
        keep_twin(options.scene_out, swept.rig, found, form, name, swept.gates, options.overwrite)
    if options.json:
        print_json(values)
    else:
        _print(values)
    return 0


def _medians(errors: DepthErrors) -> dict[str, Any]:
    names = ("median_m", "rig_median_m", "sweep_median_m")
    return dict(zip(names, errors.medians_m or (None,) * 3, strict=True))


def _check_error_file(options: Namespace, rig: Rig) -> None:
    """Raise StorageError before the sweep where its standard errors could not be kept."""
    from slopegate.drivers.files.depth_files import SUFFIXES, error_file

    beside = None if options.out is None else error_file(options.out)
    if beside is not None and rig.calibration is not None:
        check_destination(beside, SUFFIXES, overwrite=options.overwrite)


def _of_scene(options: Namespace) -> _Swept:
    scene = opened(options)
    _check_error_file(options, scene.rig)
    options.seed = options.seed or 0
    measured = scene.measure_depth(
        nearest_m=options.nearest_m,
        finest_rows=options.finest_rows,
        average=options.average,
        noise=options.noise,
        seed=options.seed,
        progress=say_share_done,
    )
    gates, moving = scene.scene.gates, scene.moving
    errors = measured.standard_errors
    return _Swept(scene.scene_name, scene.rig, "mono12", measured.map, measured.error, errors, gates, moving)


def _of_camera(options: Namespace, settings: SweepSettings) -> _Swept:
    from slopegate.app.commands.capture_camera import USUAL_WAIT_S, opened_camera
    from slopegate.core.measure.depth_errors import depth_errors
    from slopegate.core.measure.sweep import DepthSweep
    from slopegate.drivers.stream.depth_run import frames_of, run_sweep

    with ExitStack() as held:
        camera, rig = opened_camera(options, held)
        _check_error_file(options, rig)
        sweep = DepthSweep(rig, camera.info.black_count, settings)
        camera.start()
        take = frames_of(camera, wait_s=options.wait_s or USUAL_WAIT_S)
        found = run_sweep(take, sweep, lambda now: say_share_done(now.share_done))
        assert found is not None  # only a window gives up
        return _Swept(camera.info.name, rig, camera.info.pixel_format, found, None, depth_errors(rig, found))


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
    told = values.get("standard_error")
    if told is not None and told["median_m"] is not None:
        by_rig, by_sweep = (1000 * told[name] for name in ("rig_median_m", "sweep_median_m"))
        parts = f"of a depth, by the median: {by_rig:.2g} by the rig, {by_sweep:.2g} by the sweep's steps"
        rows.append(("standard error", 1000 * told["median_m"], "mm", parts))
    print_table(rows)
    if values["file"] is not None:
        beside = told and told["file"]
        print(f"  map: {values['file']}{f', its standard errors: {beside}' if beside else ''}")
    if values["scene_folder"] is not None:
        print(f"  scene: {values['scene_folder']}")
    print_warnings(values["warnings"])
