"""The y-z section of rig, scene and slab: the whole geometry in two dimensions, without OpenGL."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pyqtgraph as pg
from pyqtgraph.functions import create_qpolygonf, ndarray_from_qpolygonf
from PySide6.QtCore import QRectF, Qt, Signal
from PySide6.QtGui import QMouseEvent, QPainter, QPainterPath, QPainterPathStroker, QPen, QPolygonF
from PySide6.QtWidgets import QGraphicsPathItem, QLabel, QStyleOptionGraphicsItem, QVBoxLayout, QWidget

from slopegate.app.views.slab_geometry import (
    LEAVING,
    NO_CLOUD,
    NOWHERE,
    CameraBuffers,
    Cloud,
    GatePicture,
    dragged,
    drawn_depths,
    extent,
    gate_picture,
    recorded,
    side_cloud,
)
from slopegate.app.widgets.plot_theme import dress, fill, pen, plot_colours, swatch
from slopegate.core.gating.gate import Slab
from slopegate.core.gating.slab_mesh import Piece, slab_pieces
from slopegate.core.rig.arrays import Doubles
from slopegate.core.rig.rig import Rig, camera_rim, projector_rim
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.core.scene.scene import Scene

_HAIR_US = 1e-3
"""Exposure of the gate whose slab is drawn as the centre line."""
_RIM_PX = 4
"""So far beside the slab it can still be dragged."""


class FitPlot(pg.PlotWidget):  # type: ignore[misc]
    """A plot that asks to show everything: at a double click, and at another size until the user has moved the view."""

    fit_wished = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._moved = False
        box = self.getViewBox()
        box.sigResized.connect(self._on_resized)
        box.sigRangeChangedManually.connect(self._on_moved)
        self.setToolTip("Double click to show everything")

    def fit(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        """Show this much, also at another size."""
        self._moved = False
        self.setRange(xRange=x, yRange=y, padding=0.03)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Ask to show everything."""
        self.fit_wished.emit()
        event.accept()

    def _on_moved(self) -> None:
        self._moved = True

    def _on_resized(self) -> None:
        if not self._moved:
            self.fit_wished.emit()


def polygon(points: Doubles) -> QPolygonF:
    """(N, 2) numbers as Qt's points, without a Python object each."""
    if len(points) == 0:
        return QPolygonF()
    out: QPolygonF = create_qpolygonf(len(points))
    ndarray_from_qpolygonf(out)[:] = points
    return out


class PointsItem(pg.GraphicsObject):  # type: ignore[misc]
    """Dots with a fixed size on the screen; much cheaper to move than pyqtgraph's scatter plot."""

    def __init__(self) -> None:
        super().__init__()
        self.dots = QPolygonF()
        self._pen = QPen()

    def set_points(self, points: Doubles) -> None:
        """Show these (N, 2) points."""
        self.prepareGeometryChange()
        self.dots = polygon(points)
        self.update()

    def set_pen(self, colour: str, size_px: float) -> None:
        """Colour and size of the dots."""
        self.prepareGeometryChange()
        self._pen = pen(colour, size_px)
        self._pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        self.update()

    def viewTransformChanged(self) -> None:
        """Dots keep their size in pixels, so they cover another area."""
        self.prepareGeometryChange()

    def boundingRect(self) -> QRectF:
        """The dots with their size on the screen, or Qt would leave bits of them behind."""
        across, up = self.pixelVectors()
        reach = self._pen.widthF() / 2 + 1
        x, y = (abs(across.x()) * reach, abs(up.y()) * reach) if across is not None else (0.0, 0.0)
        return self.dots.boundingRect().adjusted(-x, -y, x, y) if not self.dots.isEmpty() else QRectF()

    def paint(self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None) -> None:
        """Draw all dots at once."""
        painter.setPen(self._pen)
        painter.drawPoints(self.dots)


def flat(points_m: Doubles) -> Doubles:
    """World points (..., 3) -> section coordinates (..., 2): z to the right, up."""
    return np.stack([points_m[..., 2], -points_m[..., 1]], axis=-1)


def outline(piece: Piece) -> Doubles:
    """A piece of one column as a closed polygon in section coordinates, (2 R, 2)."""
    return flat(np.concatenate([piece.far[:, 0], piece.near[::-1, 0]]))


def distance_marks(found: Slab | None, z_max: float) -> Doubles:
    """Near and far surface on the axis as two ticks and the line between, (N, 2), NaN as a gap; may leave the view."""
    if found is None or found.near_m is None or found.near_m >= z_max:
        return np.empty((0, 2))
    tick, gap = 0.012 * z_max, [np.nan, np.nan]
    far_seen = found.far_m is not None and found.far_m <= z_max
    end = found.far_m if found.far_m is not None and far_seen else LEAVING * z_max
    points = [[found.near_m, -tick], [found.near_m, tick], gap, [found.near_m, 0.0], [end, 0.0]]
    if far_seen:
        points += [gap, [end, -tick], [end, tick]]
    return np.array(points)


