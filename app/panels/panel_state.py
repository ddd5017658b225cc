"""What is set in a panel, as plain values by the fields' names: to be kept in a file, and set again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from PySide6.QtWidgets import QAbstractButton, QCheckBox, QComboBox, QRadioButton, QWidget

from slopegate.app.widgets.number_box import NumberBox

Values = dict[str, bool | int | float | str]


def values_of(panel: QWidget) -> Values:
    """The value of every number, choice, check box and radio button in it."""
    return {name: _value(field) for name, field in _fields(panel)}


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
