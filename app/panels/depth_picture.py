"""A depth map in colour, and as a cloud of points that can be turned."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QImage, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from slopegate.app.session.describe import measured
from slopegate.app.widgets.theme import colours
from slopegate.core.compiled.kept import njit
from slopegate.core.rig.arrays import Doubles, Singles, Words

_UNKNOWN = np.uint32(0xFF303030)
_BAR_PX = 72
_TURN_DEG_PER_PX = 0.4
_MOST_POINTS = 300_000


def colour_scale() -> Words:
    """256 colours from far (blue) to near (red) as 0xffRRGGBB: Google's Turbo map."""
    ramp = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_TURBO)[:, 0].astype(np.uint32)
    scale: Words = np.uint32(0xFF000000) | ramp[:, 2] << np.uint32(16) | ramp[:, 1] << np.uint32(8) | ramp[:, 0]
    return scale


def depth_range(inverse_depth: Singles) -> tuple[float, float]:
    """Least and greatest inverse depth worth a colour: the 0.5th and 99.5th percentile of what is known, widened."""
    known = inverse_depth[inverse_depth > 0]
    if known.size == 0:
        return 0.5, 2.0
    low, high = (float(value) for value in np.percentile(known, (0.5, 99.5)))
    middle = max(0.05 * high - (high - low), 0.0) / 2
    return low - middle, high + middle


def coloured(inverse_depth: Singles, bounds: tuple[float, float]) -> Words:
    """(H, W) 1/m -> 0xffRRGGBB (H, W): linear in inverse depth, as the gate resolves it; grey where unknown."""
    return _in_colour(inverse_depth, bounds)


def error_range(errors_m: Singles) -> tuple[float, float]:
    """Least and greatest standard error worth a colour, metres: the 0.5th and 99.5th percentile, widened."""
    known = errors_m[np.isfinite(errors_m)]
    if known.size == 0:
        return 0.0, 1e-3
    low, high = (float(value) for value in np.percentile(known, (0.5, 99.5)))
    return low, max(high, 1.01 * low, low + 1e-9)


def _in_colour(values: Singles, bounds: tuple[float, float]) -> Words:
    """From blue to red between the bounds; grey where they are not above 0."""
    low, high = bounds
    known = values > 0
    index = np.clip((np.where(known, values, low) - low) * (255.0 / (high - low)), 0, 255).astype(np.uint8)
    return np.where(known, colour_scale()[index], _UNKNOWN)


