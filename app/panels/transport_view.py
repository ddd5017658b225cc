"""What panels that look at acquired light transport have in common."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QGridLayout, QVBoxLayout, QWidget

from slopegate.app.panels.loaded_transport import LoadedTransport
from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.transport_bar import TransportBar
from slopegate.app.session.session import Change
from slopegate.app.widgets.picture_view import PictureView


class TransportView(Panel):
    """A panel with the open transport's name at its head; all below that is hidden while none is open."""

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self.bar = TransportBar(desk.transports)
        self.body = QWidget()
        whole = QVBoxLayout(self)
        whole.setContentsMargins(6, 6, 6, 6)
        whole.addWidget(self.bar)
        whole.addWidget(self.body, 1)
        whole.addStretch(0)
        desk.transports.opened.connect(self._on_opened)

    def begin(self, loaded: LoadedTransport) -> None:
        """Show this transport, unless it is shown already."""

    def show_transport(self) -> None:
        """Begin with what is open now."""
        loaded = self._desk.transports.loaded
        self.body.setVisible(loaded is not None)
        if loaded is not None:
            self.begin(loaded)

    def follow(self, change: Change) -> None:
        """What is shown stays as it is with another source."""

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.show_transport()

    def _on_opened(self) -> None:
        if self.isVisible():
            self.show_transport()


def grid_of_views(body: QWidget, views: Sequence[tuple[QWidget, PictureView]]) -> QGridLayout:
    """Lay out a panel's body: pictures side by side in row 1, each below what says what it shows."""
    grid = QGridLayout(body)
    grid.setContentsMargins(0, 0, 0, 0)
    grid.setSpacing(4)
    for column, (head, view) in enumerate(views):
        grid.addWidget(head, 0, column)
        grid.addWidget(view, 1, column)
        grid.setColumnStretch(column, 1)
    grid.setRowStretch(1, 3)
    return grid
