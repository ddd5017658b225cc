"""`slopegate capture --camera`: a real camera, which may refuse, wait or vanish, and a board that makes its delay."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

from pydantic import ValidationError

from slopegate.app.api import OpenRig, Recording, finished
from slopegate.app.commands.report import CommandError, print_warnings, say_line
from slopegate.app.session.letting_go import LettingGo
from slopegate.core.gating.slices import Slices
from slopegate.core.rig.rig import Rig
from slopegate.drivers.captures.capture_run import run_capture
from slopegate.drivers.captures.film_recorder import FilmRecorder
from slopegate.drivers.captures.recorder import Recorder
from slopegate.drivers.captures.storage import create_capture, make_manifest
from slopegate.drivers.captures.storage import open_capture as open_folder
from slopegate.drivers.contract.camera import Camera, CameraError
from slopegate.drivers.contract.device_rig import device_rig, no_gate, no_timing
from slopegate.drivers.contract.families import read_address
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.devices.catalog import VIRTUAL, no_gate_at, open_camera
from slopegate.drivers.files.errors import told_fault
from slopegate.drivers.files.rig_files import load_rig
from slopegate.drivers.stream.stream import Stream
from slopegate.drivers.sync.board_delay import BoardDelay
from slopegate.drivers.sync.boards import BoardChoice, dialect_of, who_answers
from slopegate.drivers.sync.dialect import BoardError
from slopegate.drivers.sync.serial_port import PortError

FAMILY = "serial:"
USUAL_WAIT_S = 10.0
CLOSE_S = 10.0


def record_camera(options: Namespace, plan: Callable[[OpenRig], Slices]) -> Recording:
    """Record what the camera at the address named sees; `plan` says with which gates, once its rig is known.

    Raises InputError for what is no address, RigError, StorageError, and CommandError for a camera that does not open
    or has no gate.
    """
    begun = open_folder(options.out) if options.resume else None
    with ExitStack() as held:
        camera, rig = opened_camera(options, held)
        info = camera.info
        if begun is None:
            frames = options.frames or 1
            manifest = make_manifest(info.name, rig, info, plan(OpenRig(rig)), frames, options.dark, options.skip_empty)
            folder = create_capture(options.out, manifest)
        else:
            begun.require_begun_with(rig, info)
            folder = begun.set_damaged_aside()
        attend = partial(_attended, camera, options.wait_s or USUAL_WAIT_S)
        return finished(folder, run_capture(camera, folder, attend, lambda sentence: print_warnings([sentence])))


def opened_camera(options: Namespace, held: ExitStack, gated: bool = True) -> tuple[Camera, Rig]:
    """The camera of the options, open and triggered, and its rig; `held` closes it.

    gated: refuse a camera that cannot make a gate. Raises InputError for what is no address, RigError, and CommandError
    for a camera that does not open.
    """
    if options.board is None and options.board_settings is not None:
        raise CommandError("--board-settings are those of a board: give --board too")
    address, rig = read_address(options.camera), load_rig(options.rig)
    if address.family == VIRTUAL.key:
        raise CommandError(f"{address} only looks at scenes: give a SCENE instead of --camera")
    never = no_gate_at(address)
    if never and gated:  # not opened in vain, for a webcam lights its lamp
        raise CommandError(f"{address} cannot record with a gate: {never}")
    try:
        camera = open_camera(address.family, address.where, rig, OpenOptions(pixel_format=options.pixel_format))
    except CameraError as error:
        raise CommandError(f"{address} did not open: {error}") from None
    closing = LettingGo()  # a device that hangs is left behind
    held.callback(closing.wait, CLOSE_S)
    held.callback(closing.begin, camera.close, "the camera")
    if gated or options.board is not None:
        _refuse(camera, no_timing(camera.info))
    if options.board is not None:
        camera = _with_board(camera, options, rig.projector.period_us, held)
    if gated:
        _refuse(camera, no_gate(camera.info))
    seen, remark = device_rig(rig, camera.info)
    print_warnings([remark] if remark else [])
    return camera, seen


def _refuse(camera: Camera, missing: str) -> None:
    if missing:
        raise CommandError(f"{camera.info.name} cannot record with a gate: {missing}")


def _attended(camera: Camera, wait_s: float, stream: Stream, recorder: Recorder) -> Callable[[], None]:
    return Attendant(camera, wait_s, stream, recorder).look


class SilenceWatch:
    """Ends the work of a camera that has sent nothing for too long, or whose gate has not been known so long."""

    def __init__(self, camera: Camera, wait_s: float, stream: Stream, recorder: Recorder | FilmRecorder) -> None:
        self._camera, self._wait_s, self._stream, self._recorder = camera, wait_s, stream, recorder
        self._made, self._heard_s = 0, time.monotonic()

    def look(self, trouble: str, waiting: bool = False) -> None:
        """Called a few times a second. `trouble`: why the gate is not known; `waiting`: for somebody's hands."""
        made, now_s = self._stream.counters.made, time.monotonic()
        if waiting or (made != self._made and not trouble):
            self._heard_s = now_s
        elif now_s - self._heard_s > self._wait_s:
            self._recorder.fail(trouble or silence(self._camera, self._stream, self._wait_s))
        self._made = made


