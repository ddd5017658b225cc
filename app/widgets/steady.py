"""Boxes, sliders and tabs that the mouse wheel leaves alone until they have the focus: it is meant for what scrolls."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QComboBox, QSlider, QTabBar, QWidget


def wheel_is_meant(widget: QWidget, event: QWheelEvent) -> bool:
    """Whether the wheel is for this widget. Where it is not, the event goes to what lies around it."""
    if not widget.hasFocus():
        event.ignore()
    return widget.hasFocus()


class ChoiceBox(QComboBox):
    """A list to choose from."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    def wheelEvent(self, event: QWheelEvent) -> None:
        if wheel_is_meant(self, event):
            super().wheelEvent(event)


class ValueSlider(QSlider):
    """A horizontal slider."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    def wheelEvent(self, event: QWheelEvent) -> None:
        if wheel_is_meant(self, event):
            super().wheelEvent(event)


class SteadyTabs(QObject):
    """Keeps the wheel from switching the tabs of a bar that Qt makes itself."""

    def __init__(self, tabs: QTabBar) -> None:
        super().__init__(tabs)
        tabs.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QWheelEvent) and isinstance(watched, QTabBar):
            return not wheel_is_meant(watched, event)
        return False
