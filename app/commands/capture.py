"""`slopegate capture`: slice by slice into a folder, through the same stream and recorder as in the window."""

from __future__ import annotations

import shlex
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.opening import opened
from slopegate.app.commands.options import (
    SLAB,
    add_gate_name,
    add_rig,
    add_scene_noise,
    add_slab,
    add_speed,
    describe,
    far_metres,
    flag,
    given,
    is_number,
    metres,
    positive,
    slices_shape,
    whole,
)
from slopegate.app.commands.report import CommandError, print_json, say_line
from slopegate.app.session.describe import frames_text
from slopegate.core.gating.slices import Slices, Spacing, share_edges
from slopegate.core.rig.settings import MAX_TIME_US
from slopegate.drivers.captures.limits import MAX_FRAMES, MAX_SLICES
from slopegate.drivers.captures.storage import check_new_folder, is_capture, open_capture

if TYPE_CHECKING:
    from argparse import _ActionsContainer

    from slopegate.app.api import OpenRig, Recording
    from slopegate.drivers.captures.reading import Capture
    from slopegate.drivers.transports.storage import TransportFolder

MAX_WAIT_S = 1e6
BOARD_SETTINGS = ("output", "width_us", "inverted", "trigger_rising", "trigger_level_v", "dialect", "baud")
_PLAN = (
    "clock_mhz", "line_time_us", "near_m", "far_m", "count", "spacing", "delays_us", "exposure_us", "frames", "gate",
    *SLAB,
)  # fmt: skip
_OF_CAMERA = ("pixel_format", "wait_s", "board", "board_settings")


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Records slice by slice: a scene on the virtual rig, or what a camera sees that the projector\n"
        "triggers. Each slice is on the disk before the next begins; --resume goes on where a capture stopped. Of a\n"
        "scene the slices cover all that the projector lights, unless a range is given; how far a camera sees is not\n"
        "known, so it needs a range or a list of delays. A camera that vanishes ends the capture; what it took stays.",
        epilog="examples:\n  slopegate capture three_targets --out my_capture\n"
        "  slopegate capture table --near-m 0.6 --far-m 1.4 --count 8 --frames 4 --dark --out my_capture\n"
        "  slopegate capture three_targets --tilt-deg 15 --distance-m 1.05 --thickness-m 0.1 --out leaning\n"
        "  slopegate capture table --out my_capture --resume\n"
        "  slopegate capture --camera ueye:4103123456 --rig R.toml --near-m 0.6 --far-m 1.4 --out my_capture",
    )
    parser.add_argument(
        "scene", metavar="SCENE", nargs="?", help="what to record (see 'slopegate scenes' and 'render')"
    )
    add_camera(parser)
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
    add_scene_noise(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the capture's own folder")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="take what is missing from the capture in DIR, with the same scene or camera, rig and board",
    )
    add_rig(parser)


def add_camera(parser: ArgumentParser) -> None:
    """A camera in place of a scene, its pixel format and its board."""
    parser.add_argument(
        "--camera",
        metavar="FAMILY:WHERE",
        help="instead of a SCENE: what this camera sees (see 'slopegate devices'); --rig must describe it",
    )
    parser.add_argument(
        "--pixel-format",
        metavar="NAME",
        help="with --camera: such as Mono12p, by the camera's own name (default: 12 bits, or what is nearest)",
    )
    add_wait_and_board(parser)


def add_wait_and_board(parser: _ActionsContainer) -> None:
    """Patience with a camera, and the board that makes its delay: `--wait-s`, `--board` and `--board-settings`."""
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
    add_speed(parser, False, "pixel clock: the tilt of every slice (default: upright)")
    tilted = parser.add_argument_group(
        "slices like a gate",
        "instead of the clock: every slice has this slab's tilt and, where that is given and no --count, its thickness",
    )
    add_slab(tilted)
    add_gate_name(tilted)
    parser.add_argument("--near-m", type=metres(), metavar="Z", help="where the slices begin, straight ahead")
    parser.add_argument("--far-m", type=far_metres, metavar="Z", help="where they end; inf for infinity")
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


def run(options: Namespace) -> int:
    """Record what is asked for, or what is missing; whatever was taken stays."""
    _check(options)
    if not options.resume:
        check_new_folder(options.out)
    try:
        made = _of_scene(options) if options.camera is None else _of_camera(options)
    except KeyboardInterrupt:
        say_line("")
        raise KeyboardInterrupt(_kept(options)) from None
    finally:
        say_line("")
    _print(options, made)
    return 0


def _kept(options: Namespace) -> str:
    """What an interrupted capture leaves, and how to go on with it."""
    if not is_capture(options.out):
        return "interrupted before anything was recorded"
    folder = open_capture(options.out)
    again = resuming(options, "capture", ("scene", "camera", "pixel_format", "wait_s", "board", "rig"))
    return kept_text(folder, options.out, again)


def kept_text(folder: Capture | TransportFolder, out: Path, again: str) -> str:
    """What there is of a folder of slices, and how to go on with it."""
    total = len(folder.manifest.slices)
    kept = total - len(folder.missing())
    return f"interrupted: {kept} of {total} slices are kept in {out}; go on with: {again}"


def resuming(options: Namespace, command: str, names: Sequence[str]) -> str:
    """The command line that goes on where this one stopped: with those of these options that were given."""
    words = ["slopegate", *command.split()]
    for name in given(options, names):
        words += [] if name == "scene" else [flag(name)]
        words.append(shlex.quote(str(getattr(options, name))))
    if settings := getattr(options, "board_settings", None):
        words += ["--board-settings", shlex.quote(",".join(f"{key}={value}" for key, value in settings.items()))]
    return " ".join([*words, "--out", shlex.quote(str(options.out)), "--resume"])


