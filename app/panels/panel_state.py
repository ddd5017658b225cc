"""What is set in a panel, as plain values by the fields' names: to be kept in a file, and set again."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QAbstractButton, QCheckBox, QComboBox, QRadioButton, QWidget

from slopegate.app.widgets.number_box import NumberBox

Values = dict[str, bool | int | float | str]
Box = tuple[int, int, int, int]
"""Columns x0 .. x1 - 1 of rows y0 .. y1 - 1 of the image."""


class KeptBox(QObject):
    """A rectangle of the image that belongs to a panel, by a name that is one of a kind there."""

    name = ""
    box: Box | None = None

    def set_box(self, box: Box | None) -> None:
        """Take another rectangle, or none."""
        raise NotImplementedError


def values_of(panel: QWidget) -> Values:
    """The value of every number, choice, check box and radio button in it, and its rectangles."""
    boxes = {one.name: numbers_text(one.box) for one in panel.findChildren(KeptBox) if one.box is not None}
    return {name: _value(field) for name, field in _fields(panel)} | boxes


def numbers_text(numbers: Iterable[float]) -> str:
    """Numbers as one text, which `text_numbers` reads to the last bit."""
    return " ".join(map(repr, numbers))


def text_numbers(text: object, count: int) -> tuple[float, ...] | None:
    """So many finite numbers from their text; None of anything else."""
    words = text.split() if isinstance(text, str) else []
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        return None
    return numbers if len(numbers) == count and all(map(math.isfinite, numbers)) else None


def text_box(text: object, shape: tuple[int, int]) -> Box | None:
    """A rectangle from its text, where an image of this height and width has it; else None."""
    numbers = text_numbers(text, 4)
    if numbers is None:
        return None
    x0, y0, x1, y1 = map(round, numbers)
    return (x0, y0, x1, y1) if 0 <= x0 < x1 <= shape[1] and 0 <= y0 < y1 <= shape[0] else None


def set_values(panel: QWidget, values: Mapping[str, bool | int | float | str]) -> None:
    """Set those fields that there are; names that are not known and values of another kind are left out."""
    for name, field in _fields(panel):
        value = values.get(name)
        if isinstance(field, QComboBox) and isinstance(value, str):
            index = field.findText(value)
            if index >= 0:
                field.setCurrentIndex(index)
                field.activated.emit(index)
        elif isinstance(field, QAbstractButton) and isinstance(value, bool):
            field.setChecked(value)
        elif isinstance(field, NumberBox) and isinstance(value, int | float) and not isinstance(value, bool):
            field.setValue(value)


def set_boxes(panel: QWidget, values: Mapping[str, bool | int | float | str], shape: tuple[int, int]) -> None:
    """Set its rectangles that were kept, of an image of this height and width; the others are none."""
    for one in panel.findChildren(KeptBox):
        one.set_box(text_box(values.get(one.name), shape))


def _fields(panel: QWidget) -> Iterator[tuple[str, QWidget]]:
    seen: dict[str, int] = {}
    kinds = (NumberBox, QComboBox, QCheckBox, QRadioButton)
    for field in panel.findChildren(QWidget):
        if not isinstance(field, kinds):
            continue
        text = field.text().replace("&", "") if isinstance(field, QAbstractButton) else field.accessibleName()
        if not text:
            continue
        seen[text] = seen.get(text, 0) + 1
        yield (text if seen[text] == 1 else f"{text} {seen[text]}"), field


def _value(field: QWidget) -> bool | int | float | str:
    if isinstance(field, QComboBox):
        return field.currentText()
    if isinstance(field, QAbstractButton):
        return field.isChecked()
    assert isinstance(field, NumberBox)
    return field.value()
