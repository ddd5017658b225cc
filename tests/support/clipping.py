"""What of a window cannot be read or reached: cut texts, controls outside of what holds them, plots without a size."""

from __future__ import annotations

import re
from collections.abc import Iterator

from PySide6.QtCore import QPoint, QRect, Qt
from PySide6.QtGui import QTextDocument
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QAbstractSpinBox,
    QApplication,
    QBoxLayout,
    QCheckBox,
    QComboBox,
    QDockWidget,
    QGridLayout,
    QGroupBox,
    QLabel,
    QLineEdit,
    QProgressBar,
    QRadioButton,
    QScrollBar,
    QSlider,
    QTabBar,
    QWidget,
)

from slopegate.app.widgets.elided import ElidedLabel
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.steady import ChoiceBox

_MARK_PX = 22
"""Width of the square of a check box with the gap behind it."""
_RICH = re.compile(r"<[a-z]+[^>]*>")
LEAST_PX = 24
"""Least width and height of a picture or plot that anything can be seen in."""


def clipped(root: QWidget) -> list[str]:
    """One sentence for each fault of what is visible in this widget."""
    found = []
    for widget in (root, *root.findChildren(QWidget)):
        if widget.isVisible() and not _of_qt(widget):
            found += [f"{_name(widget)} {fault}" for fault in _faults(widget)]
    return found


def _faults(widget: QWidget) -> Iterator[str]:
    need, size = widget.minimumSizeHint(), widget.size()
    if widget.width() <= 0 or widget.height() <= 0:
        yield f"has no size: {size.width()} x {size.height()}"
    elif isinstance(widget, QLabel):
        yield from _of_label(widget)
    elif isinstance(widget, QAbstractButton):
        icon = 0 if widget.icon().isNull() else widget.iconSize().width()
        room = widget.width() - icon - (_MARK_PX if widget.isCheckable() and not _flat(widget) else 6)
        yield from _of_text(widget.text(), widget, room)
        if need.height() > size.height() + 1:
            yield f"needs to be {need.height()} px high and has {size.height()}"
    elif isinstance(widget, QComboBox):
        yield from _of_choice(widget)
    elif isinstance(widget, QAbstractSpinBox):
        edit = widget.findChild(QLineEdit)
        if edit is not None:
            yield from _of_text(widget.text(), edit, edit.contentsRect().width() - 2 * _text_margin(edit))
    elif isinstance(widget, QGroupBox):
        yield from _of_text(widget.title(), widget, widget.width() - 8)
    elif isinstance(widget, QSlider | QProgressBar):
        if max(size.width(), size.height()) < 40:
            yield f"is too short: {size.width()} x {size.height()}"
    elif min(size.width(), size.height()) < LEAST_PX and hasattr(widget, "paintGL"):
        yield f"shows nothing: {size.width()} x {size.height()}"
    yield from _outside(widget)
    yield from _over(widget)


def _of_label(label: QLabel) -> Iterator[str]:
    text, room = label.text(), label.contentsRect()
    if not text or not label.pixmap().isNull() or isinstance(label, ElidedLabel):
        return
    if label.wordWrap():
        needed = label.heightForWidth(label.width())
        if needed > label.height() + 1:
            yield f"is cut: {label.height()} px high, and its text of this width {needed}"
        longest = max(re.split(r"\s+", _plain(text)), key=len)
        yield from _of_text(longest, label, room.width())
        return
    if _RICH.search(text):
        document = QTextDocument()
        document.setDefaultFont(label.font())
        document.setDocumentMargin(0)
        document.setHtml(text)
        if document.idealWidth() > room.width() + 2:
            yield f"is cut: {room.width()} px wide, and its text {document.idealWidth():.0f}"
        return
    for line in text.split("\n"):
        yield from _of_text(line, label, room.width())
    if label.fontMetrics().height() * (text.count("\n") + 1) > room.height() + 2:
        yield f"is cut: {room.height()} px high"


def _of_choice(box: QComboBox) -> Iterator[str]:
    # a box of this program says in its tool tip what it has no room for
    if not isinstance(box, ChoiceBox):
        yield from _of_text(box.currentText(), box, box.width() - 24)


