"""Before and after: the fully lit image to the left of a line that can be dragged, the gated one to its right."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPoint, QRect, Qt, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import QCheckBox, QWidget

from slopegate.app.session.loading import CancelledError, Loader, Progress
from slopegate.app.session.session import Change, Session
from slopegate.app.session.source import Source, known_buffers
from slopegate.app.views.live_panel import LivePanel
from slopegate.app.views.live_view import LiveView
from slopegate.app.views.overlay import Layer
from slopegate.app.widgets.paint import Resampler, Viewport, demosaic
from slopegate.core.exposure.sensor import SensorModel, mono
from slopegate.core.gating.gate import upright_line_time
from slopegate.core.gating.plan import whole_period
from slopegate.core.render.render import Buffers
from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.rig import Rig
from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.frame import CameraInfo, filters
from slopegate.drivers.stream.depth_run import frames_behind
from slopegate.drivers.stream.stream import Stream

_STRIDE = 2
"""The virtual camera's fully lit image is made anew for every frame of a moving scene, at half size."""
_HANDLE_PX = 14


def lit_counts(buffers: Buffers, sensor: SensorModel, colour: bool) -> Counts:
    """Everything lit, without noise: counts (H / 2, W / 2) uint16, or (..., 3) when colour."""
    light = buffers.direct[::_STRIDE, ::_STRIDE] + buffers.ambient[::_STRIDE, ::_STRIDE]
    signal = light if colour else mono(light)
    counts = signal * np.float32(sensor.counts_per_unit) + np.float32(sensor.black_count + 0.5)
    found: Counts = np.minimum(counts, np.float32(sensor.max_count)).astype(np.uint16)
    return found


def take_lit(stream: Stream, rig: Rig, info: CameraInfo, progress: Progress) -> Counts:
    """A frame with everything lit from the running camera, mono or demosaiced, (H, W) or (H, W, 3) uint16."""
    period = rig.projector.period_us
    flood = whole_period(rig, upright_line_time(rig))
    with frames_behind(stream, lambda: not progress.report(0.5, "Taking a frame with everything lit ...")) as take:
        got = take(flood)
    if got is None:
        raise CancelledError
    if got[1].exposure_us < 0.9 * period:
        raise CameraError("this camera cannot light everything at once, so there is nothing to compare with.")
    pattern = filters(info.pixel_format)
    if not pattern:
        return got[0]
    colour = np.empty((*got[0].shape, 3), np.uint16)
    demosaic(got[0], colour, pattern)
    return colour


class Before(Layer):
    """Draws an image over the left part of the live view, through the same zoom, levels and colours."""

    def __init__(self, view: LiveView) -> None:
        super().__init__(view)
        self.image: Counts | None = None
        self._stride = 1
        self._resampler = Resampler()
        self._share = 0.5

    @property
    def share(self) -> float:
        """Where the line is, as a share of the width."""
        return self._share

    def set_share(self, share: float) -> None:
        """Move the line."""
        self._share = min(max(share, 0.0), 1.0)
        self.update()

    def show_image(self, image: Counts | None, stride: int) -> None:
        """An image whose pixels are `stride` pixels of the live one wide; it must keep its values."""
        self.image, self._stride = image, stride
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        viewport = self.viewport()
        if self.image is None or viewport is None:
            return
        ratio = self.devicePixelRatioF()
        width, height = round(self.width() * ratio), round(self.height() * ratio)
        x = round(self._share * self.width())
        painter = QPainter(self)
        painter.setClipRect(QRect(0, 0, x, self.height()))
        shrunk = Viewport(viewport.scale * self._stride, viewport.left / self._stride, viewport.top / self._stride)
        screen = self._resampler.draw(self.image, self._view.table, shrunk, (width, height))
        picture = QImage(screen.data, width, height, screen.strides[0], QImage.Format.Format_ARGB32_Premultiplied)
        picture.setDevicePixelRatio(ratio)
        painter.drawImage(0, 0, picture)
        painter.setClipping(False)
        painter.setPen(QColor("#ffd400"))
        painter.drawLine(x, 0, x, self.height())
        for text, place, side in (
            ("everything lit", QRect(x - 168, 6, 160, 20), Qt.AlignmentFlag.AlignRight),
            ("this gate", QRect(x + 8, 6, 160, 20), Qt.AlignmentFlag.AlignLeft),
        ):
            flags = side | Qt.AlignmentFlag.AlignVCenter
            painter.fillRect(painter.boundingRect(place, flags, text).adjusted(-4, 0, 4, 0), QColor(0, 0, 0, 150))
            painter.drawText(place, flags, text)


