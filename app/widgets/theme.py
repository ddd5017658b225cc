"""Light and dark: two palettes on Qt's Fusion style, and the colours that plots draw with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication

Theme = Literal["system", "light", "dark"]
THEMES: tuple[Theme, ...] = ("system", "light", "dark")


@dataclass(frozen=True)
class Colours:
    """The colours that plots draw with, as #rrggbb."""

    background: str
    text: str
    muted: str
    grid: str
    camera: str
    projector: str
    slab: str
    surface: str
    warning: str
    error: str
    focus: str
    """Of the ring about what has the focus."""


LIGHT = Colours(
    background="#ffffff",
    text="#1b1f24",
    muted="#545d68",
    grid="#d5d9de",
    camera="#1565c0",
    projector="#c2410c",
    slab="#15803d",
    surface="#6b7280",
    warning="#8a5a00",
    error="#b3261e",
    focus="#0b57d0",
)
DARK = Colours(
    background="#15181c",
    text="#e8eaed",
    muted="#a0a8b2",
    grid="#343a42",
    camera="#64b5f6",
    projector="#fb923c",
    slab="#4ade80",
    surface="#9ca3af",
    warning="#ffc35c",
    error="#ff8a80",
    focus="#8ec5ff",
)

_ROLES = QPalette.ColorRole
_LIGHT_ROLES = {
    _ROLES.Window: "#eff1f3",
    _ROLES.WindowText: "#1b1f24",
    _ROLES.Base: "#ffffff",
    _ROLES.AlternateBase: "#f4f5f7",
    _ROLES.Text: "#1b1f24",
    _ROLES.Button: "#e6e9ec",
    _ROLES.ButtonText: "#1b1f24",
    _ROLES.BrightText: "#b3261e",
    _ROLES.ToolTipBase: "#1b1f24",
    _ROLES.ToolTipText: "#ffffff",
    _ROLES.PlaceholderText: "#5b6470",
    _ROLES.Highlight: "#1565c0",
    _ROLES.HighlightedText: "#ffffff",
    _ROLES.Link: "#1565c0",
    _ROLES.Light: "#ffffff",
    _ROLES.Midlight: "#f4f5f7",
    _ROLES.Mid: "#b8bec5",
    _ROLES.Dark: "#9aa1a9",
    _ROLES.Shadow: "#6b7280",
}
_DARK_ROLES = {
    _ROLES.Window: "#22262b",
    _ROLES.WindowText: "#e8eaed",
    _ROLES.Base: "#15181c",
    _ROLES.AlternateBase: "#1c2025",
    _ROLES.Text: "#e8eaed",
    _ROLES.Button: "#30353c",
    _ROLES.ButtonText: "#e8eaed",
    _ROLES.BrightText: "#ff8a80",
    _ROLES.ToolTipBase: "#e8eaed",
    _ROLES.ToolTipText: "#15181c",
    _ROLES.PlaceholderText: "#969ea8",
    _ROLES.Highlight: "#3276c8",
    _ROLES.HighlightedText: "#ffffff",
    _ROLES.Link: "#64b5f6",
    _ROLES.Light: "#4a515a",
    _ROLES.Midlight: "#3a4048",
    _ROLES.Mid: "#2a2e34",
    _ROLES.Dark: "#121417",
    _ROLES.Shadow: "#000000",
}
_OUTLINED = (
    "Menu",  # not QMenu, whose palette paints what choice boxes drop
    "QAbstractSpinBox",
    "QCheckBox",
    "QComboBox",
    "QLineEdit",
    "QListWidget",
    "QPlainTextEdit",
    "QProgressBar",
    "QPushButton",
    "QSlider",
    "QTreeWidget",
)
_DISABLED = (_ROLES.WindowText, _ROLES.Text, _ROLES.ButtonText)


def is_dark(palette: QPalette) -> bool:
    """Whether this palette is a dark one. Not by its window, which is the outline of some widgets."""
    return palette.color(_ROLES.Base).lightness() < 128


def colours(palette: QPalette) -> Colours:
    """The plot colours that belong to a widget's palette; ask again on QEvent.PaletteChange."""
    return DARK if is_dark(palette) else LIGHT


def wants_dark(app: QApplication, theme: Theme) -> bool:
    """Whether this choice means dark on this desktop now."""
    if theme == "system":
        return app.styleHints().colorScheme() == Qt.ColorScheme.Dark
    return theme == "dark"


def apply(app: QApplication, theme: Theme) -> None:
    """Give the whole application the theme; every widget gets a PaletteChange event."""
    dark = wants_dark(app, theme)
    roles = _DARK_ROLES if dark else _LIGHT_ROLES
    palette = QPalette()
    for role, colour in roles.items():
        palette.setColor(role, QColor(colour))
    faint = QColor("#868e98" if dark else "#767d86")
    for role in _DISABLED:
        palette.setColor(QPalette.ColorGroup.Disabled, role, faint)
    if app.style().name() != "fusion":
        app.setStyle("Fusion")
    app.setPalette(palette)
    # Fusion outlines these with a darker shade of the window, which nobody sees on a dark one
    outline = QColor("#b4bcc6" if dark else "#9aa1a9")
    for kind in _OUTLINED:
        _give(app, palette, kind, _ROLES.Window, outline)
    # what lies beside its last column
    _give(app, palette, "QHeaderView", _ROLES.Window, QColor(roles[_ROLES.Window]))
    # its ring of one smooth pixel needs more
    _give(app, palette, "QRadioButton", _ROLES.Window, QColor("#f4f6f8" if dark else "#8a9199"))
    _give(app, palette, "QToolButton", _ROLES.Button, QColor("#56606c" if dark else "#d3d8de"))


def _give(app: QApplication, palette: QPalette, kind: str, role: QPalette.ColorRole, colour: QColor) -> None:
    """Let all widgets of a class have another colour for one role."""
    own = QPalette(palette)
    own.setColor(role, colour)
    app.setPalette(own, kind)  # type: ignore[arg-type]  # the stub says bytes, the function wants str


def marked_button(palette: QPalette) -> QColor:
    """The button colour with which Fusion, which makes it lighter, shows what is chosen readably."""
    return palette.color(_ROLES.Highlight).darker(125)
