"""`slopegate transport`: light transport slice by slice, planned, acquired and shown."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.capture import add_wait_and_board, check_one_subject, kept_text, resuming
from slopegate.app.commands.opening import opened
from slopegate.app.commands.options import (
    SLAB,
    SPEED,
    add_gate_name,
    add_json,
    add_rig,
    add_scene_noise,
    add_screen,
    add_slab,
    add_speed,
    asked_gate,
    describe,
    far_metres,
    flag,
    given,
    metres,
    number,
    parts_list,
    positive,
    refuse_mixed,
    slices_shape,
    whole,
)
from slopegate.app.commands.registry import SentenceParser
from slopegate.app.commands.report import (
    CommandError,
    Row,
    decibels,
    print_json,
    print_table,
    print_warnings,
    say_line,
    settings_values,
)
from slopegate.core.light.part import PARTS
from slopegate.core.rig.settings import MAX_TIME_US
from slopegate.drivers.captures.limits import MAX_FRAMES, MAX_SLICES

if TYPE_CHECKING:
    from slopegate.app.api import OpenRig, OpenTransport, TransportPlan
    from slopegate.core.gating.slices import Slices
    from slopegate.drivers.transports.model import TransportRecord
    from slopegate.drivers.transports.storage import TransportFolder

CODES = ("hadamard", "s", "impulse", "gray", "adaptive")
USUAL_GRID = "32x32"
USUAL_SLICES = 5
_PLAN = (
    "grid", "count", "near_m", "far_m", "clock_mhz", "line_time_us", "delay_us", "exposure_us", "codes", "parts",
    "frames", "seed", "settle_frames", "pixel_format", "gate", *SLAB,
)  # fmt: skip
_OF_CAMERA = ("wait_s", "board", "board_settings", "screen", "settle_frames", "transfer_us")
_OF_SCENE = ("parts", "seed")


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Light transport: how much light each block of the projector brings to each pixel of the camera,\n"
        "for every slice of space that a gate keeps. Coded patterns are shown through the projector, one\n"
        "frame (or several) is taken of each, and what each block alone does is computed from them.\n"
        "Afterwards 'slopegate relight' lights every slice anew, and 'slopegate composite' puts a new\n"
        "background behind what is in front. 'slopegate transport ACTION --help' explains each action.",
        epilog="examples:\n  slopegate transport plan three_targets --grid 32x32 --count 5\n"
        "  slopegate transport acquire three_targets --out targets --grid 32x32 --count 5\n"
        "  slopegate transport show targets",
    )
    actions = parser.add_subparsers(
        title="actions", metavar="ACTION", dest="action", required=True, parser_class=SentenceParser
    )
    _add_plan(actions.add_parser("plan", help="frames, time, disk and noise of an acquisition, before it starts"))
    _add_acquire(actions.add_parser("acquire", help="show the patterns, take the frames, fill a folder"))
    _add_show(actions.add_parser("show", help="what the folder of an acquisition holds"))


def _add_plan(parser: ArgumentParser) -> None:
    describe(
        parser,
        description="What an acquisition with these options will take: frames, seconds, bytes on the disk at once,\n"
        "and the noise gain: by how much the signal of one block stands higher above the noise than if\n"
        "blocks were lit one at a time, in as many frames (1: no gain). Nothing is shown or recorded.",
        epilog="examples:\n  slopegate transport plan three_targets --grid 32x32 --count 5\n"
        "  slopegate transport plan --camera ueye:4103123456 --rig R.toml --grid 512x512 --count 2 --codes adaptive",
    )
    _add_subject(parser)
    _add_slices(parser)
    _add_codes(parser)
    add_rig(parser)


def _add_acquire(parser: ArgumentParser) -> None:
    describe(
        parser,
        description="Acquires light transport slice by slice into a folder: of a scene, with a virtual projector and\n"
        "camera, or of what a real camera sees while patterns are shown on the screen that is the\n"
        "projector (--camera and --screen). Each slice is on the disk before the next begins; --resume\n"
        "goes on where it stopped. Slices without light are noted and not acquired. A camera without a\n"
        "gate gives one slice: everything.",
        epilog="examples:\n  slopegate transport acquire three_targets --out targets --grid 32x32 --count 5\n"
        "  slopegate transport acquire three_targets --out one --clock-mhz 76 --delay-us 1853 --exposure-us 400\n"
        "  slopegate transport acquire three_targets --out targets --resume\n"
        "  slopegate transport acquire --camera ueye:4103123456 --rig R.toml --screen HDMI-1 --near-m 0.6 --far-m 1.4\n"
        "      --count 2 --grid 512x512 --codes adaptive --out bottle",
    )
    _add_subject(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the acquisition's own folder")
    _add_slices(parser)
    _add_codes(parser)
    parser.add_argument(
        "--parts",
        type=parts_list,
        metavar="LIST",
        help=f"of a scene: the light that counts: all, or some of {','.join(PARTS)}; the default is what the scene "
        "holds, without ambient light, which no pattern changes",
    )
    add_scene_noise(parser)
    parser.add_argument(
        "--pixel-format",
        metavar="F",
        help="of a scene mono12 (the default) or bayer_rg12, a camera in colour; of a camera such as Mono12p, by its "
        "own name (default: 12 bits, or what is nearest)",
    )
    parser.add_argument(
        "--keep-raw", action="store_true", help="keep the frames of every slice, 2 bytes a pixel and pattern (Zarr 3)"
    )
    parser.add_argument(
        "--resume", action="store_true", help="take what is missing in DIR, with the same scene or camera, and rig"
    )
    _add_camera(parser)
    add_rig(parser)


def _add_show(parser: ArgumentParser) -> None:
    describe(
        parser,
        description="What the folder of an acquisition holds: its grid, codes and slices, the frames taken, whether\n"
        "all is complete, and how like the sum of its slices the fully lit image is that was captured\n"
        "with it (PSNR in dB; slices that tile everything that is lit should reach 60 dB without noise).",
        epilog="example:\n  slopegate transport show targets",
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="the folder of an acquisition")
    add_json(parser)


def _add_subject(parser: ArgumentParser) -> None:
    parser.add_argument(
        "scene", metavar="SCENE", nargs="?", help="what is looked at (see 'slopegate scenes' and 'render')"
    )
    parser.add_argument(
        "--camera",
        metavar="FAMILY:WHERE",
        help="instead of a SCENE: what this camera sees (see 'slopegate devices'); --rig must describe it",
    )


def _add_slices(parser: ArgumentParser) -> None:
    slices = parser.add_argument_group("slices")
    slices.add_argument(
        "--count",
        type=whole(1, MAX_SLICES),
        metavar="N",
        help=f"how many slices ({USUAL_SLICES}); without a range they tile everything that the projector lights, and "
        "where fog, skin or surfaces scatter light, the first and the last reach on, so that all of it is in a slice",
    )
    slices.add_argument("--near-m", type=metres(), metavar="A", help="where the slices begin, straight ahead")
    slices.add_argument("--far-m", type=far_metres, metavar="B", help="where they end; inf for infinity")
    add_speed(slices, False, "pixel clock: the tilt of every slice (default: upright)")
    slices.add_argument(
        "--delay-us",
        type=number(-MAX_TIME_US, MAX_TIME_US, f"a number from {-MAX_TIME_US:.0f} to {MAX_TIME_US:.0f}"),
        metavar="D",
        help="instead of a range: one slice, the gate with this delay, with --exposure-us",
    )
    slices.add_argument("--exposure-us", type=positive(MAX_TIME_US), metavar="E", help="exposure of --delay-us")
    tilted = parser.add_argument_group(
        "a gate by its slab or name",
        "alone it is the one slice; beside --count or a range every slice has its tilt",
    )
    add_slab(tilted)
    add_gate_name(tilted)


def _add_codes(parser: ArgumentParser) -> None:
    codes = parser.add_argument_group("patterns")
    codes.add_argument(
        "--grid",
        metavar="CxR",
        help=f"columns x rows of blocks of the projector that are told apart, from 4x2 to 512x512 ({USUAL_GRID})",
    )
    codes.add_argument(
        "--codes",
        choices=CODES,
        help="hadamard (the default): half of the blocks lit, the least noise where light is dim; s: the same by "
        "S-matrices; impulse: one block after the other; gray: Gray code, in a few dozen frames, for pixels that one "
        "block lights; adaptive: Gray code, then Hadamard for what it does not explain",
    )
    codes.add_argument("--frames", type=whole(1, MAX_FRAMES), metavar="N", help="frames to sum for each pattern (1)")


def _add_camera(parser: ArgumentParser) -> None:
    camera = parser.add_argument_group("with --camera")
    add_screen(camera, "while the acquisition runs")
    add_wait_and_board(camera)


def run(options: Namespace) -> int:
    """Do what the action says."""
    return {"plan": _plan, "acquire": _acquire, "show": _show}[options.action](options)


def _plan(options: Namespace) -> int:
    check_one_subject(options)
    _check_slices(options)
    if options.camera is None:
        scene = opened(options)
        plan = scene.plan_transport(_slices(options, scene), **_patterns(options))
    else:
        from slopegate.app.commands.transport_camera import plan_with_camera

        plan = plan_with_camera(options, lambda rig: _slices(options, rig), _patterns(options))
    if options.json:
        print_json(asdict(plan))
        return 0
    _print_plan(plan)
    return 0


def _acquire(options: Namespace) -> int:
    check_one_subject(options)
    _check_kind(options)
    _check_slices(options)
    # at once: after an interrupted import, which leaves half of its modules, none may follow
    from slopegate.drivers.transports.storage import is_transport, open_transport

    try:
        made = _of_scene(options) if options.camera is None else _of_camera(options)
    except KeyboardInterrupt:
        say_line("")
        folder = open_transport(options.out) if is_transport(options.out) else None
        raise KeyboardInterrupt(_kept(options, folder)) from None
    finally:
        say_line("")
    report = {"folder": str(options.out), **_report(made)}
    if options.json:
        print_json(report)
    else:
        _print_report(options.out, report)
    return 0


def _kept(options: Namespace, folder: TransportFolder | None) -> str:
    """What an interrupted acquisition leaves, and how to go on with it."""
    if folder is None:
        return "interrupted before anything was acquired"
    names = ("scene", "camera", "wait_s", "board", "screen", "transfer_us", "rig")
    again = resuming(options, "transport acquire", names) + (" --keep-raw" if options.keep_raw else "")
    return kept_text(folder, options.out, again)


def _of_scene(options: Namespace) -> OpenTransport:
    scene = opened(options)
    if scene.moving:
        print_warnings(
            ["something moves in this scene: patterns see it in different places, so its transport is wrong"]
        )
    if options.resume:
        return scene.resume_transport(options.out, keep_raw=options.keep_raw, say=say_line)
    return scene.acquire_transport(
        options.out,
        _slices(options, scene),
        parts=options.parts,
        noise=options.noise,
        seed=options.seed or 0,
        pixel_format=options.pixel_format or "mono12",
        keep_raw=options.keep_raw,
        say=say_line,
        **_patterns(options),
    )


def _of_camera(options: Namespace) -> OpenTransport:
    from slopegate.app.commands.transport_camera import acquire_with_camera

    return acquire_with_camera(options, lambda rig: _slices(options, rig), _patterns(options))


def _show(options: Namespace) -> int:
    from slopegate.app.api import open_transport

    report = _report(open_transport(options.folder))
    if options.json:
        print_json(report)
    else:
        _print_report(options.folder, report)
    return 0


def _patterns(options: Namespace) -> dict[str, Any]:
    """How a slice is asked for, as the API takes it."""
    return {
        "grid": options.grid or USUAL_GRID,
        "codes": options.codes or CODES[0],
        "frames": options.frames or 1,
    }


def _slices(options: Namespace, rig: OpenRig) -> Slices:
    if options.delay_us is not None or (_one_gate(options) and not given(options, ("count", "near_m"))):
        gate = asked_gate(options, rig)
        print_warnings(gate.warnings)
        return (gate.sent(rig),)
    speed = slices_shape(options, rig).speed
    count = options.count or USUAL_SLICES
    if options.near_m is not None:
        return rig.plan_slices(options.near_m, options.far_m, count, **speed)
    from slopegate.app.api import OpenScene

    if not isinstance(rig, OpenScene):
        raise CommandError(
            "how far the camera sees is not known: give --near-m and --far-m, or --clock-mhz, --delay-us and "
            "--exposure-us"
        )
    return rig.plan_lit_slices(count, **speed, scattered=True)


def _one_gate(options: Namespace) -> bool:
    """Whether a gate is given by its slab or its name."""
    return bool(given(options, (*SLAB, "gate")))


def _check_kind(options: Namespace) -> None:
    """That a scene gets no options of a camera, nor a camera those of a scene."""
    named, kind, other = (
        (_OF_CAMERA, "a camera", "--camera instead of a SCENE")
        if options.camera is None
        else (_OF_SCENE, "a SCENE", "a SCENE instead of --camera")
    )
    wrong = [flag(name) for name in given(options, named)]
    if options.camera is not None and not options.noise:
        wrong.insert(0, "--no-noise")
    if wrong:
        raise CommandError(f"{wrong[0]} is for {kind}: give {other}")


def _check_slices(options: Namespace) -> None:
    refuse_mixed(options, given(options, (*SPEED, "delay_us", "exposure_us")), given(options, SLAB))
    if (options.delay_us is None) != (options.exposure_us is None):
        raise CommandError("--delay-us and --exposure-us belong together: they are one gate, one slice")
    if options.delay_us is not None and (options.near_m is not None or options.far_m is not None or options.count):
        raise CommandError("--delay-us and --exposure-us are one slice, in place of --near-m, --far-m and --count")
    if options.delay_us is not None and options.clock_mhz is None and options.line_time_us is None:
        raise CommandError("--delay-us needs --clock-mhz (or --line-time-us): the three together are a gate")
    if (options.near_m is None) != (options.far_m is None):
        raise CommandError("--near-m and --far-m belong together")
    if options.near_m is not None and options.far_m <= options.near_m:
        raise CommandError(f"--far-m is {options.far_m:g}: it must be above --near-m ({options.near_m:g})")
    resumed = getattr(options, "resume", False)
    if resumed and (given(options, _PLAN) or not options.noise):
        raise CommandError("--resume goes on with the plan in the folder: give no other plan beside it")


def _report(transport: OpenTransport) -> dict[str, Any]:
    """What a folder holds, under the names of the command line's contract."""
    folder = transport.folder
    manifest, records = folder.manifest, folder.records()
    match = transport.agreement()
    return {
        "scene": transport.scene_name,
        "grid": transport.grid,
        "codes": manifest.codes,
        "slices": [_slice_values(transport, place, records.get(place)) for place in range(len(manifest.slices))],
        "frames": sum(record.frames for record in records.values()),
        "seconds": sum(record.seconds for record in records.values()),
        "complete": not transport.missing,
        "missing": list(transport.missing),
        "warnings": [f"slice {place}: {doubt}" for place, record in records.items() for doubt in record.doubts],
        "psnr_check": None if match is None or transport.missing else decibels(match.psnr_db),
    }


