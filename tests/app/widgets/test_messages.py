"""Strips over the picture: they come to rest, and cost nothing while they are on show."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import QApplication, QLabel, QWidget
from pytestqt.qtbot import QtBot

from slopegate.app.widgets.messages import MessageStrip, ProgressStrip, StripsOver


class Layouts(QObject):
    """Counts how often something below the strips is asked to lay itself out."""

    count = 0

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        self.count += event.type() == QEvent.Type.LayoutRequest
        return False


@pytest.mark.parametrize("which", ["message", "progress"])
def test_a_strip_comes_to_rest(qtbot: QtBot, which: str) -> None:
    below, message, progress, layouts = QWidget(), MessageStrip(), ProgressStrip(), Layouts()
    qtbot.addWidget(below)
    over = StripsOver(below, (progress, message))
    below.resize(400, 300)
    with qtbot.waitExposed(below):
        below.show()
    below.installEventFilter(layouts)
    if which == "message":
        message.say("A sentence that is long enough for two lines in a window of this width, and then some more of it")
    else:
        progress.say(0.5, "Rendering ...")
    for _ in range(100):
        QApplication.processEvents()
    asked = layouts.count
    for _ in range(100):
        QApplication.processEvents()
    assert layouts.count == asked
    assert over.isVisible()
    assert over.width() == below.width()
    assert over.height() >= (message.heightForWidth(400) if which == "message" else progress.sizeHint().height())
    (message if which == "message" else progress).hide()
    assert not over.isVisible()


def test_a_message_shows_what_a_file_holds_and_does_not_obey_it(qtbot: QtBot) -> None:
    strip = MessageStrip()
    qtbot.addWidget(strip)
    strip.say("<b>bold</b> \x1b[31m \u202e" + "9" * 5000)
    assert strip.text.startswith("<b>bold</b> \\x1b[31m \\u202e99")
    assert len(strip.text) < 500
    label = next(label for label in strip.findChildren(QLabel) if label.text() == strip.text)
    assert label.textFormat() == Qt.TextFormat.PlainText
