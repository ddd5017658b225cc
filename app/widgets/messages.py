"""Strips that tell what went wrong and what is being loaded. They lie over the image and move nothing."""

from __future__ import annotations

from typing import Literal

from PySide6.QtCore import QEvent, QObject, Qt, QTimer, Signal, SignalInstance
from PySide6.QtGui import QPalette
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.widgets.sentence import Sentence
from slopegate.app.widgets.theme import colours
from slopegate.core.rig.checks import printable

Kind = Literal["note", "warning", "error"]
NOTE_MS = 8000
_SIGNS = {"note": "\u2713", "warning": "\u26a0", "error": "\u2716"}


class MessageStrip(QFrame):
    """Shows one sentence at a time. Notes go away by themselves, the rest when closed or replaced."""

    log_wished = Signal()
    """The button beside the message of a bug was pressed."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._kind: Kind = "note"
        self._sign = QLabel()
        self._text = Sentence()
        self._show_log = QPushButton("Show log")
        self._show_log.setToolTip("What went wrong in detail, to read or to send to whoever looks into it")
        self._show_log.clicked.connect(self.log_wished)
        self._show_log.hide()
        close = QToolButton()
        close.setText("\u00d7")
        close.setAutoRaise(True)
        close.setToolTip("Close this message (Escape)")
        close.setAccessibleName("Close message")
        close.clicked.connect(self.hide)
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 2, 4, 2)
        row.addWidget(self._sign)
        row.addWidget(self._text, 1)
        row.addWidget(self._show_log)
        row.addWidget(close)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self.hide)
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self.hide()

    @property
    def text(self) -> str:
        """The sentence on show; empty when there is none."""
        return "" if self.isHidden() else self._text.text()

    @property
    def kind(self) -> Kind:
        """What sort of sentence it is."""
        return self._kind

    def say(self, text: str, kind: Kind = "error") -> None:
        """Show this sentence instead of the one before."""
        self._kind = kind
        self._text.setText(printable(text))
        self._sign.setText(_SIGNS[kind])
        self._dress()
        self.show()
        if kind == "note":
            self._timer.start(NOTE_MS)
        else:
            self._timer.stop()

    def say_bug(self, text: str) -> None:
        """Show this sentence of a bug, with a way to the log, which stays until the strip is closed."""
        self._show_log.show()
        self.say(text)

    def follow(self, refused: SignalInstance, edited: SignalInstance) -> None:
        """Show what is refused there, each time until something else is typed."""
        last = ""

        def say(sentence: str) -> None:
            nonlocal last
            last = sentence
            self.say(sentence, "warning")

        refused.connect(say)
        edited.connect(lambda: self.hide() if self.text == last else None)

    def take_back(self, sentence: str) -> None:
        """Show this sentence no longer, if it is the one on show."""
        if self.text == printable(sentence):
            self.hide()

    def setVisible(self, visible: bool) -> None:
        if not visible:
            self._show_log.hide()
        super().setVisible(visible)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()

    def _dress(self) -> None:
        scheme = colours(self.palette())
        tone = {"note": scheme.slab, "warning": scheme.warning, "error": scheme.error}[self._kind]
        palette = self._sign.palette()
        if palette.color(QPalette.ColorRole.WindowText).name() != tone:
            palette.setColor(QPalette.ColorRole.WindowText, tone)
            self._sign.setPalette(palette)


class ProgressStrip(QFrame):
    """What is being loaded, how far it is, and a way out."""

    cancelled = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._text = QLabel()
        self._text.setTextFormat(Qt.TextFormat.PlainText)
        self._text.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.bar = QProgressBar()
        self.bar.setRange(0, 100)
        self.bar.setMaximumWidth(260)
        self.cancel = QPushButton("Cancel")
        self.cancel.setToolTip("Stop loading; what was shown before goes on (Escape)")
        self.cancel.clicked.connect(self.cancelled)
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 2, 4, 2)
        row.addWidget(self._text, 1)
        row.addWidget(self.bar, 1)
        row.addWidget(self.cancel)
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self.hide()

    @property
    def text(self) -> str:
        """What is said to be done; empty when nothing is."""
        return "" if self.isHidden() else self._text.text()

    def say(self, share: float, text: str) -> None:
        """Show how far the work is, 0..1."""
        self._text.setText(printable(text))
        self.bar.setValue(round(100 * share))
        self.show()


class StripsOver(QWidget):
    """Holds strips at the top of a widget, above its picture, so that nothing moves when one comes or goes."""

    def __init__(self, below: QWidget, strips: tuple[QWidget, ...]) -> None:
        super().__init__(below)
        self._below, self._strips = below, strips
        self.setAutoFillBackground(True)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(2)
        for strip in strips:
            column.addWidget(strip)
            strip.installEventFilter(self)
        below.installEventFilter(self)
        self.hide()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Follow the size of what is below, and of the strips on show."""
        kinds = QEvent.Type
        # Placing the strips asks for a layout of what is below: following that, too, would never come to rest.
        telling = (
            (kinds.Resize,) if watched is self._below else (kinds.ShowToParent, kinds.HideToParent, kinds.LayoutRequest)
        )
        if event.type() in telling:
            self._place()
        return False

    def _place(self) -> None:
        shown = [strip for strip in self._strips if not strip.isHidden()]
        column = self.layout()
        if not shown or column is None:
            self.hide()
            return
        width = self._below.width()
        column.invalidate()
        height = column.heightForWidth(width) if column.hasHeightForWidth() else column.sizeHint().height()
        self.setGeometry(0, 0, width, min(height, self._below.height()))
        self.show()
        self.raise_()
