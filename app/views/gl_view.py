"""The OpenGL picture of rig, scene and slab; import it only where `opengl_missing` is empty."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pyqtgraph.opengl as gl
from OpenGL.error import Error as DriverError
from pyqtgraph.opengl import shaders
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import (
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QResizeEvent,
    QVector3D,
    QWheelEvent,
)
from PySide6.QtOpenGL import QOpenGLPaintDevice
from PySide6.QtWidgets import QWidget

from slopegate.app.session.log import sentence_of
from slopegate.app.views.gl_items import Label, Translucent, opaque, rgba, set_lines, solid, write_labels
from slopegate.app.views.slab_geometry import (
    NOWHERE,
    Cloud,
    PlotExtent,
    fit_distance,
    floor_lines,
    piece_lines,
    recorded,
    to_plot,
    view_axes,
)
from slopegate.app.widgets.own_keys import OwnKey, act_on
from slopegate.app.widgets.plot_theme import plot_colours
from slopegate.core.gating.slab_mesh import Piece, piece_triangles
from slopegate.core.rig.arrays import Doubles, Singles
from slopegate.core.rig.rig import Rig, camera_rim, camera_view, projector_rim, projector_view
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene

FIELD_OF_VIEW_DEG = 40.0
VIEWS = {"3D": (-52.0, 18.0), "Side": (0.0, 0.0), "Front": (-90.0, 0.0), "Top": (-90.0, 90.0)}
_SLAB_ALPHA = 0.22
_FIRST, _OPAQUE, _LAST = 0, 1, 2
_MARGIN = 1.1
FIRST_TURN_S = 0.003
"""After how long in one turn of the event loop no other item is drawn for the first time."""
_NOWHERE = np.zeros((1, 3))


class GlView(gl.GLViewWidget):  # type: ignore[misc]
    """Orbit with the left button or the arrow keys, move with the middle button, zoom with the wheel or + and -."""

    failed = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.opts["fov"] = FIELD_OF_VIEW_DEG
        self.setAccessibleName("Slab in 3D")
        self._view = "3D"
        self._untouched = True
        self._broken = False
        self._drawn = 0
        """How many items have been drawn in this context. The driver compiles for each that comes first."""
        self._new, self._until_s = False, 0.0
        """Whether the next paint may draw further ones, and until when it does."""
        self._go_on = QTimer(self)
        self._go_on.setSingleShot(True)
        self._go_on.timeout.connect(self._draw_more)
        self._dark = False
        self._rig: Rig | None = None
        self._scene: Scene | None = None
        self._cloud: Cloud | None = None
        self._extent = NOWHERE
        self._gate: tuple[Rig, GateSettings, tuple[Piece, ...], float | None] | None = None
        self._labels: list[Label] = []
        self._hinge_labels: list[Label] = []
        self._make_items()

    def _make_items(self) -> None:
        self.clear()
        line = {"mode": "lines", "glOptions": "opaque", "antialias": True, "pos": np.zeros((2, 3))}
        self._floor, self._frames, self._edges, self._hinge = (gl.GLLinePlotItem(**line) for _ in range(4))
        self._lit, self._points = (gl.GLScatterPlotItem(pos=_NOWHERE, glOptions="opaque") for _ in range(2))
        self._glass = Translucent(glOptions="translucent", computeNormals=False, smooth=True)
        self._solids: list[Any] = []
        # A lit point lies on the plain one: the one drawn first wins at equal depth.
        order = [(self._lit, _FIRST), (self._glass, _LAST)]
        order += [(item, _OPAQUE) for item in (self._floor, self._frames, self._edges, self._hinge, self._points)]
        for item, depth in order:
            item.setDepthValue(depth)
            item.setVisible(False)
            self.addItem(item)

    # What is shown

    def set_scene(self, rig: Rig, scene: Scene, cloud: Cloud, extent: PlotExtent) -> None:
        """Show this rig and scene."""
        new_place = extent != self._extent
        self._rig, self._scene, self._cloud, self._extent = rig, scene, cloud, extent
        self._show_scene()
        if new_place and self._untouched:
            self.set_view(self._view)

    def show_gate(self, rig: Rig, settings: GateSettings, pieces: tuple[Piece, ...], hinge_y_m: float | None) -> None:
        """Show this slab, and which points are in it."""
        self._gate = (rig, settings, pieces, hinge_y_m)
        self._show_slab(pieces)
        self._show_lit(rig, settings)
        self._show_hinge(hinge_y_m)
        self.update()

    def set_dark(self, dark: bool) -> None:
        """Colours for a dark or a light window."""
        self._dark = dark
        self.setBackgroundColor(plot_colours(dark).background)
        self._show_scene()
        if self._gate is not None:
            self.show_gate(*self._gate)

    def _show_scene(self) -> None:
        rig, cloud = self._rig, self._cloud
        if rig is None or cloud is None or self._scene is None:
            return
        colours = plot_colours(self._dark)
        floor, depths, half = floor_lines(rig, self._extent)
        set_lines(self._floor, to_plot(floor).reshape(-1, 3), rgba(colours.grid), 1.0)
        self._show_rig(rig)
        _set_points(self._points, cloud.positions, cloud.colours, 2.5)
        self._labels = [
            Label(to_plot(rig.camera_centre_m), "camera", colours.camera, -0.5, 0.2),
            Label(to_plot(rig.projector_centre_m), "projector", colours.projector, -0.5, -1.2),
        ]
        self._labels += [Label(to_plot([half, self._extent.floor, z]), f"{z:g} m", colours.muted) for z in depths[::-1]]
        self._show_solids(self._scene if not len(cloud.positions) else Scene(""))

    def _show_rig(self, rig: Rig) -> None:
        colours = plot_colours(self._dark)
        parts, tones = [], []
        depth = self._extent.z_max
        for centre, rim, colour in (
            (rig.camera_centre_m, camera_rim(rig, depth), colours.camera),
            (rig.projector_centre_m, projector_rim(rig, depth), colours.projector),
        ):
            around = to_plot(rim.reshape(-1, 3))
            ring = np.stack([around, np.roll(around, -1, axis=0)], axis=1).reshape(-1, 3)
            corners = to_plot(rim[:, 0])
            spokes = np.stack([np.broadcast_to(to_plot(centre), corners.shape), corners], axis=1).reshape(-1, 3)
            parts += [spokes, ring]
            tones += [rgba(colour)] * (len(spokes) + len(ring))
        parts.append(to_plot(np.stack([rig.camera_centre_m, rig.projector_centre_m])))
        tones += [rgba(colours.text)] * 2
        set_lines(self._frames, np.concatenate(parts), np.array(tones), 1.4)

    def _show_solids(self, scene: Scene) -> None:
        """Objects as grey solids, as long as nothing was rendered."""
        for item in self._solids:
            self.removeItem(item)
        self._solids = []
        for thing in scene.objects:
            item = solid(thing)
            item.setDepthValue(_OPAQUE)
            self._solids.append(item)
            self.addItem(item)

    def _show_slab(self, pieces: tuple[Piece, ...]) -> None:
        self._glass.setVisible(bool(pieces))
        self._edges.setVisible(bool(pieces))
        if not pieces:
            return
        colour = rgba(plot_colours(self._dark).slab)
        vertices, faces, lines, start = [], [], [], 0
        for piece in pieces:
            far, near = to_plot(piece.far), to_plot(piece.near)
            vertices += [far.reshape(-1, 3), near.reshape(-1, 3)]
            faces.append(piece_triangles(piece) + start)
            start += far[..., 0].size + near[..., 0].size
            lines.append(piece_lines(far, near))
        data = gl.MeshData(vertexes=np.concatenate(vertices), faces=np.concatenate(faces))
        self._glass.setMeshData(meshdata=data, color=(*colour[:3], _SLAB_ALPHA))
        set_lines(self._edges, np.concatenate(lines), colour, 1.4)

    def _show_lit(self, rig: Rig, settings: GateSettings) -> None:
        cloud = self._cloud
        if cloud is None:
            return
        inside = recorded(rig, settings, cloud)
        tone = np.array(rgba(plot_colours(self._dark).slab)[:3], np.float32)
        _set_points(self._lit, cloud.positions[inside], 0.35 * cloud.colours[inside] + 0.65 * tone, 4.0)

    def _show_hinge(self, hinge_y_m: float | None) -> None:
        shown = self._extent
        in_reach = hinge_y_m is not None and shown.y_min <= hinge_y_m <= shown.y_max
        self._hinge.setVisible(in_reach)
        self._hinge_labels = []
        if in_reach and hinge_y_m is not None:
            colours = plot_colours(self._dark)
            half = 0.25 * (shown.y_max - shown.y_min)
            ends = to_plot([[-half, hinge_y_m, 0.0], [half, hinge_y_m, 0.0]])
            set_lines(self._hinge, ends, rgba(colours.warning), 2.5)
            self._hinge_labels = [Label(ends[1], "hinge", colours.warning)]

    # Where it is seen from

    def set_view(self, name: str) -> None:
        """One of `VIEWS`, from far enough to show everything."""
        self._view, self._untouched = name, True
        azimuth, elevation = VIEWS[name]
        corners = self._corners()
        centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        half_width = float(np.tan(np.radians(self.opts["fov"] / 2)))
        half_height = half_width * max(self.height(), 1) / max(self.width(), 1)
        distance = fit_distance(corners - centre, view_axes(azimuth, elevation), half_width, half_height)
        self.setCameraPosition(QVector3D(*centre), distance * _MARGIN, elevation, azimuth)

    def _corners(self) -> Doubles:
        shown = self._extent
        if self._rig is None:
            return to_plot([[0, shown.y_min, 0], [0, shown.y_max, shown.z_max]])
        views = [view(self._rig, shown.z_max) for view in (camera_view, projector_view)]
        views.append(floor_lines(self._rig, shown)[0].reshape(-1, 3))
        return to_plot(np.concatenate(views))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        if self._untouched:
            self.set_view(self._view)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self._untouched = False
        super().mouseMoveEvent(event)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self.set_view("3D")

    def wheelEvent(self, event: QWheelEvent) -> None:
        self._untouched = False
        super().wheelEvent(event)

    def own_keys(self) -> tuple[OwnKey, ...]:
        """The keys that it understands while it has the focus."""
        key = Qt.Key

        def zoom(factor: float) -> None:
            self._untouched = False
            self.opts["distance"] *= factor
            self.update()

        return (
            OwnKey((key.Key_Home,), "Show everything, as at first", lambda _: self.set_view("3D")),
            OwnKey((key.Key_Plus, key.Key_Equal), "Come nearer", lambda _: zoom(1 / 1.15)),
            OwnKey((key.Key_Minus,), "Go farther away", lambda _: zoom(1.15)),
            OwnKey((key.Key_Left, key.Key_Right, key.Key_Up, key.Key_Down), "Go round it", self._orbit),
        )

    def _orbit(self, pressed: Qt.Key) -> None:
        self._untouched = False
        step = 5.0
        across = {Qt.Key.Key_Left: step, Qt.Key.Key_Right: -step}.get(pressed, 0.0)
        up = {Qt.Key.Key_Up: -step, Qt.Key.Key_Down: step}.get(pressed, 0.0)
        self.orbit(across, up)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if not act_on(event, self.own_keys()):
            event.ignore()

    # Drawing; any failure is told once, so that the owner can show something else

    def initializeGL(self) -> None:
        try:
            # A widget that moves to another window gets a new context: programs and buffers of the old one are gone.
            gl.GLScatterPlotItem._shaderProgram = None
            gl.GLLinePlotItem._shaderProgram = None
            shaders.initShaders()
            self._drawn, self._new = 0, False
            self._make_items()
            super().initializeGL()
            self.set_dark(self._dark)
        except Exception as error:
            self._fail(error)

    def paintGL(self) -> None:
        if self._broken:
            return
        try:
            self._until_s = time.perf_counter() + FIRST_TURN_S if self._new else 0.0
            super().paintGL()
            self._new = False
            if self.complete:
                self._write_labels()
            else:
                self._go_on.start(0)
        except Exception as error:
            self._fail(error)

    def _draw_more(self) -> None:
        self._new = True
        self.update()

    @property
    def complete(self) -> bool:
        """Whether everything has been drawn once: the first picture comes in several turns where it takes long."""
        return self._drawn >= len(self.items)

    def drawItemTree(self, item: Any = None, useItemNames: bool = False) -> None:
        """Paint in order of depth value; unlike the base class let errors out, since a black panel helps nobody."""
        for number, one in enumerate(sorted(self.items, key=lambda each: each.depthValue()), start=1):
            if number > self._drawn:
                if not self._new and time.perf_counter() > self._until_s:
                    return
                self._new = False  # one of them always comes
            if one.visible():
                if self.default_vao.isCreated():
                    self.default_vao.bind()
                one.paint()
            self._drawn = max(self._drawn, number)

    def _fail(self, error: Exception) -> None:
        if self._broken:
            return
        self._broken = True
        if isinstance(error, DriverError | RuntimeError) or type(error) is Exception:  # the last is pyqtgraph's
            text = str(error).strip().splitlines()
            self.failed.emit(text[0] if text else type(error).__name__)
        else:
            self.failed.emit(sentence_of(error, "Drawing in 3D"))

    def _write_labels(self) -> None:
        # A painter on the widget itself would draw nothing into QWidget.grab().
        device = QOpenGLPaintDevice(self.deviceWidth(), self.deviceHeight())
        device.setDevicePixelRatio(self.devicePixelRatioF())
        painter = QPainter(device)
        painter.setFont(self.font())
        matrix = self.currentProjection() * self.currentModelView()
        try:
            labels = [*self._labels, *self._hinge_labels]
            write_labels(painter, matrix, self.rect(), labels, plot_colours(self._dark).background)
        finally:
            painter.end()  # a painter that outlives its device ends the process


def _set_points(item: Any, positions: Doubles, colours: Singles | Doubles, size_px: float) -> None:
    """Show these points of the scene; where there are none, nothing is kept of those before."""
    item.setVisible(len(positions) > 0)
    if not len(positions):
        positions = colours = _NOWHERE
    item.setData(pos=to_plot(positions), color=opaque(colours), size=size_px)
