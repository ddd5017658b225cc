"""Bugs as the window shows them: a message when one was logged, and the log to read."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from PySide6.QtCore import QMessageLogContext, QObject, QtMsgType, Signal, qInstallMessageHandler
from PySide6.QtGui import QFontDatabase, QGuiApplication, QTextCursor
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QLabel, QPlainTextEdit, QVBoxLayout, QWidget

from slopegate.app.session.log import PROGRAM, TOLD, Repeats, bug_sentence, is_bug, log_path, log_text
from slopegate.app.window.about import open_folder

_LEVELS = {
    QtMsgType.QtDebugMsg: logging.DEBUG,
    QtMsgType.QtInfoMsg: logging.INFO,
    QtMsgType.QtWarningMsg: logging.WARNING,
    QtMsgType.QtCriticalMsg: logging.ERROR,
    QtMsgType.QtFatalMsg: logging.CRITICAL,
}


class _Watch(logging.Handler):
    """Hands on what is logged of bugs, and sentences that nobody else shows."""

    def __init__(self, found: Callable[[str], object], told: Callable[[str], object]) -> None:
        super().__init__(logging.WARNING)
        self.addFilter(Repeats())
        self._found, self._told = found, told

    def emit(self, record: logging.LogRecord) -> None:
        """In whatever thread it happened."""
        if record.name == TOLD:
            self._told(record.getMessage())
        elif is_bug(record):
            self._found(bug_sentence(record.exc_info[0] if record.exc_info else None))


class BugWatch(QObject):
    """Tells the window of every bug that is logged in any thread, until it is closed."""

    found = Signal(str)
    """What to say of a bug."""
    told = Signal(str)
    """What is wrong, for the user to mend, where nobody else says it."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._handler = _Watch(self.found.emit, self.told.emit)
        logging.getLogger(PROGRAM).addHandler(self._handler)

    def close(self) -> None:
        """Tell of nothing any more."""
        logging.getLogger(PROGRAM).removeHandler(self._handler)


class LogDialog(QDialog):
    """The log file, to read and to copy."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Log")
        self.text = QPlainTextEdit()
        self.text.setReadOnly(True)
        self.text.setAccessibleName("Log")
        self.text.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.text.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.text.setPlaceholderText("Nothing has gone wrong inside the program so far.")
        where = QLabel(str(log_path()))
        where.setWordWrap(True)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        buttons.rejected.connect(self.reject)
        for name, act, hint in (
            ("&Copy", self.copy, "Copy all of it, to send to whoever looks into it"),
            ("&Open folder", self.open_folder, "Show the folder with this file and older ones"),
            ("&Refresh", self.refresh, "Read the file again"),
        ):
            button = buttons.addButton(name, QDialogButtonBox.ButtonRole.ActionRole)
            button.setToolTip(hint)
            button.clicked.connect(act)
        column = QVBoxLayout(self)
        column.addWidget(where)
        column.addWidget(self.text, 1)
        column.addWidget(buttons)
        self.resize(900, 500)

    def refresh(self) -> None:
        """Read the file again, and show its end."""
        self.text.setPlainText(log_text())
        self.text.moveCursor(QTextCursor.MoveOperation.End)

    def copy(self) -> None:
        """Put all of it on the clipboard."""
        QGuiApplication.clipboard().setText(self.text.toPlainText())

    def open_folder(self) -> None:
        """Show the log's folder in the file manager; the nearest one above it where nothing was logged yet."""
        open_folder(log_path().parent)


@contextmanager
def qt_messages_logged() -> Iterator[None]:
    """While it lasts, Qt's own messages go to the log; what ends the program also to standard error."""
    before = qInstallMessageHandler(_log_message)
    try:
        yield
    finally:
        qInstallMessageHandler(before)


def _log_message(kind: QtMsgType, context: QMessageLogContext, message: str) -> None:
    logging.getLogger("Qt").log(_LEVELS[kind], "%s", message)
    if kind == QtMsgType.QtFatalMsg:
        print(message, file=sys.stderr)