def _slice_values(transport: OpenTransport, place: int, record: TransportRecord | None) -> dict[str, Any]:
    gate = transport.gates[place]
    asked = None if gate is None else settings_values(transport, gate)
    if record is None:
        return {"index": place, "gate": asked, "taken": False}
    facts = record.model_dump(mode="json", exclude={"index", "asked", "applied"})
    return {"index": place, "gate": asked, "taken": True, "frames": record.frames, **facts}


def _print_plan(plan: TransportPlan) -> None:
    rows: list[Row] = [
        ("frames", f"{plan.frames}", "", ""),
        ("time", _duration(plan.seconds), "", "the paper: 50 s (4x2), 15 min (32x32, 5 slices), 4 h (512x512)"),
        ("disk", f"{plan.bytes / 1e9:.2f}", "GB", "at most at a time"),
        ("noise gain", plan.noise_gain, "", "of one block's light, against lighting one block at a time"),
    ]
    print_table(rows)


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def _print_report(folder: Path, report: dict[str, Any]) -> None:
    taken = [item for item in report["slices"] if item["taken"]]
    print(
        f"{len(taken)} of {len(report['slices'])} slices of {report['scene']}, grid {report['grid']}, "
        f"{report['codes']} codes, are in {folder}"
    )
    for item in taken:
        gate = "no gate" if item["gate"] is None else f"delay {item['gate']['delay_us']:g} us"
        what = (
            "no light"
            if item["empty"]
            else f"{item['entries']} entries, {item['left_out']:.1%} of its light spread evenly"
        )
        print(f"  {item['index']:>3}  {gate}: {item['frames']} frames, {what}")
    if report["psnr_check"] is not None:
        print(f"  the slices add up to the captured fully lit image with a PSNR of {report['psnr_check']:.1f} dB")
    print_warnings(report["warnings"])
    print_warnings([f"{len(report['missing'])} slices are missing: --resume takes them"] if report["missing"] else [])
