"""The log file: what is written, when, and by how many at once; and what is a bug."""

from __future__ import annotations

import errno
import logging
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import pytest

from slopegate.app.session import log as log_module
from slopegate.app.session.log import BACKUPS, bug_sentence, log_text, logging_to_file, sentence_of, user_sentence
from slopegate.core.rig.checks import InputError, UserError
from slopegate.drivers.contract.camera import CameraError

Bugs = list[logging.LogRecord]
OURS = logging.getLogger("slopegate.some.module")


def fail(error: BaseException) -> None:
    raise error


def log_failure(error: Exception, message: str = "It failed") -> None:
    try:
        fail(error)
    except type(error):
        OURS.exception(message)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (InputError("delay_us is nan:\n it must be finite"), "delay_us is nan: it must be finite"),
        (CameraError("The cable is out."), "The cable is out."),
        (UserError(), "UserError"),
        (MemoryError("2 TB"), "there is not enough memory for this"),
        (FileNotFoundError(2, "No such file", "a.csv"), "a.csv cannot be read or written (No such file)"),
        (OSError(errno.ENOSPC, "No space left on device"), "the disk is full"),
    ],
)
def test_what_the_user_can_mend_is_a_sentence_and_no_bug(error: Exception, sentence: str) -> None:
    assert user_sentence(error) == sentence
    assert sentence_of(error, "Something") == sentence


@pytest.mark.parametrize(
    "error",
    [
        ValueError("x"),
        KeyError("x"),
        IndexError(),
        ZeroDivisionError(),
        ImportError("x"),
        OSError("x"),
        OSError(9, "x"),
    ],
)
def test_everything_else_is_a_bug_and_logged(error: Exception, bugs: Bugs) -> None:
    assert user_sentence(error) is None
    assert sentence_of(error, "Saving") == bug_sentence(type(error))
    (record,) = bugs
    assert record.getMessage() == "Saving failed"
    assert record.exc_info is not None
    assert record.exc_info[1] is error
    bugs.clear()


def test_where_nothing_goes_wrong_nothing_is_written(log_file: Path) -> None:
    with logging_to_file(["slab"]):
        OURS.info("A step")
        logging.getLogger("some.library").info("Hello")
    assert not log_file.parent.exists()
    assert log_text() == ""


def test_what_goes_wrong_is_written_with_who_where_and_the_steps_before(log_file: Path, bugs: Bugs) -> None:
    with logging_to_file(["render", "a scene.toml"]) as log:
        for step in range(30):
            OURS.info("Step %d", step)
        log_failure(KeyError("row"))
        log_failure(KeyError("another place"), "Again")
        assert log.bugs == 2
    text = log_file.read_text("utf-8")
    assert text == log_text()
    assert text.count("slopegate 0.") == 1
    assert "Python 3." in text.splitlines()[0]
    assert "slopegate render 'a scene.toml'" in text.splitlines()[0]
    assert "Step 29" in text
    assert "Step 9\n" not in text
    assert text.index("Step 29") < text.index("It failed") < text.index("KeyError: 'row'") < text.index("Again")
    assert "Traceback" in text
    bugs.clear()


def test_what_fails_at_every_frame_does_not_fill_the_log(log_file: Path, bugs: Bugs) -> None:
    with logging_to_file([]) as log:
        for _ in range(150):
            log_failure(KeyError("row"))
        assert log.bugs == 3  # the 1st, the 10th and the 100th
    assert log_file.read_text("utf-8").count("Traceback") == 3
    bugs.clear()


def test_libraries_and_warnings_go_to_the_file_and_not_to_the_terminal(
    log_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with logging_to_file([]), warnings.catch_warnings():
        warnings.simplefilter("always")
        logging.captureWarnings(True)  # catch_warnings has just put the old way back
        logging.getLogger("some.library").warning("The %s is odd", "tag")
        warnings.warn("divide by zero", RuntimeWarning, stacklevel=1)
    assert capfd.readouterr() == ("", "")
    text = log_file.read_text("utf-8")
    assert "WARNING some.library (MainThread): The tag is odd" in text
    assert "RuntimeWarning: divide by zero" in text


def test_with_debug_they_go_to_standard_error_too(
    log_file: Path, capfd: pytest.CaptureFixture[str], bugs: Bugs
) -> None:
    with logging_to_file([], debug=True):
        log_failure(KeyError("row"))
    out, err = capfd.readouterr()
    assert out == ""
    assert "KeyError: 'row'" in err
    assert "KeyError: 'row'" in log_file.read_text("utf-8")
    bugs.clear()


def test_a_thread_that_ends_with_a_bug_is_logged(log_file: Path, bugs: Bugs, capfd: pytest.CaptureFixture[str]) -> None:
    hook = threading.excepthook
    with logging_to_file([]):
        for error in (KeyError("row"), CameraError("The cable is out.")):
            thread = threading.Thread(target=fail, args=(error,), name="some-thread")
            thread.start()
            thread.join()
    assert threading.excepthook is hook
    assert capfd.readouterr() == ("", "")
    text = log_file.read_text("utf-8")
    assert "(some-thread): Nobody caught an exception" in text
    assert "slopegate.told (some-thread): The cable is out." in text
    assert text.count("Traceback") == 1
    bugs.clear()


def test_the_log_is_cut_into_a_few_files_of_limited_size(
    log_file: Path, monkeypatch: pytest.MonkeyPatch, bugs: Bugs
) -> None:
    monkeypatch.setattr(log_module, "LIMIT_BYTES", 10_000)
    with logging_to_file([]):
        for number in range(1000):
            OURS.warning("Number %d", number)
    files = sorted(path.name for path in log_file.parent.iterdir())
    assert files == ["slopegate.log", *(f"slopegate.log.{number}" for number in range(1, BACKUPS + 1))]
    assert all(path.stat().st_size <= 10_000 for path in log_file.parent.iterdir())
    assert log_file.read_text("utf-8").endswith("Number 999\n")


def test_a_folder_that_cannot_be_made_stops_nothing(
    log_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], bugs: Bugs
) -> None:
    (tmp_path / "state").write_text("in the way")
    with logging_to_file([]) as log:
        assert log.where == f"the log {log_file} has the details"
        log_failure(KeyError("row"))
        log_failure(KeyError("another"))
        assert "cannot be written (Not a directory), 'slopegate --debug' shows the details" in log.where
        assert "KeyError: 'row'" in log_text()
        (tmp_path / "state").unlink()
        log_failure(KeyError("a third"), "It failed again")
        assert log.where == f"the log {log_file} has the details"
        written = log_file.read_text("utf-8")
        assert log_text() == written
    places = [written.index(text) for text in ("Python 3.", "'row'", "'a third'")]
    assert places == sorted(places)
    assert capfd.readouterr() == ("", "")
    bugs.clear()


def test_several_processes_log_and_cut_the_file_at_once(log_file: Path) -> None:
    code = (
        "import logging; from slopegate.app.session import log; log.LIMIT_BYTES = 5000\n"
        "with log.logging_to_file(['process']):\n"
        "    for number in range(500): logging.getLogger('slopegate').warning('Number %d', number)\n"
    )
    command = [sys.executable, "-c", code]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    for process in running:
        assert process.communicate(timeout=280) == ("", "")
        assert process.returncode == 0
    lines = log_file.read_text("utf-8").splitlines()
    assert all("Number" in line or "slopegate process" in line for line in lines)
