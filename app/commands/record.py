"""`slopegate record`: raw frames at one gate, of a scene or of what a camera sees, into a folder."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slopegate.app.commands.capture import add_camera, check_subject
from slopegate.app.commands.opening import opened
from slopegate.app.commands.options import (
    GATE,
    add_gate,
    add_overwrite,
    add_rig,
    add_scene_noise,
    asked_gate,
    describe,
    given,
    positive,
    whole,
)
from slopegate.app.commands.report import (
    hardware_warnings,
    print_json,
    print_warnings,
    say_line,
    settings_values,
)
from slopegate.app.session.describe import frames_text
from slopegate.app.session.durations import TimeLeft
from slopegate.drivers.captures.film import check_new_film, is_film

if TYPE_CHECKING:
    from slopegate.app.api import OpenFilm, OpenRig
    from slopegate.core.rig.settings import GateSettings
    from slopegate.drivers.captures.film_recorder import FilmProgress

MAX_SECONDS = 1e7
MAX_FRAMES = 100_000_000
INTERRUPTED = 130


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Records raw frames at one gate: of a scene on the virtual rig, 20 a second of its own time, or\n"
        "what a camera sees, as fast as it comes; with --every a time lapse. The folder gets TIFF stacks with every\n"
        "frame's time, number and gate inside (at most 2 GB a file), and a small preview to look at. Without --frames\n"
        "and --seconds it goes on until Ctrl-C. Whatever ends it, what has been recorded stays, and frames that the\n"
        "camera lost or the disk was too slow for are counted. A camera without a gate is recorded without one.",
        epilog="examples:\n  slopegate record hill --gate 'Only the car' --seconds 5 --out drive\n"
        "  slopegate record --camera ueye:4103123456 --rig R.toml --clock-mhz 76 --delay-us 1853 --exposure-us 400\n"
        "      --seconds 60 --out minute\n"
        "  slopegate record --camera video:0 --every 10 --out day",
    )
    parser.add_argument(
        "scene", metavar="SCENE", nargs="?", help="what to record (see 'slopegate scenes' and 'render')"
    )
    add_camera(parser)
    add_gate(parser.add_argument_group("the gate"))
    until = parser.add_mutually_exclusive_group()
    until.add_argument("--seconds", type=positive(MAX_SECONDS), metavar="S", help="end after so long")
    until.add_argument("--frames", type=whole(1, MAX_FRAMES), metavar="N", help="end after so many frames")
    parser.add_argument(
        "--every", type=positive(MAX_SECONDS), metavar="S", help="a time lapse: keep one frame every so many seconds"
    )
    add_scene_noise(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the recording's own folder")
    add_overwrite(parser)
    add_rig(parser)


def run(options: Namespace) -> int:
    """Record until the end that was asked for, or Ctrl-C; what there is, is told either way."""
    check_subject(options)
    check_new_film(options.out, options.overwrite)
    interrupted = False
    # at once: after an interrupted import, which leaves half of its modules, none may follow
    from slopegate.app.api import open_film

    try:
        film = _of_scene(options) if options.camera is None else _of_camera(options)
    except KeyboardInterrupt:
        if not is_film(options.out):
            raise
        interrupted, film = True, open_film(options.out)
    finally:
        say_line("")
    _tell(options, film)
    ends_by_itself = options.seconds is not None or options.frames is not None
    return INTERRUPTED if interrupted and ends_by_itself else 0


def _of_scene(options: Namespace) -> OpenFilm:
    scene = opened(options)
    gate = _gate(options, scene)
    return scene.film(
        options.out,
        gate,
        frames=options.frames,
        seconds=options.seconds,
        every_s=options.every,
        noise=options.noise,
        seed=options.seed or 0,
        overwrite=options.overwrite,
        watch=Teller().say,
    )


def _of_camera(options: Namespace) -> OpenFilm:
    from slopegate.app.commands.record_camera import film_camera

    asked = bool(given(options, GATE))
    plan = (lambda rig: _gate(options, rig)) if asked else None
    return film_camera(options, plan, Teller().say)


def _gate(options: Namespace, rig: OpenRig) -> GateSettings:
    """The gate of the options as the camera makes it."""
    gate = asked_gate(options, rig)
    print_warnings([*gate.warnings, *hardware_warnings(rig, gate.settings, "recorded so")])
    return gate.sent(rig)


class Teller:
    """Says on one line how far a recording is, with the time left as it is measured."""

    def __init__(self) -> None:
        self._left = TimeLeft()

    def say(self, progress: FilmProgress) -> None:
        """Called a few times a second."""
        if progress.state in ("waiting", "finishing"):
            say_line(progress.doing)
            return
        lost = f", {progress.lost} lost" if progress.lost else ""
        end = "Ctrl-C ends it" if progress.share is None else self._left.text(progress.share)
        told = f"{frames_text(progress.frames)}{lost}, {progress.seconds:.1f} s, {progress.bytes / 1e6:.0f} MB"
        say_line(f"{told}, {end}" if end else told)


def _tell(options: Namespace, film: OpenFilm) -> None:
    folder, end = film.folder, film.folder.counted()
    report: dict[str, Any] = {
        "folder": str(folder.path),
        "scene": film.scene_name,
        "frames": end.frames,
        "lost": end.lost,
        "lost_by_camera": end.lost_by_camera,
        "lost_by_disk": end.lost_by_disk,
        "repeated": end.repeated,
        "seconds": end.seconds,
        "bytes": end.bytes,
        "gate": None if film.applied is None else settings_values(film, film.applied),
        "files": [path.name for path in folder.files],
        "preview": None if folder.preview is None else folder.preview.name,
        "ended": end.ended,
    }
    if options.json:
        print_json(report)
        return
    print(f"{frames_text(end.frames)} of {film.scene_name} in {end.seconds:.2f} s are in {folder.path}")
    print(f"  {report['lost']} lost ({end.lost_by_camera} by the camera, {end.lost_by_disk} by the disk)")
    print(f"  {end.bytes / 1e6:.1f} MB, {', '.join(report['files']) or 'no file'}")
    print(f"  to look at: {report['preview'] or 'no preview'}; or open the folder in the window")
    print(f"  {end.ended}")
