"""Run time against error on logarithmic axes, one panel for rounding and one for sampling, drawn without a window."""

from __future__ import annotations

import errno
import math
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QGuiApplication, QImage, QImageWriter, QPainter, QPen, QPolygonF
from slopegate.app.bench.results import HALF_COUNT, WaySummary, pareto
from slopegate.drivers.files.durable import replacing

WIDTH, HEIGHT = 1080, 640
ROUNDING: Final = "Rounding: against the exact gate of the same rays"
SAMPLING: Final = "Sampling: against the mean over each pixel's area"
INK, FAINT, FRONT = QColor("#202428"), QColor("#d5d9dd"), QColor("#c2410c")
COLOURS: Final = {
    "default": QColor("#c2410c"),
    "number type": QColor("#1d4ed8"),
    "gate edges": QColor("#047857"),
    "ray casting": QColor("#a16207"),
    "baseline": QColor("#4b5563"),
    "peer": QColor("#7e22ce"),
}


@dataclass(frozen=True)
class Point:
    """One way in a panel: its cost, its range over the scenes, and its error."""

    name: str
    group: str
    cost: float
    span: tuple[float, float]
    error: float
    front: bool


@dataclass(frozen=True)
class Chart:
    """A pair of logarithmic axes in a rectangle of the picture."""

    box: QRectF
    title: str
    axis: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    names: Callable[[Point], bool]
    """Which points bear their names."""

    def x(self, cost: float) -> float:
        """Pixel column of a cost."""
        low, high = map(math.log10, self.x_range)
        return self.box.left() + (math.log10(cost) - low) / (high - low) * self.box.width()

    def y(self, error: float) -> float:
        """Pixel row of an error."""
        low, high = map(math.log10, self.y_range)
        return self.box.bottom() - (math.log10(error) - low) / (high - low) * self.box.height()


def save_picture(path: Path, summaries: Sequence[WaySummary], caption: str) -> None:
    """Write the picture (.png). Raises OSError where it cannot be written."""
    application = _application()
    image = QImage(WIDTH, HEIGHT, QImage.Format.Format_RGB32)
    image.fill(QColor("white"))
    painter = QPainter(image)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setFont(_font(11))
    rounding = _points(summaries, lambda item: item.gate_counts)
    sampling = _points(summaries, lambda item: item.area_rms_counts)
    costs = _decades([cost for point in (*rounding, *sampling) for cost in point.span])
    top, height = 64.0, HEIGHT - 64.0 - 92.0
    left_box, right_box = QRectF(64, top, 440, height), QRectF(588, top, 470, height)
    for box, points, title, axis, names in (
        (left_box, rounding, ROUNDING, "expected error of a pixel at an edge, counts", _any),
        (right_box, sampling, SAMPLING, "RMS error, counts", _samples_anew),
    ):
        errors = _decades([point.error for point in points] + [HALF_COUNT])
        panel = Chart(box, title, axis, costs, errors, names)
        _draw_axes(painter, panel)
        _draw_front(painter, panel, points)
        _draw_points(painter, panel, points)
    _draw_heading(painter, caption)
    painter.end()
    del application
    with replacing(path) as part:
        writer = QImageWriter(str(part), b"png")
        if not writer.write(image):
            raise OSError(errno.EIO, writer.errorString())


def _any(point: Point) -> bool:
    return True


def _samples_anew(point: Point) -> bool:
    """Number types sample alike: their points crowd round the default's."""
    return point.group != "number type"


def _application() -> QGuiApplication:
    """Fonts need an application; without a display it works offscreen."""
    found = QGuiApplication.instance()
    if isinstance(found, QGuiApplication):
        return found
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    return QGuiApplication([])


def _points(summaries: Sequence[WaySummary], error: Callable[[WaySummary], float | None]) -> list[Point]:
    known = [(item, value) for item in summaries if (value := error(item))]
    front = pareto([(item.core_ms_per_mpixel, value) for item, value in known])
    return [
        Point(item.name, item.group, item.core_ms_per_mpixel, (item.fastest, item.slowest), value, on)
        for (item, value), on in zip(known, front, strict=True)
    ]


def _decades(values: Sequence[float]) -> tuple[float, float]:
    """Powers of ten about all values, with room for labels at the ends."""
    return 10.0 ** math.floor(math.log10(min(values)) - 0.15), 10.0 ** math.ceil(math.log10(max(values)) + 0.15)


def _font(size: float, bold: bool = False) -> QFont:
    font = QFont("DejaVu Sans")
    font.setPixelSize(int(size))
    font.setBold(bold)
    return font


def _draw_heading(painter: QPainter, caption: str) -> None:
    painter.setPen(INK)
    painter.setFont(_font(16, bold=True))
    painter.drawText(QPointF(20, 28), "Run time against error of every way to make a gated 12-bit frame")
    painter.setFont(_font(11))
    painter.drawText(QPointF(20, HEIGHT - 14), caption)
    left = 20.0
    for group, colour in COLOURS.items():
        painter.setBrush(colour)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.drawEllipse(QPointF(left + 5, HEIGHT - 37), 4.5, 4.5)
        painter.setPen(INK)
        painter.drawText(QPointF(left + 14, HEIGHT - 33), group)
        left += 34 + QFontMetricsF(painter.font()).horizontalAdvance(group)
    painter.setPen(QPen(FRONT, 1.6))
    painter.drawLine(QPointF(left, HEIGHT - 37), QPointF(left + 26, HEIGHT - 37))
    painter.setPen(INK)
    text = "Pareto front (filled points)      bar: range over scenes      dashed: half a count"
    painter.drawText(QPointF(left + 32, HEIGHT - 33), text)


