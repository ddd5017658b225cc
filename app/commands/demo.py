"""`slopegate demo`: a tour of the window that leaves pictures."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from slopegate.app.commands.options import describe
from slopegate.app.commands.report import CommandError
from slopegate.app.commands.window import has_display

_VIRTUAL = ["xvfb-run", "-a", "-s", "-screen 0 1920x1200x24"]


def arguments(parser: ArgumentParser) -> None:
    """What it takes."""
    describe(
        parser,
        description="Opens the window, shows what it can do, and leaves screenshots and captured images in a folder:\n"
        "each image as a .tif of the sensor's counts with the settings inside, and as a .png to look at.",
        epilog="example:\n  slopegate demo --out demo-output",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("demo-output"), metavar="FOLDER", help="where the pictures go (demo-output)"
    )


def run(options: Namespace) -> int:
    """Tour the window, on a virtual display where there is no real one."""
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CommandError(f"--out: the folder {options.out} cannot be made ({error.strerror})") from None
    if not has_display():
        if shutil.which(_VIRTUAL[0]) is None:
            raise CommandError("there is no display, and xvfb-run, which makes a virtual one, is not installed")
        command = [*_VIRTUAL, sys.executable, "-m", "slopegate.app", "demo", "--out", str(options.out)]
        drawn = {"QT_QPA_PLATFORM": "xcb", "LIBGL_ALWAYS_SOFTWARE": "1"}
        done = subprocess.run(command, check=False, env={**os.environ, **drawn}, capture_output=True, text=True)
        print(done.stdout, end="")
        print(done.stderr, end="", file=sys.stderr)
        return done.returncode
    from slopegate.app.commands.tour import tour
    from slopegate.app.window.bugs import qt_messages_logged
    from slopegate.drivers.files.rig_files import load_rig

    with qt_messages_logged():
        files = tour(load_rig(None), options.out)
    print(f"{len(files)} pictures are in {options.out.resolve()}")
    return 0
