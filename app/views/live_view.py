"""The live image: zoom to the cursor, pan, levels; draws only the pixels that the screen shows."""

from __future__ import annotations

import math

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRect, QRectF, QSize, Qt, Signal
from PySide6.QtGui import (
    QColor,
    QGuiApplication,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QSizePolicy, QWidget

from slopegate.app.widgets.colour_maps import DARK, SATURATED, ColourMap, ramp
from slopegate.app.widgets.own_keys import OwnKey, act_on
from slopegate.app.widgets.paint import Resampler, Viewport, demosaic, fitted, level_table, shade_table
from slopegate.app.widgets.theme import colours
from slopegate.core.rig.arrays import Bytes, Counts, Words
from slopegate.drivers.contract.frame import PixelFormat, filters

ZOOM_STEP = 1.25
PAN_STEP = 64.0


class LiveView(QWidget):
    """Shows (H, W) uint16 counts, mono or RGGB mosaic. Holds a frame until it is given the next one."""

    painted = Signal()
    """After a new frame was drawn on the screen (not for repaints of an old one)."""
    hovered = Signal(int, int)
    """Column and row under the mouse; (-1, -1) outside the image."""
    zoomed = Signal(float)
    """Device pixels per image pixel, after zooming or resizing."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        if QGuiApplication.platformName() == "xcb":
            # a surface of its own: beside an OpenGL widget Qt would compose the whole window anew for every frame,
            # three times the work without a graphics card
            self.setAttribute(Qt.WidgetAttribute.WA_DontCreateNativeAncestors)
            self.setAttribute(Qt.WidgetAttribute.WA_NativeWindow)
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName("Live image")
        self.setToolTip("Wheel or +/-: zoom to the cursor. Drag or arrow keys: pan. F: fit, 1: one to one.")
        self._image: Counts | None = None
        self._rgb: Counts | None = None
        self._mosaic = False
        self._levels = level_table(0, 4095, srgb=True)
        self._colour_map: ColourMap = "grey"
        self._mapped: Words | None = None
        self._marked: tuple[int, int] | None = None
        self._resampler = Resampler()
        self._viewport: Viewport | None = None
        self._shape = (0, 0)
        """Of the last image, which may have been cleared: the next of this shape is looked at in the same place."""
        self._fresh = False
        self._stale = ""
        self._drag: QPointF | None = None
        self._pointer: QPointF | None = None

    def sizeHint(self) -> QSize:
        return QSize(720, 540)

    def minimumSizeHint(self) -> QSize:
        return QSize(240, 180)

    @property
    def image(self) -> Counts | None:
        """The counts on show, (H, W) uint16."""
        return self._image

    @property
    def viewport(self) -> Viewport | None:
        """What part of the image is shown, in device pixels; None while the whole image is fitted."""
        return self._viewport

    @property
    def scale(self) -> float:
        """Device pixels per image pixel."""
        current = self._current()
        return 1.0 if current is None else current.scale

    def show_frame(self, image: Counts, pixel_format: PixelFormat) -> None:
        """Show these counts; the array must keep its values until the next call."""
        if self._shape != image.shape:
            self._viewport = None
        self._image, self._shape = image, (image.shape[0], image.shape[1])
        pattern = filters(pixel_format)
        self._mosaic = bool(pattern)
        if not pattern:
            self._rgb = None
        else:
            if self._rgb is None or self._rgb.shape[:2] != image.shape:
                self._rgb = np.empty((*image.shape, 3), np.uint16)
            demosaic(image, self._rgb, pattern)
        self._fresh = True
        self.update()
        self._tell_hover()

    def clear(self) -> None:
        """Show no frame until the next one."""
        self._image = self._rgb = None
        self._fresh = False
        self.update()
        self._tell_hover()

    @property
    def stale(self) -> str:
        """Why the picture is not live; empty when it is."""
        return self._stale

    def set_stale(self, text: str) -> None:
        """Veil the picture and say why it is not live; an empty text takes the veil away."""
        if text != self._stale:
            self._stale = text
            self.update()

    def set_levels(self, black: float, white: float, srgb: bool) -> None:
        """Counts shown as black and white, and whether the sRGB curve lies in between."""
        self._levels = level_table(black, white, srgb)
        self._shade()

    def set_colour_map(self, name: ColourMap) -> None:
        """Show counts in these colours; an image in colour keeps its own."""
        if name != self._colour_map:
            self._colour_map = name
            self._shade()

    def set_marks(self, ends: tuple[int, int] | None) -> None:
        """Mark pixels of at most the first count, and of at least the last; None marks none."""
        if ends != self._marked:
            self._marked = ends
            self.update()

    @property
    def table(self) -> Bytes | Words:
        """What is shown of every count: `level_table`, or `shade_table` where a colour map is at work."""
        return self._levels if self._mapped is None or self._mosaic else self._mapped

    def _shade(self) -> None:
        self._mapped = None if self._colour_map == "grey" else shade_table(self._levels, ramp(self._colour_map))
        self.update()

    @property
    def pixels(self) -> Counts | None:
        """The counts on show, (H, W), or demosaiced (H, W, 3)."""
        return self._rgb if self._mosaic else self._image

    def fit(self) -> None:
        """Show the whole image, and keep doing so when the window is resized."""
        self._set_viewport(None)

    def one_to_one(self) -> None:
        """One screen pixel per image pixel, about the middle of the view."""
        current = self._current()
        if current is not None:
            self._zoom(1.0 / current.scale, self._centre())

    def zoom_in(self) -> None:
        """Magnify a step about the mouse, or the middle of the view."""
        self._zoom(ZOOM_STEP, self._anchor())

    def zoom_out(self) -> None:
        """Shrink a step about the mouse, or the middle of the view."""
        self._zoom(1 / ZOOM_STEP, self._anchor())

    def screen_pixels(self) -> Words:
        """What was drawn last, (height, width) 0xffRRGGBB in device pixels."""
        return self._resampler.screen

    def seen(self) -> QRect:
        """Where the image lies in the widget; empty without one."""
        current = self._current()
        if current is None:
            return QRect()
        scale, (width, height) = current.scale / self.devicePixelRatioF(), self._image_size()
        whole = QRectF(-current.left * scale, -current.top * scale, width * scale, height * scale)
        return whole.toAlignedRect().intersected(self.rect())

    def seen_pixels(self) -> tuple[int, int, int, int]:
        """The pixels that can be seen: columns x0 .. x1 - 1, rows y0 .. y1 - 1."""
        current = self._current()
        if current is None:
            return 0, 0, 0, 0
        (width, height), (across, down) = self._image_size(), self._device_size()
        right, bottom = current.to_image(across, down)
        x0, y0 = max(math.floor(current.left), 0), max(math.floor(current.top), 0)
        return x0, y0, min(math.ceil(right), width), min(math.ceil(bottom), height)

    def _device_size(self) -> tuple[int, int]:
        ratio = self.devicePixelRatioF()
        return max(round(self.width() * ratio), 1), max(round(self.height() * ratio), 1)

    def _image_size(self) -> tuple[int, int]:
        assert self._image is not None
        return self._image.shape[1], self._image.shape[0]

    def _current(self) -> Viewport | None:
        if self._image is None:
            return None
        return self._viewport or fitted(self._image_size(), self._device_size())

    def _set_viewport(self, viewport: Viewport | None) -> None:
        self._viewport = viewport
        self.update()
        self._tell_hover()
        current = self._current()
        if current is not None:
            self.zoomed.emit(current.scale)

    def _zoom(self, factor: float, about: QPointF) -> None:
        current = self._current()
        if current is None:
            return
        size, view, ratio = self._image_size(), self._device_size(), self.devicePixelRatioF()
        whole = fitted(size, view)
        least = min(whole.scale, 1.0)
        zoomed = current.zoomed(factor, about.x() * ratio, about.y() * ratio, least)
        fits = math.isclose(zoomed.scale, whole.scale, rel_tol=1e-9)
        self._set_viewport(None if fits else zoomed.held(size, view))

    def _pan(self, dx: float, dy: float) -> None:
        if self._viewport is not None and self._image is not None:
            self._set_viewport(self._viewport.moved(dx, dy).held(self._image_size(), self._device_size()))

    def _centre(self) -> QPointF:
        return QPointF(self.width() / 2, self.height() / 2)

    def _anchor(self) -> QPointF:
        return self._pointer if self._pointer is not None else self._centre()

    def _tell_hover(self) -> None:
        current = self._current()
        if self._pointer is None or current is None:
            self.hovered.emit(-1, -1)
            return
        ratio = self.devicePixelRatioF()
        column, row = current.to_image(self._pointer.x() * ratio, self._pointer.y() * ratio)
        width, height = self._image_size()
        inside = 0 <= column < width and 0 <= row < height
        self.hovered.emit(int(column) if inside else -1, int(row) if inside else -1)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        scheme = colours(self.palette())
        painter.fillRect(self.rect(), scheme.grid)
        current = self._current()
        if self._image is None or current is None:
            painter.setPen(scheme.muted)
            text = self._stale or "Waiting for the first image ..."
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap, text)
            return
        source = self._rgb if self._mosaic and self._rgb is not None else self._image
        screen = self._resampler.draw(source, self.table, current, self._device_size())
        if self._marked is not None:
            self._resampler.mark(self._image, self._marked, current, (DARK, SATURATED))
        picture = QImage(
            screen.data, screen.shape[1], screen.shape[0], screen.strides[0], QImage.Format.Format_ARGB32_Premultiplied
        )
        picture.setDevicePixelRatio(self.devicePixelRatioF())
        painter.drawImage(0, 0, picture)
        if self._stale:
            self._draw_veil(painter)
        painter.end()
        if self._fresh:
            self._fresh = False
            self.painted.emit()

    def _draw_veil(self, painter: QPainter) -> None:
        painter.fillRect(self.rect(), QColor(0, 0, 0, 140))
        flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap
        font = painter.font()
        font.setBold(True)
        painter.setFont(font)
        text = painter.boundingRect(self.rect().adjusted(40, 0, -40, 0), flags, self._stale)
        painter.fillRect(text.adjusted(-16, -10, 16, 10), QColor("#b3261e"))
        painter.setPen(QColor("#ffffff"))
        painter.drawText(text, flags, self._stale)

    def resizeEvent(self, event: QResizeEvent) -> None:
        if self._viewport is not None and self._image is not None:
            self._viewport = self._viewport.held(self._image_size(), self._device_size())
        current = self._current()
        if current is not None:
            self.zoomed.emit(current.scale)

    def wheelEvent(self, event: QWheelEvent) -> None:
        notches = event.angleDelta().y() / 120
        if notches:
            self._zoom(ZOOM_STEP**notches, event.position())
        event.accept()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() in (Qt.MouseButton.LeftButton, Qt.MouseButton.MiddleButton):
            self._drag = event.position()
            self.setCursor(Qt.CursorShape.ClosedHandCursor)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self._pointer = event.position()
        if self._drag is not None:
            ratio = self.devicePixelRatioF()
            moved = event.position() - self._drag
            self._drag = event.position()
            self._pan(moved.x() * ratio, moved.y() * ratio)
        self._tell_hover()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._drag = None
        self.unsetCursor()

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self.fit()

    def leaveEvent(self, event: QEvent) -> None:
        self._pointer = None
        self._tell_hover()

    def own_keys(self) -> tuple[OwnKey, ...]:
        """The keys that it understands while it has the focus."""
        key, steps = Qt.Key, {Qt.Key.Key_Left: (1, 0), Qt.Key.Key_Right: (-1, 0), Qt.Key.Key_Up: (0, 1)}

        def pan(pressed: Qt.Key) -> None:
            dx, dy = steps.get(pressed, (0, -1))
            self._pan(dx * PAN_STEP, dy * PAN_STEP)

        return (
            OwnKey((key.Key_Left, key.Key_Right, key.Key_Up, key.Key_Down), "Move what is seen", pan),
            OwnKey((key.Key_Plus, key.Key_Equal), "Magnify about the mouse", lambda _: self.zoom_in()),
            OwnKey((key.Key_Minus,), "Shrink about the mouse", lambda _: self.zoom_out()),
            OwnKey((key.Key_F, key.Key_0), "Show the whole image", lambda _: self.fit()),
            OwnKey((key.Key_1,), "One screen pixel per image pixel", lambda _: self.one_to_one()),
        )

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if not act_on(event, self.own_keys()):
            super().keyPressEvent(event)
