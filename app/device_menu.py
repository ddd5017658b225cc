"""The way from the window to its devices."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMenu, QWidget
from slopegate.app.device_bench import DeviceBench
from slopegate.app.device_memory import FILE_NAME


class DeviceMenu:
    """An entry in a menu; the dialog behind it is made when first asked for."""

    def __init__(self, window: QWidget, menu: QMenu, folder: Path) -> None:
        """`folder` keeps what is remembered; a board remembered there is connected at once, beside this thread."""
        self.bench = DeviceBench(folder / FILE_NAME, parent=window)
        self._window = window
        self._dialog: QWidget | None = None
        hint = "What is plugged in, what could be; connect, test and remember sync boards"
        action = QAction("&Devices ...", window)
        action.setShortcut(QKeySequence("Ctrl+D"))
        action.setToolTip(f"{hint} (Ctrl+D)")
        action.setStatusTip(hint)
        action.triggered.connect(lambda _=False: self.open())
        menu.addSeparator()
        menu.addAction(action)

    def open(self) -> QWidget:
        """Show the dialog."""
        if self._dialog is None:
            from slopegate.app.device_dialog import DeviceDialog

            self._dialog = DeviceDialog(self.bench, self._window)
        self._dialog.show()
        self._dialog.raise_()
        return self._dialog

    def close(self) -> None:
        """Let every device go."""
        if self._dialog is not None:
            self._dialog.close()
        self.bench.close()
