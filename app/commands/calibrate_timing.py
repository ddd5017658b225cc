"""`slopegate calibrate-timing`: when projector and camera scan, from gated pictures of a plane."""

from __future__ import annotations

import math
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.capture import add_camera, check_one_subject
from slopegate.app.commands.options import (
    MAX_SEED,
    add_overwrite,
    add_rig,
    add_scene_noise,
    add_screen,
    describe,
    flag,
    given,
    plane,
    whole,
)
from slopegate.app.commands.report import (
    CommandError,
    Row,
    old_rig_values,
    print_json,
    print_old_rig,
    print_table,
    print_warnings,
    say_line,
    settings_values,
)
from slopegate.drivers.files.durable import check_destination, write_durably

if TYPE_CHECKING:
    from slopegate.core.rig.rig import Rig
    from slopegate.drivers.calibrations.both_edges import PulseFound
    from slopegate.drivers.calibrations.plane_gates import TimingOutcome
    from slopegate.drivers.calibrations.timing_run import TimingPlan, TimingProgress
    from slopegate.drivers.stream.sieve import Tally

LEAST_FRAMES, MOST_FRAMES, USUAL_FRAMES = 12, 10_000, 400
_OF_SCENE = ("true_rig", "practice", "faults", "seed")
_OF_CAMERA = ("pixel_format", "wait_s", "board", "board_settings", "screen", "settle_frames", "transfer_us")
_NUMBERS = ("delay_offset_us", "active_fraction", "period_us", "clocks_per_line")


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Delay offset, active fraction, period, line time of every clock and the directions in which\n"
        "rows are drawn and read, each with its standard error, into a rig file: from gates whose light begins or\n"
        "ends on a plane. The gate that tells most is taken next, until all is known well enough. Of what the plane\n"
        "is: a chart whose pose the calibrated camera tells (--chart), a plane of known place (--plane), or anything,\n"
        "by patterns (a SCENE's own projector, or --screen). A capture of a plane through several gates does, too.",
        epilog="examples:\n  slopegate calibrate-timing chart_board --chart 13x9:60 --practice 7 --out timed.toml\n"
        "  slopegate calibrate-timing --camera ueye:4103123456 --rig lab.toml --chart 9x7:22 --out timed.toml\n"
        "  slopegate calibrate-timing my_capture --plane 0,0,1,-1.2 --out timed.toml --json",
    )
    parser.add_argument(
        "scene", metavar="SCENE|CAPTURE", nargs="?", help="a scene to practise with, or a capture of a plane"
    )
    add_camera(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="RIG.toml", help="the rig file to write")
    seen = parser.add_mutually_exclusive_group()
    seen.add_argument(
        "--chart", metavar="CHART", help="gates are seen on this chart, as 9x7:22 (see 'slopegate chart')"
    )
    seen.add_argument(
        "--plane",
        type=plane,
        metavar="A,B,C,D",
        help="gates are seen on the plane A x + B y + C z + D = 0, metres from the camera (x right, y down, z forward)",
    )
    parser.add_argument(
        "--frames",
        type=whole(LEAST_FRAMES, MOST_FRAMES),
        default=USUAL_FRAMES,
        metavar="N",
        help=f"at most so many gates ({USUAL_FRAMES})",
    )
    parser.add_argument(
        "--both-edges", action="store_true", help="then take gates by the trigger's falling edge: how long its pulse is"
    )
    scene = parser.add_argument_group("of a SCENE")
    hidden = scene.add_mutually_exclusive_group()
    hidden.add_argument(
        "--true-rig", type=Path, metavar="RIG", help="the rig that the scene is really seen with (default: --rig)"
    )
    hidden.add_argument(
        "--practice",
        type=whole(0, MAX_SEED),
        metavar="SEED",
        help="a rig whose timing differs from that of --rig, drawn by this number; it is told at the end",
    )
    scene.add_argument(
        "--faults",
        metavar="FAULTS",
        help="let its camera imitate a faulty rig: trigger, link, plug, all, or numbers such as missed=0.1,jitter_us=5",
    )
    add_scene_noise(parser)
    add_screen(parser.add_argument_group("with --camera"), "while patterns are shown")
    add_overwrite(parser)
    add_rig(parser)


