"""Projector rows and camera windows against time."""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QPolygonF
from PySide6.QtWidgets import QGraphicsPolygonItem, QLabel, QVBoxLayout, QWidget

from slopegate.app.widgets.plot_theme import dress, fill, pen, plot_colours, swatch
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings

PERIODS_SHOWN = 3


def first_period(start_us: float, end_us: float, period_us: float) -> int:
    """Number of the first of the periods shown: -1, moved only as far as a window from start to end needs."""
    last = math.ceil(end_us / period_us) - PERIODS_SHOWN
    return min(max(-1, last), math.floor(start_us / period_us))


def camera_corners(rig: Rig, settings: GateSettings) -> Doubles:
    """The exposure of all camera rows as a parallelogram, (4, 2): time in ms, camera row."""
    height = rig.camera.lens.height
    half, shift = settings.exposure_us / 2, height * settings.line_time_us
    times = settings.delay_us + np.array([-half, half, shift + half, shift - half])
    return np.stack([times / 1000, [0.0, 0.0, height, height]], axis=-1)


def projector_lines(rig: Rig, first: int) -> Doubles:
    """The lit stretches of `PERIODS_SHOWN` passes, (P, 2, 2): start and end as time in ms, projector row."""
    projector = rig.projector
    start = (first + np.arange(PERIODS_SHOWN)) * projector.period_us
    lit = projector.lens.height / projector.rows_per_us
    times = np.stack([start, start + lit], axis=-1) / 1000
    return np.stack([times, np.broadcast_to([0.0, projector.lens.height], times.shape)], axis=-1)


def recorded_stretches(rig: Rig, settings: GateSettings, first: int) -> Doubles:
    """The part of each pass that the camera's centre row records, (P, 2, 2) as above, NaN where there is none."""
    lines = projector_lines(rig, first)
    centre = settings.delay_us + rig.camera.lens.height / 2 * settings.line_time_us
    window = (centre + np.array([-0.5, 0.5]) * settings.exposure_us) / 1000
    times = np.clip(window, lines[:, :1, 0], lines[:, 1:, 0])
    times = np.where(times[:, :1] < times[:, 1:], times, np.nan)
    rows = (times - lines[:, :1, 0]) * 1000 * rig.projector.rows_per_us
    return np.stack([times, rows], axis=-1)


