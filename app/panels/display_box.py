"""Controls for how the live image is shown: colours, marks, scale bar, automatic levels."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker
from PySide6.QtGui import QColor, QIcon, QPixmap
from PySide6.QtWidgets import QCheckBox, QGroupBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from slopegate.app.views.live_panel import LivePanel
from slopegate.app.widgets.colour_maps import COLOUR_MAPS, DARK, SATURATED
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import NumberBox
from slopegate.app.widgets.steady import ChoiceBox


class DisplayBox(QGroupBox):
    """Shows and changes the live image's `display`."""

    def __init__(self, live: LivePanel) -> None:
        super().__init__("Shown as")
        self._live = live
        self.colours = ChoiceBox()
        self.colours.addItems(COLOUR_MAPS)
        self.colours.setAccessibleName("Colour map")
        self.saturated, self.dark, self.scale = (
            QCheckBox("Saturated"),
            QCheckBox("Too dark, up to"),
            QCheckBox("Scale bar"),
        )
        self.saturated.setIcon(_swatch(SATURATED))
        self.saturated.setToolTip("Mark pixels at the camera's greatest count (F9)")
        self.dark.setIcon(_swatch(DARK))
        self.dark.setToolTip("Mark pixels with hardly any light (Shift+F9)")
        self.scale.setToolTip("How long things are at the slab's distance; nothing where the gate has none")
        self.dark_percent = _percent("Too dark, up to", 50.0, "Of the camera's range above its dark level")
        self.auto_dark = _percent("Auto: black", 45.0, "How many of the pixels Auto shows as black")
        self.auto_bright = _percent("Auto: white", 45.0, "How many of the pixels Auto shows as white")
        self.numbers = (self.dark_percent, self.auto_dark, self.auto_bright)
        maps = _beside(QLabel("Colours"), self.colours)
        auto = _beside(QLabel("Auto: black"), self.auto_dark, QLabel("white"), self.auto_bright)
        dark = _beside(self.dark, self.dark_percent)
        column = QVBoxLayout(self)
        column.addLayout(FlowLayout((maps, self.saturated, dark, self.scale, auto)))
        self.colours.currentIndexChanged.connect(self._apply)
        for box in (self.saturated, self.dark, self.scale):
            box.toggled.connect(self._apply)
        for spin in self.numbers:
            spin.valueChanged.connect(self._apply)
        live.display_changed.connect(self._show)
        self._show()

    def _apply(self) -> None:
        update = {
            "colour_map": self.colours.currentText(),
            "mark_saturated": self.saturated.isChecked(),
            "mark_dark": self.dark.isChecked(),
            "dark_percent": self.dark_percent.value(),
            "scale_bar": self.scale.isChecked(),
            "auto_dark_percent": self.auto_dark.value(),
            "auto_bright_percent": self.auto_bright.value(),
        }
        self._live.show_as(self._live.display.model_copy(update=update))

    def _show(self) -> None:
        now = self._live.display
        fields = (self.colours, self.saturated, self.dark, self.scale)
        blockers = [QSignalBlocker(field) for field in (*fields, *self.numbers)]
        self.colours.setCurrentText(now.colour_map)
        self.saturated.setChecked(now.mark_saturated)
        self.dark.setChecked(now.mark_dark)
        self.dark_percent.setValue(now.dark_percent)
        self.scale.setChecked(now.scale_bar)
        self.auto_dark.setValue(now.auto_dark_percent)
        self.auto_bright.setValue(now.auto_bright_percent)
        del blockers

    def show_source(self, in_colour: bool) -> None:
        """A camera with a mosaic has colours of its own."""
        self.colours.setEnabled(not in_colour)
        why = "The image has colours of its own: a grey pixel format takes a map"
        self.colours.setToolTip(why if in_colour else "Colours of the counts; the bar below the histogram shows them")


def _percent(name: str, most: float, hint: str) -> NumberBox:
    spin = NumberBox()
    spin.setDecimals(2)
    spin.setRange(0.0, most)
    spin.setSingleStep(0.1)
    spin.setSuffix(" %")
    spin.setAccessibleName(name)
    spin.setToolTip(hint)
    return spin


def _beside(*widgets: QWidget) -> QWidget:
    """These in one line that the flow does not break."""
    together = QWidget()
    row = QHBoxLayout(together)
    row.setContentsMargins(0, 0, 0, 0)
    for widget in widgets:
        row.addWidget(widget)
    return together


def _swatch(colour: int) -> QIcon:
    square = QPixmap(12, 12)
    square.fill(QColor.fromRgba(colour))
    return QIcon(square)
