"""Somebody who presses whatever there is: thousands of random actions in a real window, the same for the same seed."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from PySide6.QtCore import QPoint, QPointF, Qt, QTimer
from PySide6.QtGui import QAction, QColor, QContextMenuEvent, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QDockWidget,
    QLabel,
    QLineEdit,
    QMainWindow,
    QMenu,
    QMessageBox,
    QPlainTextEdit,
    QTabBar,
    QWidget,
)

from slopegate.app.panels.panels import PANELS, WORKSPACES
from slopegate.app.window.window import Window

TEXTS = ("1", "0.5", "0,9", "-3", "1e3", "", "abc", "99999999", "1'000")
KEYS = (
    *(Qt.Key.Key_Up, Qt.Key.Key_Down, Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown),
    *(Qt.Key.Key_Tab, Qt.Key.Key_Escape, Qt.Key.Key_Return, Qt.Key.Key_Space, Qt.Key.Key_Home, Qt.Key.Key_End),
    *(Qt.Key.Key_BracketLeft, Qt.Key.Key_BracketRight, Qt.Key.Key_Comma, Qt.Key.Key_Period, Qt.Key.Key_Delete),
)
WORK = ("Start", "Pause", "Resume", "Cancel", "Record", "Stop", "Measure depth", "Search", "Arm", "Learn")
OWN_DRAGS = (QLabel, QLineEdit, QPlainTextEdit, QAbstractItemView, QDockWidget, QMainWindow)
"""Where a drag carries text or a panel away: Qt then waits for the real mouse, and not for this one."""
NOT_TOUCHED = ("Quit", "Open folder", "Full screen", "Devices", "Projector")
"""Actions that end the test, or leave the window."""


class Monkey:
    """Acts on a window. `did` counts what it did, `last` names the action before a fault."""

    def __init__(self, window: Window, seed: int, scenes: list[Path], out: Path) -> None:
        self.window, self.random, self.scenes, self.out = window, random.Random(seed), scenes, out
        self.did: Counter[str] = Counter()
        self.last = ""
        self._answering = QTimer()
        self._answering.timeout.connect(self._answer)
        self._answering.start(20)
        self._files = 0

    def act(self) -> None:
        """One random action."""
        kinds: tuple[tuple[int, Callable[[], object]], ...] = (
            (30, self._press),
            (14, self._drag),
            (14, self._type),
            (10, self._key),
            (8, self._menu),
            (6, self._wheel),
            (4, self._choose),
            (4, self._open),
            (4, self._gate),
            (4, self._panel),
            (2, self._theme),
            (2, self._size),
            (3, self._history),
            (1, self._context),
            (3, self._work),
        )
        kind = self.random.choices([one for _, one in kinds], [weight for weight, _ in kinds])[0]
        self.did[kind.__name__] += 1
        self.last = kind.__name__
        kind()

    def rest(self) -> None:
        """Act no more."""
        self._answering.stop()

    def file(self, *_: object) -> tuple[str, str]:
        """What a dialog for a file gives: nothing, one of the scenes, or a new name."""
        self._files += 1
        names = ["", str(self.random.choice(self.scenes)), str(self.out / f"file-{self._files}.tif")]
        return self.random.choice(names), ""

    def folder(self, *_: object) -> str:
        """What a dialog for a folder gives."""
        self._files += 1
        return self.random.choice(["", str(self.out / f"folder-{self._files}")])

    def text(self, *_: object) -> tuple[str, bool]:
        """What is typed when a name is asked for."""
        return self.random.choice(["", "mine", "other <b>", "x" * 300]), self.random.random() < 0.7

    def colour(self, *_: object) -> QColor:
        """Any colour, or none."""
        return QColor(self.random.choice(["red", "#20ff80", "nothing"]))

    def _answer(self) -> None:
        """Answer what stands in the way."""
        popup = QApplication.activePopupWidget()
        if isinstance(popup, QMenu):
            popup.close()
        box = QApplication.activeModalWidget()
        if isinstance(box, QMessageBox):
            self.random.choice(box.buttons()).click()
        elif isinstance(box, QDialog):
            box.reject()

    def _widgets(self) -> Iterator[QWidget]:
        for top in QApplication.topLevelWidgets():
            if top.isVisible() and not isinstance(top, QMenu):
                for widget in top.findChildren(QWidget):
                    if widget.isVisible() and widget.isEnabled() and not widget.visibleRegion().isEmpty():
                        yield widget

    def _any(self, *kinds: type[QWidget]) -> QWidget | None:
        found = [one for one in self._widgets() if not kinds or isinstance(one, kinds)]
        # among what is there of each kind, so that the live image is met as often as one of fifty buttons
        by_name: dict[str, list[QWidget]] = {}
        for one in found:
            by_name.setdefault(type(one).__name__, []).append(one)
        chosen = self.random.choice(self.random.choice(list(by_name.values()))) if by_name else None
        if chosen is not None:
            self.last += f" {type(chosen).__name__} {_text_of(chosen)!r} {chosen.accessibleName()!r}"
        return chosen

    def _place(self, widget: QWidget) -> QPoint:
        return QPoint(self.random.randrange(max(widget.width(), 1)), self.random.randrange(max(widget.height(), 1)))

    def _press(self) -> None:
        widget = self._any(QAbstractButton, QTabBar) if self.random.random() < 0.7 else self._any()
        if widget is None or any(name in _text_of(widget) for name in NOT_TOUCHED):
            return
        click = QTest.mouseDClick if self.random.random() < 0.1 else QTest.mouseClick
        place = widget.rect().center() if isinstance(widget, QAbstractButton) else self._place(widget)
        click(widget, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, place)

    def _drag(self) -> None:
        widget = self._any()
        own = type(widget).__module__.startswith(("slopegate.", "pyqtgraph."))
        if widget is None or not own or isinstance(widget, OWN_DRAGS):
            return
        keys = self.random.choice([Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ShiftModifier])
        QTest.mousePress(widget, Qt.MouseButton.LeftButton, keys, self._place(widget))
        for _ in range(3):
            if _there(widget):
                QTest.mouseMove(widget, self._place(widget))
        if _there(widget):
            QTest.mouseRelease(widget, Qt.MouseButton.LeftButton, keys, self._place(widget))

    def _type(self) -> None:
        widget = self._any(QAbstractSpinBox, QLineEdit)
        if widget is not None:
            text = self.random.choice(TEXTS)
            self.last += f" {text!r}"
            widget.setFocus()
            QTest.keyClick(widget, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
            QTest.keyClicks(widget, text)
            QTest.keyClick(widget, self.random.choice([Qt.Key.Key_Return, Qt.Key.Key_Tab]))

    def _key(self) -> None:
        key = self.random.choice(KEYS)
        self.last += f" {key.name}"
        QTest.keyClick(QApplication.focusWidget() or self.window, key)

    def _menu(self) -> None:
        actions = [one for one in self._actions() if not any(name in _bare(one) for name in NOT_TOUCHED)]
        action = self.random.choice(actions)
        self.last += f" {action.text()!r}"
        action.trigger()

    def _actions(self) -> list[QAction]:
        found, menus = [], [action.menu() for action in self.window.menuBar().actions()]
        for menu in menus:
            if isinstance(menu, QMenu) and not any(name in menu.title().replace("&", "") for name in NOT_TOUCHED):
                menu.aboutToShow.emit()
                menus += [action.menu() for action in menu.actions() if action.menu() is not None]
                found += [one for one in menu.actions() if one.isEnabled() and not one.isSeparator()]
        return [one for one in found if one.menu() is None]

    def _wheel(self) -> None:
        widget = self._any()
        if widget is not None:
            place = QPointF(self._place(widget))
            turn = QPoint(0, self.random.choice([-240, -120, 120, 240]))
            none, keys = Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier
            phase, where = Qt.ScrollPhase.NoScrollPhase, QPointF(widget.mapToGlobal(place.toPoint()))
            QApplication.sendEvent(widget, QWheelEvent(place, where, QPoint(), turn, none, keys, phase, False))

    def _choose(self) -> None:
        box = self._any(QComboBox)
        if isinstance(box, QComboBox) and box.count() and box is not self.window.menus.scenes:
            box.setCurrentIndex(self.random.randrange(box.count()))
            box.activated.emit(box.currentIndex())

    def _open(self) -> None:
        where = self.random.choice(self.scenes)
        self.last += f" {where.name}"
        self.window.open(where)

    def _gate(self) -> None:
        source = self.window.session.source
        if source is not None:
            self.window.session.use(self.random.choice(source.presets))

    def _panel(self) -> None:
        if self.random.random() < 0.5:
            self.window.docks.switch(self.random.choice(WORKSPACES).key)
        else:
            self.window.docks.bring(self.random.choice(PANELS).key)

    def _work(self) -> None:
        """Begin, hold or end what takes a while."""
        panel = self.window.docks.bring(self.random.choice(["slices", "slices", "record", "depth", "search", "alarm"]))
        buttons = [] if panel is None else [one for one in panel.findChildren(QAbstractButton) if one.isEnabled()]
        buttons = [one for one in buttons if one.isVisible() and one.text() in WORK]
        if buttons:
            button = self.random.choice(buttons)
            self.last += f" {button.text()!r}"
            QTest.mouseClick(button, Qt.MouseButton.LeftButton)

    def _theme(self) -> None:
        self.window.set_theme(self.random.choice(["light", "dark"]))

    def _size(self) -> None:
        self.window.resize(self.random.randrange(700, 1900), self.random.randrange(450, 1100))

    def _history(self) -> None:
        history = self.window.history
        for _ in range(self.random.randrange(1, 4)):
            self.random.choice([history.undo, history.redo])()

    def _context(self) -> None:
        widget = self._any()
        if widget is not None:
            place = self._place(widget)
            event = QContextMenuEvent(QContextMenuEvent.Reason.Mouse, place, widget.mapToGlobal(place))
            QApplication.sendEvent(widget, event)


def _there(widget: QWidget) -> bool:
    """Whether Qt still has it: Python does not learn that what Qt made itself, as tabs, is gone."""
    return any(one is widget for one in QApplication.allWidgets())


def _text_of(widget: QWidget) -> str:
    text = getattr(widget, "text", "")
    return str(text() if callable(text) else text)


def _bare(action: QAction) -> str:
    return action.text().replace("&", "")