class TimingView(QWidget):
    """Rows against time over three projector periods: when light is sent, and when each camera row looks.

    Projector rows are drawn at the camera row that looks the same way, so light from infinity lies on its own
    row and the time by which a window comes later than the line is disparity.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._rig: Rig | None = None
        self._settings: GateSettings | None = None
        self._first: int | None = None
        self._colours = plot_colours(False)
        self._legend = QLabel(self)
        self._legend.setWordWrap(True)
        self._legend.setTextFormat(Qt.TextFormat.RichText)
        self.triggers = QLabel(self)
        self.triggers.setWordWrap(True)
        self.plot = pg.PlotWidget(self)
        self.plot.setMenuEnabled(False)
        self.plot.hideButtons()
        self.plot.setMouseEnabled(x=True, y=False)
        self.plot.invertY(True)
        self.plot.showAxis("right")
        self.plot.setLabel("bottom", "time (ms)")
        self.plot.setLabel("left", "camera row")
        self.plot.setLabel("right", "projector row")
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self._legend)
        layout.addWidget(self.plot, 1)
        layout.addWidget(self.triggers)
        self._build()
        self.set_dark(False)

    def _build(self) -> None:
        self._blanking = [pg.LinearRegionItem(movable=False) for _ in range(PERIODS_SHOWN)]
        self.exposed = QGraphicsPolygonItem()
        self._lines = pg.PlotCurveItem(connect="pairs")
        self._recorded = pg.PlotCurveItem(connect="pairs")
        self._centre = pg.InfiniteLine(angle=0)
        for region in self._blanking:
            self.plot.addItem(region)
        for item in (self.exposed, self._centre, self._lines, self._recorded):
            self.plot.addItem(item)

    def set_rig(self, rig: Rig) -> None:
        """Show this rig; the gate stays."""
        self._rig = rig
        self._first = None
        height = rig.camera.lens.height
        self.plot.setYRange(0, height, padding=0.02)
        self._centre.setValue(height / 2)
        self._label_projector_rows(rig)
        if self._settings is not None:
            self.show_gate(rig, self._settings)

    def show_gate(self, rig: Rig, settings: GateSettings) -> None:
        """Move what this gate moves."""
        if rig is not self._rig:
            self._rig, self._settings = rig, settings
            self.set_rig(rig)
            return
        self._settings = settings
        corners = camera_corners(rig, settings)
        period_ms = rig.projector.period_us / 1000
        first = first_period(corners[:, 0].min() * 1000, corners[:, 0].max() * 1000, rig.projector.period_us)
        if first != self._first:
            self._first = first
            self._show_periods(rig, first, period_ms)
        self.exposed.setPolygon(QPolygonF([QPointF(x, y) for x, y in corners]))
        stretches = recorded_stretches(rig, settings, first)
        stretches = stretches[np.isfinite(stretches).all(axis=(1, 2))].reshape(-1, 2)
        self._recorded.setData(stretches[:, 0], _camera_rows(rig, stretches[:, 1]))

    def show_triggers(self, text: str) -> None:
        """What was measured of the real triggers, in words below the plot."""
        self.triggers.setText(text)

    def _show_periods(self, rig: Rig, first: int, period_ms: float) -> None:
        lines = projector_lines(rig, first)
        flat = lines.reshape(-1, 2)
        self._lines.setData(flat[:, 0], _camera_rows(rig, flat[:, 1]))
        for region, line in zip(self._blanking, lines, strict=True):
            start = line[0, 0]
            region.setRegion((line[1, 0], start + period_ms))
        self.plot.setXRange(first * period_ms, (first + PERIODS_SHOWN) * period_ms, padding=0)

    def _label_projector_rows(self, rig: Rig) -> None:
        height = rig.projector.lens.height
        shown = np.linspace(0, height, 5)
        at = _camera_rows(rig, shown)
        self.plot.getAxis("right").setTicks([[(float(y), f"{row:.0f}") for y, row in zip(at, shown, strict=True)]])

    def set_dark(self, dark: bool) -> None:
        """Colours for a dark or a light window."""
        self._colours = colours = plot_colours(dark)
        dress(self.plot, colours)
        for region in self._blanking:
            region.setBrush(fill(colours.muted, 50))
            for line in region.lines:
                line.setPen(pen(colours.muted, 1, 90))
        self.exposed.setBrush(fill(colours.camera, 70))
        self.exposed.setPen(pen(colours.camera, 1.5))
        self._lines.setPen(pen(colours.projector, 1.5))
        self._recorded.setPen(pen(colours.slab, 4))
        self._centre.setPen(pen(colours.muted, 1, dashed=True))
        self._legend.setText(
            " &nbsp; ".join(
                (
                    swatch(colours.projector, "&#9473;", "projector row lit"),
                    swatch(colours.muted, "&#9608;", "blanking"),
                    swatch(colours.camera, "&#9608;", "camera rows exposed"),
                    swatch(colours.slab, "&#9473;", "recorded by the centre row"),
                )
            )
        )
        for label in (self._legend, self.triggers):
            label.setStyleSheet(f"background: {colours.background}; color: {colours.text}; padding: 4px 8px;")


def _camera_rows(rig: Rig, projector_rows: Doubles) -> Doubles:
    """The camera row that looks the same way as a projector row (their lenses unrotated and undistorted)."""
    camera, projector = rig.camera.lens, rig.projector.lens
    return np.asarray(camera.cy + camera.fy * (projector_rows - projector.cy) / projector.fy, np.float64)
