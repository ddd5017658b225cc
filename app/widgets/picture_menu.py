"""The context menu of a plot or a picture: copy it, save it, and what else it offers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, Qt, Signal
from PySide6.QtGui import QContextMenuEvent, QGuiApplication, QImage, QMouseEvent
from PySide6.QtWidgets import QFileDialog, QWidget

from slopegate.app.widgets.menus import Menu
from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.checks import UserError
from slopegate.drivers.files.images import save_image

_CLICK_PX = 4.0


class PictureMenu(QObject):
    """Opens at a click with the right button anywhere in the widget, or by the menu key; not after a drag."""

    failed = Signal(str)
    """Why the picture could not be saved."""

    def __init__(self, shown: QWidget, name: str) -> None:
        """`name` is what the picture is called."""
        super().__init__(shown)
        self._shown, self._name = shown, name
        self._pressed: QPointF | None = None
        self.menu = Menu("", shown)
        self._copy = self.menu.addAction("&Copy picture")
        self._copy.triggered.connect(self.copy)
        self._save = self.menu.addAction("&Save picture ...")
        self._save.triggered.connect(self._ask)
        for part in (shown, *shown.findChildren(QWidget)):
            part.installEventFilter(self)

    def offer(self, acts: Mapping[str, Callable[[], object]]) -> None:
        """Offer these, too, before the rest."""
        for text, act in acts.items():
            action = self.menu.addAction(text)
            self.menu.insertAction(self._copy, action)
            action.triggered.connect(lambda _=False, act=act: act())
        if acts:
            self.menu.insertSeparator(self._copy)

    def copy(self) -> None:
        """Put the picture on the clipboard."""
        QGuiApplication.clipboard().setImage(self._image())

    def save(self, path: Path) -> None:
        """Write the picture as PNG or TIFF; `failed` says why it could not."""
        try:
            save_image(path if path.suffix else path.with_suffix(".png"), _rgb(self._image()))
        except UserError as error:
            self.failed.emit(str(error))

    def _ask(self) -> None:
        kinds = "PNG (*.png);;TIFF (*.tif *.tiff)"
        name, _ = QFileDialog.getSaveFileName(self._shown, f"Save {self._name}", f"{self._name}.png", kinds)
        if name:
            self.save(Path(name))

    def _image(self) -> QImage:
        return self._shown.grab().toImage()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Clicks and the menu key on any part of the widget."""
        kinds = QEvent.Type
        if event.type() not in (kinds.MouseButtonPress, kinds.MouseButtonRelease, kinds.ContextMenu):
            return False
        if isinstance(event, QContextMenuEvent):
            if event.reason() == QContextMenuEvent.Reason.Keyboard:
                self._open(self._shown.mapToGlobal(self._shown.rect().center()))
            return True
        if isinstance(event, QMouseEvent) and event.button() == Qt.MouseButton.RightButton:
            if event.type() == kinds.MouseButtonPress:
                self._pressed = event.globalPosition()
            elif self._pressed is not None:
                moved, self._pressed = event.globalPosition() - self._pressed, None
                if max(abs(moved.x()), abs(moved.y())) < _CLICK_PX:
                    self._open(event.globalPosition().toPoint())
        return False

    def _open(self, at: QPoint) -> None:
        self.menu.popup(at)


def _rgb(image: QImage) -> Bytes:
    """The picture's pixels (H, W, 3)."""
    plain = image.convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(plain.constBits(), np.uint8).reshape(plain.height(), plain.bytesPerLine())
    return rows[:, : 3 * plain.width()].reshape(plain.height(), plain.width(), 3).copy()
