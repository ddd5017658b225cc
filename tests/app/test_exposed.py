import pytest
from PySide6.QtCore import QPoint
from PySide6.QtGui import QPaintEvent
from PySide6.QtWidgets import QDialog, QMenu, QWidget
from pytestqt.qtbot import QtBot
from slopegate.app.exposed import RepaintUncovered


class Painted(QWidget):
    def __init__(self) -> None:
        super().__init__()
        self.whole = 0

    def paintEvent(self, event: QPaintEvent) -> None:
        self.whole += event.rect() == self.rect()


@pytest.fixture
def window(qtbot: QtBot) -> Painted:
    """Shown and painted once."""
    window = Painted()
    qtbot.addWidget(window)
    window.resize(300, 200)
    RepaintUncovered(window)
    window.show()
    qtbot.waitUntil(lambda: window.whole > 0)
    return window


def test_a_window_paints_itself_when_a_menu_over_it_closes(qtbot: QtBot, window: Painted) -> None:
    menu = QMenu(window)
    menu.addAction("anything")
    menu.popup(window.mapToGlobal(QPoint(20, 20)))
    qtbot.wait(250)
    before = window.whole
    qtbot.wait(250)
    assert window.whole == before, "nothing to do while it is open"
    menu.close()
    qtbot.waitUntil(lambda: window.whole > before)


def test_a_window_paints_itself_when_a_dialog_over_it_moves_or_closes(qtbot: QtBot, window: Painted) -> None:
    dialog = QDialog(window)
    dialog.resize(100, 80)
    dialog.move(window.mapToGlobal(QPoint(20, 20)))
    dialog.show()
    qtbot.wait(250)
    before = window.whole
    qtbot.wait(250)
    assert window.whole == before
    dialog.move(window.mapToGlobal(QPoint(60, 60)))
    qtbot.waitUntil(lambda: window.whole > before)
    qtbot.wait(250)
    before = window.whole
    dialog.close()
    qtbot.waitUntil(lambda: window.whole > before)
