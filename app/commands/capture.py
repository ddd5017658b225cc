"""`slopegate capture`: a scene slice by slice into a folder, through the same stream and recorder as in the window."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from typing import Any

from slopegate.app.commands.report import CommandError, print_json, share_line_done
from slopegate.app.commands.scene import opened
from slopegate.app.describe import frames_text
from slopegate.core.checks import require
from slopegate.core.rig import Rig
from slopegate.core.settings import PixelClocks
from slopegate.core.slices import (
    Slices,
    at_delays,
    depth_times,
    level_line_time,
    most_slices,
    occupied_times,
    share_edges,
    tile_depths,
    tile_times,
)
from slopegate.drivers.recorder import Recorder
from slopegate.drivers.recorder_state import Progress
from slopegate.drivers.storage import CaptureFolder, check_new_folder, create_capture, make_manifest, open_capture
from slopegate.drivers.stream import Stream
from slopegate.drivers.virtual import VirtualCamera

USUAL_COUNT = 16
POLL_S = 0.2
RATE_HZ = 20.0
_PLAN = ("clock_mhz", "line_time_us", "near_m", "far_m", "count", "spacing", "delays_us", "exposure_us", "frames")


class _SceneClock:
    """Time that passes only while the camera waits for its next frame: a capture takes no longer than computing it.

    It stands still while a slice is being written, so that no frame goes by and equal seeds make equal captures.
    """

    def __init__(self) -> None:
        self._now_s = 0.0
        self.recorder: Recorder | None = None

    def now(self) -> float:
        return self._now_s

    def sleep(self, seconds: float) -> None:
        while self.recorder is not None and self.recorder.writing:
            time.sleep(0.0005)
        self._now_s += seconds


def run_capture(options: Namespace) -> int:
    """Record what is asked for, or what is missing; whatever was taken stays."""
    _check(options)
    if not options.resume:
        check_new_folder(options.out)
    begun = open_capture(options.out) if options.resume else None
    rig, scene = opened(options)
    clock = _SceneClock()
    camera = VirtualCamera(
        rig, scene, rate_hz=RATE_HZ, noise=options.noise, seed=options.seed, clock=clock.now, sleep=clock.sleep
    )
    camera.prepare(lambda _: True)
    folder = _created(options, camera, rig, scene.name) if begun is None else _resumed(begun, camera, rig)
    stream = Stream(camera)
    recorder = clock.recorder = Recorder(stream, folder, camera.cover, clock.now)
    _record(stream, recorder)
    progress = recorder.progress
    if progress.state == "failed":
        raise CommandError(progress.doing)
    _print(options, folder, progress)
    return 0


def _check(options: Namespace) -> None:
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


def _record(stream: Stream, recorder: Recorder) -> None:
    """Run to the end; interrupted from the keyboard, what has been taken is written down first."""
    recorder.start()
    try:
        stream.start()
        while not recorder.wait(POLL_S):
            _say(recorder.progress)
    finally:
        recorder.cancel()
        recorder.wait()
        share_line_done()
        stream.close()


def _resumed(folder: CaptureFolder, camera: VirtualCamera, rig: Rig) -> CaptureFolder:
    facts = folder.manifest.camera
    same = folder.rig == rig and facts.name == camera.info.name
    if not same:
        raise CommandError(
            f"{folder.path} was begun with another scene or rig ({facts.name}): it cannot be resumed with this"
        )
    return folder.set_damaged_aside()


def _created(options: Namespace, camera: VirtualCamera, rig: Rig, scene: str) -> CaptureFolder:
    slices = _slices(options, camera, rig)
    frames = options.frames or 1
    return create_capture(
        options.out, make_manifest(scene, rig, camera.info, slices, frames, options.dark, options.skip_empty)
    )


def _slices(options: Namespace, camera: VirtualCamera, rig: Rig) -> Slices:
    line = _line_time(options, rig)
    if options.delays_us is not None:
        return at_delays(rig, line, options.exposure_us, options.delays_us)
    if options.near_m is not None:
        times = depth_times(rig, line, options.near_m, options.far_m)
        count = options.count or min(USUAL_COUNT, most_slices(rig, *times))
        return tile_depths(rig, line, options.near_m, options.far_m, count, options.spacing or "delay")
    assert camera.buffers is not None
    lit = occupied_times(rig, line, camera.buffers.projector_row)
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
    return level_line_time(rig)


def _say(progress: Progress) -> None:
    if sys.stderr.isatty():
        left = "" if progress.seconds_left is None else f", {progress.seconds_left:.0f} s left"
        print(f"\r{progress.doing}{left}".ljust(40), end="", file=sys.stderr, flush=True)


def _print(options: Namespace, folder: CaptureFolder, progress: Progress) -> None:
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
