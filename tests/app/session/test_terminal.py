"""Nothing but the program's own text reaches the terminal, and nothing in it is obeyed there."""

from __future__ import annotations

import io
import os
import subprocess
import sys

import pytest

from slopegate.app.session.terminal import EscapedText, own_terminal

NOISY = """
import ctypes, os, sys
from slopegate.app.session.terminal import own_terminal
os.write(1, b"before\\n")
with own_terminal({debug}):
    os.write(1, b"library says\\n")
    os.write(2, b"library warns\\n")
    if sys.platform == "linux":
        ctypes.CDLL(None).printf(b"C library says, and has it buffered\\n")
    print("a title\\x1b]0;mine\\x07 \\u00e9\\tb")
    print("a warning\\x9b1m", file=sys.stderr)
os.write(1, b"after\\n")
"""


def told(*, debug: bool = False) -> tuple[bytes, bytes]:
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    command = [sys.executable, "-c", NOISY.format(debug=debug)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True)
    return done.stdout, done.stderr


def test_libraries_are_not_heard() -> None:
    out, err = told()
    assert out == b"before\na title\\x1b]0;mine\\x07 \xc3\xa9\tb\nafter\n".replace(b"\n", os.linesep.encode())
    assert err == b"a warning\\x9b1m\n".replace(b"\n", os.linesep.encode())


def test_who_looks_for_bugs_hears_them_beside_the_output() -> None:
    out, err = told(debug=True)
    assert b"library" not in out
    assert err.count(b"library") == 2 + (sys.platform == "linux")


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("plain\n", "plain\n"),
        ("\rrendering  3 %", "\rrendering  3 %"),
        ("\r    \r", "\r    \r"),
        ("\r", "\r"),
        ("", ""),
        ("a\rb", "a\\rb"),
        ("\x1b[2J\u202e\udcf6\u00a0\u200b", "\\x1b[2J\\u202e\\xf6\u00a0\\u200b"),
    ],
)
def test_what_a_terminal_would_obey_is_shown(text: str, written: str) -> None:
    stream = io.StringIO()
    assert EscapedText(stream).write(text) == len(text)
    assert stream.getvalue() == written


def test_the_streams_come_back_whatever_happens() -> None:
    before = sys.stdout, sys.stderr
    with pytest.raises(ZeroDivisionError), own_terminal():
        raise ZeroDivisionError
    assert (sys.stdout, sys.stderr) == before
