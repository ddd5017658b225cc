"""What every panel is built on: the desk that all panels share, and a widget that costs nothing while it is hidden."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QWidget

from slopegate.app.panels.loaded_transport import Transports
from slopegate.app.panels.panel_state import Values, set_boxes, set_values, values_of
from slopegate.app.session.session import Change, Session
from slopegate.app.views.live_panel import LivePanel
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.projector import Projector, ProjectorError


class Desk(QObject):
    """The session and the live image that all panels share, and what they tell the window and one another."""

    open_wished = Signal(object)
    """The folder (Path) of a capture to open in the window."""
    warned = Signal(str)
    """A sentence that the user must see whichever panel is in front."""
    noted = Signal(str)
    """What has been done, or is being done, for a moment: a panel's own texts may lie beyond its edge."""
    refused = Signal(str)
    """A sentence on what was typed in a panel and cannot be set."""
    typed = Signal()
    """Something else is being typed there."""
    withdrawn = Signal(str)
    """A sentence told before that is out of date."""
    swept = Signal()
    """A depth sweep has ended; `projector_row` is what it found."""
    rig_wished = Signal(object)
    """The Rig to look at what runs with from now on."""
    found_gate = Signal()
    """A search has ended; `found` is the gate of its target."""

    def __init__(self, session: Session, live: LivePanel, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.session, self.live = session, live
        self.settings_folder: Path | None = None
        """Where panels keep what they remember between two runs; None: nowhere."""
        self.projector_row: Singles | None = None
        """Projector row (H, W) of each pixel as the last depth sweep of this source found it, -1 where unknown."""
        self.found: GateSettings | None = None
        """The gate of the target that the last search in this source found."""
        self.screen: Callable[[], tuple[Projector, int]] = _no_screen
        """The projector of the screen that shows patterns, and the frames that it takes to settle. Raises
        ProjectorError where none does. To be called in the window's thread, the projector's methods in another."""
        self.transports = Transports(self)
        """The light transport to look at, relight and composite; it stays with another source."""
        session.changed.connect(self._on_changed)

    def keep_sweep(self, projector_row: Singles) -> None:
        """Let all panels use what a depth sweep found."""
        self.projector_row = projector_row
        self.swept.emit()

    def keep_found(self, settings: GateSettings | None) -> None:
        """Let all panels use the gate that a search found."""
        self.found = settings
        self.found_gate.emit()

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE in change:
            self.projector_row = None
            self.keep_found(None)


def _no_screen() -> tuple[Projector, int]:
    raise ProjectorError("There is no projector here")


class Panel(QWidget):
    """A panel of the window. While it is hidden the session's changes are only noted, to be shown when it is."""

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self._desk, self._session, self._live = desk, desk.session, desk.live
        self._missed = Change.SOURCE | Change.GATE | Change.DEPTH
        desk.session.changed.connect(self._on_any_change)

    def follow(self, change: Change) -> None:
        """Show what has changed in the session; called only while the panel is on the screen."""

    @property
    def settled(self) -> bool:
        """Whether it has drawn everything once: the start makes the next panel after that."""
        return True

    def let_go(self) -> None:
        """Keep nothing of the source before, for another one has come while the panel is hidden; `follow` comes when
        it is shown. Nothing is to be computed here."""

    def reset_view(self) -> None:
        """Show everything again, as at first: the layout was reset."""

    def take_up(self, tool: str) -> None:
        """Take up one of the panel's tools on the live image, by its key."""
        raise NotImplementedError(f"{type(self).__name__} has no tool {tool}")

    def kept_state(self) -> Values:
        """What is set in it, to be kept in a file."""
        return values_of(self)

    def set_state(self, values: Values) -> None:
        """Set what was kept; what does not fit any more is left out."""
        set_values(self, values)
        source = self._session.source
        if source is not None:
            set_boxes(self, values, source.shape)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._catch_up()

    def _on_any_change(self, change: Change) -> None:
        self._missed |= change
        if self.isVisible():
            self._catch_up()
        elif Change.SOURCE in change:
            self.let_go()

    def _catch_up(self) -> None:
        change, self._missed = self._missed, Change(0)
        if change:
            self.follow(change)