def _of_scene(options: Namespace) -> Recording:
    scene = opened(options)
    if options.resume:
        return scene.resume(options.out, noise=None if options.noise else False, seed=options.seed, say=say_line)
    return scene.record(
        options.out,
        _slices(options, scene),
        frames=options.frames or 1,
        dark=options.dark,
        skip_empty=options.skip_empty,
        noise=options.noise,
        seed=options.seed or 0,
        say=say_line,
    )


def _of_camera(options: Namespace) -> Recording:
    from slopegate.app.commands.capture_camera import record_camera

    return record_camera(options, lambda rig: _slices(options, rig))


def _slices(options: Namespace, rig: OpenRig) -> Slices:
    shape = slices_shape(options, rig)
    if options.delays_us is not None:
        exposure_us = shape.exposure_us if options.exposure_us is None else options.exposure_us
        assert exposure_us is not None
        return rig.slices_at(options.delays_us, exposure_us, **shape.speed)
    if options.near_m is not None:
        spacing: Spacing = options.spacing or "delay"
        return rig.plan_slices(
            options.near_m, options.far_m, options.count, spacing, **shape.speed, exposure_us=shape.exposure_us
        )
    from slopegate.app.api import OpenScene

    assert isinstance(rig, OpenScene)
    return rig.plan_lit_slices(options.count, **shape.speed, exposure_us=shape.exposure_us)


def _check(options: Namespace) -> None:
    check_subject(options)
    by_delay = options.delays_us is not None
    if options.camera is not None and not options.resume and options.near_m is None and not by_delay:
        raise CommandError(
            "how far the camera sees is not known: give --near-m and --far-m, or --delays-us and --exposure-us"
        )
    if options.exposure_us is not None and not by_delay:
        raise CommandError("--exposure-us goes with --delays-us: else the slices' number or a gate sets it")
    if by_delay and options.exposure_us is None and options.gate is None and options.thickness_m is None:
        raise CommandError("--delays-us and --exposure-us belong together, unless a gate sets the exposure")
    if options.exposure_us is not None and (options.gate is not None or options.thickness_m is not None):
        other = "--gate" if options.gate is not None else "--thickness-m"
        raise CommandError(f"--exposure-us and {other} contradict each other: give one of them")
    if by_delay and any(value is not None for value in (options.near_m, options.count, options.spacing)):
        raise CommandError("--delays-us stands in place of --near-m, --far-m, --count and --spacing")
    if (options.near_m is None) != (options.far_m is None):
        raise CommandError("--near-m and --far-m belong together")
    if options.near_m is not None and options.far_m <= options.near_m:
        raise CommandError(f"--far-m is {options.far_m:g}: it must be above --near-m ({options.near_m:g})")
    if options.spacing == "depth" and options.near_m is None:
        raise CommandError("--spacing depth needs --near-m and --far-m")
    if options.spacing == "depth" and options.count is None and given(options, ("gate", "thickness_m")):
        raise CommandError("--spacing depth needs --count beside a gate: its slices are not equally long")
    planned = given(options, _PLAN)
    if options.resume and (planned or options.dark or options.skip_empty):
        raise CommandError("--resume goes on with the plan in the folder: give no other plan beside it")


def check_one_subject(options: Namespace) -> None:
    """Refuse anything but either a scene or a camera."""
    if options.camera is None and options.scene is None:
        raise CommandError("give a SCENE ('slopegate scenes' lists some) or --camera ('slopegate devices')")
    if options.camera is not None and options.scene is not None:
        raise CommandError(f"a SCENE ({options.scene}) and --camera ({options.camera}) exclude each other: give one")


def check_subject(options: Namespace) -> None:
    """Refuse anything but a scene or a camera, with the options of the one and not of the other."""
    check_one_subject(options)
    if options.camera is None:
        if of_camera := given(options, _OF_CAMERA):
            raise CommandError(f"{flag(of_camera[0])} is for a camera: give --camera instead of a SCENE")
        return
    if not options.noise or options.seed is not None:
        raise CommandError("--no-noise and --seed are for a SCENE: a camera has the noise that it has")


def _print(options: Namespace, made: Recording) -> None:
    folder = made.capture.folder
    sidecar = folder.sidecar
    empty = [record.index for record in sidecar.slices if record.empty]
    report: dict[str, Any] = {
        "folder": str(folder.path),
        "scene": sidecar.capture.scene,
        "planned": len(sidecar.capture.slices),
        "taken": len(sidecar.slices),
        "missing": sidecar.missing,
        "empty": empty,
        "share_edges": share_edges(tuple(item.settings() for item in sidecar.capture.slices)),
        "frames_a_slice": sidecar.capture.frames,
        "frames_used": made.frames_used,
        "frames_lost": made.frames_lost,
        "frames_duplicated": made.frames_duplicated,
        "frames_discarded": made.frames_discarded,
        "slices": [record.model_dump(mode="json") for record in sidecar.slices],
        "dark": None if sidecar.dark is None else sidecar.dark.model_dump(mode="json"),
    }
    if options.json:
        print_json(report)
        return
    dark = " and a dark frame" if sidecar.dark is not None else ""
    print(f"{report['taken']} of {report['planned']} slices of {report['scene']}{dark} are in {folder.path}")
    print(f"  {frames_text(made.frames_used)} used, {made.frames_lost} lost")
    if made.frames_discarded:
        first = "the first ones after a change of settings, which may still show those before"
        print(f"  {frames_text(made.frames_discarded)} discarded: {first}")
    if empty:
        print(f"  {len(empty)} slices hold no light")


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
