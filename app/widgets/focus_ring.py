"""A ring about whatever has the focus: the style's own marks are faint, and many widgets have none."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QRect, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QApplication, QMenu, QMenuBar, QSplitter, QWidget
from shiboken6 import isValid

from slopegate.app.widgets.theme import colours

_OUT_PX = 2


class _Ring(QWidget):
    """Lies over the focused widget and lets everything through."""

    def __init__(self, holder: QWidget) -> None:
        super().__init__(holder)
        self.holder = holder
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setAttribute(Qt.WidgetAttribute.WA_NoSystemBackground)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        scheme = colours(self.palette())
        # two tones, of which one is seen on whatever lies below
        for inset, colour in ((0, scheme.focus), (1, scheme.focus), (2, scheme.background)):
            painter.setPen(QPen(QColor(colour), 1))
            painter.drawRect(self.rect().adjusted(inset, inset, -inset - 1, -inset - 1))


class FocusRing(QObject):
    """Follows the focus through all windows of the application."""

    def __init__(self, application: QApplication) -> None:
        super().__init__(application)
        self._about: QWidget | None = None
        self._ring: _Ring | None = None
        application.focusChanged.connect(self._on_focus)

    @classmethod
    def on(cls, application: QApplication) -> None:
        """Show it in this application, if it does not yet."""
        if application.findChild(cls) is None:
            cls(application)

    def _on_focus(self, old: QWidget | None, new: QWidget | None) -> None:
        self._remove()
        if new is None or new.isWindow() or isinstance(new, QMenu | QMenuBar):
            return
        self._about, holder = new, _holder(new)
        self._ring = _Ring(holder)
        new.installEventFilter(self)
        self._place()

    def _remove(self) -> None:
        if self._about is not None and isValid(self._about):
            self._about.removeEventFilter(self)
        if self._ring is not None and isValid(self._ring):
            self._ring.hide()
            self._ring.deleteLater()
        self._about = self._ring = None

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Go where the widget goes."""
        kinds = QEvent.Type
        if event.type() in (kinds.Move, kinds.Resize, kinds.Show, kinds.Hide, kinds.ParentChange):
            self._place()
        return False

    def _place(self) -> None:
        about, ring = self._about, self._ring
        if about is None or ring is None or not isValid(ring):
            return
        holder = ring.holder
        if holder is about:
            place = about.rect()
        elif holder.isAncestorOf(about):
            place = QRect(about.mapTo(holder, about.rect().topLeft()), about.size())
            place = place.adjusted(-_OUT_PX, -_OUT_PX, _OUT_PX, _OUT_PX).intersected(holder.rect())
        else:  # it has moved to another window
            ring.hide()
            return
        ring.setGeometry(place)
        ring.setVisible(about.isVisible())
        ring.raise_()


def _holder(widget: QWidget) -> QWidget:
    """What the ring lies in: beside the widget, or within it where it has a surface of its own that covers others."""
    if widget.testAttribute(Qt.WidgetAttribute.WA_NativeWindow) or widget.inherits("QOpenGLWidget"):
        return widget
    holder = widget.parentWidget()
    while isinstance(holder, QSplitter):  # it would take the ring for one of its parts
        holder = holder.parentWidget()
    return holder or widget
