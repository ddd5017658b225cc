"""The slab in three dimensions, or its section where there is no OpenGL."""

from __future__ import annotations

from PySide6.QtWidgets import QVBoxLayout, QWidget
from slopegate.app.section_view import SectionView
from slopegate.app.slab_geometry import CameraBuffers
from slopegate.core.rig import Rig
from slopegate.core.scene import Scene
from slopegate.core.settings import GateSettings


class SlabView(QWidget):
    """Slab, scene and rig; never an empty panel."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._section = SectionView(self)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._section)

    @property
    def has_opengl(self) -> bool:
        """Whether the 3D picture is shown."""
        return False

    def set_scene(self, rig: Rig, scene: Scene, buffers: CameraBuffers | None) -> None:
        """Show this rig and scene; the gate stays."""
        self._section.set_scene(rig, scene, buffers)

    def show_gate(self, rig: Rig, settings: GateSettings) -> None:
        """Move what this gate moves."""
        self._section.show_gate(rig, settings)

    def set_dark(self, dark: bool) -> None:
        """Colours for a dark or a light window."""
        self._section.set_dark(dark)