@dataclass(frozen=True, eq=False)
class _Timed:
    """What was found, with what, and beside which rig."""

    name: str
    old: Rig
    outcome: TimingOutcome
    tally: Tally | None = None
    """Frames that were not used; None for a capture."""
    truth: Rig | None = None
    pulse: PulseFound | None = None
    """Of the trigger; None where it was not asked for."""


def run(options: Namespace) -> int:
    """Take gates, fit them, and write the rig."""
    _check(options)
    check_destination(options.out, (".toml",), overwrite=options.overwrite)
    from slopegate.drivers.calibrations.seen_target import WrongChartError
    from slopegate.drivers.files.rig_files import calibrated_rig_file

    try:
        timed = _of_scene_or_capture(options) if options.camera is None else _of_camera(options)
    except WrongChartError as error:
        raise CommandError(f"--chart {options.chart} is not the chart that is seen: {error}") from None
    finally:
        say_line("")
    write_durably(options.out, calibrated_rig_file(timed.outcome.rig, options.out))
    values = _values(options, timed)
    if options.json:
        print_json(values)
    else:
        _print(values)
        print_warnings(values["warnings"])
    return 0


def _check(options: Namespace) -> None:
    check_one_subject(options)
    if options.camera is None:
        if of_camera := given(options, _OF_CAMERA):
            raise CommandError(f"{flag(of_camera[0])} is for a camera: give --camera instead of a SCENE")
        return
    if of_scene := given(options, _OF_SCENE):
        raise CommandError(f"{flag(of_scene[0])} is for a SCENE: a camera has the rig and the faults that it has")
    if not options.noise:
        raise CommandError("--no-noise is for a SCENE: a camera has the noise that it has")
    if options.screen is None and options.chart is None and options.plane is None:
        raise CommandError(
            "it is not known which projector rows light what the camera sees: give --chart or --plane, or --screen, "
            "where patterns tell it"
        )


def _plan(options: Namespace) -> TimingPlan:
    from slopegate.core.calibration.chart import chart_from
    from slopegate.drivers.calibrations.seen_target import plane_target
    from slopegate.drivers.calibrations.timing_run import TimingPlan

    target = None if options.plane is None else plane_target(options.plane)
    return TimingPlan(target if options.chart is None else chart_from(options.chart), frames=options.frames)


def _say(progress: TimingProgress) -> None:
    lacks = "" if progress.timing is None or progress.verdict is None else f": {progress.verdict.reason}"
    say_line(progress.doing + lacks)


def _of_camera(options: Namespace) -> _Timed:
    from slopegate.app.commands.calibrate_timing_camera import time_camera

    name, old, outcome, tally, pulse = time_camera(options, _plan(options), _say)
    return _Timed(name, old, outcome, tally, pulse=pulse)


def _of_scene_or_capture(options: Namespace) -> _Timed:
    from slopegate.drivers.captures.exported import is_recorded
    from slopegate.drivers.scenes.scene_files import scene_path

    path = scene_path(options.scene)
    return _of_capture(options, path) if is_recorded(path) else _of_scene(options, path)


def _of_capture(options: Namespace, path: Path) -> _Timed:
    from slopegate.drivers.calibrations.timing_capture import timing_of_capture
    from slopegate.drivers.captures.exported import open_any
    from slopegate.drivers.files.rig_files import load_rig

    if of_scene := given(options, _OF_SCENE):
        raise CommandError(f"{flag(of_scene[0])} is for a SCENE: {path} is a capture")
    if options.both_edges:
        raise CommandError(f"--both-edges is for a SCENE or a camera: {path} is a capture")
    capture, target = open_any(path), _plan(options).target
    if target is None:
        raise CommandError("a capture does not tell where its plane is: give --chart or --plane")
    old = capture.rig if options.rig is None else load_rig(options.rig)
    outcome = timing_of_capture(capture, old, target, told=lambda share: say_line(f"reading slices {share:4.0%}"))
    return _Timed(capture.manifest.scene, old, outcome)


