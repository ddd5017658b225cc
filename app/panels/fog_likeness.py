"""How like a fog-free picture a gate's picture is: live, against the exposure, and how sharp an edge in it is.

All of it is measured in frames, so it works with any camera. Of rendered scenes the fog-free picture is rendered, too,
and the best exposure is predicted before a frame is taken; elsewhere a frame of the clear scene is kept as reference.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QGroupBox, QLabel, QProgressBar, QPushButton, QVBoxLayout, QWidget

from slopegate.app.panels.marks import Mark, one_at_a_time
from slopegate.app.panels.panel import Desk
from slopegate.app.session.describe import number
from slopegate.app.session.loading import CancelledError, Loader, Newest, Progress
from slopegate.app.session.source import Source
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import CountBox
from slopegate.app.widgets.plot_theme import dress, fill, pen, plot_colours, swatch
from slopegate.app.widgets.theme import is_dark
from slopegate.core.exposure.sensor import SensorModel, bayer_rg, mono
from slopegate.core.gating.plan import whole_period
from slopegate.core.light.lights import total
from slopegate.core.light.part import PartName
from slopegate.core.measure.exposure_sweep import (
    FogTarget,
    Likeness,
    best_exposure_us,
    expected_likeness,
    fog_target,
    sweep_gates,
)
from slopegate.core.measure.quality import contrast, ncc
from slopegate.core.measure.slanted_edge import EdgeMtf, slanted_edge_mtf
from slopegate.core.render.render import Cancelled, render
from slopegate.core.rig.arrays import Counts, Singles
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, quantise
from slopegate.drivers.cameras.virtual import VirtualCamera
from slopegate.drivers.contract.frame import filters
from slopegate.drivers.stream.depth_run import frames_behind
from slopegate.drivers.stream.exposure_run import run_exposures
from slopegate.drivers.stream.stream import Stream

PLOT_PX = 190
FRAMES = 3
"""Frames of each exposure: their noise shows in their differences."""
_NOISELESS = 1e12


@dataclass(frozen=True, eq=False)
class Reference:
    """A picture without fog (H, W), counts or light, and what it is in a few words."""

    image: Counts | Singles
    text: str


@dataclass(frozen=True, eq=False)
class Swept:
    """A finished sweep: what was measured at each exposure, and predicted where the light is known."""

    exposures_us: tuple[float, ...]
    measured: tuple[Likeness, ...]
    expected: tuple[Likeness, ...]
    regular: Likeness
    """With everything lit."""

    @property
    def best_us(self) -> float:
        """The exposure of the greatest NCC as measured."""
        return best_exposure_us(self.exposures_us, self.measured)

    @property
    def predicted_us(self) -> float | None:
        """The same as predicted; None where nothing was."""
        return best_exposure_us(self.exposures_us, self.expected) if self.expected else None


@dataclass(frozen=True)
class Live:
    """What the frame on show says."""

    ncc: float | None
    contrast: float | None
    edge: EdgeMtf | None
    edge_why: str


def rendered_reference(source: Source, progress: Progress) -> Reference:
    """The scene of a virtual camera rendered without fog, fully lit. Raises CancelledError."""
    clear = replace(source.scene, fog=None)
    try:
        buffers = render(source.rig, clear, progress=lambda share: progress.report(share, "Rendering without fog ..."))
    except Cancelled:
        raise CancelledError from None
    light = buffers.direct + buffers.ambient
    mosaic = filters(source.camera.info.pixel_format)
    return Reference(bayer_rg(light) if mosaic else mono(light), "the scene rendered without fog")


@dataclass(frozen=True, eq=False)
class Expecting:
    """What predicts a rendered scene's frames: its camera, the parts that are shown, and its sensor."""

    camera: VirtualCamera
    shown: Collection[PartName]
    sensor: SensorModel

    def likeness(self, settings: GateSettings, target: FogTarget) -> Likeness:
        """What a frame of this gate will say."""
        parts = {name: target.cut(light) for name, light in self.camera.light_by_part(settings).items()}
        shown: dict[PartName, Singles] = {name: light for name, light in parts.items() if name in self.shown}
        return expected_likeness(total(shown, target.reference.shape), target, self.sensor)


