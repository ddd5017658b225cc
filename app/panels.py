"""The tabs of things to do, beside the plots."""

from __future__ import annotations

from PySide6.QtWidgets import QTabWidget, QWidget
from slopegate.app.live_panel import LivePanel
from slopegate.app.session import Session


def add_panels(session: Session, live: LivePanel, tabs: QTabWidget) -> list[QWidget]:
    """Make the panels and add them as tabs. Closing one ends whatever it has under way."""
    panels: dict[str, QWidget] = {}
    for title, panel in panels.items():
        tabs.addTab(panel, title)
    return list(panels.values())
