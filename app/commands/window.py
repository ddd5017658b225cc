"""`slopegate` alone opens the window; `slopegate demo` lets it show itself."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from argparse import Namespace

from slopegate.app.commands.report import CommandError

_VIRTUAL = ["xvfb-run", "-a", "-s", "-screen 0 1920x1200x24"]


def run_window(options: Namespace) -> int:
    """Open the window and stay until it is closed."""
    if not _display():
        raise CommandError(
            "there is no display (neither DISPLAY nor WAYLAND_DISPLAY is set): start it on a desktop, or let "
            "'slopegate demo' leave pictures of it"
        )
    from PySide6.QtWidgets import QApplication
    from slopegate.app.session.preferences import default_path
    from slopegate.app.window.window import Window
    from slopegate.drivers.cameras.faults import parse_faults
    from slopegate.drivers.contract.families import read_address
    from slopegate.drivers.files.rig_files import load_rig

    rig = load_rig(options.window_rig)
    camera = None if options.window_camera is None else read_address(options.window_camera)
    faults = None if options.window_faults is None else parse_faults(options.window_faults)
    if options.window_free and camera is None:
        raise CommandError("--free-running is for a camera: give --camera too")
    application = QApplication.instance() or QApplication(sys.argv[:1])
    application.setApplicationName("slopegate")
    window = Window(rig, default_path())
    if camera is not None:
        window.devices.hub.set_triggered(not options.window_free)
    window.show()
    window.open_first(options.window_scene, options.window_skip, camera, faults)
    return application.exec()


def run_demo(options: Namespace) -> int:
    """Tour the window, on a virtual display where there is no real one."""
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CommandError(f"--out: the folder {options.out} cannot be made ({error.strerror})") from None
    if not _display():
        if shutil.which(_VIRTUAL[0]) is None:
            raise CommandError("there is no display, and xvfb-run, which makes a virtual one, is not installed")
        command = [*_VIRTUAL, sys.executable, "-m", "slopegate.app", "demo", "--out", str(options.out)]
        drawn = {"QT_QPA_PLATFORM": "xcb", "LIBGL_ALWAYS_SOFTWARE": "1"}
        return subprocess.run(command, check=False, env={**os.environ, **drawn}).returncode
    from slopegate.app.commands.tour import run
    from slopegate.drivers.files.rig_files import load_rig

    files = run(load_rig(None), options.out)
    print(f"{len(files)} pictures are in {options.out.resolve()}")
    return 0


def _display() -> bool:
    """Whether Qt will find a screen; asked first because without one it ends the process."""
    if not sys.platform.startswith("linux"):
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"))
