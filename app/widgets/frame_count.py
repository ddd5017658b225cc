"""A field for how many frames are taken."""

from __future__ import annotations

from PySide6.QtWidgets import QSpinBox, QWidget


class FrameCount(QSpinBox):
    """Says "1 frame" or "2 frames"."""

    def __init__(self, most: int, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setRange(1, most)
        self.setSuffix(" frame")
        self.valueChanged.connect(lambda count: self.setSuffix(" frame" if count == 1 else " frames"))
