"""First step of a calibration: which chart, which camera and projector, and where poses are kept."""

from __future__ import annotations

from typing import Final

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import QFormLayout, QHBoxLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout, QWidget

from slopegate.app.panels.folder_row import FolderRow
from slopegate.app.session.describe import as_sentence
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import CountBox, NumberBox
from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.calibration.chart import CHART_ERROR_PERCENT, LEAST_CORNERS, MOST_CORNERS, Chart, chart_from
from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.patterns import KINDS, LIT, PatternKind, Raster, even
from slopegate.drivers.files.rig_files import MAX_PIXELS_A_SIDE

PRACTICE, CONNECTED, PICTURES = "practice", "connected", "pictures"
USUAL_CHART: Final = "9x7:30"
SHOWN: Final = ("white", "black", "grid", "checkerboard", "row-stripes", "column-stripes")
"""Patterns to aim and to focus a projector with."""
CROSSHAIR: Final = PatternKind("crosshair", "Cross in the middle", lambda raster, _: crosshair(raster))
_DEVICES: Final = {
    PRACTICE: (
        "Practice rig",
        "A camera and a projector of the bench, near those of the rig in use, whose true numbers are told at the end: "
        "nothing is connected, nothing can go wrong",
    ),
    CONNECTED: ("Connected camera and projector", "The camera of the live image, and the screen that shows patterns"),
    PICTURES: ("Pictures in a folder", "Poses that were taken before, by this program or by others: a folder each"),
}


