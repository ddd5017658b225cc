"""Shows which button is pressed: Fusion only darkens it, which nobody sees on a dark window."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QPalette
from PySide6.QtWidgets import QAbstractButton, QApplication

from slopegate.app.widgets.theme import marked_button


class MarkWhenChecked(QObject):
    """Gives a button the theme's colour of what is chosen while it is checked."""

    def __init__(self, button: QAbstractButton) -> None:
        super().__init__(button)
        self._button = button
        button.toggled.connect(self._tint)
        button.installEventFilter(self)
        self._tint()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Follow the theme."""
        if event.type() == QEvent.Type.PaletteChange:
            self._tint()
        return False

    def _tint(self) -> None:
        button, roles, theme = self._button, QPalette.ColorRole, QApplication.palette()
        if button.isChecked():
            if button.palette().color(roles.Button) != marked_button(theme):
                palette = QPalette()
                palette.setColor(roles.Button, marked_button(theme))
                palette.setColor(roles.ButtonText, theme.color(roles.HighlightedText))
                button.setPalette(palette)
        elif button.testAttribute(Qt.WidgetAttribute.WA_SetPalette):
            button.setPalette(QPalette())