class DepthPicture(QWidget):
    """The depth map in colour with its scale, or its standard errors; depth under the mouse."""

    hovered = Signal(str)
    """Column, row and depth under the mouse; empty outside."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setMouseTracking(True)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName("Depth map")
        self._inverse: Singles | None = None
        self._errors_m: Singles | None = None
        self._by_error = False
        self._bounds = (0.5, 2.0)
        self._pixels: Words | None = None
        self._text = "No depth yet"

    def sizeHint(self) -> QSize:
        return QSize(320, 200)

    def show_depth(self, inverse_depth: Singles | None, errors_m: Singles | None = None) -> None:
        """Show this map (H, W), 1/m, 0 where unknown; errors_m: its standard errors where they are known, metres."""
        self._inverse, self._errors_m = inverse_depth, errors_m
        self._colour()

    def show_errors(self, wanted: bool) -> None:
        """Colour the standard errors in place of the depths, where there are any."""
        self._by_error = wanted
        self._colour()

    def _colour(self) -> None:
        self._pixels = None
        if self._by_error and self._errors_m is not None:
            self._bounds = error_range(self._errors_m)
            self._pixels = np.ascontiguousarray(_in_colour(self._errors_m, self._bounds))
        elif self._inverse is not None:
            self._bounds = depth_range(self._inverse)
            self._pixels = np.ascontiguousarray(coloured(self._inverse, self._bounds))
        self.update()

    def _mark(self, value: float) -> str:
        """What stands beside the scale."""
        if self._by_error and self._errors_m is not None:
            return f"{1000 * value:.2g} mm"
        return f"{1 / max(value, 1e-6):.3g} m"

    def say(self, text: str) -> None:
        """What stands in place of a map."""
        self._text = text
        self.update()

    def place(self) -> QRectF:
        """Where the map is drawn in the widget."""
        assert self._pixels is not None
        height, width = self._pixels.shape
        scale = min((self.width() - _BAR_PX) / width, self.height() / height)
        return QRectF(0, (self.height() - scale * height) / 2, scale * width, scale * height)

    def paintEvent(self, event: QPaintEvent) -> None:
        scheme = colours(self.palette())
        painter = QPainter(self)
        painter.fillRect(self.rect(), scheme.background)
        if self._pixels is None:
            painter.setPen(scheme.muted)
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, self._text)
            return
        height, width = self._pixels.shape
        picture = QImage(self._pixels.data, width, height, 4 * width, QImage.Format.Format_RGB32)
        place = self.place()
        small = place.width() < width
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, small)
        painter.drawImage(place, picture)
        bar = QRectF(place.right() + 6, place.top(), 10, place.height())
        scale = np.ascontiguousarray(colour_scale()[::-1])
        painter.drawImage(bar, QImage(scale.data, 1, 256, 4, QImage.Format.Format_RGB32))
        painter.setPen(scheme.text)
        low, high = self._bounds
        for share in (0.0, 0.5, 1.0):
            value = high + (low - high) * share
            y = bar.top() + share * (bar.height() - 14)
            painter.drawText(
                QRectF(bar.right() + 4, y, _BAR_PX - 22, 14),
                Qt.AlignmentFlag.AlignLeft,
                self._mark(value),
            )

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._inverse is None or self._pixels is None:
            return
        place = self.place()
        at = (event.position() - place.topLeft()) / place.width() * self._inverse.shape[1]
        column, row = int(np.floor(at.x())), int(np.floor(at.y()))
        if not (0 <= column < self._inverse.shape[1] and 0 <= row < self._inverse.shape[0]):
            self.hovered.emit("")
            return
        value = float(self._inverse[row, column])
        depth = "unknown"
        if value > 0:
            error = None if self._errors_m is None else float(self._errors_m[row, column])
            depth = f"depth {1 / value:.4g} m" if error is None else f"depth {measured(1 / value, error)} m"
        self.hovered.emit(f"column {column}  row {row}  {depth}")


class CloudPicture(QWidget):
    """The depth map as points in space: drag or arrow keys turn it, the wheel or + and - zoom. Needs no OpenGL."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName("Depth map in 3D")
        self.setToolTip("Drag or arrow keys: turn. Wheel, + or -: zoom.")
        self._points = np.zeros((0, 3), np.float32)
        self._tints = np.zeros(0, np.uint32)
        self._centre = np.zeros(3)
        self._reach = 1.0
        self.yaw_deg, self.pitch_deg, self.zoom = -28.0, 16.0, 1.0
        self._grip: QPointF | None = None

    def sizeHint(self) -> QSize:
        return QSize(320, 200)

    def show_points(self, points_m: Singles, inverse_depth: Singles) -> None:
        """World points (n, 3) and the inverse depth (n,) that gives each its colour."""
        step = max(1, -(-len(points_m) // _MOST_POINTS))
        self._points = np.ascontiguousarray(points_m[::step])
        self._tints = coloured(inverse_depth, depth_range(inverse_depth))[::step]
        if len(points_m):
            low, high = np.percentile(self._points, (1, 99), axis=0)
            self._centre = (low + high) / 2
            self._reach = max(float(np.linalg.norm(high - low)) / 2, 1e-3)
        self.update()

    def rotation(self) -> Doubles:
        """World axes -> the viewer's, (3, 3)."""
        yaw, pitch = np.radians((self.yaw_deg, self.pitch_deg))
        about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
        about_x = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
        turned: Doubles = about_x @ about_y
        return turned

    def paintEvent(self, event: QPaintEvent) -> None:
        scheme = colours(self.palette())
        painter = QPainter(self)
        painter.fillRect(self.rect(), scheme.background)
        if len(self._points) == 0:
            painter.setPen(scheme.muted)
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, "No depth yet")
            return
        width, height = max(self.width(), 1), max(self.height(), 1)
        screen = np.zeros((height, width), np.uint32)
        away = np.full((height, width), np.inf, np.float32)
        focal = self.zoom * 1.25 * min(width, height)
        splat(
            self._points,
            self._tints,
            self.rotation().astype(np.float32),
            self._centre.astype(np.float32),
            np.array([focal, 2.6 * self._reach, width / 2, height / 2], np.float32),
            screen,
            away,
        )
        image = QImage(screen.data, width, height, 4 * width, QImage.Format.Format_ARGB32_Premultiplied)
        painter.drawImage(0, 0, image)

    def _turn(self, yaw_deg: float, pitch_deg: float) -> None:
        self.yaw_deg = (self.yaw_deg + yaw_deg + 180) % 360 - 180
        self.pitch_deg = min(max(self.pitch_deg + pitch_deg, -89.0), 89.0)
        self.update()

    def _scale(self, factor: float) -> None:
        self.zoom = min(max(self.zoom * factor, 0.2), 20.0)
        self.update()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._grip = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._grip is not None:
            moved = event.position() - self._grip
            self._grip = event.position()
            self._turn(moved.x() * _TURN_DEG_PER_PX, -moved.y() * _TURN_DEG_PER_PX)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._grip = None

    def wheelEvent(self, event: QWheelEvent) -> None:
        self._scale(1.2 ** (event.angleDelta().y() / 120))
        event.accept()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        key = Qt.Key
        turns = {key.Key_Left: (-6, 0), key.Key_Right: (6, 0), key.Key_Up: (0, 6), key.Key_Down: (0, -6)}
        pressed = Qt.Key(event.key())
        if pressed in turns:
            self._turn(*turns[pressed])
        elif pressed in (key.Key_Plus, key.Key_Equal):
            self._scale(1.2)
        elif pressed == key.Key_Minus:
            self._scale(1 / 1.2)
        else:
            super().keyPressEvent(event)


@njit(cache=True, nogil=True)
def splat(points: Any, tints: Any, rotation: Any, centre: Any, view: Any, screen: Any, away: Any) -> None:
    """Draw points (n, 3) as 2 x 2 pixels, nearest on top. view: focal length, distance, middle of the screen."""
    height, width = screen.shape
    focal, distance, cx, cy = view[0], view[1], view[2], view[3]
    for i in range(points.shape[0]):
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        depth = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + distance
        if depth <= 0.05 * distance:
            continue
        scale = focal / depth
        column = int(cx + (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) * scale)
        row = int(cy + (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) * scale)
        for r in range(max(row, 0), min(row + 2, height)):
            for c in range(max(column, 0), min(column + 2, width)):
                if depth < away[r, c]:
                    away[r, c] = depth
                    screen[r, c] = tints[i]
