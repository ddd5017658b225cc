"""Panel for the parts of the light: what the gate keeps and refuses of each, and switches for the live image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from PySide6.QtCore import QEvent, QSignalBlocker, Qt, QTimer
from PySide6.QtGui import QCloseEvent, QColor, QHideEvent, QShowEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.panels.bake_row import BakeRow
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.loading import CancelledError, Newest, Progress
from slopegate.app.session.session import Change
from slopegate.app.session.source import Source
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.light_bars import BarPair, LightBars, Look, swatch_icon
from slopegate.app.widgets.number_box import CountBox
from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.app.widgets.theme import colours
from slopegate.core.gating.plan import whole_period
from slopegate.core.light.amounts import Amounts, Split
from slopegate.core.light.part import PARTS, PartName
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.cameras.virtual import VirtualCamera

LOOK_MS, MOVING_MS = 100, 500
"""How often the panel looks whether anything has changed, and how often it measures a scene that moves."""

_STYLES = Qt.BrushStyle
LOOKS: Final[Mapping[PartName, Look]] = {
    "direct": Look("Direct", "#e69f00", _STYLES.SolidPattern),
    "airlight": Look("Airlight", "#56b4e9", _STYLES.BDiagPattern),
    "scatter": Look("Fog blur", "#009e73", _STYLES.HorPattern),
    "indirect": Look("Indirect", "#cc79a7", _STYLES.DiagCrossPattern),
    "subsurface": Look("Under skin", "#d55e00", _STYLES.VerPattern),
    "ambient": Look("Room light", "#c8cdd3", _STYLES.Dense6Pattern),
}
"""Colours of Okabe and Ito, which colour-blind people tell apart, each with a pattern of its own."""

MEANINGS: Final[Mapping[PartName, str]] = {
    "direct": "From the projector to the surface and straight to the camera",
    "airlight": "Scattered once by the fog on its way: the veil",
    "scatter": "From the surface, turned a little by the fog before the camera: blur",
    "indirect": "Light that met more than one surface, or the fog more than once",
    "subsurface": "Went into the skin and came out beside",
    "ambient": "Not from the projector; grows with the exposure alone",
}
_ABSENT: Final[Mapping[PartName, str]] = {
    "airlight": "This scene has no fog",
    "scatter": "This scene has no fog",
    "subsurface": "Nothing in this scene is skin",
    "indirect": "Not asked for by this scene: 'indirect = true' in its file brings it",
}
UNIT = "The unit is what a white surface 1 m before the projector shows"


def what_is_missing(source: Source) -> str:
    """Why the parts of the light are not known, or not all, in one sentence; empty when all are."""
    if source.played is not None:
        return "A capture holds the light of each slice as it was recorded, not where it came from."
    if source.rendered is None:
        return "A camera records the sum of all light; its parts are known of rendered scenes only."
    if source.scene.capture is not None:
        return "A photo with depth shows one side of things, so light between its surfaces is not known."
    return ""


def measure(
    camera: VirtualCamera, rig: Rig, sent: GateSettings, progress: Progress
) -> tuple[Amounts, Mapping[PartName, Split]]:
    """What this gate keeps of each part and what everything lit would, and the means of both."""
    kept = camera.light_by_part(sent)
    progress.step(0.4, "")
    lit = camera.light_by_part(whole_period(rig, sent.line_time_us))
    progress.step(0.8, "")
    if not (kept and lit):  # another scene has come meanwhile
        raise CancelledError
    amounts = Amounts(kept, lit)
    return amounts, amounts.mean()


class LightPanel(Panel):
    """What arrives at the pixel under the pointer and in the whole picture, part by part, kept and refused."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self.amounts: Amounts | None = None
        """Of the gate that was measured last; None before that, and where parts are not known."""
        self._mean: Mapping[PartName, Split] = {}
        self._measured_at: tuple[object, ...] = ()
        self._looks = 0
        self._listening = False
        self._worker: Newest[tuple[Amounts, Mapping[PartName, Split]]] = Newest(self)
        self._make_widgets()
        self._arrange()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._worker.finished.connect(self._on_measured)
        self._worker.failed.connect(self.note.setText)
        for spin in (self.column, self.row):
            spin.valueChanged.connect(self._show)
        self.unit.currentIndexChanged.connect(self._show)

    def _make_widgets(self) -> None:
        self.note = Sentence()
        self.bake = BakeRow()
        self.bars = LightBars({str(name): look for name, look in LOOKS.items()})
        self.column, self.row = CountBox(), CountBox()
        for spin, name in ((self.column, "Column"), (self.row, "Row")):
            spin.setAccessibleName(f"{name} of the pixel")
            spin.setPrefix(f"{name.lower()} ")
            spin.setToolTip("The pixel that is looked at: point at the live image, or type")
        self.unit = ChoiceBox()
        self.unit.addItems(["percent", "light"])
        self.unit.setAccessibleName("Numbers in")
        self.unit.setToolTip(f"Percent of everything kept and refused, or light itself. {UNIT}")
        self.switches: dict[PartName, QCheckBox] = {}
        self.numbers: dict[PartName, list[QLabel]] = {}
        for name in PARTS:
            box = QCheckBox(LOOKS[name].name)
            box.toggled.connect(self._on_switch)
            self.switches[name] = box
            self.numbers[name] = [_number() for _ in range(4)]
        self.totals = [_number() for _ in range(4)]

    def _arrange(self) -> None:
        grid = QGridLayout()
        grid.setVerticalSpacing(2)
        grid.setHorizontalSpacing(10)
        self.table = QWidget()
        self.table.setLayout(grid)
        grid.setContentsMargins(0, 0, 0, 0)
        for place, text in ((1, "this pixel"), (3, "whole picture")):
            grid.addWidget(QLabel(text), 0, place, 1, 2, Qt.AlignmentFlag.AlignRight)
        grid.addWidget(QLabel("shown"), 1, 0)
        for place in range(4):
            grid.addWidget(QLabel(("kept", "refused")[place % 2]), 1, place + 1, Qt.AlignmentFlag.AlignRight)
        lines: list[tuple[QWidget, list[QLabel]]] = [(self.switches[name], self.numbers[name]) for name in PARTS]
        for line, (first, labels) in enumerate([*lines, (QLabel("Together"), self.totals)], 2):
            for place, widget in enumerate((first, *labels)):
                grid.addWidget(widget, line, place)
        grid.setColumnStretch(0, 1)
        pixel = QHBoxLayout()
        pixel.addLayout(FlowLayout([self.column, self.row, self.unit]))
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(self.note)
        column.addLayout(pixel)
        column.addWidget(self.bars)
        column.addWidget(self.table)
        column.addWidget(self.bake)
        column.addStretch(1)

    def follow(self, change: Change) -> None:
        source = self._session.source
        if source is None:
            return
        if Change.SOURCE in change:
            self.let_go()
            info = source.camera.info
            for spin, size in ((self.column, info.width), (self.row, info.height)):
                with QSignalBlocker(spin):
                    spin.setRange(0, size - 1)
                    spin.setValue(size // 2)
            self._show_source(source)
        self._look()

    def let_go(self) -> None:
        self._worker.cancel()
        self.amounts, self._mean, self._measured_at = None, {}, ()
        self.bake.look(None)

    def _show_source(self, source: Source) -> None:
        missing, known = what_is_missing(source), source.rendered is not None
        # by name, for it stays on show while another scene is loaded
        self.note.setText(missing or f"The light of {source.scene.name}:")
        for widget in (self.bars, self.table, self.column, self.row, self.unit):
            widget.setVisible(known)
        self._show()

    def _look(self) -> None:
        """Measure anew where the gate or the light has changed."""
        source, resolved = self._session.source, self._session.resolved
        if source is None or resolved is None or source.rendered is None:
            self.bake.look(None)
            return
        self.bake.look(source.rendered.baking)
        self._show_switches(source.rendered)
        self._looks += 1
        moved = self._looks * LOOK_MS // MOVING_MS if source.scene.moving else source.rendered.smooth.changes
        now = (resolved.sent, moved)
        if now == self._measured_at:
            return
        self._measured_at = now
        camera, rig, sent = source.rendered, source.rig, resolved.sent
        self._worker.want(lambda progress: measure(camera, rig, sent, progress))

    def _on_measured(self, found: tuple[Amounts, Mapping[PartName, Split]]) -> None:
        self.amounts, self._mean = found
        self._show()

    def _show(self) -> None:
        """Show the numbers of the pixel that is looked at, and of the whole picture."""
        amounts = self.amounts
        column, row = self.column.value(), self.row.value()
        here: Mapping[PartName, Split] = {}
        if amounts is not None and row < amounts.shape[0] and column < amounts.shape[1]:
            here = amounts.at(column, row)
        places = (here, self._mean)
        titles = (f"At column {column}, row {row}", "Whole picture")
        self.bars.show_pairs([_pair(title, place) for title, place in zip(titles, places, strict=True)])
        for place, (splits, labels) in enumerate(zip(places, (slice(0, 2), slice(2, 4)), strict=True)):
            whole = sum(sum(split) for split in splits.values())
            for name in PARTS:
                self._write(self.numbers[name][labels], splits.get(name), whole)
            both = [sum(split[side] for split in splits.values()) for side in range(2)]
            self._write(self.totals[2 * place : 2 * place + 2], Split(*both) if splits else None, whole)

    def _write(self, labels: list[QLabel], split: Split | None, whole: float) -> None:
        for label, value in zip(labels, split or (None, None), strict=True):
            if value is None:
                label.setText("\u2013")
            elif self.unit.currentIndex() == 0:
                label.setText(f"{100 * value / whole if whole > 0 else 0.0:.1f} %")
            else:
                label.setText(f"{value:.4f}")

    def _show_switches(self, camera: VirtualCamera) -> None:
        ready, shown = camera.smooth.ready, camera.smooth.shown
        for name, box in self.switches.items():
            there = name in ready
            with QSignalBlocker(box):
                box.setChecked(name in shown and (there or name not in _ABSENT or name in shown))
            box.setEnabled(there or name in shown)
            hint = MEANINGS[name] if there else "Not ready yet" if name in shown else _ABSENT[name]
            box.setToolTip(hint)

    def _on_switch(self) -> None:
        source = self._session.source
        if source is not None and source.rendered is not None:
            source.rendered.smooth.show([name for name, box in self.switches.items() if box.isChecked()])
            self._look()

    def _on_hover(self, column: int, row: int) -> None:
        if column < 0 or (column, row) == (self.column.value(), self.row.value()):
            return
        for spin, value in ((self.column, column), (self.row, row)):
            with QSignalBlocker(spin):
                spin.setValue(value)
        self._show()

    def _listen(self, wanted: bool) -> None:
        """Hear of the pointer, of which every frame tells: only while that is of use."""
        if wanted and not self._listening:
            self._live.view.hovered.connect(self._on_hover)
        elif self._listening and not wanted:
            self._live.view.hovered.disconnect(self._on_hover)
        self._listening = wanted

    def _dress(self) -> None:
        outline = QColor(colours(self.palette()).text)
        for name, box in self.switches.items():
            box.setIcon(swatch_icon(LOOKS[name], outline))

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._dress()
        self._listen(True)
        self._look()
        self._timer.start(LOOK_MS)

    def hideEvent(self, event: QHideEvent) -> None:
        self._timer.stop()
        self._worker.cancel()
        self._measured_at = ()
        self._listen(False)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._worker.close()
        event.accept()


def _number() -> QLabel:
    label = QLabel()
    label.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
    return label


def _pair(title: str, splits: Mapping[PartName, Split]) -> BarPair:
    kept = {str(name): split.kept for name, split in splits.items()}
    return BarPair(title, kept, {str(name): split.refused for name, split in splits.items()})
