"""Says what in a window has no room: what lies outside, and what is cut off."""

from __future__ import annotations

from collections.abc import Iterator

from PySide6.QtCore import QPoint, QRect
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QAbstractSpinBox,
    QComboBox,
    QLabel,
    QProgressBar,
    QSlider,
    QTabBar,
    QWidget,
)

from slopegate.app.widgets.elided import ElidedLabel
from slopegate.app.window.docks import PanelDock
from slopegate.app.window.window import Window

CONTROLS = (QAbstractButton, QAbstractSpinBox, QComboBox, QProgressBar, QSlider)


def complaints(window: Window) -> list[str]:
    """Every visible widget that lies outside of what holds it, is smaller than it must be, or cuts its text off."""
    found = [f"the window {area(window)} leaves its screen" for _ in range(not on_screen(window))]
    for widget in window.findChildren(QWidget):
        if not widget.isVisible() or widget.isWindow() or behind(widget) or of_qt(widget):
            continue
        text = widget.text() if isinstance(widget, QAbstractButton | QLabel) else ""
        name = f"{type(widget).__name__} {text!r} {area(widget)}"
        holder = widget.parentWidget()
        if not reachable(widget, holder):
            found.append(f"{name} leaves {type(holder).__name__} {area(holder)}")
        if isinstance(widget, CONTROLS):
            least = widget.minimumSizeHint()
            if widget.width() < min(least.width(), widget.maximumWidth()) or widget.height() < least.height() - 1:
                found.append(f"{name} is smaller than {least.toTuple()}")
        if isinstance(widget, QLabel) and widget.text() and not isinstance(widget, ElidedLabel):
            found += cut_off(widget, name)
    return found


def cut_off(label: QLabel, name: str) -> Iterator[str]:
    if label.wordWrap():
        if label.height() < label.heightForWidth(label.width()) - 1:
            yield f"{name} needs a height of {label.heightForWidth(label.width())}"
    elif label.pixmap().isNull():
        metrics = label.fontMetrics()
        if label.width() < metrics.horizontalAdvance(label.text().replace("&", "")) - 1:
            yield f"{name} is cut off"
        if label.height() < metrics.height() - 2:
            yield f"{name} is cut off below"


def reachable(widget: QWidget, holder: QWidget) -> bool:
    """Whether it lies within its holder, or can be scrolled into it."""
    area_of = holder.parentWidget()
    if isinstance(area_of, QAbstractScrollArea) and area_of.viewport() is holder:
        right, down = area_of.horizontalScrollBar(), area_of.verticalScrollBar()
        wide = widget.width() <= holder.width() or right.maximum() > 0
        high = widget.height() <= holder.height() or down.maximum() > 0
        return wide and high
    return holder.rect().contains(widget.geometry())


def behind(widget: QWidget) -> bool:
    """Whether it is in a dock that another tab covers."""
    above: QWidget | None = widget
    while above is not None and not isinstance(above, PanelDock):
        above = above.parentWidget()
    return above is not None and not above.front


def of_qt(widget: QWidget) -> bool:
    """Whether it is a tab bar that Qt keeps out of sight for later, or an arrow or other part of a tab bar."""
    parked = isinstance(widget, QTabBar) and widget.geometry().right() < 0
    return parked or isinstance(widget.parentWidget(), QTabBar)


def on_screen(window: QWidget) -> bool:
    return window.screen().availableGeometry().contains(window.frameGeometry())


def area(widget: QWidget) -> tuple[int, ...]:
    corner = widget.mapToGlobal(QPoint(0, 0))
    return QRect(corner, widget.size()).getRect()
