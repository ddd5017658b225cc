"""The list of keys, read from the menus, labels and views themselves."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtGui import QAction, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QAbstractButton,
    QDialog,
    QDialogButtonBox,
    QHeaderView,
    QLabel,
    QLineEdit,
    QMainWindow,
    QMenu,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.widgets.controls import mnemonic
from slopegate.app.widgets.own_keys import HasOwnKeys
from slopegate.app.widgets.wrapping_tree import WrappingTree

_NATIVE = QKeySequence.SequenceFormat.NativeText


@dataclass(frozen=True)
class ListedKey:
    """A key, where it works and what it does."""

    where: str
    keys: str
    does: str


def keys_of(window: QMainWindow) -> list[ListedKey]:
    """Every key that works in this window: of its menus, of what is always on the screen, and of each view."""
    found: list[ListedKey] = []
    for action in window.menuBar().actions():
        menu = action.menu()
        if isinstance(menu, QMenu):
            found += _keys_of_menu(menu, _plain(action.text()))
            if "&" in action.text():
                found.append(ListedKey("Menus", mnemonic(action.text()), f"Open the menu {_plain(action.text())}"))
    for label in window.findChildren(QLabel):
        if label.buddy() is not None and "&" in label.text():
            found.append(ListedKey("Controls", mnemonic(label.text()), label.buddy().toolTip() or _plain(label.text())))
    for button in window.findChildren(QAbstractButton):
        if not button.shortcut().isEmpty():
            does = button.toolTip() or _plain(button.text())
            found.append(ListedKey("Controls", button.shortcut().toString(_NATIVE), does))
    for shortcut in window.findChildren(QShortcut):
        found.append(ListedKey("Controls", shortcut.key().toString(_NATIVE), shortcut.whatsThis()))
    for widget in window.findChildren(QWidget):
        if isinstance(widget, HasOwnKeys):
            where = f"In {widget.accessibleName()}"
            found += [ListedKey(where, one.shown, one.does) for one in widget.own_keys()]
    return list(dict.fromkeys(found))


def _keys_of_menu(menu: QMenu, where: str) -> list[ListedKey]:
    found = []
    for action in menu.actions():
        below = action.menu()
        if isinstance(below, QMenu):
            found += _keys_of_menu(below, where)
        elif not action.shortcut().isEmpty():
            found.append(ListedKey(where, action.shortcut().toString(_NATIVE), _said(action)))
    return found


def _said(action: QAction) -> str:
    text, hint = _plain(action.text()).removesuffix(" ..."), action.statusTip()
    return f"{text}: {hint[0].lower()}{hint[1:]}" if hint else text


def _plain(text: str) -> str:
    return text.replace("&&", "\0").replace("&", "").replace("\0", "&")


class KeysDialog(QDialog):
    """All keys in groups, with a field that finds one."""

    def __init__(self, window: QMainWindow) -> None:
        super().__init__(window)
        self.setWindowTitle("Keys")
        self.wanted = QLineEdit()
        self.wanted.setPlaceholderText("Find a key, or what it does")
        self.wanted.setAccessibleName("Find")
        self.wanted.setClearButtonEnabled(True)
        self.tree = WrappingTree()
        self.tree.setAccessibleName("Keys")
        self.tree.setColumnCount(2)
        self.tree.setHeaderLabels(["Key", "What it does"])
        self.tree.header().setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        groups: dict[str, QTreeWidgetItem] = {}
        for one in keys_of(window):
            if one.where not in groups:
                groups[one.where] = QTreeWidgetItem(self.tree, [one.where])
                groups[one.where].setFirstColumnSpanned(True)
                groups[one.where].setExpanded(True)
            QTreeWidgetItem(groups[one.where], [one.keys, one.does])
        self.groups = list(groups.values())
        self.wanted.textChanged.connect(self._find)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        buttons.rejected.connect(self.reject)
        column = QVBoxLayout(self)
        column.addWidget(self.wanted)
        column.addWidget(self.tree, 1)
        column.addWidget(buttons)
        self.resize(680, 560)

    @classmethod
    def show_of(cls, window: QMainWindow) -> None:
        """Open it beside the window, with the keys that work now."""
        for old in window.findChildren(cls):
            old.close()
            old.deleteLater()
        dialog = cls(window)
        dialog.show()
        dialog.raise_()

    def _find(self, text: str) -> None:
        wanted = text.strip().lower()
        for group in self.groups:
            items = [item for row in range(group.childCount()) if (item := group.child(row)) is not None]
            for item in items:
                item.setHidden(wanted not in f"{item.text(0)} {item.text(1)}".lower())
            group.setHidden(all(item.isHidden() for item in items))
