"""The line at the head of panels that work with acquired light transport: which folder it is, and another one."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QPushButton, QWidget

from slopegate.app.panels.loaded_transport import Transports
from slopegate.app.widgets.elided import ElidedLabel

NOTHING = "No light transport is open: acquire it with Transport, or open a folder"


class TransportBar(QWidget):
    """Says what is open, and opens other folders for all panels."""

    def __init__(self, transports: Transports, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._transports = transports
        self.open, self.said = QPushButton("Open …"), ElidedLabel()
        self.open.setToolTip("Open the folder of light transport that was acquired before")
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.open)
        row.addWidget(self.said, 1)
        self.open.clicked.connect(self._ask)
        transports.said.connect(self.said.set_full_text)
        transports.opened.connect(self._show)
        self._show()

    def _ask(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "The folder of light transport")
        if name:
            self._transports.read(Path(name))

    def _show(self) -> None:
        loaded = self._transports.loaded
        if loaded is None:
            self.said.set_full_text(NOTHING)
            return
        opened = loaded.opened
        many = "1 slice" if len(loaded.slices) == 1 else f"{len(loaded.slices)} slices"
        missing = f", {len(opened.missing)} not yet acquired" if opened.missing else ""
        self.said.set_full_text(f"{opened.folder.path.name}: {many}, {opened.grid} blocks{missing}")
