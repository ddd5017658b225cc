"""The slices of a light transport as layers: which are seen, in which colour, how bright, and with which picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QRectF, QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QColor, QIcon, QPainter, QPen, QPixmap
from PySide6.QtWidgets import (
    QAbstractItemView,
    QColorDialog,
    QFileDialog,
    QHBoxLayout,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.session.describe import number
from slopegate.app.session.loading import Loader
from slopegate.app.widgets.controls import Linear, NumberControl
from slopegate.app.widgets.flow import FlowLayout
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.patterns import Raster
from slopegate.core.transport.relight import WHITE, Colour, SliceLight
from slopegate.drivers.files.picture_files import read_pattern

GAINS = Linear(0.0, 4.0, 0.01, 25)
_SHOWN = Qt.CheckState
PICTURES = "Pictures (*.png)"


class LayerList(QWidget):
    """One row a slice, and below them what the selected ones are lit with."""

    changed = Signal()
    """Some slice is lit differently."""
    failed = Signal(str)
    """Why a picture cannot be used, in one sentence."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._names: tuple[str, ...] = ()
        self._lights: list[SliceLight] = []
        self._files: list[str] = []
        self._written: list[SliceLight | None] = []
        """What the rows show."""
        self._raster = Raster(1, 1)
        self.rows = QListWidget()
        self.colour, self.picture, self.plain = (
            QPushButton("Colour …"),
            QPushButton("Picture …"),
            QPushButton("No picture"),
        )
        self.gain = NumberControl(GAINS, self)
        self.all, self.reset = QPushButton("Select all"), QPushButton("All white")
        self._reader: Loader[tuple[str, Singles]] = Loader(lambda _: None, self)
        self._explain()
        self._arrange()
        self._connect()

    def _explain(self) -> None:
        self.rows.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.rows.setIconSize(QSize(28, 14))
        self.rows.setAccessibleName("Slices")
        self.rows.setToolTip("Tick what is to be seen; select one or more to change their light")
        self.rows.setMinimumHeight(72)
        self.gain.set_scale(GAINS)
        self.gain.describe("Gain", "", "How many times as bright the selected slices are lit")
        self.colour.setToolTip("Light the selected slices with a colour; each value of 255 is its share of the light")
        self.picture.setToolTip(
            "Light the selected slices with a picture of at most the projector's size, read as linear"
        )
        self.plain.setToolTip("Light the selected slices evenly again")
        self.all.setToolTip("Change the light of all slices together")
        self.reset.setToolTip("Show every slice, evenly lit with white")

    def _arrange(self) -> None:
        gain = QHBoxLayout()
        gain.addWidget(self.gain.label)
        gain.addWidget(self.gain.slider, 1)
        gain.addWidget(self.gain.spin)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(4)
        column.addWidget(self.rows, 1)
        column.addLayout(gain)
        column.addLayout(FlowLayout([self.colour, self.picture, self.plain, self.all, self.reset]))

    def _connect(self) -> None:
        self.rows.itemSelectionChanged.connect(self._show_selected)
        self.rows.itemChanged.connect(self._on_ticked)
        self.gain.edited.connect(lambda gain: self._change(gain=gain))
        self.colour.clicked.connect(self._ask_colour)
        self.picture.clicked.connect(self._ask_picture)
        self.plain.clicked.connect(lambda: self._put_picture("", None))
        self.all.clicked.connect(self.rows.selectAll)
        self.reset.clicked.connect(self._reset)
        self._reader.finished.connect(lambda found: self._put_picture(*found))
        self._reader.failed.connect(self.failed)

    @property
    def lights(self) -> tuple[SliceLight, ...]:
        """What each slice is lit with, in their order."""
        return tuple(self._lights)

    @property
    def chosen(self) -> tuple[int, ...]:
        """The selected slices by their place, rising."""
        return tuple(sorted(index.row() for index in self.rows.selectedIndexes()))

    def show_slices(self, names: Sequence[str], raster: Raster) -> None:
        """List these slices, all seen and evenly white; the first is selected."""
        self._reader.cancel()
        self._names, self._raster = tuple(names), raster
        self._lights, self._files = [WHITE] * len(names), [""] * len(names)
        self._written = [None] * len(names)
        with QSignalBlocker(self.rows):
            self.rows.clear()
            for _ in names:
                item = QListWidgetItem()
                item.setFlags(item.flags() | Qt.ItemFlag.ItemIsUserCheckable)
                self.rows.addItem(item)
            self._write()
            self.rows.setCurrentRow(0)
        self._show_selected()

    def light(self, place: int, light: SliceLight) -> None:
        """Light one slice with this."""
        self._lights[place] = light
        self._write()
        self._show_selected()
        self.changed.emit()

    def end(self) -> None:
        """Stop what is being read."""
        self._reader.close()

    def _write(self) -> None:
        """Show in the list what the slices are lit with."""
        with QSignalBlocker(self.rows):
            for place, (name, light, file) in enumerate(zip(self._names, self._lights, self._files, strict=True)):
                item = self.rows.item(place)
                words = [
                    name,
                    *([] if light.gain == 1 else [f"{number(light.gain, 2)} \u00d7"]),
                    *([file] if file else []),
                ]
                item.setText(", ".join(words))
                item.setIcon(_swatch(shown_colour(light.colour)))
                item.setCheckState(_SHOWN.Checked if light.visible else _SHOWN.Unchecked)

    def _show_selected(self) -> None:
        chosen = self.chosen
        missing = "" if chosen else "Select a slice first"
        self.gain.set_missing(missing)
        for button in (self.colour, self.picture):
            button.setEnabled(bool(chosen))
        self.plain.setEnabled(any(self._lights[place].picture is not None for place in chosen))
        if chosen:
            self.gain.show_value(self._lights[chosen[0]].gain)

    def _change(self, **changes: object) -> None:
        for place in self.chosen:
            self._lights[place] = replace(self._lights[place], **changes)  # type: ignore[arg-type]
        self._write()
        self.changed.emit()

    def _on_ticked(self, item: QListWidgetItem) -> None:
        place = self.rows.row(item)
        self._lights[place] = replace(self._lights[place], visible=item.checkState() == _SHOWN.Checked)
        self.changed.emit()

    def _ask_colour(self) -> None:
        before = shown_colour(self._lights[self.chosen[0]].colour)
        colour = QColorDialog.getColor(before, self, "Colour of the light")
        if colour.isValid():
            self._change(colour=light_colour(colour))

    def _ask_picture(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, "Picture for the selected slices", "", PICTURES)
        if name:
            path, raster = Path(name), self._raster
            self._reader.start(lambda _: (path.name, read_pattern(path, raster, colours=True)))

    def _put_picture(self, name: str, picture: Singles | None) -> None:
        for place in self.chosen:
            self._files[place] = name
        self._change(picture=picture)
        self._show_selected()

    def _reset(self) -> None:
        self._lights, self._files = [WHITE] * len(self._names), [""] * len(self._names)
        self._write()
        self._show_selected()
        self.changed.emit()


def light_colour(colour: QColor) -> Colour:
    """The light of a colour: as in pictures and patterns, each value of 255 is its share of the light."""
    return colour.redF(), colour.greenF(), colour.blueF()


def shown_colour(light: Colour) -> QColor:
    """The colour that stands for light; what is brighter than 1 counts as 1."""
    return QColor.fromRgbF(*(min(part, 1.0) for part in light))


def _swatch(colour: QColor) -> QIcon:
    picture = QPixmap(56, 28)
    picture.setDevicePixelRatio(2.0)
    picture.fill(colour)
    painter = QPainter(picture)
    painter.setPen(QPen(QColor("#808080"), 1))
    painter.drawRect(QRectF(0.5, 0.5, 27, 13))
    painter.end()
    icon = QIcon(picture)
    icon.addPixmap(picture, QIcon.Mode.Selected)  # Qt would tint it
    return icon