class SlabBody(QGraphicsPathItem):
    """The slab as an area that the left mouse button drags and, with Shift, turns."""

    def __init__(self, wish_for: Callable[[Doubles], None]) -> None:
        super().__init__()
        self._wish_for = wish_for
        self._start: Doubles | None = None
        self.wish: Doubles | None = None
        """Tilt, distance and thickness as shown; None where the slab has no finite ones to keep."""
        self.setToolTip("Drag to move the slab, with Shift to turn it")

    def shape(self) -> QPainterPath:
        """The area with a rim of a few pixels of the screen: without it a thin slab would hardly be hit."""
        rim = QPainterPathStroker()
        rim.setWidth(2 * _RIM_PX / max(abs(self.sceneTransform().m11()), 1e-9))
        return self.path().united(rim.createStroke(self.path()))

    def hoverEvent(self, event: Any) -> None:
        """Claim the left button here, so that it does not move the view."""
        if not event.isExit() and self.wish is not None:
            event.acceptDrags(Qt.MouseButton.LeftButton)
            self.setCursor(Qt.CursorShape.SizeHorCursor)

    def mouseDragEvent(self, event: Any) -> None:
        """Ask for the slab that follows the pointer."""
        if event.button() != Qt.MouseButton.LeftButton or (event.isStart() and self.wish is None):
            event.ignore()
            return
        event.accept()
        if event.isStart():
            self._start = self.wish
        if self._start is not None:
            down, now = (np.array([at.x(), at.y()]) for at in (event.buttonDownPos(), event.pos()))
            turning = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
            self._wish_for(dragged(self._start, down, now, turning))


