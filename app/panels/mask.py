"""Panel for masks: paint a region of the live image and get the gate that keeps it or hides it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtGui import QCloseEvent, QColor, QHideEvent, QShowEvent
from PySide6.QtWidgets import (
    QButtonGroup,
    QCheckBox,
    QLabel,
    QPushButton,
    QRadioButton,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.panel_state import Values
from slopegate.app.panels.wipe import WipeSwitch
from slopegate.app.session.describe import gate_text, line_text
from slopegate.app.session.loading import CancelledError, Loader, Progress
from slopegate.app.session.session import Change, Intent
from slopegate.app.session.source import known_buffers
from slopegate.app.views.draw_tools import BrushTool, PolygonTool, RectangleTool, Tool
from slopegate.app.views.overlay import RegionLayer
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import CountBox
from slopegate.app.widgets.painted import PaintedRegion, region_text, text_region
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.gating.gate import complement
from slopegate.core.measure.mask import GOOD_IOU, MaskGate, best_gate, overlap, seen_in_frames
from slopegate.core.rig.arrays import Bools, Singles
from slopegate.core.rig.axis import no_slabs
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.stream.depth_run import frames_behind
from slopegate.drivers.stream.stream import Stream

KEEP, HIDE = QColor("#ffd400"), QColor("#ff4d4d")
"""Tint of a region that is to be kept, and of one that is to be hidden."""
_WHOLE_PERIODS = 0.01
"""How far the exposures of a gate and its complement together may be from whole projector periods."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A painted region (H, W), what is to become of it, and which projector row lights each pixel (-1: none)."""

    region: Bools
    hide: bool
    projector_row: Singles


@dataclass(frozen=True, eq=False)
class FoundGate:
    """The best gate for what was wanted."""

    wanted: Wanted
    best: MaskGate
    of_slabs: bool = True
    """Whether gates of this rig are slabs of space."""


@dataclass(frozen=True)
class Achieved:
    """The overlap as measured in two frames: one with the gate, one with its complement."""

    iou: float
    told_share: float
    """Share of the lit pixels that are bright enough to tell."""


def find(rig: Rig, wanted: Wanted, progress: Progress) -> FoundGate:
    """Try every line time. Raises InputError where the region has no lit pixel."""
    progress.step(0.0, "Trying every clock ...")
    best = best_gate(rig, wanted.projector_row, wanted.region, wanted.hide)
    return FoundGate(wanted, best, not no_slabs(rig))


def measure(
    stream: Stream, rig: Rig, black_count: float, sent: GateSettings, wanted: Wanted, progress: Progress
) -> Achieved:
    """Take a frame of the gate and one of its complement from the running camera and compare with the region.

    Raises CameraError, InputError while something else takes every frame, or CancelledError.
    """
    with frames_behind(stream, lambda: not progress.report(0.5, "Measuring ...")) as take:
        got = [take(settings) for settings in (sent, complement(sent, rig.projector.period_us))]
    first, second = got
    if first is None or second is None:
        raise CancelledError
    both_us, period_us = first[1].exposure_us + second[1].exposure_us, rig.projector.period_us
    if abs(both_us / period_us - round(both_us / period_us)) > _WHOLE_PERIODS:
        raise CameraError("this camera does not make the complement of its gate, against which it would be measured.")
    seen, told = seen_in_frames(first[0], second[0], black_count)
    chosen = ~seen if wanted.hide else seen
    lit = wanted.projector_row >= 0
    told &= lit
    share = int(np.count_nonzero(told)) / max(int(np.count_nonzero(lit)), 1)
    return Achieved(overlap(chosen, wanted.region, told), share)


def found_text(found: FoundGate) -> str:
    """How well the gate does what is wanted, and whether that is good."""
    best, verb = found.best, "mask" if found.wanted.hide else "keep"
    region = best.hit_pixels + best.missed_pixels
    numbers = (
        f"{best.hit_pixels / region:.0%} of the region, and elsewhere as much as {best.extra_pixels / region:.0%} of "
        f"it (overlap {best.iou:.3f})"
    )
    if best.good:
        tried = f"Of the gates on {best.line_times} clocks that do this equally well, it is the thinnest."
        return f"Predicted: this gate {verb}s {numbers}. {tried}"
    why = (
        "What is painted does not lie in one slab of space."
        if best.missed_pixels > best.extra_pixels
        else "The slab that holds it holds as much else: paint all that lies there, or something apart from it."
    )
    if not found.of_slabs:
        why = "Gates of this rig are no slabs: they keep bands of the picture's rows, whatever the distance. Paint one."
    nearest = f"The nearest one {verb}s {numbers}, and an overlap of {GOOD_IOU:g} would be good."
    return f"No gate can {verb} this region. {nearest} {why}"


