"""What every panel is built on: the desk that all panels share, and a widget that costs nothing while it is hidden."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QWidget

from slopegate.app.session.session import Change, Session
from slopegate.app.views.live_panel import LivePanel
from slopegate.core.rig.arrays import Singles


class Desk(QObject):
    """The session and the live image that all panels share, and what they tell the window and one another."""

    open_wished = Signal(object)
    """The folder (Path) of a capture to open in the window."""
    warned = Signal(str)
    """A sentence that the user must see whichever panel is in front."""
    swept = Signal()
    """A depth sweep has ended; `projector_row` is what it found."""

    def __init__(self, session: Session, live: LivePanel, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.session, self.live = session, live
        self.projector_row: Singles | None = None
        """Projector row (H, W) of each pixel as the last depth sweep of this source found it, -1 where unknown."""
        session.changed.connect(self._on_changed)

    def keep_sweep(self, projector_row: Singles) -> None:
        """Let all panels use what a depth sweep found."""
        self.projector_row = projector_row
        self.swept.emit()

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE in change:
            self.projector_row = None


class Panel(QWidget):
    """A panel of the window. While it is hidden the session's changes are only noted, to be shown when it is."""

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self._desk, self._session, self._live = desk, desk.session, desk.live
        self._missed = Change.SOURCE | Change.GATE | Change.DEPTH
        desk.session.changed.connect(self._on_any_change)

    def follow(self, change: Change) -> None:
        """Show what has changed in the session; called only while the panel is on the screen."""

    def reset_view(self) -> None:
        """Show everything again, as at first: the layout was reset."""

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._catch_up()

    def _on_any_change(self, change: Change) -> None:
        self._missed |= change
        if self.isVisible():
            self._catch_up()

    def _catch_up(self) -> None:
        change, self._missed = self._missed, Change(0)
        if change:
            self.follow(change)