class SectionView(QWidget):
    """Seen from the side: all that the camera sees, the slab cut at x = 0 with its centre line, the fields of view.

    `gate_wished` tells the tilt (degrees), distance and thickness (metres) that a drag on the slab asks for.
    """

    gate_wished = Signal(float, float, float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._rig: Rig | None = None
        self._settings: GateSettings | None = None
        self._left_out: GateSettings | None = None
        self._cloud: Cloud = NO_CLOUD
        self._extent = NOWHERE
        self._colours = plot_colours(False)
        self._legend = QLabel(self)
        self._legend.setWordWrap(True)
        self._legend.setTextFormat(Qt.TextFormat.RichText)
        self.note = QLabel(self)
        self.note.setWordWrap(True)
        self.plot = FitPlot(self)
        self.plot.setMenuEnabled(False)
        self.plot.hideButtons()  # nothing here has bounds that pyqtgraph's own could fit
        self.plot.fit_wished.connect(self.reset_view)
        self.plot.setAspectLocked(True)
        self.plot.setLabel("bottom", "distance z (m)")
        self.plot.setLabel("left", "height (m)")
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self._legend)
        layout.addWidget(self.plot, 1)
        layout.addWidget(self.note)
        self._build()
        self.set_dark(False)

    def _build(self) -> None:
        self.surface, self.lit = PointsItem(), PointsItem()
        self._body, self._hinge_mark = SlabBody(self._wish_for), pg.TextItem("hinge", anchor=(0, 0.5))
        self._middle = pg.PlotCurveItem(connect="finite")
        self._camera_fov, self._projector_fov, self.baseline = (pg.PlotCurveItem() for _ in range(3))
        self.hinge, self.distance = PointsItem(), pg.PlotCurveItem(connect="finite")
        items = (self._camera_fov, self._projector_fov, self.baseline, self._body, self.surface, self.lit)
        for depth, item in enumerate((*items, self._middle, self.distance, self.hinge, self._hinge_mark)):
            item.setZValue(depth)
            self.plot.addItem(item, ignoreBounds=True)

    def set_scene(self, rig: Rig, scene: Scene, buffers: CameraBuffers | None) -> None:
        """Show this rig and scene; the gate stays."""
        self._rig = rig
        self._cloud = NO_CLOUD if buffers is None else side_cloud(rig, buffers)
        self._extent = extent(rig, scene, self._cloud)
        self.surface.set_points(flat(self._cloud.positions))
        self._show_rig(rig)
        self.reset_view()
        if self._settings is not None:
            settings, self._settings = self._settings, None
            self.show_gate(rig, settings)

    def reset_view(self) -> None:
        """Show all that is seen and both centres; of the fields of view what there is room for above and below."""
        box, shown, rig = self.plot.getViewBox(), self._extent, self._rig
        low, high = -shown.y_max, -shown.y_min
        if rig is not None:
            centres = np.stack([rig.camera_centre_m, rig.projector_centre_m])
            heights = flat(np.concatenate([self._cloud.positions, centres]))[:, 1]
            room = (shown.z_max + 0.05) * box.height() / max(box.width(), 1.0)
            spare = max(room - float(np.ptp(heights)), 0.0) / 2
            low, high = max(low, float(heights.min()) - spare), min(high, float(heights.max()) + spare)
        self.plot.fit((-0.05, shown.z_max), (low, high))

    def show_gate(self, rig: Rig, settings: GateSettings, left_out: GateSettings | None = None) -> None:
        """Move what this gate moves; with `left_out`, it is the complement of that gate, which the caption names."""
        if (settings, left_out) == (self._settings, self._left_out) and rig is self._rig:
            return
        self._left_out = left_out
        if rig is not self._rig:
            self._rig = rig
            self._show_rig(rig)
        self._settings = settings
        depths = (self._extent.z_min, self._extent.z_max)
        column = rig.camera.lens.cx
        seen = gate_picture(rig, settings, left_out, depths, column)
        path = QPainterPath()
        for piece in seen.pieces:
            path.addPolygon(polygon(outline(piece)))
            path.closeSubpath()
        path.setFillRule(Qt.FillRule.WindingFill)
        self._body.setPath(path)
        if seen.pieces and not path.intersects(self.plot.viewRect()):
            self.reset_view()
        self.lit.set_points(flat(self._cloud.positions[recorded(rig, settings, self._cloud)]))
        self._show_middle(rig, settings if seen.pieces else None, drawn_depths(seen.slab, depths))
        self._show_read_outs(seen, depths)

    def _show_middle(self, rig: Rig, settings: GateSettings | None, depths: tuple[float, float]) -> None:
        """Draw the line through the middle of this gate's space; none of None."""
        lines = []
        if settings is not None:
            hair = gate(settings.line_time_us, settings.delay_us, _HAIR_US)
            lines = [flat(piece.far[:, 0]) for piece in slab_pieces(rig, hair, *depths, rig.camera.lens.cx)]
        gap = np.full((1, 2), np.nan)
        points = np.concatenate([part for line in lines for part in (line, gap)]) if lines else np.empty((0, 2))
        self._middle.setData(points[:, 0], points[:, 1])

    def _wish_for(self, wish: Doubles) -> None:
        self.gate_wished.emit(*wish.tolist())

    def _show_read_outs(self, seen: GatePicture, depths: tuple[float, float]) -> None:
        found = seen.slab
        finite = found is not None and found.distance_m is not None and found.thickness_m is not None
        self._body.wish = np.array([found.tilt_deg, found.distance_m, found.thickness_m]) if found and finite else None
        marks = distance_marks(seen.named, depths[1])
        self.distance.setData(marks[:, 0], marks[:, 1])
        hinge = None if found is None else found.hinge_y_m
        shown = hinge is not None and self._extent.y_min <= hinge <= self._extent.y_max
        self.hinge.setVisible(shown)
        self._hinge_mark.setVisible(shown)
        if shown and hinge is not None:
            self.hinge.set_points(np.array([[0.0, -hinge]]))
            self._hinge_mark.setPos(0.02 * depths[1], -hinge)
        self.note.setText(seen.caption)
        self.note.setToolTip(seen.why)

    def _show_rig(self, rig: Rig) -> None:
        depth = self._extent.z_max
        for item, centre, rim in (
            (self._camera_fov, rig.camera_centre_m, camera_rim(rig, depth)),
            (self._projector_fov, rig.projector_centre_m, projector_rim(rig, depth)),
        ):
            middle = rim.shape[1] // 2
            ends = flat(np.stack([rim[0, middle], centre, rim[2, middle]]))
            item.setData(ends[:, 0], ends[:, 1])
        self._dress_projector()
        both = flat(np.stack([rig.camera_centre_m, rig.projector_centre_m]))
        self.baseline.setData(both[:, 0], both[:, 1])

    def _dress_projector(self) -> None:
        """Dashed where its field of view covers the camera's: seen from the side, one beside it does."""
        camera, projector = (np.stack(item.getData()) for item in (self._camera_fov, self._projector_fov))
        self._projector_fov.setPen(pen(self._colours.projector, 1.5, dashed=np.allclose(camera, projector, rtol=0.02)))

    def set_dark(self, dark: bool) -> None:
        """Colours for a dark or a light window."""
        self._colours = colours = plot_colours(dark)
        dress(self.plot, colours)
        self.surface.set_pen(colours.surface, 2)
        self.lit.set_pen(colours.slab, 4)
        self._body.setBrush(fill(colours.slab, 60))
        self._body.setPen(pen(colours.slab, 1.5))
        self._middle.setPen(pen(colours.slab, 1.5, dashed=True))
        self._camera_fov.setPen(pen(colours.camera, 1.5))
        self._dress_projector()
        self.baseline.setPen(pen(colours.muted, 3))
        self.distance.setPen(pen(colours.text, 1.5))
        self.hinge.set_pen(colours.warning, 10)
        self._hinge_mark.setColor(colours.text)
        self._legend.setText(
            " &nbsp; ".join(
                (
                    swatch(colours.camera, "&#9473;", "camera"),
                    swatch(colours.projector, "&#9473;", "projector"),
                    swatch(colours.slab, "&#9608;", "slab, cut at x = 0"),
                    swatch(colours.surface, "&#8226;", "all surfaces seen"),
                    swatch(colours.slab, "&#8226;", "recorded"),
                )
            )
        )
        sheet = f"background: {colours.background}; color: {colours.text}; padding: 4px 8px;"
        self._legend.setStyleSheet(sheet)
        self.note.setStyleSheet(sheet)
