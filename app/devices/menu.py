"""The menu entries for devices."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMenu, QWidget

from slopegate.app.devices.hub import FILE_NAME, DeviceHub
from slopegate.drivers.contract.families import Address

if TYPE_CHECKING:
    from slopegate.app.devices.dialog import DeviceDialog


class DeviceMenu:
    """Adds its entries to a menu. The dialog is made when it is first asked for."""

    def __init__(self, window: QWidget, menu: QMenu, folder: Path) -> None:
        """`folder` holds what is remembered. A board remembered there is connected at once, in another thread."""
        self.hub = DeviceHub(folder / FILE_NAME, parent=window)
        self._window, self._menu = window, menu
        self._dialog: DeviceDialog | None = None
        self._open_camera: Callable[[Address], object] | None = None
        menu.addSeparator()
        hint = "What is plugged in, what could be; connect, test and remember cameras and sync boards"
        self._add("&Devices ...", "Ctrl+D", hint).triggered.connect(lambda _=False: self.open())
        hint = "Stream from the camera that was connected last"
        self.again = self._add("Connect the &last camera", "Ctrl+Shift+D", hint)
        self.again.triggered.connect(self._open_last)
        self.hub.changed.connect(self._show_last)
        self._show_last()

    def connect_cameras(self, open_camera: Callable[[Address], object]) -> None:
        """Set what is called to stream from a camera that is chosen."""
        self._open_camera = open_camera
        self._show_last()

    def open(self) -> QWidget:
        """Show the dialog."""
        if self._dialog is None:
            from slopegate.app.devices.dialog import DeviceDialog

            self._dialog = DeviceDialog(self.hub, self._window, self._open_camera)
        self._dialog.show()
        self._dialog.raise_()
        return self._dialog

    def say_failed(self, sentence: str) -> None:
        """Show in the dialog why the window could not open a camera."""
        if self._dialog is not None:
            self._dialog.say_failed(sentence)

    def close(self) -> None:
        """Close every device."""
        if self._dialog is not None:
            self._dialog.close()
        self.hub.close()

    def _add(self, text: str, keys: str, hint: str) -> QAction:
        action = QAction(text, self._window)
        action.setShortcut(QKeySequence(keys))
        action.setToolTip(f"{hint} ({keys})")
        action.setStatusTip(hint)
        self._menu.addAction(action)
        return action

    def _open_last(self) -> None:
        last = self.hub.last_camera
        if last is not None and self._open_camera is not None:
            self._open_camera(last)

    def _show_last(self) -> None:
        last = self.hub.last_camera
        self.again.setEnabled(last is not None and last != self.hub.running and self._open_camera is not None)
        name = "the &last camera" if last is None else str(last).replace("&", "&&")
        self.again.setText(f"Connect {name}")
