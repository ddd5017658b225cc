from PySide6.QtCore import QPoint
from PySide6.QtGui import QPaintEvent
from PySide6.QtWidgets import QMenu, QWidget
from pytestqt.qtbot import QtBot
from slopegate.app.exposed import RepaintBehindMenus


class Painted(QWidget):
    def __init__(self) -> None:
        super().__init__()
        self.whole = 0

    def paintEvent(self, event: QPaintEvent) -> None:
        self.whole += event.rect() == self.rect()


def test_a_window_paints_itself_when_a_menu_over_it_closes(qtbot: QtBot) -> None:
    window = Painted()
    qtbot.addWidget(window)
    window.resize(300, 200)
    RepaintBehindMenus(window)
    window.show()
    qtbot.waitUntil(lambda: window.whole > 0)
    menu = QMenu(window)
    menu.addAction("anything")
    menu.popup(window.mapToGlobal(QPoint(20, 20)))
    qtbot.wait(250)
    before = window.whole
    qtbot.wait(250)
    assert window.whole == before, "nothing to do while it is open"
    menu.close()
    qtbot.waitUntil(lambda: window.whole > before)
