"""Panel that measures on the live image: a region's counts, a line's, a distance; and how the image is shown."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QColor, QGuiApplication, QHideEvent, QShowEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QVBoxLayout

from slopegate.app.panels.display_box import DisplayBox
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.panel_state import Values, numbers_text, text_numbers, values_of
from slopegate.app.session.session import Change
from slopegate.app.session.source import Source, known_buffers
from slopegate.app.views.draw_tools import EllipseTool, LineTool, PolygonTool, RectangleTool, Tool
from slopegate.app.views.overlay import RegionLayer, Segment, SegmentLayer
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import CountBox
from slopegate.app.widgets.painted import PaintedRegion, region_text, text_region
from slopegate.app.widgets.trace_plot import TracePlot
from slopegate.core.gating.gate import slab_if_any
from slopegate.core.measure.lengths import Spot, at_depth, in_slab, length_text
from slopegate.core.measure.region import RegionCounts, line_counts, mosaic_parts, region_counts
from slopegate.core.rig.arrays import Bools, Counts, Doubles
from slopegate.drivers.contract.frame import Frame, filters

LOOK_MS = 100
"""How often counts are looked at, at most;"""
SHARE = 0.1
"""and the greatest share of the window's time that this may take."""
KEPT_S = 30.0
"""What the plot over time goes back."""
REGION, LINE, LENGTH = QColor("#ffd400"), QColor("#4dd0ff"), QColor("#7dff7a")
_ELLIPSE_CORNERS = 180
_FIGURES = ("mean", "std", "least", "median", "most")
_COLUMNS = ("pixels", "mean", "std", "min", "median", "max", "saturated", "too dark")


