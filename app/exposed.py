"""Paint what a closed menu uncovers."""

from __future__ import annotations

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QApplication, QWidget

LOOK_MS = 100


class RepaintBehindMenus(QObject):
    """On X11 a window with both a native surface and OpenGL is not told when a menu over it closes: its pixels stay."""

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self._window = window
        self._open = False
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._timer.start(LOOK_MS)

    def _look(self) -> None:
        was_open, self._open = self._open, QApplication.activePopupWidget() is not None
        if was_open and not self._open:
            self._window.update()
