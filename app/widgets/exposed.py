"""Repaints what a menu or dialog uncovers when it is closed or moved, and what moves onto the screen."""

from __future__ import annotations

from PySide6.QtCore import QObject, QRect, QTimer
from PySide6.QtWidgets import QApplication, QWidget

LOOK_MS = 100


class RepaintUncovered(QObject):
    """On X11 a window with both a native surface and OpenGL is not told what is uncovered: the old pixels stay.

    Windows of other programs are not known here; desktops that compose their windows need none of this.
    """

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self._window = window
        self._above: list[QRect] = []
        """Where the window is, and all that is over it."""
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._timer.start(LOOK_MS)

    def _look(self) -> None:
        others = (other for other in QApplication.topLevelWidgets() if other is not self._window)
        above = [self._window.geometry(), *(other.frameGeometry() for other in others if other.isVisible())]
        before, self._above = self._above, above
        if any(place not in above for place in before):
            self._window.update()