@dataclass(frozen=True, eq=False)
class MarkedRegion:
    """Pixels that are measured, and the smallest box about them: columns x0 .. x1 - 1, rows y0 .. y1 - 1."""

    inside: Bools
    box: tuple[int, int, int, int]

    @staticmethod
    def of(inside: Bools) -> MarkedRegion | None:
        """These pixels (H, W); None where there is none."""
        rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
        if rows.size == 0:
            return None
        # whole cells of a mosaic, so that each filter stays where it is
        x0, y0 = int(columns[0]) // 2 * 2, int(rows[0]) // 2 * 2
        x1, y1 = min(int(columns[-1]) // 2 * 2 + 2, inside.shape[1]), min(int(rows[-1]) // 2 * 2 + 2, inside.shape[0])
        return MarkedRegion(inside[y0:y1, x0:x1], (x0, y0, x1, y1))

    def within(self, shape: tuple[int, int]) -> Bools:
        """Its pixels of an image of this height and width (H, W)."""
        x0, y0, x1, y1 = self.box
        whole = np.zeros(shape, bool)
        whole[y0:y1, x0:x1] = self.inside
        return whole


def measured(source: Source, image: Counts, region: MarkedRegion, dark_count: int) -> dict[str, RegionCounts]:
    """The figures of a region by filter, or of all its pixels under "" where there are no filters."""
    info, (x0, y0, x1, y1) = source.camera.info, region.box
    part, pattern = image[y0:y1, x0:x1], filters(info.pixel_format)
    pieces = mosaic_parts(part, region.inside, pattern) if pattern else {"": (part, region.inside)}
    found = {key: region_counts(*piece, info.max_count, dark_count) for key, piece in pieces.items()}
    return {key: figures for key, figures in found.items() if figures is not None}


def figures_rows(found: Mapping[str, RegionCounts]) -> list[list[str]]:
    """The figures as a table of texts, with a line of headings."""
    rows = [["", *_COLUMNS]]
    for key, one in found.items():
        counts = [
            f"{getattr(one, name):.1f}" if name in ("mean", "std") else f"{getattr(one, name):g}" for name in _FIGURES
        ]
        shares = [f"{100 * share:.3g} %" for share in (one.saturated, one.dark)]
        rows.append([key, str(one.pixels), *counts, *shares])
    return rows


def distance_text(source: Source, frame: Frame, ends: tuple[Spot, Spot]) -> str:
    """How far two spots of the image are apart in space, and how that is known."""
    pixels = f"{float(np.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1])):.1f} px"
    buffers, applied = known_buffers(source), frame.stamp.applied
    if buffers is not None and buffers.inverse_depth.shape == frame.image.shape:
        height, width = frame.image.shape
        cells = [(min(int(row), height - 1), min(int(column), width - 1)) for column, row in ends]
        found = [
            at_depth(source.rig, spot, float(buffers.inverse_depth[cell]))
            for spot, cell in zip(ends, cells, strict=True)
        ]
        if (metres := _apart(found)) is not None:
            how = (
                "the scene's depth" if source.rendered else "the capture's depth" if source.played else "depth as swept"
            )
            return f"{length_text(metres)} by {how} ({pixels})"
    if applied is not None:
        metres = _apart([in_slab(source.rig, applied, spot) for spot in ends])
        slab = slab_if_any(source.rig, applied).slab
        if metres is not None and slab is not None and slab.distance_m is not None:
            return f"{length_text(metres)} if both are in the slab's middle, at {slab.distance_m:.2f} m ({pixels})"
    return f"{pixels}; no depth is known there, and the gate has no slab to go by"


def _apart(points: list[Doubles | None]) -> float | None:
    first, last = points
    return None if first is None or last is None else float(np.linalg.norm(last - first))


class MeasurePanel(Panel):
    """Figures of a region over time, counts along a line and a distance, followed while the panel is on the screen."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._region: MarkedRegion | None = None
        self._line: tuple[Spot, Spot] | None = None
        self._ends: tuple[Spot, Spot] | None = None
        self._source: Source | None = desk.session.source
        self._past: deque[tuple[float, dict[str, float]]] = deque()
        self._seen: object = None
        self.found: dict[str, RegionCounts] = {}
        """The figures on show."""
        view = self._live.view
        self._region_layer, self._segment_layer = RegionLayer(view), SegmentLayer(view)
        self._make_tools()
        self._arrange()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)

    def _make_tools(self) -> None:
        view = self._live.view
        rectangle, ellipse, polygon = RectangleTool(view), EllipseTool(view), PolygonTool(view)
        profile, distance = LineTool(view), LineTool(view)
        self.tools: dict[str, Tool] = {
            "rectangle": rectangle,
            "ellipse": ellipse,
            "polygon": polygon,
            "profile": profile,
            "distance": distance,
        }
        rectangle.chosen.connect(lambda *box: self._take_shape(lambda painted: painted.rectangle(box)))
        ellipse.chosen.connect(lambda *box: self._take_shape(lambda painted: painted.polygon(_ellipse(*box))))
        polygon.chosen.connect(lambda corners: self._take_shape(lambda painted: painted.polygon(corners)))
        polygon.refused.connect(self._desk.warned)
        profile.chosen.connect(lambda xa, ya, xb, yb: self.set_line(((xa, ya), (xb, yb))))
        distance.chosen.connect(lambda xa, ya, xb, yb: self.set_ends(((xa, ya), (xb, yb))))
        hints = {
            "rectangle": ("Rectangle", "Counts of a region: drag a rectangle over the live image (F6)"),
            "ellipse": ("Ellipse", "Counts of a region: drag the box about an ellipse"),
            "polygon": ("Polygon", "Counts of a region: click its corners, and the first one or Enter to close it"),
            "profile": ("Line", "Counts along a line: drag it, or click its ends; Shift: along rows and columns (F7)"),
            "distance": ("Distance", "How far two points are apart in space: click both (F8)"),
        }
        self.buttons: dict[str, QPushButton] = {}
        for key, (text, hint) in hints.items():
            button = QPushButton(text)
            button.setCheckable(True)
            button.setToolTip(hint)
            tool = self.tools[key]
            button.toggled.connect(lambda on, tool=tool: tool.start() if on else tool.stop())
            tool.ended.connect(lambda button=button: button.setChecked(False))
            self.buttons[key] = button

    def _arrange(self) -> None:
        self.whole, self.clear, self.copy = (QPushButton(text) for text in ("Whole image", "Clear", "Copy figures"))
        self.whole.setToolTip("Counts of the whole image")
        self.clear.setToolTip("Measure nothing any more")
        self.copy.setToolTip("Put figures and curves on the clipboard as a table")
        self.whole.clicked.connect(self.take_whole)
        self.clear.clicked.connect(self.forget)
        self.copy.clicked.connect(self._copy)
        self.figures = QLabel("Mark a region to see its counts.")
        self.figures.setTextFormat(Qt.TextFormat.AutoText)
        self.figures.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.figures.setWordWrap(True)
        self.figures.setMinimumWidth(self.figures.fontMetrics().horizontalAdvance("saturated 100.00 %  "))
        self.figures.setAccessibleName("Figures of the region")
        self.over_time = TracePlot("Mean of the region over time", "seconds ago", "The mean over time comes here.")
        self.along = TracePlot("Counts along the line", "pixels along the line", "Counts along a line come here.")
        self.beside = CountBox()
        self.beside.setRange(1, 200)
        self.beside.setSuffix(" px")
        self.beside.setAccessibleName("Width of the line")
        self.beside.setToolTip("The mean of so many lines beside one another")
        self.beside.valueChanged.connect(self._look_again)
        self.distance = QLabel("Click two points with Distance.")
        self.distance.setWordWrap(True)
        self.distance.setAccessibleName("Distance")
        self.display = DisplayBox(self._live)
        line = QHBoxLayout()
        line.addWidget(QLabel("Width of the line"))
        line.addWidget(self.beside)
        line.addStretch(1)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addLayout(FlowLayout((*self.buttons.values(), self.whole, self.clear, self.copy)))
        beside = QHBoxLayout()
        beside.addWidget(self.figures)
        beside.addWidget(self.over_time, 1)
        column.addLayout(beside)
        for widget in (self.along, self.distance):
            column.addWidget(widget)
        column.addLayout(line)
        column.addWidget(self.display)
        column.addStretch(1)

    def take_up(self, tool: str) -> None:
        self.buttons[tool].setChecked(True)

    def take_whole(self) -> None:
        """Measure the whole image."""
        if self._live.view.image is not None:
            self._take(np.ones(self._live.view.image.shape, bool))

    def set_line(self, ends: tuple[Spot, Spot] | None) -> None:
        """Show the counts along this line; None shows none."""
        self._line = ends
        self.tools["profile"].stop()
        self._look_again()

    def set_ends(self, ends: tuple[Spot, Spot] | None) -> None:
        """Measure from one of these spots to the other; None measures nothing."""
        self._ends = ends
        self.tools["distance"].stop()
        self._look_again()

    def forget(self) -> None:
        """Measure nothing any more."""
        self._region = None
        self.set_line(None)
        self.set_ends(None)

    def _take_shape(self, paint: Callable[[PaintedRegion], None]) -> None:
        image = self._live.view.image
        if image is not None:
            painted = PaintedRegion((image.shape[0], image.shape[1]))
            paint(painted)
            self._take(painted.pixels)

    def _take(self, inside: Bools) -> None:
        self._region = MarkedRegion.of(inside)
        self._past.clear()
        for key in ("rectangle", "ellipse", "polygon"):
            self.tools[key].stop()
        self._show_shapes()
        self._look_again()

    def _show_shapes(self) -> None:
        region, source = self._region, self._session.source
        shown = self.isVisible() and source is not None
        self._live.region = region.box if shown and region is not None else None
        if not shown or region is None or source is None:
            self._region_layer.show_region(None, REGION)
        else:
            self._region_layer.show_region(region.within(source.shape), REGION, filled=False)

    # Following the image

    def follow(self, change: Change) -> None:
        if Change.SOURCE not in change:
            return
        old, new = self._source, self._session.source
        self._source = new
        self.display.show_source(new is not None and bool(filters(new.camera.info.pixel_format)))
        if old is None or new is None or not new.shows_the_same(old):
            self.forget()
        self._past.clear()

    def let_go(self) -> None:
        self.follow(Change.SOURCE)

    def kept_state(self) -> Values:
        """What is measured: the region as a picture, the line and the two points as numbers; and the line's width.

        How the image is shown belongs to the window, with this panel or without.
        """
        shown, source = values_of(self.display), self._session.source
        kept = {name: value for name, value in super().kept_state().items() if name not in shown}
        if self._region is not None and source is not None:
            kept["region"] = region_text(self._region.within(source.shape))
        for name, ends in (("line", self._line), ("points", self._ends)):
            if ends is not None:
                kept[name] = numbers_text((*ends[0], *ends[1]))
        return kept

    def set_state(self, values: Values) -> None:
        """Measure what was measured, where the image has that size."""
        super().set_state(values)
        source = self._session.source
        self.forget()
        if source is None:
            return
        region = text_region(values.get("region"), source.shape)
        if region is not None:
            self._take(region)
        for name, take in (("line", self.set_line), ("points", self.set_ends)):
            ends = text_numbers(values.get(name), 4)
            if ends is not None and _inside(ends, source.shape):
                take(((ends[0], ends[1]), (ends[2], ends[3])))

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._show_shapes()
        self._look_again()
        self._timer.start(LOOK_MS)

    def hideEvent(self, event: QHideEvent) -> None:
        self._timer.stop()
        for tool in self.tools.values():
            tool.stop()
        self._show_shapes()
        self._segment_layer.show_segments(())

    def _look_again(self) -> None:
        self._seen = None
        self._look()

    def _look(self) -> None:
        """Measure the frame on show, if it is another; then no sooner again than the share of time allows."""
        frame, source = self._live.frame, self._session.source
        if not self.isVisible() or frame is None or source is None or self._seen is frame:
            return
        start_s = time.perf_counter()
        self._seen = frame
        self._show_region(source, frame)
        self._show_line(source)
        self._show_distance(source, frame)
        wanted_ms = 1000 * (time.perf_counter() - start_s) / SHARE
        self._timer.setInterval(max(LOOK_MS, round(wanted_ms)))

    def _show_region(self, source: Source, frame: Frame) -> None:
        region = self._region
        if region is None:
            self.found = {}
            self.figures.setText("Mark a region to see its counts.")
            self.over_time.show_curves({})
            self._show_shapes()
            return
        if frame.image.shape[0] < region.box[3] or frame.image.shape[1] < region.box[2]:
            return
        self.found = measured(source, frame.image, region, self._live.display.dark_count(source.camera.info))
        rows = figures_rows(self.found)
        self.figures.setText(_as_html(rows))
        self.figures.setToolTip("Counts of the frame on show")
        now_s = time.monotonic()
        if frame.stamp.settled:
            self._past.append((now_s, {key: one.mean for key, one in self.found.items()}))
        while self._past and self._past[0][0] < now_s - KEPT_S:
            self._past.popleft()
        self.over_time.show_curves(self._history(now_s))

    def _history(self, now_s: float) -> dict[str, tuple[Doubles, Doubles]]:
        """The means so far against seconds, now is 0."""
        if not self._past:
            return {}
        x = np.array([at_s - now_s for at_s, _ in self._past])
        keys = [key for key in self._past[-1][1] if all(key in means for _, means in self._past)]
        return {key: (x, np.array([means[key] for _, means in self._past])) for key in keys}

    def _show_line(self, source: Source) -> None:
        pixels = self._live.view.pixels
        if self._line is None or pixels is None:
            self.along.show_curves({})
            return
        values = line_counts(pixels, *self._line, self.beside.value())
        length = float(np.hypot(self._line[1][0] - self._line[0][0], self._line[1][1] - self._line[0][1]))
        x = np.linspace(0.0, length, len(values))
        columns = {"": values} if values.ndim == 1 else dict(zip("RGB", values.T, strict=True))
        self.along.show_curves({key: (x, column) for key, column in columns.items()})

    def _show_distance(self, source: Source, frame: Frame) -> None:
        segments = [] if self._line is None else [Segment(*self._line, LINE)]
        if self._ends is None:
            self.distance.setText("Click two points with Distance.")
        else:
            text = distance_text(source, frame, self._ends)
            self.distance.setText(f"Distance: {text}")
            segments.append(Segment(*self._ends, LENGTH, text.split(" (")[0]))
        self._segment_layer.show_segments(tuple(segments))

    def _copy(self) -> None:
        """Figures, then the curves, as a table for a spreadsheet."""
        lines = ["\t".join(row) for row in figures_rows(self.found)] if self.found else []
        for name, plot in (("seconds ago", self.over_time), ("pixels along the line", self.along)):
            if plot.curves:
                first = next(iter(plot.curves.values()))[0]
                lines += ["", "\t".join((name, *(f"counts {key}".strip() for key in plot.curves)))]
                table = np.stack([first, *(y for _, y in plot.curves.values())], axis=1)
                lines += ["\t".join(f"{value:.6g}" for value in row) for row in table]
        if self._ends is not None:
            lines += ["", self.distance.text()]
        QGuiApplication.clipboard().setText("\n".join(lines))


def _inside(ends: Sequence[float], shape: tuple[int, int]) -> bool:
    """Whether two spots, column and row of one after the other, lie in an image of this height and width."""
    return all(0 <= at <= size for at, size in zip(ends, (*shape[::-1], *shape[::-1]), strict=True))


def _ellipse(x0: int, y0: int, x1: int, y1: int) -> Doubles:
    angle = np.linspace(0.0, 2 * np.pi, _ELLIPSE_CORNERS, endpoint=False)
    x = (x0 + x1) / 2 + (x1 - x0) / 2 * np.cos(angle)
    return np.stack([x, (y0 + y1) / 2 + (y1 - y0) / 2 * np.sin(angle)], axis=1)


def _as_html(rows: list[list[str]]) -> str:
    """Headings down, one column a filter: narrow enough for a panel beside the image."""
    lines = []
    for index, name in enumerate(rows[0]):
        cells = "".join(f"<td align='right'>&nbsp;&nbsp;{row[index]}</td>" for row in rows[1:])
        if index or any(row[0] for row in rows[1:]):
            lines.append(f"<tr><td>{name}</td>{cells}</tr>")
    return f"<table>{''.join(lines)}</table>"
