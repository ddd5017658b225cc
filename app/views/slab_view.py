"""The slab in three dimensions, or its section where there is no OpenGL."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QTimer
from PySide6.QtGui import QHideEvent, QShowEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QStackedWidget, QVBoxLayout, QWidget

from slopegate.app.session.log import sentence_of
from slopegate.app.views.opengl import opengl_missing
from slopegate.app.views.section_view import SectionView
from slopegate.app.views.slab_geometry import NO_CLOUD, NOWHERE, CameraBuffers, cloud, extent, gate_picture
from slopegate.app.widgets.plot_theme import plot_colours
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.core.scene.scene import Scene

if TYPE_CHECKING:
    from slopegate.app.views.gl_view import GlView

_FIRST_PICTURE_MS = 1500


class SlabView(QWidget):
    """Slab, scene and rig, orbited by mouse or keys; the section, with a sentence, where OpenGL is missing or fails."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._scene: tuple[Rig, Scene, CameraBuffers | None] | None = None
        self._gate: tuple[Rig, GateSettings] | None = None
        self._left_out: GateSettings | None = None
        self._extent = NOWHERE
        self._dark = False
        self.gl: GlView | None = None
        self.section: SectionView | None = None
        self._checker = QTimer(self)
        self._checker.setSingleShot(True)
        self._checker.timeout.connect(self._check)
        self._stack = QStackedWidget(self)
        self.note = QLabel(self)
        self.note.setWordWrap(True)
        self._buttons = QWidget(self)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self._buttons)
        layout.addWidget(self._stack, 1)
        layout.addWidget(self.note)
        self._start()
        self.set_dark(False)

    def _start(self) -> None:
        reason = opengl_missing()
        if not reason:
            try:
                from slopegate.app.views.gl_view import VIEWS, GlView

                self.gl = GlView(self)
            except (ImportError, AttributeError, OSError) as error:  # PyOpenGL, where libraries are missing
                reason = f"OpenGL could not be loaded ({error})"
            except Exception as error:  # the section shows the same
                reason = sentence_of(error, "The view in 3D")
        if self.gl is None:
            self._fall_back(reason)
            return
        self.gl.failed.connect(self._fall_back)
        self._stack.addWidget(self.gl)
        row = QHBoxLayout(self._buttons)
        row.setContentsMargins(4, 4, 4, 4)
        for name in VIEWS:
            button = QPushButton(name, self._buttons)
            button.setAccessibleName(f"{name} view")
            button.clicked.connect(lambda _=False, view=name: self.set_view(view))
            row.addWidget(button)
        row.addStretch(1)

    @property
    def has_opengl(self) -> bool:
        """Whether the 3D picture is shown."""
        return self.gl is not None

    @property
    def settled(self) -> bool:
        """Whether nothing is left to be drawn for the first time."""
        return self.gl is None or self.gl.complete

    @property
    def views(self) -> tuple[str, ...]:
        """The preset directions; none without OpenGL."""
        return tuple(button.text() for button in self._buttons.findChildren(QPushButton))

    def set_view(self, name: str) -> None:
        """Look from one of the preset directions: 3D, Side, Front, Top."""
        if self.gl is not None:
            self.gl.set_view(name)

    def set_scene(self, rig: Rig, scene: Scene, buffers: CameraBuffers | None) -> None:
        """Show this rig and scene; the gate stays."""
        self._scene = (rig, scene, buffers)
        if self.section is not None:
            self.section.set_scene(rig, scene, buffers)
        if self.gl is not None:
            points = NO_CLOUD if buffers is None else cloud(rig, buffers)
            self._extent = extent(rig, scene, points)
            self.gl.set_scene(rig, scene, points, self._extent)
            if self._gate is not None:
                self._show(rig, self._gate[1])

    def show_gate(self, rig: Rig, settings: GateSettings, left_out: GateSettings | None = None) -> None:
        """Move what this gate moves; with `left_out`, it is the complement of that gate, which the caption names."""
        same = self._left_out == left_out and self._gate is not None and self._gate[0] is rig
        self._left_out = left_out
        if not same or self._gate != (rig, settings):
            self._show(rig, settings)

    def _show(self, rig: Rig, settings: GateSettings) -> None:
        self._gate = (rig, settings)
        if self.section is not None:
            self.section.show_gate(rig, settings, self._left_out)
        if self.gl is not None:
            depths = (self._extent.z_min, self._extent.z_max)
            seen = gate_picture(rig, settings, self._left_out, depths)
            self.gl.show_gate(rig, settings, seen.pieces, None if seen.slab is None else seen.slab.hinge_y_m)
            self.note.setText(seen.caption)
            self.note.setToolTip(seen.why)

    def set_dark(self, dark: bool) -> None:
        """Colours for a dark or a light window."""
        self._dark = dark
        colours = plot_colours(dark)
        self.note.setStyleSheet(f"background: {colours.background}; color: {colours.text}; padding: 4px 8px;")
        for view in (self.gl, self.section):
            if view is not None:
                view.set_dark(dark)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._checker.start(_FIRST_PICTURE_MS)

    def hideEvent(self, event: QHideEvent) -> None:
        self._checker.stop()

    def _check(self) -> None:
        """A context that Qt could not make for the window leaves the widget invalid without a word."""
        if self.gl is not None and self.gl.isVisible() and not self.gl.isValid():
            self._fall_back("no OpenGL context could be created for the window")

    def _fall_back(self, reason: str) -> None:
        if self.gl is not None:
            self._stack.removeWidget(self.gl)
            self.gl.deleteLater()
            self.gl = None
        self._buttons.hide()
        self.section = SectionView(self)
        self._stack.addWidget(self.section)
        self.note.setText(f"No 3D picture: {reason}. The section shows the same geometry.")
        self.set_dark(self._dark)
        if self._scene is not None:
            self.section.set_scene(*self._scene)
        if self._gate is not None:
            self.section.show_gate(*self._gate, self._left_out)
