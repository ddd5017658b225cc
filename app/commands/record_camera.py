"""`slopegate record --camera`: a real camera, which may refuse, wait or vanish."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack

from slopegate.app.api import OpenFilm, OpenRig, filmed
from slopegate.app.commands.capture_camera import USUAL_WAIT_S, SilenceWatch, opened_camera
from slopegate.app.commands.report import CommandError, print_warnings
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.film import create_film, make_film_manifest
from slopegate.drivers.captures.film_recorder import FilmLimits, FilmProgress, FilmRecorder
from slopegate.drivers.captures.film_run import run_film
from slopegate.drivers.contract.device_rig import no_gate
from slopegate.drivers.stream.stream import Stream


def film_camera(
    options: Namespace,
    plan: Callable[[OpenRig], GateSettings] | None,
    say: Callable[[FilmProgress], object],
) -> OpenFilm:
    """Record what the camera at the address named sees; `plan` says with which gate, once its rig is known.

    Raises InputError for what is no address, RigError, StorageError, and CommandError for a camera that does not open,
    or has a gate and is given none.
    """
    limits = FilmLimits(options.frames, options.seconds, options.every)
    with ExitStack() as held:
        camera, rig = opened_camera(options, held, gated=plan is not None)
        info = camera.info
        if plan is None and not no_gate(info):
            raise CommandError(
                f"{info.name} has a gate: give --clock-mhz, --delay-us and --exposure-us, or --gate 'Everything lit'"
            )
        gate = None if plan is None else plan(OpenRig(rig))
        folder = create_film(
            options.out, make_film_manifest(info.name, rig, info, gate, limits.every_s), options.overwrite
        )
        wait_s = options.wait_s or USUAL_WAIT_S

        def attend(stream: Stream, recorder: FilmRecorder) -> Callable[[], object]:
            watch = SilenceWatch(camera, wait_s, stream, recorder)

            def look() -> None:
                watch.look(camera.trouble)
                say(recorder.progress)

            return look

        ended = run_film(camera, folder, limits, attend, lambda sentence: print_warnings([sentence]))
        print_warnings([ended.remark] if ended.remark else [])
        return filmed(folder, ended)