class Attendant:
    """Looks after a capture that nobody sees: asks for what only hands can do, and waits for nothing that is gone.

    A camera or board that comes back in time goes on as if nothing had been, for both are connected anew by themselves.
    """

    def __init__(self, camera: Camera, wait_s: float, stream: Stream, recorder: Recorder) -> None:
        self._camera, self._recorder = camera, recorder
        self._watch = SilenceWatch(camera, wait_s, stream, recorder)

    def look(self) -> None:
        """Called a few times a second while the recorder is at work."""
        progress, trouble = self._recorder.progress, self._camera.trouble
        if progress.state == "waiting":
            self._ask(progress.doing)
        elif progress.state == "running" and trouble:
            self._recorder.pause()  # while the gate is not known, no frame counts
        elif progress.state == "paused" and not trouble:
            self._recorder.resume()
        self._watch.look(trouble, progress.state == "waiting")
        say_line(progress.sentence)

    def _ask(self, doing: str) -> None:
        """What only hands can do; the capture goes on at the end of a line on standard input."""
        say_line("")
        print(f"{doing} with Enter", file=sys.stderr, flush=True)
        if sys.stdin.readline():
            self._recorder.resume()
        else:
            self._recorder.fail("The dark frame needs somebody at the lens, and standard input has ended")


def silence(camera: Camera, stream: Stream, wait_s: float) -> str:
    """Why nothing came for so long, in a sentence."""
    why = stream.error or "without the projector's sync signal on its trigger input it waits for ever"
    return f"{camera.info.name} has sent no frame for {wait_s:g} s: {why}"


def _with_board(camera: Camera, options: Namespace, period_us: float, held: ExitStack) -> Camera:
    """The camera with its delay made by the board named, which has answered; `held` lets the board go.

    Raises InputError and CommandError for a board that does not answer or cannot do this.
    """
    choice, wait_s = _choice(options), options.wait_s or USUAL_WAIT_S
    choice.check()
    board = choice.board()
    delayed = BoardDelay(camera, board, period_us, choice.pulse())
    board.start()
    held.callback(board.close)
    if not board.wait_ready(wait_s):
        raise CommandError(board.status.sentence or f"the board at {choice.where} has not answered for {wait_s:g} s")
    return delayed


def _choice(options: Namespace) -> BoardChoice:
    """The board by its port and the numbers given; its kind and speed by asking, where they are not given."""
    where, given = options.board.removeprefix(FAMILY), dict(options.board_settings or {})
    if "dialect" not in given:
        try:
            _, dialect, baud = who_answers(where)
        except (BoardError, PortError) as error:
            raise CommandError(f"{options.board} did not open: {error}") from None
        given = {"dialect": dialect.key, "baud": str(baud)} | given
    elif "baud" not in given:
        given["baud"] = str(dialect_of(given["dialect"]).bauds[0])
    try:
        return BoardChoice.model_validate({"where": where} | given)
    except ValidationError as error:
        raise CommandError(f"--board-settings: {told_fault(error)}") from None
