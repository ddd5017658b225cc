"""The mouse wheel over boxes, sliders and tabs, with and without the focus."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QApplication, QLineEdit, QTabBar, QVBoxLayout, QWidget
from pytestqt.qtbot import QtBot

from slopegate.app.widgets.number_box import CountBox, NumberBox
from slopegate.app.widgets.steady import ChoiceBox, SteadyTabs, ValueSlider


def turn_wheel(widget: QWidget, notches: int) -> bool:
    """Turn the wheel over the middle of a widget. Whether somebody took it."""
    at = QPointF(widget.rect().center())
    angle, none = QPoint(0, 120 * notches), Qt.MouseButton.NoButton
    phase, keys = Qt.ScrollPhase.NoScrollPhase, Qt.KeyboardModifier.NoModifier
    event = QWheelEvent(at, widget.mapToGlobal(at), QPoint(), angle, none, keys, phase, False)
    QApplication.sendEvent(widget, event)
    return event.isAccepted()


class Fields(QWidget):
    def __init__(self) -> None:
        super().__init__()
        self.other = QLineEdit()
        self.number, self.count, self.slider = NumberBox(), CountBox(), ValueSlider()
        self.choice, self.tabs = ChoiceBox(), QTabBar()
        SteadyTabs(self.tabs)
        self.choice.addItems(["a", "b", "c"])
        for name in "abc":
            self.tabs.addTab(name)
        for field in (self.number, self.count, self.slider):
            field.setValue(5)
        self.choice.setCurrentIndex(1)
        self.tabs.setCurrentIndex(1)
        column = QVBoxLayout(self)
        for part in (self.other, self.number, self.count, self.slider, self.choice, self.tabs):
            column.addWidget(part)

    def state(self, name: str) -> float:
        field = getattr(self, name)
        return float(field.value() if hasattr(field, "value") else field.currentIndex())


@pytest.mark.parametrize("name", ["number", "count", "slider", "choice", "tabs"])
def test_the_wheel_changes_what_has_the_focus_and_nothing_else(qtbot: QtBot, name: str) -> None:
    fields = Fields()
    qtbot.addWidget(fields)
    with qtbot.waitActive(fields):
        fields.show()
        fields.activateWindow()
    fields.other.setFocus()
    field: QWidget = getattr(fields, name)
    before = fields.state(name)
    assert not turn_wheel(field, 1)
    assert fields.state(name) == before
    assert fields.other.hasFocus()  # the wheel takes no focus, either
    field.setFocus()
    turn_wheel(field, 1)
    assert fields.state(name) != before
