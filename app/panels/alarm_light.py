"""What the proximity alarm shows: its state in a colour, and the frame that set it off in small."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage, QPixmap
from PySide6.QtWidgets import QLabel

State = Literal["ALARM", "Armed", "Waiting", "Not armed"]
_PAPER: Final[dict[State, str]] = {
    "ALARM": "#b3261e",
    "Armed": "#15803d",
    "Waiting": "#8a5a00",
    "Not armed": "#6b7280",
}


class AlarmLight(QLabel):
    """The state in large letters."""

    def show_state(self, state: State) -> None:
        """Show this one."""
        self.setText(state)
        self.setStyleSheet(
            f"background: {_PAPER[state]}; color: #ffffff; font-size: 15pt; font-weight: bold; padding: 4px 10px;"
        )


def thumbnail(counts: NDArray[np.uint16], table: NDArray[np.uint8], size_px: tuple[int, int]) -> QPixmap:
    """Counts (H, W) through a table of greys (65536,) as a picture that fits into this width and height."""
    grey = np.ascontiguousarray(table[counts])
    height, width = grey.shape
    picture = QImage(grey.data, width, height, width, QImage.Format.Format_Grayscale8).copy()
    keep, smooth = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
    return QPixmap.fromImage(picture).scaled(*size_px, keep, smooth)
