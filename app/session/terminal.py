"""The terminal belongs to the program: what libraries write there is not shown, what a file holds is not obeyed.

Libraries in C write to the file descriptors 1 and 2, past `sys.stdout` and `sys.stderr`. While a command runs these two
lead nowhere, and the program's own text goes to copies of them that nobody else knows.
"""

from __future__ import annotations

import ctypes
import io
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import IO, Any, TextIO, cast

from slopegate.core.rig.checks import escaped

STDOUT, STDERR = 1, 2


class EscapedText:
    """A text stream that writes control characters as text, but for ends of lines, tabs and returns at either end."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write the text, escaped; its length."""
        inner = text.strip("\r")
        self._stream.write(text if inner.isprintable() else text.replace(inner, escaped(inner, allowed="\n\t")))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def own_terminal(debug: bool = False) -> Iterator[None]:
    """While it lasts, nothing but what Python prints reaches the terminal, and that escaped.

    With `debug` what libraries write goes to standard error.
    """
    before = sys.stdout, sys.stderr
    with ExitStack() as undo:
        streams = [_own(undo, sys.stdout, STDOUT), _own(undo, sys.stderr, STDERR)]
        undo.callback(_flush, *streams)
        sys.stdout, sys.stderr = streams
        with suppress(OSError), open(os.devnull, "wb") as nowhere:
            if not debug:
                _lead(undo, STDERR, nowhere.fileno())
            _lead(undo, STDOUT, STDERR)
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before


def _own(undo: ExitStack, stream: TextIO | None, number: int) -> TextIO:
    """The stream, escaped; one of this descriptor as another with a copy of it."""
    if stream is None:  # a program without a terminal, as on Windows
        return io.StringIO()
    own: IO[str] = stream
    with suppress(OSError, AttributeError, ValueError):
        if stream.fileno() == number:
            stream.flush()
            lines = number == STDERR or stream.isatty()
            own = os.fdopen(os.dup(number), "w", 1 if lines else -1, stream.encoding, "backslashreplace")
            undo.callback(_close, own)
    return cast(TextIO, EscapedText(cast(TextIO, own)))


def _lead(undo: ExitStack, number: int, to: int) -> None:
    """Let a descriptor lead where another leads, until the end."""
    kept = os.dup(number)
    undo.callback(os.close, kept)
    undo.callback(os.dup2, kept, number)
    undo.callback(_flush_libraries)
    os.dup2(to, number)


def _flush_libraries() -> None:
    """Let go what C has buffered, while it still leads nowhere."""
    with suppress(OSError, AttributeError, TypeError):  # Windows has no library without a name
        ctypes.CDLL(None).fflush(None)


def _flush(*streams: TextIO) -> None:
    for stream in streams:
        with suppress(OSError, ValueError):  # whoever read it has gone, or the disk is full: that has been told
            stream.flush()


def _close(stream: IO[str]) -> None:
    with suppress(OSError):
        stream.close()
