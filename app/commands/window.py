"""`slopegate` alone opens the window."""

from __future__ import annotations

import os
import signal
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from slopegate.app.commands.options import NO_SKIP
from slopegate.app.commands.report import CommandError

if TYPE_CHECKING:
    from slopegate.app.session.tidying import Unsearched
    from slopegate.app.window.window import Window


def arguments(parser: ArgumentParser) -> None:
    """What `slopegate` takes without a command."""
    parser.add_argument(
        "--open",
        dest="window_scene",
        metavar="SCENE",
        help="show this scene (see 'slopegate scenes'), capture, recording, light transport or saved session",
    )
    parser.add_argument(
        "--rig",
        dest="window_rig",
        type=Path,
        metavar="RIG",
        help="open the window with this rig: a rig file (.toml), or beside, which ships",
    )
    parser.add_argument(
        "--camera",
        dest="window_camera",
        metavar="FAMILY:WHERE",
        help="stream from this camera in the window (see 'slopegate devices'); video:FILE plays a file or a folder",
    )
    parser.add_argument(
        "--faults",
        dest="window_faults",
        metavar="FAULTS",
        help="let the virtual camera imitate a faulty rig: trigger, link, plug, all, or numbers such as "
        "missed=0.05,jitter_us=150",
    )
    parser.add_argument(
        "--free-running",
        dest="window_free",
        action="store_true",
        help="with --camera: let it run by itself instead of waiting for the projector's sync signal",
    )
    parser.add_argument("--no-skip", dest="window_skip", action="store_false", help=f"in the window, {NO_SKIP}")


def run(options: Namespace) -> int:
    """Open the window and stay until it is closed."""
    if not has_display():
        raise CommandError(
            "there is no display (neither DISPLAY nor WAYLAND_DISPLAY is set): start it on a desktop, or let "
            "'slopegate demo' leave pictures of it"
        )
    from slopegate.app.session.tidying import Unsearched

    start = Unsearched()
    try:
        return _run(options, start)
    finally:
        start.end()


def _run(options: Namespace, start: Unsearched) -> int:
    from PySide6.QtWidgets import QApplication

    from slopegate.app.session.preferences import default_path
    from slopegate.app.window.bugs import qt_messages_logged
    from slopegate.app.window.window import Window
    from slopegate.drivers.cameras.faults import parse_faults
    from slopegate.drivers.contract.families import read_address
    from slopegate.drivers.files.rig_files import load_rig

    rig = load_rig(options.window_rig)
    camera = None if options.window_camera is None else read_address(options.window_camera)
    faults = None if options.window_faults is None else parse_faults(options.window_faults)
    if options.window_free and camera is None:
        raise CommandError("--free-running is for a camera: give --camera too")
    with qt_messages_logged():
        application = QApplication.instance() or QApplication(sys.argv[:1])
        application.setApplicationName("slopegate")
        window = Window(rig, default_path())
        if camera is not None:
            window.devices.hub.set_triggered(not options.window_free)
        with _signals_close(window):
            start.end()  # the window has one of its own by now
            window.show()
            window.open_first(options.window_scene, options.window_skip, camera, faults)
            return application.exec()


@contextmanager
def _signals_close(window: Window) -> Iterator[None]:
    """Ctrl+C in the terminal, and a session that ends, close the window without a question: what was set is kept."""
    from PySide6.QtCore import QTimer

    def close(*_: object) -> None:
        QTimer.singleShot(0, window.close_unasked)

    before = {number: signal.signal(number, close) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def has_display() -> bool:
    """Whether Qt will find a screen; asked first because without one it ends the process."""
    if not sys.platform.startswith("linux"):
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"))
