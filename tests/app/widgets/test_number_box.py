"""Numbers that are typed, under the desktop's languages, with real keys."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtCore import QLocale, Qt
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from slopegate.app.widgets.number_box import CountBox, FrameCount, NumberBox, read_number

LANGUAGES = ("de_DE", "en_US", "ar_EG", "de_CH", "fa_IR", "hi_IN", "fr_FR")


@pytest.fixture(params=LANGUAGES)
def language(request: pytest.FixtureRequest) -> Iterator[str]:
    before = QLocale()
    QLocale.setDefault(QLocale(request.param))
    yield request.param
    QLocale.setDefault(before)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("0.9", 0.9),
        ("0,9", 0.9),
        (" .5", 0.5),
        ("5,", 5.0),
        ("-1,5e-3", -0.0015),
        ("+2E2", 200.0),
        ("\u22123", -3.0),
        ("\u0661\u0662\u066b\u0665", 12.5),
        ("1,234", 1.234),
        ("1.234,5", None),
        ("1,234.5", None),
        ("1.234.567", None),
        ("1'234", None),
        ("1 234", None),
        ("1_000", None),
        ("nan", None),
        ("inf", None),
        ("1e999", None),
        ("0x10", None),
        ("", None),
    ],
)
def test_dot_and_comma_are_the_decimal_mark_and_nothing_is_a_group(text: str, number: float | None) -> None:
    assert read_number(text) == number


def make(qtbot: QtBot, box: NumberBox, suffix: str) -> tuple[NumberBox, list[str]]:
    said: list[str] = []
    qtbot.addWidget(box)
    box.setAccessibleName("Distance")
    box.setSuffix(suffix)
    box.refused.connect(said.append)
    with qtbot.waitExposed(box):
        box.show()
    return box, said


def enter(qtbot: QtBot, box: NumberBox, text: str) -> None:
    box.selectAll()
    qtbot.keyClicks(box.lineEdit(), text)
    qtbot.keyClick(box, Qt.Key.Key_Return)


def of_three_decimals(qtbot: QtBot) -> tuple[NumberBox, list[str]]:
    box = NumberBox()
    box.setDecimals(3)
    box.setRange(0.0, 99_999.0)
    return make(qtbot, box, " m")


@pytest.mark.parametrize(
    ("typed", "value", "shown"),
    [
        ("0.900", 0.9, "0.900 m"),
        ("0,900", 0.9, "0.900 m"),
        ("2028.5", 2028.5, "2028.500 m"),
        ("2028,5", 2028.5, "2028.500 m"),
        ("12345", 12345.0, "12345.000 m"),
        ("1,5m", 1.5, "1.500 m"),
    ],
)
def test_what_is_typed_is_what_is_set_in_every_language(
    qtbot: QtBot, language: str, typed: str, value: float, shown: str
) -> None:
    box, said = of_three_decimals(qtbot)
    enter(qtbot, box, typed)
    assert (box.value(), box.text(), said) == (value, shown, [])


@pytest.mark.parametrize("pasted", ["1.234,5", "1,234.5", "1'234.5", "1\u202f234,5"])
def test_groups_that_are_pasted_are_refused_in_a_sentence(qtbot: QtBot, language: str, pasted: str) -> None:
    box, said = of_three_decimals(qtbot)
    box.setValue(0.9)
    QApplication.clipboard().setText(pasted)
    box.selectAll()
    qtbot.keyClick(box, Qt.Key.Key_V, Qt.KeyboardModifier.ControlModifier)
    qtbot.keyClick(box, Qt.Key.Key_Return)
    assert box.value() == 0.9
    assert box.text() == "0.900 m"
    mark = repr(pasted)
    hint = "write it with one decimal mark, such as 1234.5; 0 to 99999 m is possible. It is still 0.900 m."
    assert said == [f"Distance: {mark} has marks between groups of digits: {hint}"]


def test_more_decimals_than_the_field_has_are_rounded_and_said(qtbot: QtBot) -> None:
    box, said = of_three_decimals(qtbot)
    enter(qtbot, box, "0.9004")
    assert box.value() == 0.9
    assert said == ["Distance: there is no 0.9004 m, the nearest is set: 0.9 m."]
    said.clear()
    enter(qtbot, box, "0.90000")
    assert (box.value(), said) == (0.9, [])


def test_a_whole_number_is_not_cut_at_its_mark(qtbot: QtBot, language: str) -> None:
    box = CountBox()
    box.setRange(0, 99_999)
    box, said = make(qtbot, box, " counts")
    enter(qtbot, box, "12345")
    assert (box.value(), box.text(), said) == (12345, "12345 counts", [])
    enter(qtbot, box, "12.7")
    assert (box.value(), said) == (13, ["Distance: there is no 12.7 counts, the nearest is set: 13 counts."])
    said.clear()
    enter(qtbot, box, "1.234,0")
    assert box.value() == 13
    assert len(said) == 1


def test_frames_are_one_or_many(qtbot: QtBot) -> None:
    box, said = make(qtbot, FrameCount(64), " frame")
    enter(qtbot, box, "12")
    assert (box.value(), box.text()) == (12, "12 frames")
    enter(qtbot, box, "1")
    assert (box.value(), box.text(), said) == (1, "1 frame", [])
    qtbot.keyClick(box, Qt.Key.Key_Up)
    assert box.text() == "2 frames"


def test_what_stands_before_and_after_the_number_may_stay(qtbot: QtBot) -> None:
    box = CountBox()
    box.setPrefix("column ")
    box, said = make(qtbot, box, " px")
    enter(qtbot, box, "column 7 px")
    assert (box.value(), box.text(), said) == (7, "column 7 px", [])
