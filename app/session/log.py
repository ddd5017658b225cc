"""The log file, and the one place that tells what is the user's to mend from a bug of the program.

A `UserError`, a file that cannot be read or written and too little memory are told in a sentence and leave no trace.
Everything else is a bug: a log record of level ERROR with its traceback. The file holds version, platform, the command,
paths and settings, and nothing else about the user. It is made only when there is something to write.
"""

from __future__ import annotations

import logging
import platform
import shlex
import sys
import threading
import traceback
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Final

import platformdirs

from slopegate.core.rig.checks import UserError, escaped, printable
from slopegate.drivers.files.durable import FULL

LIMIT_BYTES: Final = 500_000
BACKUPS: Final = 3
WAITING: Final = 20
"""Entries that wait to be written: the last steps before something went wrong, or what could not be written."""
PROGRAM: Final = "slopegate"
TOLD: Final = f"{PROGRAM}.told"
"""Logger of sentences for the user that nobody was there to show."""

_log = logging.getLogger(__name__)


def log_path() -> Path:
    """Where this platform wants the log."""
    return Path(platformdirs.user_log_dir("slopegate", appauthor=False)) / "slopegate.log"


def user_sentence(error: BaseException) -> str | None:
    """What is wrong, for the user to mend; None where the error is a bug."""
    if isinstance(error, UserError):
        return printable(" ".join(str(error).split())) or type(error).__name__
    if isinstance(error, MemoryError):
        return "there is not enough memory for this"
    if isinstance(error, OSError) and error.filename is not None:
        return printable(f"{error.filename} cannot be read or written ({error.strerror})")
    if isinstance(error, OSError) and error.errno in FULL:
        return "the disk is full"
    return None


def sentence_of(error: Exception, doing: str) -> str:
    """What the user is told of an error. A bug is logged with its traceback; `doing` is what failed."""
    sentence = user_sentence(error)
    if sentence is None:
        _log.error("%s failed", doing, exc_info=error)
        return bug_sentence(type(error))
    return sentence


def bug_sentence(kind: type[BaseException] | None) -> str:
    """What the user is told of a bug."""
    name = "an error" if kind is None else kind.__name__
    return f"Something went wrong inside the program ({name}): the log has the details"


def is_bug(record: logging.LogRecord) -> bool:
    """Whether this record tells of a bug of the program."""
    ours = record.name.partition(".")[0] == PROGRAM
    return ours and record.levelno >= logging.ERROR and bool(record.exc_info)