def _of_scene(options: Namespace, path: Path) -> _Timed:
    from slopegate.drivers.calibrations.both_edges import pulse_by_edges
    from slopegate.drivers.calibrations.practice import hidden_rig
    from slopegate.drivers.calibrations.timing_bench import TimingBench, timed_as
    from slopegate.drivers.calibrations.timing_run import TimingAttendance, run_timing
    from slopegate.drivers.cameras.faults import parse_faults
    from slopegate.drivers.files.rig_files import load_rig
    from slopegate.drivers.scenes.scene_files import open_scene

    plan, seed = _plan(options), options.seed or 0
    faults = None if options.faults is None else parse_faults(options.faults)
    believed = load_rig(options.rig)
    true = believed if options.true_rig is None else load_rig(options.true_rig)
    if options.practice is not None:
        true = timed_as(believed, hidden_rig(believed, options.practice))
    seen_by, scene = open_scene(path, true)
    # A folder with photo and depth brings its own camera.
    old = believed if seen_by is true else open_scene(path, believed)[0]
    bench = TimingBench(scene, seen_by, old, seed=seed, noise=options.noise, faults=faults)
    attendance, pulse = TimingAttendance(_say), None
    try:
        outcome = run_timing(bench.shots, old, plan, attendance, bench.projector)
        assert outcome is not None  # nobody gives up but by an interrupt
        if options.both_edges:
            first = outcome.timing
            pulse = pulse_by_edges(bench.camera, bench.shots, old, plan, first, attendance, bench.projector)
    finally:
        bench.close()
    return _Timed(scene.name, old, outcome, bench.shots.tally, None if true is believed else seen_by, pulse)


def _values(options: Namespace, timed: _Timed) -> dict[str, Any]:
    from slopegate.app.rig_gates import OpenRig
    from slopegate.core.calibration.compared import compared

    outcome, told = timed.outcome, _numbers(timed.outcome)
    against = compared(timed.old, outcome.rig)
    timing, useless, tally = outcome.timing, outcome.useless, timed.tally
    return {
        "scene": timed.name,
        "rig": timed.old.name,
        "file": str(options.out),
        **told,
        "line_time_us": [
            {
                "clock_mhz": line.clock_mhz,
                "set_us": line.set_us,
                "value": line.line_time_us,
                "standard_error": line.standard_error_us,
            }
            for line in outcome.line_times
        ],
        "rows": {"camera": timing.camera, "projector": timing.projector},
        "next_gate": settings_values(OpenRig(timed.old), outcome.next_gate),
        "enough": outcome.verdict.enough,
        "reason": outcome.verdict.reason,
        "open": list(outcome.open_numbers),
        "frames": outcome.frames,
        "edges": timing.edges,
        "left_out": asdict(useless) | ({} if tally is None else asdict(tally)),
        "jitter_us": timing.jitter_us,
        "exposure_excess_us": {
            "value": float(timing.values[3]),
            "standard_error": float(timing.standard_errors[3]),
        },
        "pulse_width_us": _pulse(timed.pulse),
        "differences": [asdict(one) for one in against.differences],
        "old_rig": old_rig_values(against),
        "truth": None if timed.truth is None else _truth(timed.truth, told),
        "facts": {} if outcome.rig.calibration is None else dict(outcome.rig.calibration.facts),
        "warnings": list(_warnings(timed)),
    }


def _numbers(outcome: TimingOutcome) -> dict[str, dict[str, float] | None]:
    """The rig's numbers of time, each with its standard error; None for clocks where line times are set directly."""
    from slopegate.core.rig.calibration import NUMBERS
    from slopegate.core.rig.uncertainty import numbers_of

    known = outcome.rig.calibration
    errors = {} if known is None else known.standard_errors
    values = dict(zip(NUMBERS, numbers_of(outcome.rig).tolist(), strict=True))
    return {
        name: {"value": values[name], "standard_error": errors[name]} if name in errors else None for name in _NUMBERS
    }


