"""Errors of the command line: the user's in a sentence, bugs with a trace in the log."""

from __future__ import annotations

import logging
from argparse import Namespace
from pathlib import Path

import pytest

from slopegate.app.cli import main
from slopegate.app.commands import slab
from slopegate.core.rig.checks import InputError

Capture = pytest.CaptureFixture[str]
SLAB = ("slab", "--clock-mhz", "78", "--delay-us", "2028", "--exposure-us", "400", "--json")


def break_slab(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    def broken(options: Namespace) -> int:
        raise error

    monkeypatch.setattr(slab, "run", broken)


@pytest.mark.parametrize(
    "error",
    [ValueError("7 is odd"), KeyError("7"), IndexError("7"), OverflowError("7"), ImportError("7"), OSError("7")],
)
def test_a_bug_is_exit_code_1_with_its_trace_in_the_log(
    error: Exception,
    capsys: Capture,
    log_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    bugs: list[logging.LogRecord],
) -> None:
    break_slab(monkeypatch, error)
    assert main(SLAB) == 1
    said = f"slopegate: this is a bug of the program ({type(error).__name__}): the log {log_file} has the details\n"
    assert capsys.readouterr() == ("", said)
    text = log_file.read_text("utf-8")
    assert "slopegate slab --clock-mhz 78" in text
    assert "Traceback" in text
    assert f"{type(error).__name__}: {error}" in text
    bugs.clear()


def test_debug_shows_the_trace_too(
    capsys: Capture, log_file: Path, monkeypatch: pytest.MonkeyPatch, bugs: list[logging.LogRecord]
) -> None:
    break_slab(monkeypatch, ValueError("7 is odd"))
    assert main(("--debug", *SLAB)) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "ValueError: 7 is odd\n" in err
    assert "Traceback" in err
    bugs.clear()


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (InputError("delay_us is 7: it must be even"), "delay_us is 7: it must be even"),
        (MemoryError("1 TB"), "there is not enough memory for this"),
        (PermissionError(13, "Permission denied", "a.csv"), "a.csv cannot be read or written (Permission denied)"),
    ],
)
@pytest.mark.parametrize("debug", [(), ("--debug",)])
def test_what_the_user_can_mend_is_exit_code_2_and_leaves_no_trace(
    error: Exception,
    sentence: str,
    debug: tuple[str, ...],
    capsys: Capture,
    log_file: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    break_slab(monkeypatch, error)
    assert main((*debug, *SLAB)) == 2
    assert capsys.readouterr() == ("", f"slopegate: {sentence}\n")
    assert not log_file.exists()


def test_an_error_that_came_of_a_bug_in_another_thread_is_a_bug(
    capsys: Capture, log_file: Path, monkeypatch: pytest.MonkeyPatch, bugs: list[logging.LogRecord]
) -> None:
    def broken(options: Namespace) -> int:
        try:
            raise KeyError("7")
        except KeyError:
            logging.getLogger("slopegate.drivers").exception("The writer failed")
        raise InputError("the capture failed")

    monkeypatch.setattr(slab, "run", broken)
    assert main(SLAB) == 1
    assert capsys.readouterr() == ("", f"slopegate: the capture failed: the log {log_file} has the details\n")
    bugs.clear()
