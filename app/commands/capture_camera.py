"""`slopegate capture --camera`: what is to be recorded is seen by a real camera, which may refuse, wait or vanish."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

from slopegate.app.commands.capture_board import with_board
from slopegate.app.commands.capture_subject import OpenCamera
from slopegate.app.commands.report import CommandError, print_warnings, share_line_done
from slopegate.app.session.letting_go import LettingGo
from slopegate.drivers.captures.recorder import Recorder
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.contract.device_rig import device_rig, no_gate, no_slab
from slopegate.drivers.contract.families import read_address
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.devices.catalog import VIRTUAL, no_gate_at, open_camera
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.stream.stream import Stream

USUAL_WAIT_S = 10.0
CLOSE_S = 10.0


def camera_subject(options: Namespace, held: ExitStack) -> OpenCamera:
    """The camera at the address named, open, triggered, and able to make a gate; `held` closes it.

    Raises InputError for what is no address, RigError, and CommandError for a camera that does not open or has no gate.
    """
    address, rig = read_address(options.camera), load_rig(options.rig)
    if address.family == VIRTUAL.key:
        raise CommandError(f"{address} only looks at scenes: give a SCENE instead of --camera")
    never = no_gate_at(address)
    if never:  # not opened in vain, for a webcam lights its lamp
        raise CommandError(f"{address} cannot record slices: {never}")
    try:
        camera = open_camera(address.family, address.where, rig, OpenOptions(pixel_format=options.pixel_format))
    except CameraError as error:
        raise CommandError(f"{address} did not open: {error}") from None
    closing = LettingGo()  # a device that hangs is left behind
    held.callback(closing.wait, CLOSE_S)
    held.callback(closing.begin, camera.close, "the camera")
    wait_s = options.wait_s or USUAL_WAIT_S
    _refuse(camera, no_slab(camera.info))
    if options.board is not None:
        camera = with_board(camera, options, rig.projector.period_us, wait_s, held)
    _refuse(camera, no_gate(camera.info))
    info = camera.info
    seen, remark = device_rig(rig, info)
    print_warnings([remark] if remark else [])
    return OpenCamera(info.name, seen, camera, time.monotonic, partial(_attended, camera, wait_s))


def _refuse(camera: Camera, missing: str) -> None:
    if missing:
        raise CommandError(f"{camera.info.name} cannot record slices: {missing}")


def _attended(camera: Camera, wait_s: float, stream: Stream, recorder: Recorder) -> Callable[[], None]:
    return Attendant(camera, wait_s, stream, recorder).look


class Attendant:
    """Looks after a capture that nobody sees: asks for what only hands can do, and waits for nothing that is gone.

    A camera or board that comes back in time goes on as if nothing had been, for both are connected anew by themselves.
    """

    def __init__(
        self,
        camera: Camera,
        wait_s: float,
        stream: Stream,
        recorder: Recorder,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._camera, self._wait_s, self._stream, self._recorder, self._clock = camera, wait_s, stream, recorder, clock
        self._made, self._heard_s = 0, clock()

    def look(self) -> None:
        """Called a few times a second while the recorder is at work."""
        progress, trouble = self._recorder.progress, self._camera.trouble
        if progress.state == "waiting":
            self._ask(progress.doing)
        elif progress.state == "running" and trouble:
            self._recorder.pause()  # while the gate is not known, no frame counts
        elif progress.state == "paused" and not trouble:
            self._recorder.resume()
        made, now_s = self._stream.counters.made, self._clock()
        if progress.state == "waiting" or (made != self._made and not trouble):
            self._heard_s = now_s
        elif now_s - self._heard_s > self._wait_s:
            self._recorder.fail(trouble or self._silence())
        self._made = made

    def _ask(self, doing: str) -> None:
        """What only hands can do; the capture goes on at the end of a line on standard input."""
        share_line_done()
        print(f"{doing} with Enter", file=sys.stderr, flush=True)
        if sys.stdin.readline():
            self._recorder.resume()
        else:
            self._recorder.fail("The dark frame needs somebody at the lens, and standard input has ended")

    def _silence(self) -> str:
        why = self._stream.error or "without the projector's sync signal on its trigger input it waits for ever"
        return f"{self._camera.info.name} has sent no frame for {self._wait_s:g} s: {why}"