def expecting(source: Source) -> Expecting | None:
    """What predicts this source's frames; None where it is no rendered scene at rest."""
    camera = source.rendered
    if camera is None or camera.sensor is None or source.scene.moving:
        return None
    quiet = replace(camera.sensor, read_noise_e=0.0, electrons_per_count=_NOISELESS)
    return Expecting(camera, camera.smooth.shown, camera.sensor if source.options.noise else quiet)


def sweep(
    stream: Stream,
    rig: Rig,
    now: GateSettings,
    target: FogTarget,
    black_count: float,
    count: int,
    known: Expecting | None,
    progress: Progress,
) -> Swept:
    """Predict, then take frames at every exposure with the camera itself; its own gate comes back at the end.

    Raises CameraError, InputError or CancelledError.
    """
    gates = sweep_gates(rig.camera.shutter, rig.projector.period_us, now.line_time_us, float(now.delay_us), count)
    expected = []
    for place, one in enumerate(gates if known is not None else ()):
        assert known is not None
        progress.step(0.3 * place / len(gates), "Predicting ...")
        expected.append(known.likeness(one, target))
    share = [0.3]

    def told(done: float) -> None:
        share[0] = 0.3 + 0.7 * done

    lit = quantise(rig.camera.shutter, whole_period(rig, now.line_time_us), rig.projector.period_us)
    wanted = [quantise(rig.camera.shutter, one, rig.projector.period_us) for one in gates]
    with frames_behind(stream, lambda: not progress.report(share[0], "Taking frames ...")) as take:
        found = run_exposures(take, [*wanted, lit], target, black_count, FRAMES, told)
    if found is None:
        raise CancelledError
    exposures = tuple(applied.exposure_us for applied, _ in found[:-1])
    return Swept(exposures, tuple(one for _, one in found[:-1]), tuple(expected), found[-1][1])


def look(image: Counts, target: FogTarget | None, edge: Counts | None, black_count: float, max_count: int) -> Live:
    """Measure one frame (H, W); `edge` is the marked part of it."""
    alike = apart = None
    if target is not None:
        cut = target.cut(image)
        alike = ncc(cut, target.reference)
        apart = contrast(cut, target.bright, target.dark, black_count)
    if edge is None:
        return Live(alike, apart, None, "")
    try:
        return Live(alike, apart, slanted_edge_mtf(edge, max_count), "")
    except InputError as error:
        return Live(alike, apart, None, str(error))


