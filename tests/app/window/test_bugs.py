"""Bugs in the real window: a message that does not stop the live view, and the log to read."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QTimer, qWarning
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QPushButton
from pytestqt.qtbot import QtBot

from slopegate.app.session.loading import Progress
from slopegate.app.session.log import logging_to_file
from slopegate.app.window.bugs import LogDialog, qt_messages_logged
from slopegate.app.window.window import Window
from slopegate.core.rig.checks import InputError, UserError

Bugs = list[logging.LogRecord]
pytestmark = pytest.mark.qt_no_exception_capture
SAID = "Something went wrong inside the program ({}): the log has the details"


@pytest.fixture
def logged(log_file: Path, window: Window) -> Iterator[Path]:
    """The window's log, written as the command line has it written."""
    with logging_to_file(["--open", "three_targets"]), qt_messages_logged():
        yield log_file


def fail(error: Exception) -> None:
    raise error


def log_button(window: Window) -> QPushButton:
    return next(one for one in window.messages.findChildren(QPushButton) if one.text() == "Show log")


def goes_on(qtbot: QtBot, window: Window) -> bool:
    """Whether frames still come to the screen."""
    assert window.live.frame is not None
    before = window.live.frame.stamp.sequence
    qtbot.waitUntil(lambda: window.live.frame.stamp.sequence > before + 2)
    return True


def test_a_slot_that_raises_is_told_and_logged_and_the_view_goes_on(
    qtbot: QtBot, window: Window, logged: Path, bugs: Bugs
) -> None:
    assert not log_button(window).isVisible()
    QTimer.singleShot(0, window, lambda: fail(KeyError("row")))
    qtbot.waitUntil(lambda: window.messages.text == SAID.format("KeyError"))
    assert window.messages.kind == "error"
    assert log_button(window).isVisible()
    assert goes_on(qtbot, window)
    text = logged.read_text("utf-8")
    assert "slopegate --open three_targets" in text
    assert "Traceback" in text
    assert "KeyError: 'row'" in text
    assert "gate GateSettings(" in text
    bugs.clear()


def test_the_log_is_opened_read_and_copied(qtbot: QtBot, window: Window, logged: Path, bugs: Bugs) -> None:
    QTimer.singleShot(0, window, lambda: fail(KeyError("row")))
    qtbot.waitUntil(lambda: log_button(window).isVisible())
    window.messages.say("Another message", "warning")
    assert log_button(window).isVisible()
    log_button(window).click()
    dialog = window.findChild(LogDialog)
    assert dialog.isVisible()
    assert not dialog.isModal()
    assert "KeyError: 'row'" in dialog.text.toPlainText()
    buttons = {button.text(): button for button in dialog.findChildren(QPushButton)}
    buttons["&Copy"].click()
    assert QGuiApplication.clipboard().text() == logged.read_text("utf-8")
    logging.getLogger("some.library").warning("Something else")
    buttons["&Refresh"].click()
    assert "Something else" in dialog.text.toPlainText()
    dialog.close()
    window.messages.hide()
    window.messages.say("A message")
    assert not log_button(window).isVisible()
    help_menu = window.menuBar().actions()[-1].menu()
    next(action for action in help_menu.actions() if "Log" in action.text()).trigger()
    assert dialog.isVisible()
    dialog.close()
    bugs.clear()


def test_a_worker_that_raises_is_told_and_logged(qtbot: QtBot, window: Window, logged: Path, bugs: Bugs) -> None:
    def job(progress: Progress) -> Path:
        raise KeyError("row")

    with qtbot.waitSignal(window.saver.failed) as got:
        window.saver.start(job)
    assert got.args == [SAID.format("KeyError")]
    qtbot.waitUntil(lambda: window.messages.text == SAID.format("KeyError") and log_button(window).isVisible())
    text = logged.read_text("utf-8")
    assert "KeyError: 'row'" in text
    assert text.index("Starting test_a_worker_that_raises") < text.index("Traceback")
    assert goes_on(qtbot, window)
    bugs.clear()


def test_a_thread_that_raises_is_told_and_logged(qtbot: QtBot, window: Window, logged: Path, bugs: Bugs) -> None:
    thread = threading.Thread(target=fail, args=(IndexError("row"),))
    thread.start()
    thread.join()
    qtbot.waitUntil(lambda: window.messages.text == SAID.format("IndexError"))
    assert "IndexError: row" in logged.read_text("utf-8")
    bugs.clear()


def test_a_camera_with_a_bug_is_told_logged_and_read_on(
    qtbot: QtBot, window: Window, logged: Path, bugs: Bugs, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = window.session.source.camera
    read, errors = camera.read, [KeyError("row")]

    def broken(buffer: object, timeout_s: float) -> object:
        if errors:
            raise errors.pop()
        return read(buffer, timeout_s)

    monkeypatch.setattr(camera, "read", broken)
    qtbot.waitUntil(lambda: log_button(window).isVisible())
    assert goes_on(qtbot, window)
    assert "KeyError: 'row'" in logged.read_text("utf-8")
    bugs.clear()


def test_what_the_user_can_mend_is_a_sentence_without_a_trace(qtbot: QtBot, window: Window, logged: Path) -> None:
    def job(progress: Progress) -> Path:
        raise UserError("The disk is not there.")

    window.saver.start(job)
    qtbot.waitUntil(lambda: window.messages.text == "The disk is not there.")
    QTimer.singleShot(0, window, lambda: fail(InputError("delay_us is nan")))
    qtbot.waitUntil(lambda: window.messages.text == "delay_us is nan")
    thread = threading.Thread(target=fail, args=(UserError("The board is out."),))
    thread.start()
    thread.join()
    qtbot.waitUntil(lambda: window.messages.text == "The board is out.")
    assert not log_button(window).isVisible()
    assert "Traceback" not in logged.read_text("utf-8")


def test_qt_itself_writes_to_the_log(logged: Path, capfd: pytest.CaptureFixture[str]) -> None:
    qWarning("QWidget: a riddle")
    assert "WARNING Qt (MainThread): QWidget: a riddle" in logged.read_text("utf-8")
    assert capfd.readouterr() == ("", "")


def test_a_closed_window_is_told_of_nothing(window: Window, logged: Path, bugs: Bugs) -> None:
    window.close()
    sys.excepthook(KeyError, KeyError("late"), None)
    assert window.messages.text == ""
    bugs.clear()
