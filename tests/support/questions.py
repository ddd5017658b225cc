"""Answers to questions that the window asks in a dialog of their own."""

from __future__ import annotations

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication, QMessageBox

LOOK_MS = 10


def answer_next(button: str) -> list[str]:
    """Press this button of the next question. What was asked is in the list as soon as it has been."""
    asked: list[str] = []

    def answer() -> None:
        box = QApplication.activeModalWidget()
        if not isinstance(box, QMessageBox):
            QTimer.singleShot(LOOK_MS, answer)
            return
        asked.append(f"{box.text()} {box.informativeText()}".strip())
        next(one for one in box.buttons() if one.text() == button).click()

    QTimer.singleShot(LOOK_MS, answer)
    return asked
