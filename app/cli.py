"""The command line: `slopegate` opens the window, its sub-commands script the rest.

Programs rely on it: `--json` prints one JSON object on standard output and nothing else; an error is one sentence on
standard error with exit code 2. Commands are imported when they run, so that `slab` starts without Qt or numba.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence

from slopegate.app.commands import window
from slopegate.app.commands.options import is_number
from slopegate.app.commands.registry import command_parser
from slopegate.app.commands.report import CommandError


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 2 refused with a sentence, 130 interrupted."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = _run(sys.argv[1:] if argv is None else argv)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print("slopegate: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # whoever read our output has gone: nothing is left to say
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2
    except _refusals() as error:
        print(f"slopegate: {_sentence(error)}", file=sys.stderr)
        return 2


def _run(argv: Sequence[str]) -> int:
    try:
        options = command_parser().parse_args(_glue_negative(argv))
    except SystemExit as stop:  # --help and --version
        return int(stop.code or 0)
    of_window = (options.window_scene, options.window_rig, options.window_camera, options.window_faults)
    if options.run is not window.run and any(of_window):
        raise CommandError(
            "--open, --rig, --camera and --faults before the command are for the window: give --rig, and the --camera "
            "of a capture, after the command"
        )
    return int(options.run(options))


def _refusals() -> tuple[type[Exception], ...]:
    """Errors that are the user's to mend. Anything else is a fault of the program and shows its traceback."""
    from slopegate.drivers.contract.camera import CameraError
    from slopegate.drivers.files.durable import StorageError
    from slopegate.drivers.files.errors import SceneError
    from slopegate.drivers.files.rig_files import RigError

    return (
        CommandError,
        CameraError,
        RigError,
        SceneError,
        StorageError,
        ValueError,
        ArithmeticError,
        OSError,
        ImportError,
        MemoryError,
    )


def _sentence(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return "there is not enough memory for this"
    if isinstance(error, ArithmeticError):
        return f"these numbers lead beyond what can be computed ({error})"
    return " ".join(str(error).split()) or type(error).__name__


def _glue_negative(argv: Sequence[str]) -> list[str]:
    """`--delay-us -1e3` -> `--delay-us=-1e3`: argparse itself takes numbers with an exponent for options."""
    glued: list[str] = []
    for word in argv:
        negative = word.startswith("-") and is_number(word.split(",")[0])
        if negative and glued and glued[-1].startswith("--") and "=" not in glued[-1]:
            glued[-1] += f"={word}"
        else:
            glued.append(word)
    return glued
