"""Menus of the program's own class, so that the theme can outline the boxes of their ticks."""

from __future__ import annotations

from PySide6.QtWidgets import QMenu, QMenuBar, QWidget


class Menu(QMenu):
    """A menu. With the palette of plain ones Qt also paints what choice boxes drop, where the outline is a ground."""

    def __init__(self, title: str, parent: QWidget) -> None:
        super().__init__(title, parent)

    @classmethod
    def below(cls, above: QMenu | QMenuBar, title: str) -> Menu:
        """A new menu at the end of another, or of a menu bar."""
        made = cls(title, above)
        above.addMenu(made)
        return made