class SweepPlot(QWidget):
    """NCC against exposure: dots as measured, a dashed line as predicted, and where either is greatest."""

    def __init__(self) -> None:
        super().__init__()
        self.swept: Swept | None = None
        """What is shown."""
        self.plot = pg.PlotWidget()
        self.plot.setMenuEnabled(False)
        self.plot.hideButtons()
        self.plot.setMouseEnabled(x=False, y=False)
        self.plot.setLogMode(x=True)
        self.plot.setLabel("bottom", "exposure (\u00b5s)")
        self.plot.setLabel("left", "NCC")
        self.plot.setFixedHeight(PLOT_PX)
        self.legend = QLabel()
        self.legend.setWordWrap(True)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(2)
        column.addWidget(self.plot)
        column.addWidget(self.legend)
        self.setAccessibleName("NCC against exposure")
        self._draw()

    def show_sweep(self, swept: Swept | None) -> None:
        """Show this one; None shows nothing."""
        self.swept = swept
        self._draw()

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._draw()

    def _draw(self) -> None:
        scheme, swept = plot_colours(is_dark(self.palette())), self.swept
        dress(self.plot, scheme)
        self.plot.clear()
        signs = [swatch(scheme.camera, "\u25cf", "measured"), swatch(scheme.projector, "- -", "predicted")]
        signs.append(swatch(scheme.surface, "\u2500", "everything lit"))
        self.legend.setText("&nbsp;&nbsp; ".join(signs))
        self.setVisible(swept is not None)
        if swept is None:
            return
        x = np.log10(swept.exposures_us)
        if swept.expected:
            line = [one.ncc for one in swept.expected]
            self.plot.plot(swept.exposures_us, line, pen=pen(scheme.projector, 2, dashed=True))
        lines = [(swept.best_us, scheme.camera, False), (swept.predicted_us, scheme.projector, True)]
        for exposure_us, colour, dashed in lines:
            if exposure_us is not None:
                at = float(np.log10(exposure_us))
                self.plot.addItem(pg.InfiniteLine(at, angle=90, pen=pen(colour, 1.5, dashed=dashed)))
        self.plot.addItem(pg.InfiniteLine(swept.regular.ncc, angle=0, pen=pen(scheme.surface, 1.5)))
        dots = [one.ncc for one in swept.measured]
        self.plot.plot(
            swept.exposures_us,
            dots,
            pen=pen(scheme.camera, 1.5),
            symbol="o",
            symbolSize=6,
            symbolBrush=fill(scheme.camera, 255),
            symbolPen=None,
        )
        self.plot.setXRange(float(x.min()), float(x.max()), padding=0.02)
        self.plot.getAxis("bottom").setTicks([decades(swept.exposures_us[0], swept.exposures_us[-1])])


def decades(low: float, high: float) -> list[tuple[float, str]]:
    """Ticks at 1, 2 and 5 times powers of ten within a range: their logarithms, and what to write there."""
    steps = [lead * 10.0**power for power in range(9) for lead in (1, 2, 5)]
    return [(float(np.log10(step)), f"{step:.0f}") for step in steps if low <= step <= 1.001 * high]


