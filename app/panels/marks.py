"""Rectangles that panels ask for on the live image, each with its button and its outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QPushButton

from slopegate.app.panels.panel import Desk
from slopegate.app.panels.panel_state import Box, KeptBox
from slopegate.app.session.session import Change
from slopegate.app.views.draw_tools import RectangleTool
from slopegate.app.views.overlay import RegionLayer
from slopegate.core.rig.arrays import Counts, Doubles


class Mark(KeptBox):
    """One rectangle: pressing its button and dragging over the live image sets it."""

    changed = Signal()
    """Another rectangle, or none."""

    def __init__(self, desk: Desk, text: str, hint: str, colour: str, parent: QObject) -> None:
        super().__init__(parent)
        self._desk, self._colour, self.name = desk, QColor(colour), text
        self._source = desk.session.source
        self.box: Box | None = None
        """Columns x0 .. x1 - 1 of rows y0 .. y1 - 1; None until one is drawn."""
        self.layer, self.tool = RegionLayer(desk.live.view), RectangleTool(desk.live.view)
        self.button = QPushButton(text)
        self.button.setCheckable(True)
        self.button.setToolTip(f"{hint}: drag a rectangle over the live image. Esc ends it.")
        self.button.toggled.connect(lambda on: self.tool.start() if on else self.tool.stop())
        self.tool.ended.connect(lambda: self.button.setChecked(False))
        self.tool.chosen.connect(lambda *box: self.set_box(box))
        desk.session.changed.connect(self._on_changed)

    def set_box(self, box: Box | None) -> None:
        """Mark this rectangle; None marks nothing."""
        self.box = box
        self.button.setChecked(False)
        self.outline(self.button.isVisible())
        self.changed.emit()

    def outline(self, shown: bool) -> None:
        """Draw the rectangle's outline on the image, or not: only what is on the screen draws there."""
        source, box = self._desk.session.source, self.box
        if not shown:
            self.button.setChecked(False)
        if box is None or source is None or not shown:
            self.layer.show_region(None, self._colour)
            return
        self.layer.show_box(box, source.shape, self._colour, filled=False)

    def pixels(self, image: Counts | None) -> Counts | None:
        """The marked part of a frame (h, w), a view; None where nothing is marked or the frame is smaller."""
        if image is None or self.box is None:
            return None
        x0, y0, x1, y1 = self.box
        part = image[y0:y1, x0:x1]
        return part if part.shape == (y1 - y0, x1 - x0) else None

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE not in change:
            return
        old, new = self._source, self._desk.session.source
        self._source = new
        if old is None or new is None or not new.shows_the_same(old):
            self.set_box(None)


def one_at_a_time(marks: Sequence[Mark]) -> None:
    """Taking up one mark's tool puts the others' down."""
    for mark in marks:
        for other in marks:
            if other is not mark:
                mark.button.toggled.connect(lambda on, other=other: other.button.setChecked(False) if on else None)


def light_of(part: Counts | None, black_count: float) -> Doubles | None:
    """Counts above the dark level as float64, for measuring."""
    return None if part is None else part.astype(np.float64) - black_count