def _of_text(text: str, widget: QWidget, room: int) -> Iterator[str]:
    plain = text.replace("&&", "\0").replace("&", "").replace("\0", "&")
    needed = widget.fontMetrics().horizontalAdvance(plain)
    if needed > room + 1:
        yield f"is cut: {room} px wide, and {plain!r} {needed}"


def _flat(button: QAbstractButton) -> bool:
    """Whether its mark, if it is checked, takes no room beside its text."""
    return not isinstance(button, QCheckBox | QRadioButton)


def _text_margin(edit: QLineEdit) -> int:
    return 2 + edit.textMargins().left()


def _outside(widget: QWidget) -> Iterator[str]:
    holder = widget.parentWidget()
    if holder is None or widget.isWindow():
        return
    room = holder.rect()
    place = widget.geometry()
    if _scrolled(widget) or room.contains(place.adjusted(1, 1, -1, -1)):
        return
    yield f"at {_text(place)} is not inside of {_name(holder)} {_text(room)}"


def _over(widget: QWidget) -> Iterator[str]:
    """Whether it lies over another one of the same layout."""
    layout = widget.layout()
    if not isinstance(layout, QBoxLayout | QGridLayout | FlowLayout):
        return
    inside = widget.findChildren(QWidget, options=Qt.FindChildOption.FindDirectChildrenOnly)
    shown = [one for one in inside if one.isVisible() and layout.indexOf(one) >= 0]
    for number, one in enumerate(shown):
        for other in shown[number + 1 :]:
            both = one.geometry().adjusted(1, 1, -1, -1) & other.geometry().adjusted(1, 1, -1, -1)
            if both.width() > 1 and both.height() > 1:
                yield f"has {_name(one)} over {_name(other)}"


def _scrolled(widget: QWidget) -> bool:
    """Whether it, or what holds it, is what a scroll area moves."""
    holder = widget.parentWidget()
    area = None if holder is None else holder.parentWidget()
    return isinstance(area, QAbstractScrollArea) and area.viewport() is holder


def _of_qt(widget: QWidget) -> bool:
    """What Qt itself arranges: bars of scroll areas, the insides of boxes, docks behind a tab."""
    own = isinstance(widget, QScrollBar | QTabBar) or widget.objectName().startswith("qt_")
    own = own or isinstance(widget.parent(), QTabBar)
    return own or (isinstance(widget, QLineEdit) and isinstance(widget.parent(), QAbstractSpinBox)) or _behind(widget)


def _behind(widget: QWidget) -> bool:
    """Whether it is in a dock behind another's tab, which Qt moves out of the window and calls visible."""
    at: QWidget | None = widget
    while at is not None:
        if isinstance(at, QDockWidget) and not at.isFloating():
            place = at.geometry()
            return place.right() < 0 or place.bottom() < 0
        at = at.parentWidget()
    return False


def beyond_screen(root: QWidget) -> list[str]:
    """The texts of tab bars that have neither room nor arrows."""
    found = []
    for bar in root.findChildren(QTabBar):
        if bar.isVisible() and bar.count() and not _behind(bar):
            end = max(bar.tabRect(index).right() for index in range(bar.count()))
            if end > bar.width() and not bar.usesScrollButtons():
                found.append(f"tabs end at {end} of {bar.width()} px")
    return found


def settle() -> None:
    """Let layouts and what they ask for come to rest."""
    for _ in range(5):
        QApplication.sendPostedEvents()
        QApplication.processEvents()


def _plain(text: str) -> str:
    if not _RICH.search(text):
        return text
    document = QTextDocument()
    document.setHtml(text)
    return document.toPlainText()


def _text(place: QRect) -> str:
    return f"({place.x()}, {place.y()}, {place.width()} x {place.height()})"


def _name(widget: QWidget) -> str:
    said = ""
    for name in ("text", "title", "accessibleName"):
        read = getattr(widget, name, None)
        if not said and callable(read):
            said = str(read())
    where, at = [], widget.parentWidget()
    while at is not None:
        if isinstance(at, QDockWidget):
            where.append(f"in {at.windowTitle()}")
        at = at.parentWidget()
    corner = widget.mapTo(widget.window(), QPoint(0, 0))
    return " ".join([type(widget).__name__, repr(said[:40]), *where, f"at {corner.x()},{corner.y()}"])