class MaskPanel(Panel):
    """Tools to paint a region, and the gate for it with the overlap that is predicted and the one that is measured."""

    applied = Signal()
    """The gate that was found has been set."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._painted: PaintedRegion | None = None
        self._found: FoundGate | None = None
        self._finder: Loader[FoundGate] = Loader(lambda _: None, self)
        self._meter: Loader[Achieved] = Loader(lambda _: None, self)
        view = desk.live.view
        self.layer = RegionLayer(view)
        self.rectangle, self.polygon, self.brush = RectangleTool(view), PolygonTool(view), BrushTool(view)
        self.wipe = WipeSwitch(desk.session, desk.live)
        self._make_widgets()
        self._arrange()
        self._connect()
        if desk.projector_row is not None:
            self._use_sweep()
        self._refresh()

    def _make_widgets(self) -> None:
        def tool(text: str, hint: str) -> QPushButton:
            button = QPushButton(text)
            button.setCheckable(True)
            button.setToolTip(f"{hint} Esc or the right button end it.")
            return button

        self.tools: dict[QPushButton, Tool] = {
            tool("Rectangle", "Drag a rectangle over the live image."): self.rectangle,
            tool("Polygon", "Click corners; a double click closes."): self.polygon,
            tool("Brush", "Paint over the live image."): self.brush,
        }
        self.radius = CountBox()
        self.radius.setRange(1, 200)
        self.radius.setValue(round(self.brush.radius_px))
        self.radius.setSuffix(" px")
        self.radius.setToolTip("The brush's radius in image pixels")
        self.radius.setAccessibleName("Brush radius")
        self.erase = QCheckBox("Erase")
        self.erase.setToolTip("Shapes take pixels away instead of adding them")
        self.undo, self.clear = QPushButton("Undo"), QPushButton("Clear")
        self.keep, self.hide_it = QRadioButton("Keep this, mask the rest"), QRadioButton("Mask this, keep the rest")
        self.keep.setChecked(True)
        self.depth_source = ChoiceBox()
        self.depth_source.setToolTip("Where each pixel's depth comes from")
        self.depth_source.setAccessibleName("Depth source")
        self.depth_source.addItems(["Depth of the virtual rig", "Depth measured by a sweep"])
        self.find_button = QPushButton("Find the gate and use it")
        self.find_button.setToolTip(
            "Try every clock. Of gates whose overlap is within 5 % of the greatest, the thinnest is set, if it is good"
        )
        self.anyway = QPushButton("Use the nearest anyway")
        self.anyway.setToolTip("Set this gate, although its overlap is not good")
        self.check = QCheckBox("Measure it")
        self.check.setChecked(True)
        self.check.setToolTip(
            "Take a frame of the gate and one of its complement, and count what the gate really keeps"
        )
        self.predicted, self.achieved, self.gate = QLabel(), QLabel(), QLabel()
        for label in (self.predicted, self.achieved, self.gate):
            label.setWordWrap(True)

    def _arrange(self) -> None:
        rows: tuple[list[QWidget], ...] = (
            [*self.tools, self.radius, self.erase, self.undo, self.clear],
            [self.keep, self.hide_it],
            [self.find_button, self.check, self.depth_source],
            [self.wipe],
        )
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.setSpacing(4)
        for widgets in rows:
            column.addLayout(FlowLayout(widgets))
        for label in (self.predicted, self.achieved, self.gate, self.anyway):
            column.addWidget(label)
        column.addStretch(1)

    def _connect(self) -> None:
        group = QButtonGroup(self)
        group.setExclusive(False)
        for button, tool in self.tools.items():
            group.addButton(button)
            button.toggled.connect(lambda on, button=button, tool=tool: self._take_up(button, tool, on))
            tool.ended.connect(lambda button=button: button.setChecked(False))
        self.rectangle.chosen.connect(lambda *box: self._paint(lambda to, add: to.rectangle(box, add)))
        self.polygon.refused.connect(self.predicted.setText)
        self.polygon.chosen.connect(lambda corners: self._paint(lambda to, add: to.polygon(corners, add)))
        self.brush.stroked.connect(lambda at, radius: self._paint(lambda to, add: to.stroke(at, radius, add)))
        self.radius.valueChanged.connect(lambda radius: setattr(self.brush, "radius_px", float(radius)))
        self.undo.clicked.connect(lambda: self._paint(lambda to, add: to.undo()))
        self.clear.clicked.connect(lambda: self._paint(lambda to, add: to.clear()))
        self.keep.toggled.connect(self._region_changed)
        self.depth_source.currentIndexChanged.connect(self._refresh)
        self.find_button.clicked.connect(self.find_gate)
        self.anyway.clicked.connect(self._use_found)
        self._finder.finished.connect(self._on_found)
        self._finder.failed.connect(self._say_failed)
        self._hold = self._session.hold("the measurement of the mask")
        self._meter.release(self._hold)
        self._meter.finished.connect(self._on_measured)
        self._meter.failed.connect(lambda sentence: self.achieved.setText(f"Not measured: {sentence}"))
        self.wipe.said.connect(self.achieved.setText)
        self._session.changed.connect(self._on_source)
        self._desk.swept.connect(self._use_sweep)

    @property
    def region(self) -> Bools | None:
        """The painted pixels (H, W); None where nothing is painted."""
        return None if self._painted is None or self._painted.empty else self._painted.pixels

    @property
    def busy(self) -> bool:
        """Whether a gate is being looked for or measured."""
        return self._finder.busy or self._meter.busy

    def _use_sweep(self) -> None:
        """Choose the depth that a sweep has just measured."""
        self.depth_source.setCurrentIndex(1)
        self._refresh()

    def find_gate(self) -> None:
        """Look for the gate that suits the region, and use it when it is a good one."""
        source, region, rows = self._session.source, self.region, self._projector_rows()
        if source is None or region is None or rows is None:
            return
        self._meter.cancel()
        self.predicted.setText("Trying every clock ...")
        self.achieved.clear()
        wanted = Wanted(region.copy(), self.hide_it.isChecked(), rows)
        self._finder.start(lambda progress: find(source.rig, wanted, progress))
        self._refresh()

    def _projector_rows(self) -> Singles | None:
        source = self._session.source
        if source is None:
            return None
        if self.depth_source.currentIndex() == 1:
            return self._desk.projector_row
        buffers = known_buffers(source)
        return None if buffers is None else buffers.projector_row.copy()

    def _take_up(self, button: QPushButton, tool: Tool, on: bool) -> None:
        if not on:
            tool.stop()
            return
        for other in self.tools:
            if other is not button:
                other.setChecked(False)
        tool.start()

    def _paint(self, shape: Callable[[PaintedRegion, bool], None]) -> None:
        image = self._live.view.image
        if image is None:
            return
        if self._painted is None or self._painted.pixels.shape != image.shape:
            self._painted = PaintedRegion((image.shape[0], image.shape[1]))
        shape(self._painted, not self.erase.isChecked())
        self._region_changed()

    def _region_changed(self) -> None:
        self._finder.cancel()
        self._meter.cancel()
        self._found = None
        self._show_region(filled=True)
        self._refresh()

    def _show_region(self, filled: bool) -> None:
        shown = self.region if self.isVisible() else None
        self.layer.show_region(shown, HIDE if self.hide_it.isChecked() else KEEP, filled)

    def _on_found(self, found: FoundGate) -> None:
        self._found = found
        if found.best.good:
            self._use_found()
        self._refresh()

    def _use_found(self) -> None:
        source, stream, found = self._session.source, self._session.stream, self._found
        if source is None or stream is None or found is None:
            return
        if not self._session.ask(Intent(found.best.gate, found.best.complement)):
            return
        # what the gate leaves must not be seen through a tint
        self._show_region(filled=False)
        self.applied.emit()
        if self.check.isChecked():
            self.achieved.setText("Measuring ...")
            rig, black = source.rig, source.camera.info.black_count
            self._hold.begin("source")
            self._meter.start(lambda progress: measure(stream, rig, black, found.best.sent, found.wanted, progress))

    def _on_measured(self, achieved: Achieved) -> None:
        self.achieved.setText(
            f"Achieved: overlap {achieved.iou:.3f}. It is counted where there is light enough to tell, in "
            f"{achieved.told_share:.0%} of the lit pixels."
        )

    def _say_failed(self, sentence: str) -> None:
        self._refresh()
        self.predicted.setText(sentence)

    def _on_source(self, change: Change) -> None:
        if Change.SOURCE in change:
            self._painted = None
            self.depth_source.setCurrentIndex(0)
            for button in self.tools:
                button.setChecked(False)
            self._region_changed()

    def _refresh(self) -> None:
        ready = self.region is not None and self._projector_rows() is not None
        self.find_button.setEnabled(ready and not self._finder.busy)
        self.undo.setEnabled(self._painted is not None and self._painted.can_undo)
        self.clear.setEnabled(self.region is not None)
        found = self._found
        self.anyway.setVisible(found is not None and not found.best.good)
        if found is None:
            self.achieved.clear()
            self.gate.clear()
            self.predicted.setText(self._advice() if not self._finder.busy else "Trying every clock ...")
            return
        self.predicted.setText(found_text(found))
        source = self._session.source
        if source is not None:
            kind = "all but " if found.best.complement else ""
            best = found.best.gate
            self.gate.setText(f"Gate: {kind}{line_text(source.rig, best.line_time_us)}, {gate_text(best)}")

    def _advice(self) -> str:
        if self.region is None:
            return "Choose a tool and paint on the live image what the gate is to keep or to mask."
        if self._projector_rows() is None:
            return "This camera knows no depth: measure it first, with the sweep of the Depth panel."
        return ""

    def kept_state(self) -> Values:
        """The fields, and what is painted as a picture."""
        region = self.region
        return super().kept_state() | ({} if region is None else {"region": region_text(region)})

    def set_state(self, values: Values) -> None:
        """Set the fields, and paint what was painted where the image has that size."""
        super().set_state(values)
        source = self._session.source
        region = None if source is None else text_region(values.get("region"), source.shape)
        if source is not None and region is not None:
            self._painted = PaintedRegion(source.shape)
            self._painted.show(region)
            self._region_changed()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._show_region(filled=self._found is None)

    def hideEvent(self, event: QHideEvent) -> None:
        for button in self.tools:
            button.setChecked(False)
        self._show_region(filled=False)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._finder.close()
        self._meter.close()
        self.wipe.end()
        event.accept()
