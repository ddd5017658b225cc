"""Panel for light from under the skin: the window beside the direct row, its tilt, and how well veins stand out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import QTimer
from PySide6.QtGui import QCloseEvent, QHideEvent, QShowEvent
from PySide6.QtWidgets import QGridLayout, QGroupBox, QLabel, QProgressBar, QPushButton, QVBoxLayout

from slopegate.app.panels.marks import Mark, light_of, one_at_a_time
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.session.describe import measured, number
from slopegate.app.session.loading import CancelledError, Loader, Progress
from slopegate.app.session.session import Change
from slopegate.app.session.source import Source, known_buffers
from slopegate.app.widgets.checked import MarkWhenChecked
from slopegate.app.widgets.controls import Ladder, Linear, NumberControl
from slopegate.app.widgets.flow import FlowLayout
from slopegate.core.gating.gate import Slab
from slopegate.core.gating.plan import whole_period
from slopegate.core.measure.offset import (
    Box,
    LitPlace,
    at_line_time,
    brightest,
    coarse_gates,
    fine_gates,
    offset_rows,
    place_from,
    place_in,
    with_offset,
)
from slopegate.core.measure.quality import contrast
from slopegate.core.rig.arrays import Counts, Doubles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks
from slopegate.core.scene.scene import Preset
from slopegate.drivers.stream.depth_run import Take, frames_behind
from slopegate.drivers.stream.stream import Stream

LOOK_MS = 200
FAR_ROWS = 120.0
"""Largest offset that can be chosen, in projector rows."""
_SMOOTH = 0.3
_NO_CONTRAST = 0.003
"""Contrast below which a vein cannot be told from noise, and nothing is compared with it."""
"""Weight of the newest frame in the contrast that is shown."""


@dataclass(frozen=True)
class Stands:
    """How well a vein stands out from the skin round it: light above the dark level, and (skin - vein) / (sum)."""

    vein: float
    skin: float

    @property
    def contrast(self) -> float:
        """The visibility, -1 to 1; 0 where neither is lit."""
        areas = np.array([[True, False]])
        return contrast(np.array([[self.skin, self.vein]]), areas, ~areas)


def mean_light(image: Counts, box: Box, black_count: float) -> float:
    """Mean counts above the dark level in a box."""
    return float(image[box[1] : box[3], box[0] : box[2]].mean()) - black_count


def find_place(
    stream: Stream, rig: Rig, settings: GateSettings, box: Box, black_count: float, progress: Progress
) -> LitPlace:
    """Move the window over the marked place and see when it lights up; the stream's own gate comes back at the end.

    Raises CameraError, CancelledError, and InputError where no delay stands out.
    """
    shares = [0.0]

    def given_up() -> bool:
        return not progress.report(shares[0], "Looking for the direct row ...")

    def light(take: Take, gates: list[GateSettings], first: float, last: float) -> tuple[list[GateSettings], Doubles]:
        made, seen = [], []
        for index, asked in enumerate(gates):
            shares[0] = first + (last - first) * index / len(gates)
            got = take(asked)
            if got is None:
                raise CancelledError
            made.append(got[1])
            seen.append(mean_light(got[0], box, black_count) / got[1].exposure_us)
        return made, np.array(seen)

    with frames_behind(stream, given_up) as take:
        made, seen = light(take, coarse_gates(rig, settings.line_time_us), 0.0, 0.5)
        made, seen = light(take, fine_gates(rig, made[brightest(seen)]), 0.5, 1.0)
    return place_from(rig, (box[1] + box[3]) / 2, made, seen)


def compare(
    stream: Stream, rig: Rig, sent: GateSettings, boxes: tuple[Box, Box], black_count: float, progress: Progress
) -> tuple[Stands, Stands]:
    """The vein with this gate and with everything lit, a frame each. Raises CameraError or CancelledError."""
    found = []
    with frames_behind(stream, lambda: not progress.report(0.5, "Taking two frames ...")) as take:
        for asked in (sent, whole_period(rig, sent.line_time_us)):
            got = take(asked)
            if got is None:
                raise CancelledError
            found.append(Stands(*(mean_light(got[0], box, black_count) for box in boxes)))
    return found[0], found[1]


class SkinPanel(Panel):
    """Sets the window by its distance from the direct row of a marked place, and measures the contrast of a vein."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self.place: LitPlace | None = None
        """Where the marked place is lit from; None until that is known."""
        self._measured = False
        self._shown: Stands | None = None
        self._finder: Loader[LitPlace] = Loader(lambda _: None, self)
        self._meter: Loader[tuple[Stands, Stands]] = Loader(lambda _: None, self)
        self.at = Mark(desk, "Mark a place", "The skin that the offset is measured from", "#ffd400", self)
        self.vein = Mark(desk, "Mark a vein", "Part of a vein", "#64b5f6", self)
        self.skin = Mark(desk, "Mark skin", "Skin beside the vein", "#fb923c", self)
        self._marks = (self.at, self.vein, self.skin)
        one_at_a_time(self._marks)
        self._make_widgets()
        self._arrange()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._connect()

    def _make_widgets(self) -> None:
        self.offset = NumberControl(Linear(-FAR_ROWS, FAR_ROWS, 0.5, 10), self)
        self.line = NumberControl(Linear(0.0, 1.0, 1.0), self)
        self.seek = QPushButton("Measure it")
        self.seek.setToolTip("Find the direct row with the camera: move the window until the marked place lights up")
        self.cancel = QPushButton("Cancel")
        self.bar = QProgressBar()
        self.row, self.beside, self.tilt = QLabel(), QLabel(), QLabel()
        self.contrast, self.against = QLabel(), QLabel()
        for label in (self.row, self.beside, self.tilt, self.contrast, self.against):
            label.setWordWrap(True)
        self.both = QPushButton("Compare with everything lit")
        self.both.setToolTip("Take a frame with this gate and one with everything lit, and compare the vein's contrast")
        self.gates = QGroupBox("Gates of this scene")
        self._gate_buttons: list[tuple[QPushButton, Preset]] = []

    def _arrange(self) -> None:
        where, numbers = QGroupBox("Offset from the direct row"), QGridLayout()
        numbers.setColumnStretch(1, 1)
        for place, control in enumerate((self.offset, self.line)):
            for beside, widget in enumerate((control.label, control.slider, control.spin)):
                numbers.addWidget(widget, place, beside)
            control.slider.setMinimumWidth(60)
        inside = QVBoxLayout(where)
        inside.addLayout(FlowLayout([self.at.button, self.seek, self.cancel]))
        inside.addWidget(self.bar)
        inside.addWidget(self.row)
        inside.addLayout(numbers)
        inside.addWidget(self.beside)
        inside.addWidget(self.tilt)
        self._buttons = FlowLayout()
        self.gates.setLayout(self._buttons)
        seen = QGroupBox("Visibility of a vein")
        below = QVBoxLayout(seen)
        below.addLayout(FlowLayout([self.vein.button, self.skin.button, self.both]))
        below.addWidget(self.contrast)
        below.addWidget(self.against)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        for box in (where, self.gates, seen):
            column.addWidget(box)
        column.addStretch(1)

    def _connect(self) -> None:
        fate = "What it has found so far is not kept."
        self._finding = self._session.hold("the search for the direct row", fate, self._finder.cancel)
        self._measuring = self._session.hold("the measurement of the skin")
        self._finder.release(self._finding)
        self._meter.release(self._measuring)
        self.offset.edited.connect(self._move)
        self.line.edited.connect(self._turn)
        self.at.changed.connect(self._on_place)
        self.seek.clicked.connect(self.measure_place)
        self.cancel.clicked.connect(self._finder.cancel)
        self._finder.progressed.connect(self._on_progress)
        self._finder.finished.connect(self._on_found)
        self._finder.failed.connect(self._on_not_found)
        self._finder.cancelled.connect(self._refresh)
        for mark in (self.vein, self.skin):
            mark.changed.connect(self._on_mark)
        self.both.clicked.connect(self.compare)
        self._meter.finished.connect(self._on_compared)
        self._meter.failed.connect(self._on_not_compared)
        self._desk.swept.connect(self._locate)

    @property
    def busy(self) -> bool:
        """Whether frames are being taken for a measurement."""
        return self._finder.busy or self._meter.busy

    def measure_place(self) -> None:
        """Find the direct row of the marked place with the camera."""
        source, stream, resolved, box = self._ready()
        if source is None or stream is None or resolved is None or box is None:
            return
        rig, black = source.rig, source.camera.info.black_count
        self._finding.begin("gate")
        self._finder.start(lambda progress: find_place(stream, rig, resolved, box, black, progress))
        self._refresh()

    def compare(self) -> None:
        """Measure the vein's contrast with this gate and with everything lit."""
        source, stream, resolved = self._session.source, self._session.stream, self._session.resolved
        vein, skin = self.vein.box, self.skin.box
        if source is None or stream is None or resolved is None or vein is None or skin is None:
            return
        rig, sent, black = source.rig, resolved.sent, source.camera.info.black_count
        self._measuring.begin("source")
        self._meter.start(lambda progress: compare(stream, rig, sent, (vein, skin), black, progress))
        self.against.setText("Taking two frames ...")
        self._refresh()

    def follow(self, change: Change) -> None:
        source = self._session.source
        if source is None:
            return
        if Change.SOURCE in change:
            self._finder.cancel()
            self._meter.cancel()
            self._show_rig(source.rig)
            self._show_gates(source)
            self.against.clear()
        if change & (Change.SOURCE | Change.DEPTH):
            self._locate()
        self._refresh()

    def _ready(self) -> tuple[Source | None, Stream | None, GateSettings | None, Box | None]:
        resolved = self._session.resolved
        gate = None if resolved is None else resolved.gate
        return self._session.source, self._session.stream, gate, self.at.box

    def _show_rig(self, rig: Rig) -> None:
        line = rig.camera.shutter.line
        self.offset.set_scale(Linear(-FAR_ROWS, FAR_ROWS, 0.5, 10))
        self.offset.describe("Offset", " rows", "From the direct row to the middle of the window, in projector rows")
        if isinstance(line, PixelClocks):
            self.line.set_scale(Ladder(line.ladder_mhz))
            self.line.describe("Tilt", " MHz", "The clock tilts the slab; the offset at the marked place stays")
        else:
            self.line.set_scale(Linear(line.min_us, line.max_us, line.step_us))
            self.line.describe("Tilt", " \u00b5s", "The line time tilts the slab; the offset at the marked place stays")

    def _show_gates(self, source: Source) -> None:
        while self._gate_buttons:
            self._gate_buttons.pop()[0].deleteLater()
        for preset in source.presets:
            button = QPushButton(preset.name)
            button.setCheckable(True)
            button.setToolTip("Use this named gate of the scene")
            button.clicked.connect(lambda _=False, preset=preset: self._use(preset))
            MarkWhenChecked(button)
            self._buttons.addWidget(button)
            self._gate_buttons.append((button, preset))
        self.gates.setVisible(bool(source.presets))

    def _use(self, preset: Preset) -> None:
        source = self._session.source
        if source is not None and preset in source.presets:
            self._session.use(preset)
        self._refresh()

    def _on_place(self) -> None:
        self._measured = False
        self._locate()
        self._refresh()

    def _locate(self) -> None:
        """Take the direct row from what is known of the scene; what was measured of this place stays."""
        source, box = self._session.source, self.at.box
        if box is None:
            self.place = None
        if source is None or box is None or self._measured:
            return
        known = known_buffers(source)
        rows = self._desk.projector_row if known is None else known.projector_row
        self.place = None if rows is None else place_in(source.rig, rows, box)

    def _on_found(self, place: LitPlace) -> None:
        self.place, self._measured = place, True
        self._refresh()

    def _on_progress(self, share: float, text: str) -> None:
        self.bar.setValue(round(100 * share))
        self.bar.setFormat(text)

    def _on_not_found(self, sentence: str) -> None:
        self._refresh()
        self.row.setText(f"Not found: {sentence}")

    def _move(self, rows: float) -> None:
        source, _, settings, _ = self._ready()
        if source is not None and settings is not None and self.place is not None:
            self._session.ask_wish(with_offset(source.rig, settings, self.place, rows))
        self._refresh()

    def _turn(self, value: float) -> None:
        source, _, settings, _ = self._ready()
        if source is None or settings is None:
            return
        line = source.rig.camera.shutter.line
        wanted_us = line.nearest(line.line_time_us(value) if isinstance(line, PixelClocks) else value)
        if self.place is not None:
            self._session.ask_wish(at_line_time(settings, source.rig, self.place, wanted_us))
        self._refresh()

    def _refresh(self) -> None:
        source, stream, settings, box = self._ready()
        # A mark tells of a new scene before a hidden panel has followed it there: that is made good when it is shown.
        if source is None or settings is None or Change.SOURCE in self._missed:
            return
        busy = self.busy
        no_place = "" if self.place is not None else "Mark a place first"
        self.offset.set_missing(source.no_gate or no_place)
        self.line.set_missing(source.no_gate or source.camera.info.can.line_time.missing or no_place)
        self.seek.setEnabled(box is not None and stream is not None and not busy and not source.no_gate)
        self.cancel.setVisible(self._finder.busy)
        self.bar.setVisible(self._finder.busy)
        self.both.setEnabled(self.vein.box is not None and self.skin.box is not None and not busy)
        self._show_offset(source.rig, settings)
        line = source.rig.camera.shutter.line
        self.line.show_value(
            Ladder(line.ladder_mhz).snap(line.clock_mhz(settings.line_time_us))
            if isinstance(line, PixelClocks)
            else settings.line_time_us
        )
        resolved, intent = self._session.resolved, self._session.intent
        assert resolved is not None
        assert intent is not None
        slab = None if source.no_timing else resolved.slab
        self.tilt.setText("" if slab is None else f"The slab is tilted by {_tilt_text(slab)}\u00b0.")
        now = (intent.wish, resolved.gate)
        for button, preset in self._gate_buttons:  # of the scene before, while this is told of a new one's gate first
            button.setChecked(preset.settings in now and preset.complement == intent.complement)
        for said in (self.beside, self.tilt, self.against):
            said.setVisible(bool(said.text()))

    def _show_offset(self, rig: Rig, settings: GateSettings) -> None:
        place = self.place
        if place is None:
            unlit = self.at.box is not None and not self._finder.busy
            self.row.setText(
                "The direct row of this place is not known: measure it."
                if unlit
                else "Mark a place on the skin: the window's offset is measured from the row that lights it."
            )
            self.beside.clear()
            return
        how = "measured" if self._measured else "known"
        self.row.setText(f"Direct row {number(place.projector_row, 1)} ({how}), at camera row {place.camera_row:.0f}.")
        rows = offset_rows(rig, settings, place)
        self.offset.show_value(rows)
        half, speed = settings.exposure_us / 2 * rig.projector.rows_per_us, rig.projector.rows_per_us
        gap = abs(rows) - half
        where = (
            f"the window begins {number(gap, 1)} rows beside the direct row: only light that went astray is recorded"
            if gap > 0
            else "the window holds the direct row"
        )
        self.beside.setText(f"{number(rows, 1)} rows = {number(rows / speed, 0)} \u00b5s; {where}.")

    def _on_mark(self) -> None:
        self._shown = None
        self.against.clear()
        self._look()
        self._refresh()

    def _look(self) -> None:
        """Measure the frame on show."""
        source, frame = self._session.source, self._live.frame
        if source is None or frame is None:
            return
        black = source.camera.info.black_count
        vein, skin = (light_of(mark.pixels(frame.image), black) for mark in (self.vein, self.skin))
        if vein is None or skin is None:
            self.contrast.setText("Mark a vein and the skin beside it to see the vein's contrast.")
            return
        new, old = Stands(float(vein.mean()), float(skin.mean())), self._shown
        if old is not None and frame.stamp.settled:
            mixed = (_SMOOTH * a + (1 - _SMOOTH) * b for a, b in ((new.vein, old.vein), (new.skin, old.skin)))
            new = Stands(*mixed)
        self._shown = new
        self.contrast.setText(f"Contrast {contrast_text(new)}: vein {new.vein:.0f}, skin {new.skin:.0f} counts.")

    def _on_compared(self, found: tuple[Stands, Stands]) -> None:
        gated, lit = found
        seen = lit.contrast > _NO_CONTRAST
        times = f", {number(gated.contrast / lit.contrast, 1)} times as much" if seen else ""
        flat = contrast_text(lit) if seen else "no contrast is seen"
        self.against.setText(f"This gate: {contrast_text(gated)}{times}. Everything lit: {flat}. A frame each.")
        self._refresh()

    def _on_not_compared(self, sentence: str) -> None:
        self.against.setText(f"Not measured: {sentence}")
        self._refresh()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        for mark in self._marks:
            mark.outline(True)
        self._look()
        self._timer.start(LOOK_MS)

    def hideEvent(self, event: QHideEvent) -> None:
        self._timer.stop()
        for mark in self._marks:
            mark.outline(False)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._finder.close()
        self._meter.close()
        event.accept()


def _tilt_text(slab: Slab) -> str:
    return measured(slab.tilt_deg, slab.error("tilt_deg"), 1)


def contrast_text(stands: Stands) -> str:
    """The contrast in percent."""
    return f"{100 * stands.contrast:.1f} %"
