"""Scales, and sliders and spin boxes driven by real keys and clicks."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QVBoxLayout, QWidget
from pytestqt.qtbot import QtBot

from pointer import move_pointer
from rigs import LADDER
from slopegate.app.widgets.controls import Ladder, Linear, Logarithmic, NumberControl, Scale, stepped

SCALES: list[Scale] = [Ladder(LADDER), Linear(-16667.0, 33334.0, 1.0), Logarithmic(100.0, 50000.0, 1.0)]


@given(which=st.sampled_from(SCALES), share=st.floats(0, 1))
def test_positions_and_values_agree(which: Scale, share: float) -> None:
    value = which.value(round(share * which.last))
    assert which.snap(value) == value
    assert which.value(which.position(value)) == value
    assert which.value(0) <= value <= which.value(which.last)


@given(which=st.sampled_from(SCALES), share=st.floats(0, 1), steps=st.sampled_from([-25, -1, 1, 25]))
def test_a_step_always_moves_until_the_end(which: Scale, share: float, steps: int) -> None:
    value = which.value(round(share * which.last))
    moved = stepped(which, value, steps)
    at_end = value == which.value(which.last if steps > 0 else 0)
    assert (moved - value) * steps > 0 or at_end


def test_exposure_reaches_from_a_tenth_of_a_millisecond_beyond_a_period_in_equal_ratios() -> None:
    scale = Logarithmic(100.0, 50_000.0, 1.0)
    assert (scale.value(0), scale.value(scale.last)) == (100.0, 50_000.0)
    ratios = [scale.value(p + 50) / scale.value(p) for p in range(0, scale.last - 50, 50)]
    assert ratios == pytest.approx([math.exp(math.log(500) / 12)] * len(ratios), rel=0.01)


class Board(QWidget):
    def __init__(self, scale: Scale) -> None:
        super().__init__()
        self.control = NumberControl(scale, self)
        self.control.set_scale(scale)
        self.control.describe("&Clock", " MHz", "hint")
        self.heard: list[float] = []
        self.control.edited.connect(self.heard.append)
        layout = QVBoxLayout(self)
        for part in (self.control.label, self.control.slider, self.control.spin):
            layout.addWidget(part)


def board(qtbot: QtBot, scale: Scale, value: float) -> Board:
    made = Board(scale)
    qtbot.addWidget(made)
    made.control.show_value(value)
    with qtbot.waitExposed(made):
        made.show()
    return made


def test_keys_walk_the_ladder(qtbot: QtBot) -> None:
    made = board(qtbot, Ladder(LADDER), 78.0)
    for part in (made.control.slider, made.control.spin):
        made.control.show_value(78.0)
        made.heard.clear()
        qtbot.keyClick(part, Qt.Key.Key_Up)
        qtbot.keyClick(part, Qt.Key.Key_Up)
        qtbot.keyClick(part, Qt.Key.Key_Down)
        qtbot.keyClick(part, Qt.Key.Key_PageUp)
        assert made.heard == [80.0, 82.0, 80.0, 90.0]
        assert made.control.spin.value() == 90.0
        assert made.control.slider.value() == LADDER.index(90.0)


@pytest.mark.parametrize(("typed", "wanted"), [("79.2", 80.0), ("51", 50.0), ("500", 128.0), ("3", 10.0), ("64", 64.0)])
def test_typed_values_snap(qtbot: QtBot, typed: str, wanted: float) -> None:
    made = board(qtbot, Ladder(LADDER), 78.0)
    spin = made.control.spin
    spin.setDecimals(1)
    spin.setFocus()
    spin.selectAll()
    qtbot.keyClicks(spin, typed)
    assert made.heard == []  # nothing is sent while typing
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert made.heard == [wanted]
    assert spin.value() == wanted


def test_nonsense_leaves_the_value(qtbot: QtBot) -> None:
    made = board(qtbot, Linear(-16667.0, 33334.0, 1.0), 2028.0)
    spin = made.control.spin
    spin.selectAll()
    qtbot.keyClicks(spin, "nan")
    qtbot.keyClick(spin, Qt.Key.Key_Return)
    assert made.control.value == 2028.0
    assert made.heard == []


def test_showing_a_value_tells_nobody_and_keeps_it_exactly(qtbot: QtBot) -> None:
    made = board(qtbot, Logarithmic(100.0, 50_000.0, 1.0), 100.0)
    made.control.show_value(12_345.0)
    assert made.heard == []
    assert made.control.spin.value() == 12_345.0
    qtbot.keyClick(made.control.slider, Qt.Key.Key_Right)
    assert len(made.heard) == 1
    assert 12_345.0 < made.heard[0] < 12_345.0 * 1.03


def test_clicking_and_dragging_the_slider(qtbot: QtBot) -> None:
    made = board(qtbot, Linear(0.0, 1000.0, 1.0), 0.0)
    made.resize(600, 120)
    slider = made.control.slider
    start = slider.rect().center()
    start.setX(6)
    qtbot.mousePress(slider, Qt.MouseButton.LeftButton, pos=start)
    move_pointer(qtbot, slider, slider.rect().center())
    qtbot.mouseRelease(slider, Qt.MouseButton.LeftButton, pos=slider.rect().center())
    assert made.control.value == pytest.approx(500, abs=30)
    assert made.control.spin.value() == made.control.value == made.heard[-1]
