"""Keeps windows on the screens that there are."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QRect, QSize
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QWidget

TITLE_PX = 32
"""Height allowed for a window's title bar before the window manager has drawn one."""


def held(place: QRect, areas: Sequence[QRect]) -> QRect:
    """The place moved, and made smaller where it must be, into the area that it covers most; else into the first."""

    def covered(area: QRect) -> int:
        both = area.intersected(place)
        return both.width() * both.height()

    area = max(areas, key=covered)
    size = place.size().boundedTo(area.size())
    left = min(max(place.left(), area.left()), area.left() + area.width() - size.width())
    top = min(max(place.top(), area.top()), area.top() + area.height() - size.height())
    return QRect(left, top, size.width(), size.height())


def bring_onto_a_screen(window: QWidget) -> None:
    """Move a window, its title bar included, to where it can be seen and reached."""
    if not window.isMaximized() and not window.isFullScreen():
        window.setGeometry(held(window.geometry(), _areas()))


def first_size(wanted: QSize) -> QSize:
    """The size of a window at its very first start: as wanted, or what the screen has room for."""
    return wanted.boundedTo(_areas()[0].size())


def _areas() -> list[QRect]:
    """What is free for the contents of windows on each screen, the primary screen first."""
    return [screen.availableGeometry().adjusted(0, TITLE_PX, 0, 0) for screen in QGuiApplication.screens()]