def _truth(truth: Rig, told: dict[str, dict[str, float] | None]) -> dict[str, dict[str, float]]:
    """The hidden rig's numbers, and by how many standard errors what was found is off."""
    from slopegate.core.rig.calibration import NUMBERS
    from slopegate.core.rig.uncertainty import numbers_of

    values, period_us = dict(zip(NUMBERS, numbers_of(truth).tolist(), strict=True)), truth.projector.period_us
    found = {}
    for name, number in told.items():
        if number is not None:
            gap = number["value"] - values[name]
            gap = math.remainder(gap, period_us) if name == "delay_offset_us" else gap
            found[name] = {"value": values[name], "off": gap, "sigmas": gap / number["standard_error"]}
    return found


def _pulse(found: PulseFound | None) -> dict[str, Any] | None:
    """The trigger's pulse: high between its rising and its falling edge, low where the falling one comes first."""
    if found is None or found.width is None:
        return None
    level = "high" if found.width.second == "falling" else "low"
    return {"value": found.width.width_us, "standard_error": found.width.error_us, "level": level}


def _warnings(timed: _Timed) -> Iterator[str]:
    from slopegate.drivers.calibrations.timing_run import more_gates

    outcome, pulse = timed.outcome, timed.pulse
    if pulse is not None and pulse.why_not:
        yield f"the trigger's pulse is not known: {pulse.why_not}"
    if not outcome.verdict.enough:
        more = more_gates(outcome, "--frames")
        yield f"not known well enough after {outcome.frames} gates: {outcome.verdict.reason}{more}"
    if outcome.open_numbers:
        yield (
            f"these gates do not tell {', '.join(outcome.open_numbers)}, which stays as the rig file has it; gates of "
            "other clocks, delays and exposures do"
        )
    turned = [name for name in ("camera", "projector") if getattr(outcome.timing, name) == "up"]
    if turned:
        yield f"rows of the {' and the '.join(turned)} count against the scan: the rig file written is turned round"


def _print(values: dict[str, Any]) -> None:
    print(f"{values['scene']} on {values['rig'] or 'this rig'}: the timing from {values['frames']} gates")
    units = {"delay_offset_us": "us", "active_fraction": "", "period_us": "us", "clocks_per_line": ""}
    rows: list[Row] = []
    for name, unit in units.items():
        number = values[name]
        if number is not None:
            rows.append((name.removesuffix("_us").replace("_", " "), number["value"], unit, _error(number)))
    for line in values["line_time_us"]:
        clock = f"at {line['clock_mhz']:g} MHz, " if line["clock_mhz"] is not None else ""
        rows.append(("line time", line["value"], "us", f"{clock}{line['set_us']:.4f} set; {_error(line)}"))
    rows += [
        ("camera rows", values["rows"]["camera"], "", "as the picture counts them"),
        ("projector rows", values["rows"]["projector"], "", "as the picture counts them"),
        ("jitter", values["jitter_us"], "us", "of the trigger"),
    ]
    pulse = values["pulse_width_us"]
    if pulse is not None:
        rows.append(("trigger pulse", pulse["value"], "us", f"{pulse['level']}; {_error(pulse)}"))
    print_table(rows)
    left_out = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in values["left_out"].items() if count)
    if left_out:
        print(f"  not used: {left_out}")
    print_old_rig(values["old_rig"]["sentences"])
    if values["truth"] is not None:
        print("The rig that this was tried on")
        print_table(
            [
                (
                    name.removesuffix("_us").replace("_", " "),
                    one["value"],
                    units[name],
                    f"{one['sigmas']:+.1f} errors off",
                )
                for name, one in values["truth"].items()
            ]
        )
    print(f"  {values['file']} is written")


def _error(number: dict[str, float]) -> str:
    return f"standard error {number['standard_error']:.2g}"
