"""Rows that are high enough for all of their text, whatever width the columns have."""

from __future__ import annotations

from PySide6.QtCore import QRect, Qt
from PySide6.QtWidgets import QTreeWidgetItem
from pytestqt.qtbot import QtBot

from slopegate.app.widgets.wrapping_tree import WrappingTree

REASON = "This needs a package that is not installed, and a very long sentence says which one and how to get it. " * 2


def test_rows_hold_all_lines_of_their_text_however_narrow(qtbot: QtBot) -> None:
    tree = WrappingTree()
    qtbot.addWidget(tree)
    tree.setHeaderLabels(["Device", "State"])
    group = QTreeWidgetItem(tree, ["Cameras"])
    short, long = QTreeWidgetItem(group, ["one", "fine"]), QTreeWidgetItem(group, ["A name of many words", REASON])
    tree.expandAll()
    tree.resize(600, 400)
    with qtbot.waitExposed(tree):
        tree.show()
    tree.fit_columns(0.35)

    def holds_all() -> bool:
        room = QRect(0, 0, tree.columnWidth(1), 10_000)
        needed = tree.fontMetrics().boundingRect(room, Qt.TextFlag.TextWordWrap, REASON).height()
        return tree.visualItemRect(long).height() >= needed

    qtbot.waitUntil(holds_all)
    wide = tree.visualItemRect(long).height()
    assert wide > 2 * tree.visualItemRect(short).height()
    tree.resize(350, 400)
    qtbot.waitUntil(lambda: tree.visualItemRect(long).height() > wide and holds_all())
    tree.close()


def test_no_column_but_the_last_takes_more_than_its_share(qtbot: QtBot) -> None:
    tree = WrappingTree()
    qtbot.addWidget(tree)
    tree.setHeaderLabels(["Device", "State"])
    QTreeWidgetItem(tree, [REASON, "fine"])
    tree.resize(600, 400)
    tree.fit_columns(0.35)
    assert tree.columnWidth(0) <= 0.35 * tree.viewport().width() + 1