class Repeats(logging.Filter):
    """Lets a traceback pass the 1st, 10th, 100th ... time: what fails at every frame must not fill the log."""

    def __init__(self) -> None:
        super().__init__()
        self._times: Counter[tuple[object, ...]] = Counter()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether it is new enough."""
        if not record.exc_info or record.exc_info[2] is None:
            return True
        way = (f"{frame.f_code.co_filename}:{line}" for frame, line in traceback.walk_tb(record.exc_info[2]))
        place = record.name, record.msg, record.exc_info[0], *way
        self._times[place] += 1
        return str(self._times[place]).rstrip("0") == "1"


class _Escaped(logging.Formatter):
    """For people who read the file in a terminal."""

    def format(self, record: logging.LogRecord) -> str:
        return escaped(super().format(record), allowed="\n\t")


class LogFile(RotatingFileHandler):
    """The file is open only while a record is written, so that several processes can share it and rename it."""

    def __init__(self, path: Path, words: Sequence[str]) -> None:
        """`words`: the command line, which is written with the first record."""
        super().__init__(path, "a", LIMIT_BYTES, BACKUPS, "utf-8", delay=True, errors="backslashreplace")
        self.setFormatter(_Escaped("%(asctime)s %(process)d %(levelname)s %(name)s (%(threadName)s): %(message)s"))
        self.addFilter(Repeats())
        self._words = words
        self._begun = False
        self._waiting: deque[logging.LogRecord] = deque(maxlen=WAITING)
        self.bugs = 0
        """How many this process has logged."""
        self.problem = ""
        """Why the last entry could not be written; empty when it was."""

    def emit(self, record: logging.LogRecord) -> None:
        """Keep what tells only of a step; write those steps together with what went wrong."""
        self.bugs += is_bug(record)
        if record.levelno < logging.WARNING:
            self._waiting.append(record)
            return
        due = [*self._waiting, record] if self._begun else [self._who(), *self._waiting, record]
        self._begun, self.problem = True, ""
        self._waiting.clear()
        for one in due:
            super().emit(one)  # where that fails, `handleError` has it wait for the next time
        self.close()

    def doRollover(self) -> None:
        """Begin a new file; where another process has the old one open, as on Windows, the next record tries again."""
        with suppress(OSError):
            super().doRollover()

    def handleError(self, record: logging.LogRecord) -> None:
        """A log that cannot be written stops nothing."""
        error = sys.exc_info()[1]
        if isinstance(error, OSError):
            self.problem = error.strerror or str(error)
            self._waiting.append(record)

    @property
    def waiting(self) -> str:
        """Entries that are not in the file."""
        return "\n".join(self.format(record) for record in self._waiting)

    @property
    def where(self) -> str:
        """Where the details are, as a clause."""
        if self.problem:
            return (
                f"the log {self.baseFilename} cannot be written ({self.problem}), 'slopegate --debug' shows the details"
            )
        return f"the log {self.baseFilename} has the details"

    def _open(self):  # type: ignore[no-untyped-def]  # noqa: ANN202 - a private type of the base class
        Path(self.baseFilename).parent.mkdir(parents=True, exist_ok=True)
        return super()._open()

    def _who(self) -> logging.LogRecord:
        from importlib.metadata import version  # takes as long to import as all the rest

        about = f"slopegate {version(PROGRAM)}, Python {platform.python_version()}, {platform.platform()}"
        command = shlex.join([PROGRAM, *self._words])
        return logging.makeLogRecord({"name": PROGRAM, "levelname": "INFO", "msg": f"{about}: {command}"})


@contextmanager
def logging_to_file(words: Sequence[str], debug: bool = False) -> Iterator[LogFile]:
    """While it lasts, records of the program and its libraries, warnings and uncaught exceptions go to the log file.

    With `debug` to standard error, too.
    """
    root, program, file = logging.getLogger(), logging.getLogger(PROGRAM), LogFile(log_path(), words)
    handlers: list[logging.Handler] = [file, *([logging.StreamHandler()] if debug else [])]
    before = program.level, sys.excepthook, threading.excepthook, sys.unraisablehook
    for handler in handlers:
        root.addHandler(handler)
    program.setLevel(logging.INFO)
    logging.captureWarnings(True)
    sys.excepthook, threading.excepthook, sys.unraisablehook = _on_uncaught, _on_thread, _on_unraisable
    try:
        yield file
    finally:
        level, sys.excepthook, threading.excepthook, sys.unraisablehook = before
        logging.captureWarnings(False)
        program.setLevel(level)
        for handler in handlers:
            root.removeHandler(handler)
            handler.close()


def log_text() -> str:
    """What is in the log file, for people to read."""
    try:
        text = log_path().read_text("utf-8", "replace")
    except FileNotFoundError:
        text = ""
    except OSError as error:
        text = f"{log_path()} cannot be read ({error.strerror})\n"
    for handler in logging.getLogger().handlers:
        if isinstance(handler, LogFile) and handler.problem:
            text += f"{log_path()} cannot be written ({handler.problem}). What belongs there:\n{handler.waiting}\n"
    return text


def _on_uncaught(kind: type[BaseException], error: BaseException, at: object) -> None:
    if not isinstance(error, Exception):
        sys.__excepthook__(kind, error, error.__traceback__)
        return
    sentence = user_sentence(error)
    if sentence is None:
        _log.error("Nobody caught an exception", exc_info=error)
    else:
        logging.getLogger(TOLD).warning("%s", sentence)


def _on_thread(args: threading.ExceptHookArgs) -> None:
    if isinstance(args.exc_value, Exception):
        _on_uncaught(args.exc_type, args.exc_value, args.exc_traceback)


def _on_unraisable(args: sys.UnraisableHookArgs) -> None:
    _log.warning("Ignored in %r", args.object, exc_info=args.exc_value)
