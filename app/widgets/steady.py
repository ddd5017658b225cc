"""Boxes, sliders and tabs that the mouse wheel leaves alone until they have the focus: it is meant for what scrolls."""

from __future__ import annotations

from html import escape

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QHelpEvent, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import (
    QComboBox,
    QSlider,
    QStyle,
    QStyleOptionComboBox,
    QStyleOptionSlider,
    QTabBar,
    QToolTip,
    QWidget,
)


def wheel_is_meant(widget: QWidget, event: QWheelEvent) -> bool:
    """Whether the wheel is for this widget. Where it is not, the event goes to what lies around it."""
    if not widget.hasFocus():
        event.ignore()
    return widget.hasFocus()


def _shift(event: QMouseEvent) -> bool:
    return bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)


class ChoiceBox(QComboBox):
    """A list to choose from."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    def wheelEvent(self, event: QWheelEvent) -> None:
        if wheel_is_meant(self, event):
            super().wheelEvent(event)

    def event(self, event: QEvent) -> bool:
        """The tool tip begins with the choice where the box has no room for all of it."""
        if isinstance(event, QHelpEvent) and event.type() == QEvent.Type.ToolTip and self.cut:
            told = escape(self.toolTip(), quote=False)
            QToolTip.showText(event.globalPos(), f"<b>{escape(self.currentText(), quote=False)}</b><br>{told}", self)
            return True
        return super().event(event)

    @property
    def cut(self) -> bool:
        """Whether there is no room for all of the choice that is shown."""
        option = QStyleOptionComboBox()
        self.initStyleOption(option)
        field = QStyle.SubControl.SC_ComboBoxEditField
        room = self.style().subControlRect(QStyle.ComplexControl.CC_ComboBox, option, field, self).width()
        return self.fontMetrics().horizontalAdvance(self.currentText()) > room


FINE = 1 / 20
"""How fast a slider moves while Shift is held, as a share of its usual speed."""


class ValueSlider(QSlider):
    """A horizontal slider, which is dragged finely while Shift is held."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._fine: tuple[float, float] | None = None
        """Of a drag with Shift: where the mouse was, and the position it stands for, with its fraction."""

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton and _shift(event):
            self._fine = event.position().x(), float(self.value())
            self.setSliderDown(True)
            return
        super().mousePressEvent(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._fine is None and self.isSliderDown() and _shift(event):
            self._fine = event.position().x(), float(self.value())
        if self._fine is None:
            super().mouseMoveEvent(event)
            return
        before, place = self._fine
        now = event.position().x()
        place += (now - before) * self._steps_per_px() * (FINE if _shift(event) else 1.0)
        place = min(max(place, float(self.minimum())), float(self.maximum()))
        self._fine = now, place
        self.setSliderPosition(round(place))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._fine is not None:
            self._fine = None
            self.setSliderDown(False)
        super().mouseReleaseEvent(event)

    def _steps_per_px(self) -> float:
        """Positions that one pixel of the track stands for."""
        option = QStyleOptionSlider()
        self.initStyleOption(option)
        groove, handle = (
            self.style().subControlRect(QStyle.ComplexControl.CC_Slider, option, part, self).width()
            for part in (QStyle.SubControl.SC_SliderGroove, QStyle.SubControl.SC_SliderHandle)
        )
        return (self.maximum() - self.minimum()) / max(groove - handle, 1)

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
