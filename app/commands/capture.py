"""`slopegate capture`: slice by slice into a folder, through the same stream and recorder as in the window."""

from __future__ import annotations

import sys
from argparse import Namespace
from contextlib import ExitStack
from typing import Any

from slopegate.app.commands.capture_subject import OpenCamera, scene_subject
from slopegate.app.commands.report import CommandError, print_json, print_warnings, share_line_done
from slopegate.app.session.describe import frames_text
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.slices import (
    Slices,
    at_delays,
    depth_times,
    most_slices,
    occupied_times,
    share_edges,
    tile_depths,
    tile_times,
)
from slopegate.core.rig.checks import require
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import PixelClocks
from slopegate.drivers.captures.recorder import CaptureProgress, Recorder
from slopegate.drivers.captures.storage import (
    CaptureFolder,
    check_new_folder,
    create_capture,
    make_manifest,
    open_capture,
)
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.stream.stream import Stream

USUAL_COUNT = 16
POLL_S = 0.2
_PLAN = ("clock_mhz", "line_time_us", "near_m", "far_m", "count", "spacing", "delays_us", "exposure_us", "frames")
_OF_CAMERA = ("--pixel-format", "--wait-s", "--board", "--board-settings")


def run_capture(options: Namespace) -> int:
    """Record what is asked for, or what is missing; whatever was taken stays."""
    _check(options)
    if not options.resume:
        check_new_folder(options.out)
    begun = open_capture(options.out) if options.resume else None
    with ExitStack() as held:
        subject = _subject(options, held)
        folder = _created(options, subject) if begun is None else _resumed(begun, subject)
        progress = _record(subject, folder)
    if progress.state == "failed":
        raise CommandError(progress.doing)
    _print(options, folder, progress)
    return 0


def _subject(options: Namespace, held: ExitStack) -> OpenCamera:
    if options.camera is None:
        return scene_subject(options)
    from slopegate.app.commands.capture_camera import camera_subject

    return camera_subject(options, held)


def _check(options: Namespace) -> None:
    _check_subject(options)
    by_delay = options.delays_us is not None
    if by_delay != (options.exposure_us is not None):
        raise CommandError("--delays-us and --exposure-us belong together")
    if by_delay and any(value is not None for value in (options.near_m, options.count, options.spacing)):
        raise CommandError("--delays-us stands in place of --near-m, --far-m, --count and --spacing")
    if (options.near_m is None) != (options.far_m is None):
        raise CommandError("--near-m and --far-m belong together")
    if options.near_m is not None and options.far_m <= options.near_m:
        raise CommandError(f"--far-m is {options.far_m:g}: it must be above --near-m ({options.near_m:g})")
    if options.spacing == "depth" and options.near_m is None:
        raise CommandError("--spacing depth needs --near-m and --far-m")
    planned = [name for name in _PLAN if getattr(options, name) is not None]
    if options.resume and (planned or options.dark or options.skip_empty):
        raise CommandError("--resume goes on with the plan in the folder: give no other plan beside it")


def _check_subject(options: Namespace) -> None:
    """That it is either a scene or a camera, with the options of the one and not of the other."""
    of_camera = [name for name in _OF_CAMERA if getattr(options, name[2:].replace("-", "_")) is not None]
    if options.camera is None:
        if options.scene is None:
            raise CommandError("give a SCENE ('slopegate scenes' lists some) or --camera ('slopegate devices')")
        if of_camera:
            raise CommandError(f"{of_camera[0]} is for a camera: give --camera instead of a SCENE")
        return
    if options.scene is not None:
        raise CommandError(f"a SCENE ({options.scene}) and --camera ({options.camera}) exclude each other: give one")
    if not options.noise or options.seed is not None:
        raise CommandError("--no-noise and --seed are for a SCENE: a camera has the noise that it has")
    if options.board is None and options.board_settings is not None:
        raise CommandError("--board-settings are those of a board: give --board too")
    if not options.resume and options.near_m is None and options.delays_us is None:
        raise CommandError(
            "how far the camera sees is not known: give --near-m and --far-m, or --delays-us and --exposure-us"
        )