def _draw_axes(painter: QPainter, panel: Chart) -> None:
    box = panel.box
    painter.setFont(_font(11))
    for value in _powers(panel.x_range):
        x = panel.x(value)
        painter.setPen(QPen(FAINT, 1))
        painter.drawLine(QPointF(x, box.top()), QPointF(x, box.bottom()))
        painter.setPen(INK)
        painter.drawText(QRectF(x - 30, box.bottom() + 3, 60, 16), Qt.AlignmentFlag.AlignCenter, _power(value))
    for value in _powers(panel.y_range):
        y = panel.y(value)
        painter.setPen(QPen(FAINT, 1))
        painter.drawLine(QPointF(box.left(), y), QPointF(box.right(), y))
        painter.setPen(INK)
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        painter.drawText(QRectF(box.left() - 46, y - 8, 41, 16), right, _power(value))
    painter.setPen(QPen(INK, 1, Qt.PenStyle.DashLine))
    painter.drawLine(QPointF(box.left(), panel.y(HALF_COUNT)), QPointF(box.right(), panel.y(HALF_COUNT)))
    painter.setPen(QPen(INK, 1))
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.drawRect(box)
    text = QRectF(box.left(), box.bottom() + 18, box.width(), 16)
    painter.drawText(text, Qt.AlignmentFlag.AlignCenter, "run time per megapixel, ms of one core")
    painter.setFont(_font(12, bold=True))
    painter.drawText(QPointF(box.left(), box.top() - 8), panel.title)
    painter.save()
    painter.setFont(_font(11))
    painter.translate(box.left() - 50, box.center().y())
    painter.rotate(-90)
    painter.drawText(QRectF(-150, -14, 300, 16), Qt.AlignmentFlag.AlignCenter, panel.axis)
    painter.restore()


def _powers(limits: tuple[float, float]) -> list[float]:
    low, high = (round(math.log10(limit)) for limit in limits)
    return [10.0**power for power in range(low, high + 1)]


def _power(value: float) -> str:
    if 1e-3 <= value < 1e4:
        return f"{value:g}"
    return "10" + str(round(math.log10(value))).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _draw_front(painter: QPainter, panel: Chart, points: Sequence[Point]) -> None:
    """A staircase: what is above and to the right of it is beaten by a point on it."""
    painter.setPen(QPen(FRONT, 1.6))
    painter.drawPolyline(QPolygonF(_corners(panel, points)))


def _corners(panel: Chart, points: Sequence[Point]) -> list[QPointF]:
    corners: list[QPointF] = []
    for point in sorted((point for point in points if point.front), key=lambda point: point.cost):
        if corners:
            corners.append(QPointF(panel.x(point.cost), corners[-1].y()))
        corners.append(QPointF(panel.x(point.cost), panel.y(point.error)))
    return corners


def _steps(panel: Chart, points: Sequence[Point]) -> list[QRectF]:
    """The front's lines as rectangles that labels keep clear of."""
    pairs = pairwise(_corners(panel, points))
    return [QRectF(a, b).normalized().adjusted(-2, -2, 2, 2) for a, b in pairs]


def _bar(panel: Chart, point: Point) -> QRectF:
    """The range over the scenes."""
    left, right, y = panel.x(point.span[0]), panel.x(point.span[1]), panel.y(point.error)
    return QRectF(left, y - 2, right - left + 1, 4)


def _draw_points(painter: QPainter, panel: Chart, points: Sequence[Point]) -> None:
    for point in sorted(points, key=lambda point: point.group == "default"):
        x, y, colour = panel.x(point.cost), panel.y(point.error), COLOURS[point.group]
        painter.setPen(QPen(colour, 1))
        bar = _bar(panel, point)
        painter.drawLine(QPointF(bar.left(), y), QPointF(bar.right(), y))
        size = 6.5 if point.group == "default" else 4.5
        painter.setPen(QPen(colour, 1.6))
        painter.setBrush(colour if point.front else QColor("white"))
        painter.drawEllipse(QPointF(x, y), size, size)
    painter.setFont(_font(11))
    metrics = QFontMetricsF(painter.font())
    half = QRectF(panel.box.left(), panel.y(HALF_COUNT) - 2, panel.box.width(), 4)
    taken = [QRectF(panel.x(p.cost) - 6, panel.y(p.error) - 6, 12, 12) for p in points]
    taken += [half, *_steps(panel, points), *(_bar(panel, point) for point in points)]
    for point in sorted(filter(panel.names, points), key=lambda point: panel.y(point.error)):
        x, y = panel.x(point.cost), panel.y(point.error)
        place = _free_place(panel.box, x, y, metrics.horizontalAdvance(point.name), taken)
        taken.append(place)
        painter.setPen(QPen(COLOURS[point.group], 0.7))
        end = place.left() - 1 if place.left() > x else place.right() + 1
        if abs(place.center().y() - y) > 7 or abs(end - x) > 16:
            painter.drawLine(QPointF(x, y), QPointF(end, place.center().y()))
        painter.setPen(COLOURS[point.group].darker(115))
        painter.drawText(place, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, point.name)


def _free_place(box: QRectF, x: float, y: float, width: float, taken: Sequence[QRectF]) -> QRectF:
    """The free rectangle for a label that is nearest to its point, right of it where there is room, else left."""
    best, cost = QRectF(x + 10, y - 7, width, 14), math.inf
    for right in (True, False):
        for away in (10, 24, 40, 60):
            for lift in range(-30, 31):
                left = x + away if right else x - away - width
                place = QRectF(left, y - 7 + 5 * lift, width, 14)
                far = away + abs(5 * lift) + (0 if right else 6)
                if far < cost and box.contains(place) and not any(place.intersects(other) for other in taken):
                    best, cost = place, far
    return best
