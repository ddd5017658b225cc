"""Sentences that are not known beforehand, in a label or in the middle of what is painted."""

from __future__ import annotations

from PySide6.QtCore import QRect, Qt
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget

_TALL_PX = 10_000
ONE_LINE = "line"
"""Words that keep room for one line."""


def keep_place(widget: QWidget) -> None:
    """Let a widget keep its room while it is hidden: what stands beside it does not move."""
    policy = widget.sizePolicy()
    policy.setRetainSizeWhenHidden(True)
    widget.setSizePolicy(policy)


class Sentence(QLabel):
    """Text on as many lines as it needs; it never makes the window wider, and the pointer can select it."""

    def __init__(self, text: str = "", parent: QWidget | None = None) -> None:
        super().__init__(text, parent)
        self.setTextFormat(Qt.TextFormat.PlainText)  # a title may look like HTML, and is none
        self.setWordWrap(True)
        policy = QSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        policy.setHeightForWidth(True)  # which Qt itself would set with the next text only
        self.setSizePolicy(policy)
        self.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._longest = ""

    def keep_room_for(self, longest: str) -> None:
        """Be always as high as these words would make it: what stands below does not move with shorter ones."""
        self._longest = longest
        self.setAlignment(Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft)
        self.updateGeometry()

    def heightForWidth(self, width: int) -> int:
        """Of the text, or of the room that is kept."""
        room = QRect(0, 0, width, _TALL_PX)
        kept = self.fontMetrics().boundingRect(room, Qt.TextFlag.TextWordWrap, self._longest).height()
        return max(super().heightForWidth(width), kept if self._longest else 1)


_MARGIN_PX = 8


def write_in_middle(painter: QPainter, text: str, within: QRect, colour: QColor) -> None:
    """Write a sentence on as many lines as it needs."""
    room = within.adjusted(_MARGIN_PX, _MARGIN_PX, -_MARGIN_PX, -_MARGIN_PX)
    painter.setPen(colour)
    painter.drawText(room, Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap, text)