def crosshair(raster: Raster) -> Bytes:
    """The middle row and column lit, and the outermost ones."""
    pattern = even(raster, 0)
    pattern[[0, raster.height // 2, -1]] = pattern[:, [0, raster.width // 2, -1]] = LIT
    return pattern


class ChartStep(QWidget):
    """What is calibrated with which chart."""

    begin_wished = Signal()
    save_wished = Signal()
    show_wished = Signal()
    edited = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.device, self.kind = ChoiceBox(), ChoiceBox()
        self.columns, self.rows, self.square, self.error = CountBox(), CountBox(), NumberBox(), NumberBox()
        self.text = QLineEdit(USUAL_CHART)
        self.width_px, self.height_px = CountBox(), CountBox()
        self.save = QPushButton("Save the chart as PDF ...")
        self.place = FolderRow("the poses", "A folder of its own; every pose is kept there as pictures", "-calibration")
        self.pattern, self.show_it = ChoiceBox(), QPushButton("Show")
        self.note, self.begin = Sentence(), QPushButton("Begin")
        self._explain()
        self._arrange()
        self._connect()
        self._spell_out()
        self._on_device()

    def _explain(self) -> None:
        for key, (text, tip) in _DEVICES.items():
            self.device.addItem(text, key)
            self.device.setItemData(self.device.count() - 1, tip, Qt.ItemDataRole.ToolTipRole)
        self.kind.addItem("Checkerboard", "checkerboard")
        self.kind.addItem("ChArUco board", "charuco")
        for pattern in (*(kind for kind in KINDS if kind.key in SHOWN[:2]), CROSSHAIR):
            self.pattern.addItem(pattern.title, pattern)
        for pattern in (kind for kind in KINDS if kind.key in SHOWN[2:]):
            self.pattern.addItem(pattern.title, pattern)
        for box, name in ((self.columns, "Inner corners across"), (self.rows, "Inner corners down")):
            box.setRange(LEAST_CORNERS, MOST_CORNERS)
            box.setAccessibleName(name)
        for count, name in ((self.width_px, "Projector columns"), (self.height_px, "Projector rows")):
            count.setRange(1, MAX_PIXELS_A_SIDE)
            count.setAccessibleName(name)
        self.square.setRange(0.1, 1000.0)
        self.square.setDecimals(3)
        self.square.setSuffix(" mm")
        self.error.setRange(0.0, 5.0)
        self.error.setDecimals(2)
        self.error.setValue(CHART_ERROR_PERCENT)
        self.error.setPrefix("\u00b1 ")
        self.error.setSuffix(" %")
        names: list[tuple[QWidget, str, str]] = [
            (self.device, "What is calibrated", "The camera and projector whose numbers are wanted"),
            (self.kind, "Kind of chart", "A ChArUco board may be seen in part, a checkerboard has to be seen whole"),
            (self.columns, "Inner corners across", "Places where four squares meet, from left to right"),
            (self.rows, "Inner corners down", "Places where four squares meet, from top to bottom"),
            (self.square, "Square", "Side of a square as it was printed: measure over many of them with a ruler"),
            (
                self.error,
                "Error of the chart",
                "How well its lengths are known (one standard error): all lengths of the result share it",
            ),
            (self.text, "Chart as text", "As the command line has it: COLUMNSxROWS:MM, or charuco:COLUMNSxROWS:MM"),
            (self.save, "Save the chart as PDF", "To print at its true size, on paper that is glued to a flat board"),
            (self.pattern, "Pattern on the projector", "To aim and to focus it"),
            (self.show_it, "Show the pattern", "Show it through the projector that is calibrated"),
            (self.begin, "Begin the calibration", "Go on with the poses of the chart"),
        ]
        for widget, name, tip in names:
            widget.setAccessibleName(name)
            widget.setToolTip(tip)

    def _arrange(self) -> None:
        form = QFormLayout()
        form.setRowWrapPolicy(QFormLayout.RowWrapPolicy.WrapLongRows)
        form.addRow("Calibrate", FlowLayout([self.device]))
        form.addRow("Chart", FlowLayout([self.kind, self.columns, QLabel("\u00d7"), self.rows, QLabel("corners")]))
        form.addRow("Square", FlowLayout([self.square, self.error]))
        form.addRow("As text", self.text)
        form.addRow("", FlowLayout([self.save]))
        form.addRow("Projector", FlowLayout([self.width_px, QLabel("\u00d7"), self.height_px, QLabel("pixels")]))
        form.addRow("Pattern", FlowLayout([self.pattern, self.show_it]))
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(6)
        column.addLayout(form)
        column.addWidget(self.place)
        below = QHBoxLayout()
        below.addWidget(self.begin)
        below.addStretch(1)
        column.addLayout(below)
        column.addWidget(self.note)
        column.addStretch(1)

    def _connect(self) -> None:
        self.device.currentIndexChanged.connect(self._on_device)
        self.kind.currentIndexChanged.connect(self._on_fields)
        for box in (self.columns, self.rows, self.square):
            box.valueChanged.connect(self._on_fields)
        self.text.textChanged.connect(self._spell_out)
        self.place.changed.connect(self.edited)
        self.save.clicked.connect(self.save_wished)
        self.show_it.clicked.connect(self.show_wished)
        self.begin.clicked.connect(self.begin_wished)

    @property
    def chosen(self) -> str:
        """PRACTICE, CONNECTED or PICTURES."""
        return str(self.device.currentData())

    def chart(self) -> Chart:
        """The chart of the text. Raises InputError."""
        return chart_from(self.text.text())

    def raster(self) -> Raster:
        """The projector's pixels as they are typed."""
        return Raster(self.width_px.value(), self.height_px.value())

    def drawn(self, raster: Raster) -> Bytes:
        """The pattern that is chosen."""
        kind = self.pattern.currentData()
        assert isinstance(kind, PatternKind)
        return kind.draw(raster, kind.number.usual(raster) if kind.number else 0)

    def show_raster(self, raster: Raster) -> None:
        """Set the projector's pixels."""
        self.width_px.setValue(raster.width)
        self.height_px.setValue(raster.height)

    def say(self, sentence: str) -> None:
        """Say what is missing."""
        self.note.setText(sentence)

    def _on_device(self) -> None:
        reads = self.chosen == PICTURES
        for widget in (self.pattern, self.show_it):
            widget.setEnabled(not reads)
        for box in (self.width_px, self.height_px):
            box.setEnabled(reads)
        self.edited.emit()

    def _on_fields(self) -> None:
        """The fields become the text; what only the text tells of a ChArUco board goes back to what is usual."""
        kind = "charuco:" if self.kind.currentData() == "charuco" else ""
        with QSignalBlocker(self.text):
            self.text.setText(f"{kind}{self.columns.value()}x{self.rows.value()}:{self.square.value():.6g}")
        self._judge()

    def _spell_out(self) -> None:
        """The text becomes the fields, where it names a chart."""
        try:
            chart = self.chart()
        except InputError:
            self._judge()
            return
        fields = (self.kind, self.columns, self.rows, self.square)
        blocked = [QSignalBlocker(field) for field in fields]
        self.kind.setCurrentIndex(self.kind.findData(chart.kind))
        self.columns.setValue(chart.columns)
        self.rows.setValue(chart.rows)
        self.square.setValue(1000 * chart.square_m)
        for one in blocked:
            one.unblock()
        self._judge()

    def _judge(self) -> None:
        try:
            self.chart()
        except InputError as error:
            self.say(as_sentence(error))
        else:
            self.say("")
        self.edited.emit()
