import pytest
from PySide6.QtCore import QPoint
from PySide6.QtGui import QPaintEvent
from PySide6.QtWidgets import QDialog, QMenu, QWidget
from pytestqt.qtbot import QtBot

from slopegate.app.widgets.exposed import RepaintUncovered


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


def wait_until_quiet(qtbot: QtBot, window: Painted) -> None:
    """Until a quarter of a second has gone by in which it had nothing to paint."""

    def quiet() -> bool:
        before = window.whole
        qtbot.wait(250)
        return window.whole == before

    qtbot.waitUntil(quiet)


def test_a_window_paints_itself_when_a_menu_over_it_closes(qtbot: QtBot, window: Painted) -> None:
    menu = QMenu(window)
    menu.addAction("anything")
    with qtbot.waitExposed(menu):
        menu.popup(window.mapToGlobal(QPoint(20, 20)))
    wait_until_quiet(qtbot, window)
    before = window.whole
    menu.close()
    qtbot.waitUntil(lambda: window.whole > before)


def test_a_window_paints_itself_when_a_dialog_over_it_moves_or_closes(qtbot: QtBot, window: Painted) -> None:
    dialog = QDialog(window)
    dialog.resize(100, 80)
    dialog.move(window.mapToGlobal(QPoint(20, 20)))
    with qtbot.waitExposed(dialog):
        dialog.show()
    wait_until_quiet(qtbot, window)
    before = window.whole
    dialog.move(window.mapToGlobal(QPoint(60, 60)))
    qtbot.waitUntil(lambda: window.whole > before)
    wait_until_quiet(qtbot, window)
    before = window.whole
    dialog.close()
    qtbot.waitUntil(lambda: window.whole > before)
