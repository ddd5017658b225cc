"""The mouse wheel over boxes, sliders and tabs, with and without the focus."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent, QWheelEvent
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


def test_a_drag_with_shift_is_fine_and_does_not_jump(qtbot: QtBot) -> None:
    slider = ValueSlider()
    qtbot.addWidget(slider)
    slider.resize(220, 30)
    slider.setRange(0, 20_000)
    slider.setValue(10_000)
    with qtbot.waitExposed(slider):
        slider.show()
    shift, left = Qt.KeyboardModifier.ShiftModifier, Qt.MouseButton.LeftButton
    start = slider.rect().center()
    per_px = slider._steps_per_px()
    assert 90 < per_px < 120
    qtbot.mousePress(slider, left, shift, start)
    assert slider.value() == 10_000  # a press pages nowhere

    def move(dx: int, keys: Qt.KeyboardModifier) -> None:
        at = QPointF(start + QPoint(dx, 0))
        event = QMouseEvent(QEvent.Type.MouseMove, at, slider.mapToGlobal(at), Qt.MouseButton.NoButton, left, keys)
        QApplication.sendEvent(slider, event)

    move(40, shift)
    assert slider.value() == pytest.approx(10_000 + 40 * per_px / 20, abs=1)
    move(50, Qt.KeyboardModifier.NoModifier)  # from where it stands, at the usual speed
    assert slider.value() == pytest.approx(10_000 + 40 * per_px / 20 + 10 * per_px, abs=1)
    qtbot.mouseRelease(slider, left, Qt.KeyboardModifier.NoModifier, start + QPoint(50, 0))
    assert not slider.isSliderDown()
