"""The tabs of things to do, beside the plots."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtGui import QPalette
from PySide6.QtWidgets import QAbstractButton, QPushButton, QTabWidget, QWidget
from slopegate.app.session.session import Change, Session
from slopegate.app.views.live_panel import LivePanel
from slopegate.app.views.plots_panel import allow_tab


def add_panels(
    session: Session,
    live: LivePanel,
    tabs: QTabWidget,
    open_folder: Callable[[Path], None],
    warn: Callable[[str], None],
) -> list[QWidget]:
    """Make the panels and add them as tabs. Closing one ends whatever it has under way.

    The tab of a reopened capture is there only while one is open; those that need a gate are switched off without.
    `warn` shows a sentence whichever tab is in front.
    """
    from slopegate.app.panels.alarm import AlarmPanel
    from slopegate.app.panels.capture import CapturePanel
    from slopegate.app.panels.capture_view import CaptureView
    from slopegate.app.panels.depth import DepthPanel
    from slopegate.app.panels.mask import MaskPanel
    from slopegate.app.panels.search import SearchPanel

    mask, depth, view = MaskPanel(session, live), DepthPanel(session), CaptureView(session)
    slices, alarm = CapturePanel(session), AlarmPanel(session, live)
    alarm.went_off_duty.connect(warn)
    depth.measured.connect(mask.set_measured)
    slices.open_wished.connect(open_folder)
    panels: dict[str, QWidget] = {
        "Mask": mask,
        "Search": SearchPanel(session, live),
        "Depth": depth,
        "Slices": slices,
        "Alarm": alarm,
        "Capture": view,
    }
    for title, panel in panels.items():
        _leave_letters(panel)
        _show_what_is_checked(panel)
        tabs.addTab(panel, title)

    def show_tabs(change: Change) -> None:
        if change & Change.SOURCE:
            source = session.source
            for title in ("Mask", "Search", "Depth", "Slices"):
                allow_tab(tabs, panels[title], "" if source is None else source.no_gate)
            is_capture = source is not None and source.played is not None
            tabs.setTabVisible(tabs.indexOf(view), is_capture)
            if is_capture:
                tabs.setCurrentWidget(view)
            elif not tabs.isTabEnabled(tabs.currentIndex()):
                tabs.setCurrentWidget(panels["Alarm"])

    session.changed.connect(show_tabs)
    show_tabs(Change.SOURCE)
    return list(panels.values())


def _leave_letters(panel: QWidget) -> None:
    """Alt with a letter belongs to what is always on the screen: there are more buttons than letters."""
    for button in panel.findChildren(QAbstractButton):
        button.setText(button.text().replace("&", ""))


def _show_what_is_checked(panel: QWidget) -> None:
    """A pressed button in the colour of what is chosen: Fusion only darkens it, which nobody sees on a dark window."""
    for button in panel.findChildren(QPushButton):
        if button.isCheckable():
            button.toggled.connect(lambda on, button=button: _tint(button, on))
            _tint(button, button.isChecked())


def _tint(button: QPushButton, on: bool) -> None:
    palette = QPalette()
    if on:
        palette.setColor(QPalette.ColorRole.Button, button.palette().color(QPalette.ColorRole.Highlight))
        palette.setColor(QPalette.ColorRole.ButtonText, button.palette().color(QPalette.ColorRole.HighlightedText))
    button.setPalette(palette)