class LikenessBox(QGroupBox):
    """The measured half of the fog panel. Its owner calls `look` from time to time while it is on the screen."""

    def __init__(self, desk: Desk, parent: QWidget | None = None) -> None:
        super().__init__("How like the scene without fog", parent)
        self._desk, self._session = desk, desk.session
        self.kept: Reference | None = None
        """A frame that was kept as reference."""
        self.rendered: Reference | None = None
        """The rendered one."""
        self._target: FogTarget | None = None
        self._why = ""
        self.target = Mark(desk, "Mark a target", "What is to be seen through the fog", "#ffd400", self)
        self.edge = Mark(desk, "Mark an edge", "One straight edge, a little slanted", "#64b5f6", self)
        one_at_a_time((self.target, self.edge))
        self._renderer: Newest[Reference] = Newest(self)
        self._looker: Newest[Live] = Newest(self)
        self._sweeper: Loader[Swept] = Loader(lambda _: None, self)
        self._make_widgets()
        self._arrange()
        self._connect()

    def _make_widgets(self) -> None:
        self.keep = QPushButton("Keep as reference")
        self.keep.setToolTip("Compare with the frame on show from now on: take it while the air is clear")
        self.drop = QPushButton("Drop it")
        self.drop.setToolTip("Forget the frame that was kept")
        self.count = CountBox()
        self.count.setRange(4, 80)
        self.count.setValue(24)
        self.count.setSuffix(" exposures")
        self.count.setToolTip("At equal ratios, from the camera's shortest to one projector period")
        self.count.setAccessibleName("Exposures of the sweep")
        self.start = QPushButton("Sweep the exposure")
        self.cancel = QPushButton("Cancel")
        self.use = QPushButton("Use the best")
        self.use.setToolTip("Set the exposure of the greatest NCC")
        self.bar = QProgressBar()
        self.reference, self.now, self.found, self.sharp = QLabel(), QLabel(), QLabel(), QLabel()
        for label in (self.reference, self.now, self.found, self.sharp):
            label.setWordWrap(True)
        self.plot = SweepPlot()

    def _arrange(self) -> None:
        column = QVBoxLayout(self)
        column.addLayout(FlowLayout([self.keep, self.drop, self.target.button]))
        column.addWidget(self.reference)
        column.addWidget(self.now)
        column.addLayout(FlowLayout([self.start, self.count, self.cancel, self.use]))
        column.addWidget(self.bar)
        column.addWidget(self.plot)
        column.addWidget(self.found)
        column.addLayout(FlowLayout([self.edge.button]))
        column.addWidget(self.sharp)

    def _connect(self) -> None:
        self.keep.clicked.connect(self.keep_frame)
        self.drop.clicked.connect(lambda: self._keep(None))
        self.target.changed.connect(self._on_target)
        self.edge.changed.connect(self.sharp.clear)
        self.start.clicked.connect(self.sweep)
        self.cancel.clicked.connect(self._sweeper.cancel)
        self.use.clicked.connect(self._use_best)
        self._renderer.finished.connect(self._on_rendered)
        self._renderer.failed.connect(self.reference.setText)
        self._looker.finished.connect(self._on_looked)
        self._looker.failed.connect(self.now.setText)
        fate = "What it has measured so far is not kept."
        self._hold = self._session.hold("the exposure sweep", fate, self._sweeper.cancel)
        self._sweeper.release(self._hold)
        self._sweeper.progressed.connect(self._on_progress)
        self._sweeper.finished.connect(self._on_swept)
        self._sweeper.failed.connect(self._on_failed)
        self._sweeper.cancelled.connect(lambda: self._on_failed("Cancelled; the exposure is as it was."))

    @property
    def busy(self) -> bool:
        """Whether a sweep is under way."""
        return self._sweeper.busy

    def follow(self, same: bool) -> None:
        """Another source; `same`: the scene that it was, in another fog perhaps."""
        self._sweeper.cancel()
        if not same:
            self._renderer.cancel()
            self.kept = self.rendered = None
            self.plot.show_sweep(None)
            self.found.clear()
            self._retarget()

    def render_reference(self) -> None:
        """Render the scene without fog, where that has not been done."""
        source = self._session.source
        wanted = self.rendered is None and source is not None and source.rendered is not None
        if source is not None and wanted and not self._renderer.busy:
            self._renderer.want(lambda progress: rendered_reference(source, progress))

    def pause(self) -> None:
        """Look at no frames and render nothing; a sweep goes on."""
        self._renderer.cancel()
        self._looker.cancel()

    def keep_frame(self) -> None:
        """Take the frame on show as what is seen without fog."""
        frame = self._desk.live.copy_frame()
        if frame is not None:
            self._keep(Reference(frame.image, f"the frame kept at {time.strftime('%H:%M:%S')}"))

    def sweep(self) -> None:
        """Measure the likeness at every exposure."""
        source, stream, resolved, target = (
            self._session.source,
            self._session.stream,
            self._session.resolved,
            self._target,
        )
        if source is None or stream is None or resolved is None or target is None:
            return
        rig, now, black, count = source.rig, resolved.gate, source.camera.info.black_count, self.count.value()
        known = expecting(source)
        self.found.setText(
            "Something moves in this scene: it is not where it was in the reference." * source.scene.moving
        )
        self._hold.begin("gate")
        self._sweeper.start(lambda progress: sweep(stream, rig, now, target, black, count, known, progress))
        self.refresh()

    def look(self) -> None:
        """Measure the frame on show, in a thread of its own."""
        source, frame = self._session.source, self._desk.live.frame
        if source is None or frame is None or self._looker.busy:
            return
        edge = self.edge.pixels(frame.image)
        if self._target is None and edge is None:
            return
        info, target = source.camera.info, self._target
        if edge is not None and filters(info.pixel_format):
            self.sharp.setText("The sharpness of an edge is measured on a mono sensor.")
            edge = None
        image = frame.image.copy()
        cut = None if edge is None else edge.copy()
        self._looker.want(lambda _: look(image, target, cut, info.black_count, info.max_count))

    def outline(self, shown: bool) -> None:
        """Draw what is marked on the live image, or not."""
        for mark in (self.target, self.edge):
            mark.outline(shown)

    def close_workers(self) -> None:
        """End what is under way."""
        for worker in (self._renderer, self._looker, self._sweeper):
            worker.close()

    def refresh(self) -> None:
        """Show what can be done."""
        source, busy = self._session.source, self.busy
        gated = source is not None and not source.no_gate and source.played is None
        self.start.setEnabled(self._target is not None and gated and not busy)
        self.start.setToolTip(
            "A capture has the exposures that it was recorded with"
            if source is not None and source.played is not None
            else "Take frames at every exposure with this camera; its own exposure comes back"
        )
        self.count.setEnabled(not busy)
        self.drop.setVisible(self.kept is not None)
        self.cancel.setVisible(busy)
        self.bar.setVisible(busy)
        swept = self.plot.swept
        self.use.setVisible(swept is not None and not busy)
        using = self.kept or self.rendered
        if self._why:
            self.reference.setText(self._why)
        elif using is not None:
            where = "the whole image" if self.target.box is None else "the marked target"
            self.reference.setText(f"Compared with {using.text}, in {where}.")
        elif self._renderer.busy:
            self.reference.setText("Rendering the scene without fog ...")
        else:
            self.reference.setText("Keep a frame of the clear scene as reference first.")
        for label in (self.now, self.found, self.sharp):
            label.setVisible(bool(label.text()))

    def _keep(self, reference: Reference | None) -> None:
        self.kept = reference
        self._retarget()

    def _on_rendered(self, reference: Reference) -> None:
        self.rendered = reference
        self._retarget()

    def _on_target(self) -> None:
        self.plot.show_sweep(None)
        self.found.clear()
        self._retarget()

    def _retarget(self) -> None:
        """Take the marked part of the reference."""
        using, self._target, self._why = self.kept or self.rendered, None, ""
        self.now.clear()
        if using is not None:
            try:
                self._target = fog_target(using.image, self.target.box)
            except InputError as error:
                self._why = f"{error}."
        self.refresh()

    def _on_looked(self, live: Live) -> None:
        if live.ncc is not None and live.contrast is not None:
            self.now.setText(f"This frame: NCC {live.ncc:.3f}, contrast {100 * live.contrast:.1f} %.")
        if live.edge is not None:
            self.sharp.setText(edge_text(live.edge))
        elif live.edge_why:
            self.sharp.setText(f"No edge measured: {live.edge_why}.")
        self.refresh()

    def _on_progress(self, share: float, text: str) -> None:
        self.bar.setValue(round(100 * share))
        self.bar.setFormat(text)

    def _on_swept(self, swept: Swept) -> None:
        self.plot.show_sweep(swept)
        self.found.setText(sweep_text(swept))
        self.refresh()

    def _on_failed(self, sentence: str) -> None:
        self.found.setText(sentence)
        self.refresh()

    def _use_best(self) -> None:
        swept, resolved = self.plot.swept, self._session.resolved
        if swept is not None and resolved is not None:
            self._session.ask_wish(replace(resolved.gate, exposure_us=swept.best_us))


def sweep_text(swept: Swept) -> str:
    """What a sweep found, in a sentence or two."""
    best = max(one.ncc for one in swept.measured)
    text = f"Most alike at {number(swept.best_us, 0)} \u00b5s: NCC {best:.3f}. "
    if swept.predicted_us is not None:
        text += f"Predicted before a frame was taken: {number(swept.predicted_us, 0)} \u00b5s. "
    return text + f"Everything lit: {swept.regular.ncc:.3f}."


def edge_text(edge: EdgeMtf) -> str:
    """How sharp an edge is."""
    tilt = f"edge {abs(edge.edge_angle_deg):.1f}\u00b0 off {edge.near}"
    if edge.mtf50_cy_per_px is None:
        return f"MTF does not fall to a half below 1 cycle per pixel ({tilt})."
    return f"MTF50 {edge.mtf50_cy_per_px:.3f} cycles per pixel ({tilt}, ISO 12233)."
