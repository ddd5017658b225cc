"""The window on the projector's screen. A pixel of a pattern is a pixel of the screen, whatever its scale factor."""

from __future__ import annotations

import queue
import time
from collections.abc import Sequence
from typing import Final

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, QRect, Qt, QThread, Signal
from PySide6.QtGui import QCloseEvent, QGuiApplication, QImage, QKeyEvent, QPainter, QPaintEvent, QRasterWindow, QScreen

from slopegate.app.devices.projector_screens import ScreenFacts, facts
from slopegate.core.rig.arrays import Bytes
from slopegate.drivers.contract.projector import ProjectorError, ProjectorInfo, Showing, check_picture

BLACK, WHITE = -1, -2
DRAW_TIMEOUT_S: Final = 5.0


class ProjectorWindow(QRasterWindow):
    """Shows pictures that were loaded before. Escape hides it.

    Qt draws a picture without a colour space as its numbers are, and this one without interpolation.
    """

    drawn = Signal(int, float)
    """The picture with this number, from `display`, was handed to the screen at this time of the monotonic clock."""
    uncovered = Signal(str)
    """Nothing is shown any more; with a sentence that says why when the user did not ask for it."""

    def __init__(self) -> None:
        super().__init__()
        # first of all, for Qt sends events from here on
        self._covered: QScreen | None = None
        self._facts: ScreenFacts | None = None
        self._images: list[QImage] = []
        self.loads = 0
        """How often `load` was called: tells whether pictures that were loaded are still there."""
        self._index, self._asked, self._painted, self._told = BLACK, 0, 0, 0
        self.setTitle("Slopegate: projector")
        self.setFlags(Qt.WindowType.FramelessWindowHint | Qt.WindowType.WindowStaysOnTopHint)
        self.setCursor(Qt.CursorShape.BlankCursor)
        # as of widgets that are shown without being activated
        self.setProperty("_q_showWithoutActivating", True)
        application = QGuiApplication.instance()
        assert isinstance(application, QGuiApplication)
        application.screenRemoved.connect(self._on_removed)

    @property
    def covers(self) -> ScreenFacts | None:
        """The facts of the screen that is covered now."""
        return self._facts

    @property
    def screen_covered(self) -> QScreen | None:
        """The screen that is covered now."""
        return self._covered

    def load(self, pictures: Sequence[Bytes]) -> None:
        """Keep these pictures, and show black until one is asked for."""
        self._images = [_image(picture) for picture in pictures]
        self._index = BLACK
        self.loads += 1

    def cover(self, screen: QScreen) -> None:
        """Cover this screen."""
        if self._covered is not None:
            self.uncover()
        self._covered, self._facts = screen, facts(screen)
        screen.geometryChanged.connect(self._on_geometry)
        self.setScreen(screen)
        self.setGeometry(screen.geometry())
        # not showFullScreen, which takes the keys away from the control window
        self.setWindowStates(Qt.WindowState.WindowFullScreen)
        self.setVisible(True)

    def uncover(self, why: str = "") -> None:
        """Hide the window."""
        screen, self._covered, self._facts = self._covered, None, None
        if screen is not None:
            screen.geometryChanged.disconnect(self._on_geometry)
            self.hide()
            self.uncovered.emit(why)

    def display(self, index: int) -> int:
        """Show a loaded picture, BLACK or WHITE; returns the number that `drawn` will tell."""
        self._index = index
        self._asked += 1
        self.update()
        return self._asked

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
        colour = Qt.GlobalColor.white if self._index == WHITE else Qt.GlobalColor.black
        painter.fillRect(QRect(0, 0, self.width(), self.height()), colour)
        if self._index >= 0:
            image = self._images[self._index]
            image.setDevicePixelRatio(self.devicePixelRatio())
            painter.drawImage(QPointF(0, 0), image)
        painter.end()
        self._painted = self._asked

    def event(self, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ShortcutOverride:
            event.accept()  # Escape is this window's while it has the keys, not the control window's
            return True
        done = super().event(event)
        # Qt hands over what was painted before it returns from here
        if self._told != self._painted:
            self._told = self._painted
            self.drawn.emit(self._told, time.monotonic())
        return done

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key.Key_Escape:
            self.uncover()

    def closeEvent(self, event: QCloseEvent) -> None:
        self.uncover()

    def _on_removed(self, screen: QScreen) -> None:
        # before Qt moves the window to the screen of the control window
        if screen is self._covered:
            self.uncover(f"{screen.name()} was unplugged: nothing is projected any more.")

    def _on_geometry(self) -> None:
        screen, before = self._covered, self._facts
        if screen is None or before is None:
            return
        now = facts(screen)
        if now.raster != before.raster:
            self.uncover(f"{now.name} changed from {before.raster} to {now.raster} pixels: nothing is projected now.")
        else:
            self._facts = now
            self.setGeometry(screen.geometry())


class ScreenProjector(QObject):
    """A covering window as a `drivers.contract.projector.Projector`, for threads other than the window's."""

    _wished = Signal(int, object)
    _loaded = Signal(object)
    _stopped = Signal()

    def __init__(self, window: ProjectorWindow, settle_frames: int) -> None:
        """Raises ProjectorError when the window covers no screen."""
        super().__init__()
        if window.covers is None:
            raise ProjectorError("No screen is chosen for the projector: show a pattern on it first")
        self._window, self._settle_frames = window, settle_frames
        self._count, self._load = 0, window.loads
        self._info = ProjectorInfo(window.covers.name, window.covers.raster, window.covers.period_us)
        self._waiting: dict[int, queue.SimpleQueue[float | str]] = {}
        self._wished.connect(self._on_wished)
        self._loaded.connect(self._on_loaded)
        self._stopped.connect(window.uncover)
        window.drawn.connect(self._on_drawn)
        window.uncovered.connect(self._on_uncovered)

    @property
    def info(self) -> ProjectorInfo:
        """Fixed facts."""
        return self._info

    def load(self, patterns: Sequence[Bytes]) -> None:
        """Hand them to the window."""
        for number, picture in enumerate(patterns):
            check_picture(picture, self._info.raster, f"Pattern {number}")
        self._count = len(patterns)
        self._loaded.emit(tuple(patterns))

    def show(self, index: int) -> Showing:
        """Have a loaded pattern drawn."""
        if not 0 <= index < self._count:
            raise IndexError(f"pattern {index} was not loaded: there are {self._count}")
        return self._draw(index)

    def black(self) -> Showing:
        """Everything off."""
        return self._draw(BLACK)

    def white(self) -> Showing:
        """Everything on."""
        return self._draw(WHITE)

    def stop(self) -> None:
        """Hide the window."""
        self._stopped.emit()

    def _draw(self, index: int) -> Showing:
        if QThread.currentThread() is self.thread():
            raise RuntimeError("the thread that draws cannot wait for its own drawing")
        reply: queue.SimpleQueue[float | str] = queue.SimpleQueue()
        self._wished.emit(index, reply)
        try:
            drawn = reply.get(timeout=DRAW_TIMEOUT_S)
        except queue.Empty:
            drawn = f"{self._info.name} did not draw a pattern within {DRAW_TIMEOUT_S:g} s"
        if isinstance(drawn, str):
            raise ProjectorError(drawn)
        return Showing(max(index, BLACK), drawn, drawn + self._settle_frames * self._info.period_us * 1e-6)

    def _on_loaded(self, patterns: Sequence[Bytes]) -> None:
        self._window.load(patterns)
        self._load = self._window.loads

    def _on_wished(self, index: int, reply: queue.SimpleQueue[float | str]) -> None:
        if self._window.covers is None:
            reply.put(f"{self._info.name} is not covered any more: nothing can be shown on it")
        elif self._window.loads != self._load:
            reply.put(f"Something else was put on {self._info.name} meanwhile")
        else:
            self._waiting[self._window.display(index)] = reply

    def _on_drawn(self, number: int, time_s: float) -> None:
        for asked in [asked for asked in self._waiting if asked <= number]:
            self._waiting.pop(asked).put(time_s)

    def _on_uncovered(self, why: str) -> None:
        for reply in self._waiting.values():
            reply.put(why or f"The pattern on {self._info.name} was hidden")
        self._waiting.clear()


def _image(picture: Bytes) -> QImage:
    rows = np.ascontiguousarray(picture)
    height, width = rows.shape[:2]
    form = QImage.Format.Format_Grayscale8 if rows.ndim == 2 else QImage.Format.Format_RGB888
    return QImage(rows.data, width, height, rows.strides[0], form).copy()
