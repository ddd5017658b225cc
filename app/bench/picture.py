"""Run time against error on logarithmic axes, one chart for rounding and one for sampling, drawn without a window."""

from __future__ import annotations

import errno
import math
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QImageWriter
from PySide6.QtWidgets import QApplication

from slopegate.app.bench.results import HALF_COUNT, WaySummary, pareto
from slopegate.drivers.files.durable import replacing

WIDTH, HEIGHT = 1080, 640
ROUNDING: Final = "Rounding: against the exact gate of the same rays"
SAMPLING: Final = "Sampling: against the mean over each pixel's area"
INK, GRID, FRONT = "#202428", 40, "#c2410c"
COLOURS: Final = {
    "default": "#c2410c",
    "number type": "#1d4ed8",
    "gate edges": "#047857",
    "ray casting": "#a16207",
    "baseline": "#4b5563",
    "peer": "#7e22ce",
}
LABEL_HEIGHT = 14


@dataclass(frozen=True)
class Point:
    """One way to make a frame in a chart: decimal logarithms of its cost, of its range over scenes, of its error."""

    name: str
    group: str
    cost: float
    span: tuple[float, float]
    error: float
    front: bool

    @property
    def colour(self) -> str:
        """The colour of its group."""
        return COLOURS[self.group]


def save_picture(path: Path, summaries: Sequence[WaySummary], caption: str) -> None:
    """Write the picture (.png). Raises StorageError where it cannot be written."""
    application = _application()
    view = pg.GraphicsLayoutWidget(size=(WIDTH, HEIGHT))
    view.setBackground("white")
    view.setAntialiasing(True)
    view.ci.layout.setContentsMargins(12, 8, 16, 8)
    heading = "Run time against error of every way to make a gated 12-bit frame"
    view.addLabel(heading, row=0, col=0, colspan=2, size="16px", bold=True, color=INK, justify="left")
    rounding = _points(summaries, lambda item: item.gate_counts)
    sampling = _points(summaries, lambda item: item.area_rms_counts)
    costs = _decades([cost for point in (*rounding, *sampling) for cost in point.span])
    charts = (
        (ROUNDING, "expected error of a pixel at an edge, counts", rounding, rounding),
        # Number types sample alike: their points crowd round the default's, and bear no names.
        (SAMPLING, "RMS error, counts", sampling, [point for point in sampling if point.group != "number type"]),
    )
    plots = [view.addPlot(row=1, col=place) for place in range(len(charts))]
    for plot, (title, axis, points, _) in zip(plots, charts, strict=True):
        _draw_chart(plot, title, axis, points, costs)
    view.addLabel(_legend(), row=2, col=0, colspan=2, size="11px", color=INK, justify="left")
    view.addLabel(caption, row=3, col=0, colspan=2, size="11px", color=INK, justify="left")
    view.grab()  # for the places of the points in pixels, which the names then keep clear of
    for plot, (_, _, points, named) in zip(plots, charts, strict=True):
        _draw_names(plot, points, named)
    image = view.grab().toImage()
    view.close()
    del application
    with replacing(path) as part:
        writer = QImageWriter(str(part), b"png")
        if not writer.write(image):
            raise OSError(errno.EIO, writer.errorString())


def _application() -> QApplication:
    """Widgets need an application; without a display it works offscreen."""
    found = QApplication.instance()
    if isinstance(found, QApplication):
        return found
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    return QApplication([])


def _points(summaries: Sequence[WaySummary], error: Callable[[WaySummary], float | None]) -> list[Point]:
    known = [(item, value) for item in summaries if (value := error(item))]
    front = pareto([(item.core_ms_per_mpixel, value) for item, value in known])
    log = math.log10
    return [
        Point(
            item.name, item.group, log(item.core_ms_per_mpixel), (log(item.fastest), log(item.slowest)), log(value), on
        )
        for (item, value), on in zip(known, front, strict=True)
    ]


def _decades(values: Sequence[float]) -> tuple[int, int]:
    """Powers of ten about all values, with room for names at the ends."""
    return math.floor(min(values) - 0.15), math.ceil(max(values) + 0.15)


def _font(size: int = 11) -> QFont:
    font = QFont("DejaVu Sans")
    font.setPixelSize(size)
    return font


def _legend() -> str:
    """The colours and signs, as rich text."""
    signs = [f'<span style="color:{colour}">\u25cf</span> {group}' for group, colour in COLOURS.items()]
    signs.append(f'<span style="color:{FRONT}">\u2500\u2500</span> Pareto front (filled points)')
    return "&nbsp;&nbsp;&nbsp; ".join([*signs, "bar: range over scenes", "dashed: half a count"])


