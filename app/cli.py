"""The command line: `slopegate` opens the window, its sub-commands script the rest.

Programs rely on it: `--json` prints one JSON object on standard output and nothing else. An error that the user can
mend is one sentence on standard error with exit code 2. A bug is one sentence with exit code 1, and its traceback is in
the log. Commands are imported when they run, so that `slab` starts without Qt or numba.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from slopegate.app.commands import window
from slopegate.app.commands.options import is_number
from slopegate.app.commands.registry import command_parser
from slopegate.app.commands.report import CommandError
from slopegate.app.session.log import LogFile, logging_to_file, user_sentence
from slopegate.app.session.terminal import own_terminal

_log = logging.getLogger(__name__)


def program() -> NoReturn:
    """Run the command of the process's own command line, and end the process with its exit code."""
    code = main()
    widgets = sys.modules.get("PySide6.QtWidgets")
    application = widgets and widgets.QApplication.instance()
    if application is None:
        sys.exit(code)
    # All that is to be kept has been written. Taking every widget and compiled loop to pieces would need seconds more,
    # and a thread that still computes what nobody waits for could crash in it. What was copied stays on the clipboard.
    application.shutdown()
    os._exit(code)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    0: done. 1: a bug, or the answer of a command that checks something is no. 2: refused with a sentence.
    130: interrupted.
    """
    words = sys.argv[1:] if argv is None else argv
    debug = "--debug" in words
    with own_terminal(debug), logging_to_file(words, debug) as log:
        try:
            code = _run(words)
            sys.stdout.flush()
            return code
        except KeyboardInterrupt as stop:  # with a sentence, where something is kept
            print(f"slopegate: {str(stop) or 'interrupted'}", file=sys.stderr)
            return 130
        except BrokenPipeError:  # whoever read our output has gone: nothing is left to say
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 2
        except Exception as error:
            return _tell(error, log)


def _tell(error: Exception, log: LogFile) -> int:
    """Say what went wrong, and return the exit code."""
    sentence = user_sentence(error)
    if sentence is None:
        _log.error("The command failed", exc_info=error)
        sentence = f"this is a bug of the program ({type(error).__name__})"
    elif not log.bugs:
        print(f"slopegate: {sentence}", file=sys.stderr)
        return 2
    print(f"slopegate: {sentence}: {log.where}", file=sys.stderr)
    return 1


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
