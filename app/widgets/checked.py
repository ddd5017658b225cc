"""Shows which button is pressed: Fusion only darkens it, which nobody sees on a dark window."""

from __future__ import annotations

from PySide6.QtGui import QPalette
from PySide6.QtWidgets import QAbstractButton


def mark_when_checked(button: QAbstractButton) -> None:
    """Give a button the colour of what is chosen while it is checked."""
    button.toggled.connect(lambda on: _tint(button, on))
    _tint(button, button.isChecked())


def _tint(button: QAbstractButton, on: bool) -> None:
    palette, roles = QPalette(), QPalette.ColorRole
    if on:
        palette.setColor(roles.Button, button.palette().color(roles.Highlight))
        palette.setColor(roles.ButtonText, button.palette().color(roles.HighlightedText))
    button.setPalette(palette)