class Handle(QWidget):
    """The strip by which the line is dragged."""

    def __init__(self, view: LiveView, before: Before) -> None:
        super().__init__(view)
        self._view, self._before = view, before
        self.setCursor(Qt.CursorShape.SplitHCursor)
        self.setToolTip("Drag: everything lit on the left, this gate on the right")
        self.hide()

    def place(self) -> None:
        """Stand over the line."""
        x = round(self._before.share * self._view.width())
        self.setGeometry(x - _HANDLE_PX // 2, 0, _HANDLE_PX, self._view.height())

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        at = self.mapTo(self._view, QPoint(round(event.position().x()), 0)).x()
        self._before.set_share(at / max(self._view.width(), 1))
        self.place()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        middle = self.rect().center()
        painter.setPen(QColor("#000000"))
        painter.setBrush(QColor("#ffd400"))
        painter.drawEllipse(middle, _HANDLE_PX // 2 - 1, _HANDLE_PX // 2 - 1)


class WipeSwitch(QCheckBox):
    """Switches the wipe on; keeps its left side up to date."""

    said = Signal(str)
    """Why it could not be."""

    def __init__(self, session: Session, live_panel: LivePanel, parent: QWidget | None = None) -> None:
        super().__init__("Before / after", parent)
        self.setToolTip("Compare with the scene fully lit: drag the line over the live image")
        self._session, self._live = session, live_panel
        self.before = Before(live_panel.view)
        self.handle = Handle(live_panel.view, self.before)
        self._taker: Loader[Counts] = Loader(lambda _: None, self)
        self._taker.finished.connect(lambda image: self.before.show_image(image, 1))
        self._taker.failed.connect(self._on_failed)
        self.toggled.connect(self._on_toggled)
        session.changed.connect(self._on_changed)

    def end(self) -> None:
        """Take it away and stop what is under way."""
        self.setChecked(False)
        self._taker.close()

    def _on_toggled(self, on: bool) -> None:
        view = self._live.view
        for signal, slot in (
            (view.painted, self._follow),
            (view.zoomed, self.handle.place),
        ):
            if on:
                signal.connect(slot)
            else:
                signal.disconnect(slot)
        self.before.setVisible(on)
        self.handle.setVisible(on)
        self.handle.place()
        if on:
            self.before.raise_()
            self.handle.raise_()
            self._begin()
        else:
            self._taker.cancel()
            self.before.show_image(None, 1)

    def _begin(self) -> None:
        source, stream = self._session.source, self._session.stream
        if source is None or stream is None or self._draw_known(source):
            return
        rig, info = source.rig, source.camera.info
        self._taker.start(lambda progress: take_lit(stream, rig, info, progress))

    def _draw_known(self, source: Source) -> bool:
        """The virtual camera's own image; False for a camera that has to take one."""
        buffers, sensor = known_buffers(source), source.rendered.sensor if source.rendered else None
        if buffers is None or sensor is None:
            return False
        colour = source.camera.info.pixel_format.startswith("bayer")
        self.before.show_image(lit_counts(buffers, sensor, colour), _STRIDE)
        return True

    def _follow(self) -> None:
        source = self._session.source
        if source is not None and source.scene.moving:
            self._draw_known(source)

    def _on_failed(self, sentence: str) -> None:
        self.setChecked(False)
        self.said.emit(sentence)

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE in change and self.isChecked():
            self._begin()
