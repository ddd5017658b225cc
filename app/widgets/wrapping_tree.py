"""A tree whose rows are as high as their wrapped text needs."""

from __future__ import annotations

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QRect, QSize, Qt
from PySide6.QtWidgets import QStyle, QStyledItemDelegate, QStyleOptionViewItem, QTreeWidget, QWidget

_TALL_PX = 100_000


class WrappingTree(QTreeWidget):
    """Nothing in it ends in dots: where a column is too narrow, its text goes on in another line."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWordWrap(True)
        self.setItemDelegate(_WrappedText(self))
        # Qt keeps the heights of rows when columns get another width
        self.header().sectionResized.connect(self._on_resized)

    def _on_resized(self) -> None:
        self.scheduleDelayedItemsLayout()

    def fit_columns(self, share: float) -> None:
        """Make all columns but the last as wide as their text, but none wider than this share of the tree."""
        for column in range(self.columnCount() - 1):
            self.resizeColumnToContents(column)
            most = round(share * self.viewport().width())
            self.setColumnWidth(column, min(self.columnWidth(column), most))


class _WrappedText(QStyledItemDelegate):
    """Asks for the height that a text takes in the width of its column: Qt asks for that of one line."""

    def __init__(self, tree: QTreeWidget) -> None:
        super().__init__(tree)
        self._tree = tree

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        plain = QStyleOptionViewItem(option)
        plain.features &= ~QStyleOptionViewItem.ViewItemFeature.WrapText
        line = super().sizeHint(plain, index)
        margin = self._tree.style().pixelMetric(QStyle.PixelMetric.PM_FocusFrameHMargin) + 1
        room = QRect(0, 0, self._width(index) - 2 * margin, _TALL_PX)
        text = str(index.data() or "")
        high = option.fontMetrics.boundingRect(room, Qt.TextFlag.TextWordWrap, text).height()
        return QSize(line.width(), max(line.height(), high + line.height() - option.fontMetrics.height()))

    def _width(self, index: QModelIndex | QPersistentModelIndex) -> int:
        """Of the cell, without what shows that it lies below another one."""
        spanned = self._tree.isFirstColumnSpanned(index.row(), index.parent())
        wide = self._tree.header().length() if spanned else self._tree.columnWidth(index.column())
        if index.column() > 0:
            return wide
        above, depth = index.parent(), int(self._tree.rootIsDecorated())
        while above.isValid():
            above, depth = above.parent(), depth + 1
        return wide - depth * self._tree.indentation()
