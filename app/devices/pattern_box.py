"""The form for a projector's pattern: its kind, and its number or file."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import (
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QWidget,
)

from slopegate.app.devices.projector_memory import FILE_KEY, ProjectorChoice
from slopegate.app.widgets.number_box import CountBox
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.patterns import KINDS, Raster
from slopegate.drivers.files.picture_files import COLOUR_SUFFIXES

_KINDS = {kind.key: kind for kind in KINDS}


class PatternBox(QWidget):
    """The fields for a pattern. `edited` tells that another one is chosen."""

    edited = Signal()

    def __init__(self, form: QFormLayout, choice: ProjectorChoice, raster: Raster, parent: QWidget) -> None:
        """Adds its rows to the form. `choice` is what was chosen the last time, `raster` the pixels of the screen."""
        super().__init__(parent)
        self.hide()  # its fields are the form's
        self._numbers, self._raster = dict(choice.numbers), raster
        self.kinds, self.number, self.number_name = ChoiceBox(), CountBox(), QLabel()
        self.file, file_name, self.browse = QLineEdit(choice.file), QLabel("&File"), QPushButton("&Browse ...")
        for kind in KINDS:
            self.kinds.addItem(kind.title, kind.key)
        self.kinds.addItem("Picture file", FILE_KEY)
        self.kinds.setCurrentIndex(max(self.kinds.findData(choice.pattern), 0))
        self._told = choice.file
        self._form, self._files = form, QHBoxLayout()
        self._files.addWidget(self.file, 1)
        self._files.addWidget(self.browse)
        form.addRow("&Pattern", self.kinds)
        form.addRow(self.number_name, self.number)
        self.number_name.setBuddy(self.number)
        form.addRow(file_name, self._files)
        file_name.setBuddy(self.file)
        self.file.setPlaceholderText("a picture of exactly the screen's size")
        self._show_kind()
        self.kinds.currentIndexChanged.connect(self._on_kind)
        self.number.valueChanged.connect(self._on_number)
        self.file.editingFinished.connect(self._on_file)
        self.browse.clicked.connect(self._on_browse)

    @property
    def title(self) -> str:
        """The pattern's name."""
        return self.kinds.currentText()

    def changes(self) -> dict[str, object]:
        """The pattern that is chosen, as fields of a `ProjectorChoice`."""
        return {"pattern": self.kinds.currentData(), "numbers": dict(self._numbers), "file": self.file.text()}

    def use_raster(self, raster: Raster) -> None:
        """Set the number of pixels of the screen."""
        if raster != self._raster:
            self._raster = raster
            self._show_kind()

    def draw(self, raster: Raster) -> Bytes | Path | None:
        """The pattern, or the file that holds it; None while no file is chosen."""
        kind, name = _KINDS.get(self.kinds.currentData()), self.file.text()
        if kind is not None:
            return kind.draw(raster, self.number.value())
        return Path(name) if name else None

    def _show_kind(self) -> None:
        """Show the fields of the chosen pattern, with the number it had last."""
        kind = _KINDS.get(self.kinds.currentData())
        number = None if kind is None else kind.number
        self._form.setRowVisible(self.number, number is not None)
        self._form.setRowVisible(self._files, kind is None)
        if kind is not None and number is not None:
            with QSignalBlocker(self.number):
                self.number.setRange(number.low, number.high(self._raster))
                self.number.setValue(self._numbers.get(kind.key, number.usual(self._raster)))
            self.number_name.setText(f"&{number.name}")
            self.number.setAccessibleName(number.name)

    def _on_kind(self) -> None:
        self._show_kind()
        self.edited.emit()

    def _on_number(self) -> None:
        self._numbers[self.kinds.currentData()] = self.number.value()
        self.edited.emit()

    def _on_file(self) -> None:
        if self.file.text() != self._told:  # or leaving the field would count as a change
            self._told = self.file.text()
            self.edited.emit()

    def _on_browse(self) -> None:
        kinds = " ".join(f"*{suffix}" for suffix in COLOUR_SUFFIXES)
        name, _ = QFileDialog.getOpenFileName(
            self.window(), "A picture of the screen's size", "", f"Pictures ({kinds})"
        )
        if name:
            self.file.setText(name)
            self._on_file()
