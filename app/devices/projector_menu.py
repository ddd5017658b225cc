"""The menu entry for the projector."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMenu, QWidget

from slopegate.app.devices.projector_memory import FILE_NAME
from slopegate.app.devices.projector_window import ProjectorWindow, ScreenProjector
from slopegate.app.widgets.messages import MessageStrip
from slopegate.core.rig.rig import RigProjector
from slopegate.drivers.contract.projector import ProjectorError

if TYPE_CHECKING:
    from slopegate.app.devices.projector_dialog import ProjectorDialog


class ProjectorMenu:
    """Adds its entry to a menu. The dialog and the projector's window are made when they are first asked for."""

    def __init__(
        self, window: QWidget, menu: QMenu, folder: Path, projector: RigProjector, messages: MessageStrip
    ) -> None:
        """`folder` holds what is remembered; `projector` is the rig's, to compare screens with."""
        self._owner, self._path, self._projector = window, folder / FILE_NAME, projector
        self._messages = messages
        self._window: ProjectorWindow | None = None
        self._dialog: ProjectorDialog | None = None
        hint = "Choose the projector's screen and the pattern on it"
        action = QAction("Pro&jector ...", window)
        action.setShortcut(QKeySequence("Ctrl+J"))
        action.setToolTip(f"{hint} (Ctrl+J)")
        action.setStatusTip(hint)
        action.triggered.connect(lambda _=False: self.open())
        menu.addAction(action)

    def open(self) -> ProjectorDialog:
        """Show the dialog."""
        if self._dialog is None:
            from slopegate.app.devices.projector_dialog import ProjectorDialog

            self._window = ProjectorWindow()
            self._window.uncovered.connect(self._on_uncovered)
            self._dialog = ProjectorDialog(self._window, self._projector, self._path, self._owner)
        self._dialog.show()
        self._dialog.raise_()
        return self._dialog

    def screen(self) -> tuple[ScreenProjector, int]:
        """The projector of the screen that shows a pattern now, and its settle count. Raises ProjectorError where none
        does.
        """
        if self._window is None or self._dialog is None:
            raise ProjectorError("No screen is chosen for the projector: show a pattern on it first (Ctrl+J)")
        settle_frames = self._dialog.choice.settle_frames
        return ScreenProjector(self._window, settle_frames), settle_frames

    def use(self, projector: RigProjector) -> None:
        """Compare screens with another rig's projector from now on."""
        if projector != self._projector:
            self.close()
            self._projector, self._dialog, self._window = projector, None, None

    def close(self) -> None:
        """Hide the pattern; else its window would keep the program running."""
        if self._dialog is not None:
            self._dialog.close()
        if self._window is not None:
            self._window.uncover()
            self._window.close()

    def _on_uncovered(self, why: str) -> None:
        if why:  # the dialog may be closed
            self._messages.say(why, "warning")