def _draw_chart(plot: Any, title: str, axis: str, points: Sequence[Point], costs: tuple[int, int]) -> None:
    half = math.log10(HALF_COUNT)
    errors = _decades([point.error for point in points] + [half])
    plot.setTitle(title, size="12px", bold=True, color=INK)
    plot.showAxes(True, showValues=(True, False, False, True))
    plot.setRange(xRange=costs, yRange=errors, padding=0)
    plot.hideButtons()
    for side, across, text, limits in (
        ("bottom", "top", "run time per megapixel, ms of one core", costs),
        ("left", "right", axis, errors),
    ):
        powers = range(limits[0], limits[1] + 1)
        plot.setLabel(side, text, color=INK, **{"font-size": "11px"})
        plot.getAxis(side).setTicks([[(power, _power(power)) for power in powers]])
        # The grid is the other side's: an axis with one drops the names at its ends.
        plot.getAxis(across).setTicks([[(power, "") for power in powers]])
        plot.getAxis(across).setGrid(GRID)
        for one in (side, across):
            plot.getAxis(one).setTickFont(_font())
            plot.getAxis(one).setPen(INK)
            plot.getAxis(one).setTextPen(INK)
            plot.getAxis(one).setStyle(tickLength=0, hideOverlappingLabels=False)
    plot.addItem(pg.InfiniteLine(half, angle=0, pen=pg.mkPen(INK, style=Qt.PenStyle.DashLine)))
    corners = _corners(points)
    plot.plot([x for x, _ in corners], [y for _, y in corners], pen=pg.mkPen(FRONT, width=1.6))
    for point in sorted(points, key=lambda point: point.group == "default"):
        plot.plot(list(point.span), [point.error] * 2, pen=pg.mkPen(point.colour))
        plot.plot(
            [point.cost],
            [point.error],
            symbol="o",
            symbolSize=13 if point.group == "default" else 9,
            symbolPen=pg.mkPen(point.colour, width=1.6),
            symbolBrush=point.colour if point.front else "white",
        )


def _power(power: int) -> str:
    if -3 <= power < 4:
        return f"{10.0**power:g}"
    return "10" + str(power).translate(
        str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
    )


def _corners(points: Sequence[Point]) -> list[tuple[float, float]]:
    """The front as a staircase: what is above and to the right of it is beaten by a point on it."""
    corners: list[tuple[float, float]] = []
    for point in sorted((point for point in points if point.front), key=lambda point: point.cost):
        if corners:
            corners.append((point.cost, corners[-1][1]))
        corners.append((point.cost, point.error))
    return corners


def _draw_names(plot: Any, points: Sequence[Point], named: Sequence[Point]) -> None:
    """Write each name beside its point, clear of everything else, with a line to the point where it is not near."""
    box, metrics = plot.getViewBox(), QFontMetricsF(_font())

    def at(x: float, y: float) -> QPointF:
        return QPointF(box.mapViewToScene(QPointF(x, y)))

    def line(start: tuple[float, float], end: tuple[float, float]) -> QRectF:
        return QRectF(at(*start), at(*end)).normalized().adjusted(-2, -2, 2, 2)

    (left, right), (bottom, top) = box.viewRange()
    inside, half = QRectF(at(left, top), at(right, bottom)), math.log10(HALF_COUNT)
    taken = [QRectF(at(p.cost, p.error) - QPointF(6, 6), at(p.cost, p.error) + QPointF(6, 6)) for p in points]
    taken += [line(*pair) for pair in pairwise(_corners(points))]
    taken += [line((p.span[0], p.error), (p.span[1], p.error)) for p in points]
    taken.append(line((left, half), (right, half)))
    for point in sorted(named, key=lambda point: -point.error):
        spot = at(point.cost, point.error)
        place = _free_place(inside, spot, metrics.horizontalAdvance(point.name), taken)
        taken.append(place)
        end = QPointF(place.left() - 1 if place.left() > spot.x() else place.right() + 1, place.center().y())
        if abs(end.y() - spot.y()) > 7 or abs(end.x() - spot.x()) > 16:
            meets = box.mapSceneToView(end)
            plot.plot([point.cost, meets.x()], [point.error, meets.y()], pen=pg.mkPen(point.colour, width=0.7))
        text = pg.TextItem(point.name, color=QColor(point.colour).darker(115), anchor=(0, 0.5))
        text.textItem.document().setDocumentMargin(0)
        text.setFont(_font())
        text.setPos(box.mapSceneToView(QPointF(place.left(), place.center().y())))
        plot.addItem(text, ignoreBounds=True)


def _free_place(box: QRectF, spot: QPointF, width: float, taken: Sequence[QRectF]) -> QRectF:
    """The free rectangle for a name that is nearest to its point, right of it where there is room, else left."""
    x, top = spot.x(), spot.y() - LABEL_HEIGHT / 2
    best, cost = QRectF(x + 10, top, width, LABEL_HEIGHT), math.inf
    for right in (True, False):
        for away in (10, 24, 40, 60):
            for lift in range(-30, 31):
                left = x + away if right else x - away - width
                place = QRectF(left, top + 5 * lift, width, LABEL_HEIGHT)
                far = away + abs(5 * lift) + (0 if right else 6)
                if far < cost and box.contains(place) and not any(place.intersects(other) for other in taken):
                    best, cost = place, far
    return best
