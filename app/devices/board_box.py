"""The form for a sync board: its kind, its port's speed, and its pulses."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QFormLayout, QGroupBox, QWidget

from slopegate.app.widgets.number_box import CountBox, NumberBox
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.drivers.sync.boards import DIALECTS, BoardChoice, dialect_of

BAUDS = (9600, 19200, 38400, 57600, 115200)


class BoardBox(QGroupBox):
    """Edits a `BoardChoice`. The port comes from the device list."""

    edited = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("Sync board or delay generator", parent)
        self.kind, self.baud = ChoiceBox(), ChoiceBox()
        for dialect in DIALECTS:
            self.kind.addItem(dialect.title, dialect.key)
        for rate in BAUDS:
            self.baud.addItem(f"{rate} baud", rate)
        self.output = CountBox()
        self.width_us, self.level_v = NumberBox(), NumberBox()
        self.width_us.setSuffix(" \u00b5s")
        self.level_v.setSuffix(" V")
        self.level_v.setSingleStep(0.1)
        self.rising, self.inverted = QCheckBox("Trigger on the rising edge"), QCheckBox("Pulse low instead of high")
        form = QFormLayout(self)
        form.addRow("&Kind", self.kind)
        form.addRow("&Speed", self.baud)
        form.addRow("&Output", self.output)
        form.addRow("Pulse &width", self.width_us)
        form.addRow("Trigger &level", self.level_v)
        form.addRow(self.rising)
        form.addRow(self.inverted)
        for box, name in ((self.output, "Output"), (self.width_us, "Pulse width"), (self.level_v, "Trigger level")):
            box.setAccessibleName(name)
        self.kind.setToolTip("Which family of boards it is; Test finds out by itself")
        self.output.setToolTip("The output that is wired to the camera's trigger input, counted from 1")
        self.level_v.setToolTip("The input switches at this voltage: half of the projector's sync signal")
        self.kind.currentIndexChanged.connect(self._on_kind)
        self._on_kind()
        self.show_choice(None)

    def show_choice(self, choice: BoardChoice | None) -> None:
        """Show what is remembered; None shows the defaults of the first kind."""
        known = choice or BoardChoice(where="", dialect=DIALECTS[0].key, baud=DIALECTS[0].bauds[0])
        self.kind.setCurrentIndex(self.kind.findData(known.dialect))
        self._on_kind()
        self._set_baud(known.baud)
        self.output.setValue(known.output)
        self.width_us.setValue(known.width_us)
        self.level_v.setValue(known.trigger_level_v)
        self.rising.setChecked(known.trigger_rising)
        self.inverted.setChecked(known.inverted)

    def choice(self, where: str) -> BoardChoice:
        """The choice that is set, for the board at this port."""
        return BoardChoice(
            where=where,
            dialect=self.kind.currentData(),
            baud=self.baud.currentData(),
            output=self.output.value(),
            width_us=self.width_us.value(),
            inverted=self.inverted.isChecked(),
            trigger_rising=self.rising.isChecked(),
            trigger_level_v=self.level_v.value(),
        )

    def _set_baud(self, rate: int) -> None:
        if self.baud.findData(rate) < 0:
            self.baud.addItem(f"{rate} baud", rate)
        self.baud.setCurrentIndex(self.baud.findData(rate))

    def _on_kind(self) -> None:
        dialect = dialect_of(self.kind.currentData())
        self._set_baud(dialect.bauds[0])
        limits = dialect.limits
        for widget in (self.output, self.width_us, self.level_v, self.rising, self.inverted):
            widget.setEnabled(limits is not None)
        self.output.setRange(1, max(dialect.outputs, 1))
        if limits is not None:
            self.width_us.setRange(max(limits.width_us.min, 0.01), min(limits.width_us.max, 1e6))
            self.level_v.setRange(limits.trigger_level_v.min, limits.trigger_level_v.max)
        self.edited.emit()