def _record(subject: OpenCamera, folder: CaptureFolder) -> CaptureProgress:
    """Run to the end; interrupted from the keyboard, what has been taken is written down first."""
    stream, camera = Stream(subject.camera), subject.camera
    recorder = Recorder(stream, folder, camera.cover if camera.info.can.cover else None, subject.clock)
    attend = subject.attend(stream, recorder)
    recorder.start()
    try:
        stream.start()
        while not recorder.wait(POLL_S):
            attend()
            _say(recorder.progress)
    finally:
        recorder.cancel()
        recorder.wait()
        share_line_done()
        try:
            stream.close()
        except CameraError as error:  # what there is to say of the capture matters more
            print_warnings([str(error)])
    return recorder.progress


def _resumed(folder: CaptureFolder, subject: OpenCamera) -> CaptureFolder:
    manifest = folder.manifest
    if folder.rig != subject.rig or not manifest.same_camera(subject.camera.info):
        raise CommandError(
            f"{folder.path} was begun with another scene, camera or rig ({manifest.scene}, "
            f"{manifest.camera.pixel_format}): it cannot be resumed with this"
        )
    return folder.set_damaged_aside()


def _created(options: Namespace, subject: OpenCamera) -> CaptureFolder:
    slices, info = _slices(options, subject), subject.camera.info
    frames = options.frames or 1
    return create_capture(
        options.out, make_manifest(subject.name, subject.rig, info, slices, frames, options.dark, options.skip_empty)
    )


def _slices(options: Namespace, subject: OpenCamera) -> Slices:
    rig = subject.rig
    line = _line_time(options, rig)
    if options.delays_us is not None:
        return at_delays(rig, line, options.exposure_us, options.delays_us)
    if options.near_m is not None:
        times = depth_times(rig, line, options.near_m, options.far_m)
        count = options.count or min(USUAL_COUNT, most_slices(rig, *times))
        return tile_depths(rig, line, options.near_m, options.far_m, count, options.spacing or "delay")
    assert subject.projector_row is not None
    lit = occupied_times(rig, line, subject.projector_row)
    if lit is None:
        raise CommandError("the projector lights nothing that the camera sees: give --near-m and --far-m")
    return tile_times(rig, line, *lit, options.count or min(USUAL_COUNT, most_slices(rig, *lit)))


def _line_time(options: Namespace, rig: Rig) -> float:
    if options.clock_mhz is not None:
        line = rig.camera.shutter.line
        clocked = isinstance(line, PixelClocks)
        require(clocked, "clock_mhz", options.clock_mhz, "left out: this rig's camera has line times (--line-time-us)")
        assert isinstance(line, PixelClocks)
        return line.nearest(line.line_time_us(options.clock_mhz))
    if options.line_time_us is not None:
        return rig.camera.shutter.line.nearest(options.line_time_us)
    return upright_line_time(rig)


def _say(progress: CaptureProgress) -> None:
    if sys.stderr.isatty():
        left = "" if progress.seconds_left is None else f", {progress.seconds_left:.0f} s left"
        print(f"\r{progress.doing}{left}".ljust(40), end="", file=sys.stderr, flush=True)


def _print(options: Namespace, folder: CaptureFolder, progress: CaptureProgress) -> None:
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
        "frames_used": progress.frames,
        "frames_lost": progress.tally.lost,
        "frames_duplicated": progress.tally.duplicated,
        "frames_discarded": progress.tally.discarded,
        "slices": [record.model_dump(mode="json") for record in sidecar.slices],
        "dark": None if sidecar.dark is None else sidecar.dark.model_dump(mode="json"),
    }
    if options.json:
        print_json(report)
        return
    dark = " and a dark frame" if sidecar.dark is not None else ""
    print(f"{report['taken']} of {report['planned']} slices of {report['scene']}{dark} are in {folder.path}")
    print(f"  {frames_text(progress.frames)} used, {progress.tally.discarded} discarded, {progress.tally.lost} lost")
    if empty:
        print(f"  {len(empty)} slices hold no light")
