"""The table of a rig's numbers with their errors, beside those in use or the true ones of a practice rig."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QSizePolicy, QTreeWidgetItem

from slopegate.app.widgets.theme import colours
from slopegate.app.widgets.wrapping_tree import WrappingTree
from slopegate.core.calibration.applied import differences
from slopegate.core.rig.calibration import NUMBERS, TIMING
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.uncertainty import numbers_of

FAR_SIGMAS: Final = 3.0
"""Standard errors by which a number differs more than chance tells."""
TableRow = tuple[Sequence[str], bool]
"""Texts, and whether they are to be heeded."""
_HEEDED: Final = Qt.ItemDataRole.UserRole
_AXES: Final = {"x": "right", "y": "down", "z": "forward"}
_TIMING_WORDS: Final = dict(
    zip(TIMING, ("period, \u00b5s", "active fraction", "clocks per line", "delay offset, \u00b5s"), strict=True)
)


def spelled(name: str) -> str:
    """A number's name in words."""
    if name in _TIMING_WORDS:
        return _TIMING_WORDS[name]
    if name.startswith("rotation"):
        return f"projector turned about {name[9]}, rad"
    if name.startswith("offset"):
        return f"projector's place, {_AXES[name[7]]}, m"
    lens, _, short = name.partition(".")
    return f"{lens} {short}{', px' if short in {'fx', 'fy', 'cx', 'cy'} else ''}"


class NumbersTable(WrappingTree):
    """Rows of figures."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setAccessibleName(name)
        self.setRootIsDecorated(False)
        self.setAlternatingRowColors(True)
        self.setMinimumHeight(96)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Ignored)
        self.setHeaderHidden(True)

    def show_rows(self, head: Sequence[str], rows: Sequence[TableRow], figures: bool = True) -> None:
        """Show these; `figures` stand to the right. A row of one text has the whole width to itself."""
        self.clear()
        self.setColumnCount(len(head))
        self.setHeaderHidden(not any(head))
        self.setHeaderLabels(list(head))
        for texts, heeded in rows:
            item = QTreeWidgetItem(self, list(texts))
            item.setFirstColumnSpanned(len(texts) == 1)
            for column in range(1, len(texts)):
                if figures:
                    item.setTextAlignment(column, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                else:
                    item.setToolTip(column, texts[column])  # one long word has no place where it could be wrapped
            item.setData(0, _HEEDED, heeded)
        self._colour()
        self.header().setStretchLastSection(not figures)
        self.fit_columns(0.35 if figures else 0.5)
        if figures:
            self.resizeColumnToContents(len(head) - 1)

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange:
            self._colour()

    def _colour(self) -> None:
        """Rows to be heeded in the theme's colour: their figures, or the one text that they have."""
        loud = QColor(colours(self.palette()).error)
        for row in range(self.topLevelItemCount()):
            item = self.topLevelItem(row)
            if item is not None and item.data(0, _HEEDED):
                for column in range(0 if item.isFirstColumnSpanned() else 1, self.columnCount()):
                    item.setForeground(column, loud)

    def show_numbers(self, old: Rig, rig: Rig, truth: Rig | None, names: Sequence[str]) -> None:
        """The numbers of these names that a calibration told."""
        errors = {} if rig.calibration is None else rig.calibration.standard_errors
        now, before = numbers_of(rig), {one.name: one for one in differences(old, rig)}
        true = None if truth is None else numbers_of(truth)
        rows: list[TableRow] = []
        for name in (name for name in names if name in errors):
            place, error = NUMBERS.index(name), errors[name]
            value = float(now[place])
            beside = before[name].old if true is None else float(true[place])
            gap = value - beside
            if name == "delay_offset_us":  # a whole period later is the same
                gap = math.remainder(gap, rig.projector.period_us)
            sigmas = before[name].sigmas if true is None else abs(gap) / max(error, 1e-300)
            digits = max(0, min(6, 1 - math.floor(math.log10(error)))) if error > 0 else 4
            figures = (f"{value:.{digits}f}", f"{error:.2g}", f"{beside:.{digits}f}", f"{sigmas:.1f} \u03c3")
            rows.append(((spelled(name), *figures), true is not None and sigmas > FAR_SIGMAS))
        beside_words = ("before", "apart") if true is None else ("true", "off by")
        self.show_rows(("", "value", "\u00b1", *beside_words), rows)
