"""Panels as docks around the live image, and the workspaces that arrange them."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from itertools import pairwise

from PySide6.QtCore import QByteArray, QChildEvent, QEvent, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QGuiApplication, QPalette
from PySide6.QtWidgets import (
    QAbstractButton,
    QDockWidget,
    QFrame,
    QLabel,
    QMainWindow,
    QScrollArea,
    QStackedWidget,
    QTabBar,
    QTabWidget,
)

from slopegate.app.panels.panel import Desk, Panel
from slopegate.app.panels.panel_state import Values
from slopegate.app.panels.panels import PANELS, WORKSPACES, PanelSpec
from slopegate.app.session.loading import Loader, Progress
from slopegate.app.session.session import Change
from slopegate.app.widgets.signs import drawn
from slopegate.app.widgets.steady import SteadyTabs
from slopegate.app.window.screens import bring_onto_a_screen
from slopegate.app.window.state import pack, unpack

STATE_VERSION = 7301
"""Of the remembered layouts: those with another number are ignored."""
IMAGE_SHARE = 4 / 7
"""Part of the width that the live image has at first."""
LEAST_PX = (290, 96)
"""Smallest width and height of a dock's content; what does not fit is scrolled."""
STACKED_PX = 680
"""Height of the window from which a workspace begins with groups of panels above one another; below it all are tabs."""
HELD_MS = 50
"""How often to look whether a mouse button is still held."""
SWITCH_S = 0.0005
"""After how long the thread that imports modules lets another one on, which asks for it many times in each frame."""
STEP_MS = 5
"""From one step of the start to the next: what is due comes in between."""
PATIENCE_S = 2.0
"""How long the start waits for panels that draw themselves in several turns; one that is covered never ends."""
_AREA = Qt.DockWidgetArea.RightDockWidgetArea
_CLOSE = (((3, 3), (13, 13)), ((13, 3), (3, 13)))
_FLOAT = (((3, 6), (10, 6), (10, 13), (3, 13), (3, 6)), ((6, 6), (6, 3), (13, 3), (13, 10), (10, 10)))
"""Signs of the title bar's buttons: lines in a square of 16."""


class PanelDock(QDockWidget):
    """The frame of one panel. It makes the panel when it first comes to the front, and hides it when it does not."""

    def __init__(self, spec: PanelSpec, desk: Desk) -> None:
        super().__init__(spec.title)
        self.setObjectName(spec.key)
        self.spec, self._desk = spec, desk
        self.panel: Panel | None = None
        """None until it is first shown."""
        self._running, self._begun, self._missing = False, False, ""
        self._kept: Values = {}
        """What is to be set in the panel when it is made."""
        self._note = QLabel("Waiting for the first image ...")
        self._note.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._note.setWordWrap(True)
        self._note.setMargin(24)
        self._scroll = QScrollArea()
        self._scroll.setFrameShape(QFrame.Shape.NoFrame)
        self._scroll.setWidgetResizable(True)
        self._pages = _Pages()
        self._pages.addWidget(self._note)
        self._pages.addWidget(self._scroll)
        self.setWidget(self._pages)
        self._later = QTimer(self)
        self._later.setSingleShot(True)
        self._later.timeout.connect(self.turn)
        self.visibilityChanged.connect(self._on_visibility)

    @property
    def front(self) -> bool:
        """Whether its content is on the screen: not closed, and not behind another tab."""
        place = self.geometry()  # Qt moves a dock behind another tab out of the window, and calls it visible
        return self.isVisible() and (self.isFloating() or (place.right() >= 0 and place.bottom() >= 0))

    @property
    def missing(self) -> str:
        """Why the panel is of no use with this source, in one sentence; empty when it is."""
        return self._missing

    def set_missing(self, why: str) -> None:
        """Show this sentence instead of the panel; the panel again with an empty one."""
        self._missing = why
        if self._running:
            self._note.setText(why)
        self.turn()

    def prepare(self) -> None:
        """Make the panel where it will be shown, without showing it yet."""
        if self.front and not self._missing:
            self._make()

    def run(self) -> None:
        """Let the panel be made from now on."""
        self._running = True
        self.set_missing(self._missing)

    def turn(self) -> None:
        """Show the panel if it is in front and of use, else hide it."""
        if self.front and not self._running and not self._begun:
            self._begun = True
            self.spec.begin()
        able = self._running and self.front and not self._missing
        self._draw_buttons()
        if able:
            self._make()
        self._pages.setCurrentWidget(self._scroll if able else self._note)

    def _make(self) -> None:
        if self.panel is None:
            self.panel = self.spec.make(self._desk)
            self._scroll.setWidget(self.panel)
            if self._kept:
                self.panel.set_state(self._kept)

    def kept_state(self) -> Values:
        """What is set in the panel, or will be when it is made."""
        return self._kept if self.panel is None else self.panel.kept_state()

    def set_state(self, values: Values) -> None:
        """Set this in the panel, or when it is made."""
        self._kept = values
        if self.panel is not None:
            self.panel.set_state(values)

    def end(self) -> None:
        """Stop whatever the panel has under way."""
        self._running = False
        if self.panel is not None:
            self.panel.close()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange:
            self._draw_buttons()

    def _draw_buttons(self) -> None:
        """Qt's own signs, which it sets whenever the dock moves, can hardly be seen on a dark window."""
        for name, sign, hint in (
            ("qt_dockwidget_floatbutton", _FLOAT, "A window of its own, for another screen; or back into this one"),
            ("qt_dockwidget_closebutton", _CLOSE, "Close this panel; View > Panels brings it back"),
        ):
            button = self.findChild(QAbstractButton, name)
            if button is not None:
                button.setIcon(drawn(sign, self.palette().color(QPalette.ColorRole.WindowText)))
                button.setToolTip(hint)

    def _on_visibility(self, visible: bool) -> None:
        if visible:
            self._later.start(0)  # docks that are restored are visible for a moment before one covers another
        else:
            self.turn()


class _Pages(QStackedWidget):
    """A small least size, whatever the pages would like."""

    def minimumSizeHint(self) -> QSize:
        return QSize(*LEAST_PX)

    def sizeHint(self) -> QSize:
        return QSize(480, 300)


class Docks(QMainWindow):
    """The live image with the panels docked around it. A workspace is a remembered layout of these docks."""

    switched = Signal(str)
    """The key of the workspace that is shown now."""
    ran = Signal()
    """The panels that were in front at `run` are made."""

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self.setWindowFlags(Qt.WindowType.Widget)
        self.setCentralWidget(desk.live)
        options = QMainWindow.DockOption
        self.setDockOptions(options.AllowTabbedDocks | options.AllowNestedDocks)
        self.setTabPosition(Qt.DockWidgetArea.AllDockWidgetAreas, QTabWidget.TabPosition.North)
        for corner in (Qt.Corner.TopRightCorner, Qt.Corner.BottomRightCorner):
            self.setCorner(corner, _AREA)
        self._desk = desk
        self._source = desk.session.source
        self._layouts: dict[str, str] = {}
        self._left: list[PanelDock] = []
        """What was in front before there was nothing to show in it."""
        self.running = False
        """Whether panels are made: not before the first image is on the screen."""
        self.workspace = ""
        """The key of the workspace that is shown."""
        self.docks = {spec.key: PanelDock(spec, desk) for spec in PANELS}
        self._arranging = False
        self._steps: list[Callable[[], None]] = []
        """What is left of `run`."""
        self._patient_until_s = 0.0
        """Until when each of them waits for the panels that are made already to settle."""
        self._importer: Loader[bool] = Loader(lambda _: None, self)
        self._importer.finished.connect(self._begin)
        self._importer.failed.connect(self._begin)
        for dock in self.docks.values():
            self.addDockWidget(_AREA, dock)
            dock.topLevelChanged.connect(lambda floating, dock=dock: self._on_floated(dock, floating))
        desk.session.changed.connect(self._on_changed)

    # What is shown

    def run(self) -> None:
        """Make the panels that are in front, and from now on each one that comes to the front.

        Their modules are imported in another thread, and each panel is made and shown in a turn of its own, so that
        frames and keys come through in between. `ran` follows.
        """
        self.running = True
        specs = [dock.spec for dock in self.docks.values() if dock.front and not dock.missing]

        def job(_: Progress) -> bool:
            usual_s = sys.getswitchinterval()
            sys.setswitchinterval(SWITCH_S)
            try:
                for spec in specs:
                    spec.prefetch()
            finally:
                sys.setswitchinterval(usual_s)
            return True

        self._importer.start(job)

    @property
    def made(self) -> bool:
        """Whether the panels that were in front at `run` are made."""
        return self.running and not self._importer.busy and not self._steps

    def _begin(self, _: object) -> None:
        """A module that cannot be imported is told of when its panel is made."""
        self._patient_until_s = time.monotonic() + PATIENCE_S
        first = sorted(self.docks.values(), key=lambda dock: not dock.front)
        self._steps = [step for dock in first for step in ((dock.prepare, dock.run) if dock.front else (dock.run,))]
        self._step()

    def _step(self) -> None:
        panels = [dock.panel for dock in self.docks.values()]
        settled = all(panel.settled for panel in panels if panel is not None and panel.isVisible())
        if settled or time.monotonic() > self._patient_until_s:
            if not self._steps:
                self.ran.emit()
                return
            self._steps.pop(0)()
        QTimer.singleShot(STEP_MS, self, self._step)

    def end(self) -> None:
        """Stop what the panels have under way."""
        self._steps.clear()
        self._importer.close()
        for dock in self.docks.values():
            dock.end()

    def open(self, key: str) -> Panel | None:
        """Bring a panel to the front of the workspace that is shown; None while it has nothing to show."""
        dock = self.docks[key]
        dock.show()
        dock.raise_()
        if dock.isFloating():
            dock.activateWindow()
        dock.turn()
        return dock.panel

    def bring(self, key: str) -> Panel | None:
        """Switch to the workspace that a panel belongs to, and bring it to the front there."""
        self.switch(self.docks[key].spec.workspace, key)
        return self.open(key)  # at once, where the other workspace comes later

    def toggle(self, key: str) -> None:
        """Bring a panel to the front; close it when it is there already."""
        dock = self.docks[key]
        if dock.front:
            dock.close()
        else:
            self.open(key)

    # Workspaces

    def switch(self, key: str, front: str = "") -> None:
        """Show another workspace, as it was left, but with the panel `front` in front where one is named."""
        if key != self.workspace:
            if self._postponed(lambda: self.switch(key, front)):
                return
            if self.workspace:
                self._layouts[self.workspace] = self._packed()
            self.workspace = key
            self._apply(self._layouts.get(key, ""))
            self.switched.emit(key)
        if front:
            self.open(front)

    def reset(self) -> None:
        """Arrange the panels of this workspace as at first."""
        if self._postponed(self.reset):
            return
        self._apply("")
        for dock in self.docks.values():
            if dock.panel is not None:
                dock.panel.reset_view()

    def layouts(self) -> dict[str, str]:
        """How the docks are arranged in each workspace that has been shown, fit for preferences."""
        return {**self._layouts, self.workspace: self._packed()}

    def panel_states(self) -> dict[str, Values]:
        """What is set in each panel, fit for a file."""
        found = {key: dock.kept_state() for key, dock in self.docks.items()}
        return {key: values for key, values in found.items() if values}

    def set_panel_states(self, states: Mapping[str, Values]) -> None:
        """Set in each panel what was kept of it."""
        for key, values in states.items():
            if key in self.docks:
                self.docks[key].set_state(values)

    def restore(self, layouts: Mapping[str, str], workspace: str) -> None:
        """Show a workspace with these layouts; what is no layout of this program is ignored."""
        if self._postponed(lambda: self.restore(layouts, workspace)):
            return
        known = [one.key for one in WORKSPACES]
        self._layouts = {key: layouts[key] for key in known if key in layouts}
        self.workspace = ""
        self.switch(workspace if workspace in known else known[0])

    def _postponed(self, do: Callable[[], object]) -> bool:
        """Whether a mouse button is held: then `do` comes later.

        Qt goes on moving a dock that is dragged after all have been arranged anew, which ends the process.
        """
        held = QGuiApplication.mouseButtons() != Qt.MouseButton.NoButton
        if held:
            QTimer.singleShot(HELD_MS, self, do)
        return held

    def _packed(self) -> str:
        return pack(self.saveState(STATE_VERSION))

    def _on_floated(self, dock: PanelDock, floating: bool) -> None:
        if not floating and not self._arranging:
            dock.raise_()  # Qt may put it behind another tab

    def _apply(self, state: str) -> None:
        self._arranging = True
        self.setUpdatesEnabled(False)
        try:
            kept = unpack(state)
            if not state or not self.restoreState(kept, STATE_VERSION):
                self._arrange()
            else:
                self._close_unnamed(kept)
            for dock in self.docks.values():
                if dock.isFloating():
                    bring_onto_a_screen(dock)
        finally:
            self.setUpdatesEnabled(True)
            for dock in self.docks.values():
                dock.setUpdatesEnabled(True)  # one that floats now is a window, which the line above does not reach
            self._arranging = False

    def _close_unnamed(self, state: QByteArray) -> None:
        """Qt leaves a dock as it is that a layout does not know, as one of a former version knows no newer panels."""
        for key, dock in self.docks.items():
            text = key.encode("utf-16-be")
            if not state.contains(QByteArray(len(text).to_bytes(4, "big") + text)):
                dock.setFloating(False)
                dock.close()

    def _arrange(self) -> None:
        """Put the workspace's panels to the right of the image, group above group; close the others."""
        own = [dock for dock in self.docks.values() if dock.spec.workspace == self.workspace]
        others = [dock for dock in self.docks.values() if dock not in own]
        stacked = self.window().height() >= STACKED_PX
        groups: dict[int, list[PanelDock]] = {}
        for dock in (*own, *others):
            dock.setFloating(False)
            self.removeDockWidget(dock)
            groups.setdefault(dock.spec.row if stacked else 0, []).append(dock)
        for group in groups.values():
            self.addDockWidget(_AREA, group[0], Qt.Orientation.Vertical)
            for before, dock in pairwise(group):
                self.tabifyDockWidget(before, dock)
        for dock in own:
            dock.show()
        tops = [group[0] for group in groups.values() if group[0] in own]
        for dock in tops:
            dock.raise_()
        self.resizeDocks(tops, [1000] * len(tops), Qt.Orientation.Vertical)
        self.resizeDocks(tops[:1], [round((1 - IMAGE_SHARE) * self.window().width())], Qt.Orientation.Horizontal)

    def childEvent(self, event: QChildEvent) -> None:
        super().childEvent(event)
        tabs = event.child()
        if event.type() == QEvent.Type.ChildPolished and isinstance(tabs, QTabBar):
            tabs.setElideMode(Qt.TextElideMode.ElideNone)  # arrows appear where the tabs have no room
            SteadyTabs(tabs)

    # What the source has nothing for

    def _on_changed(self, change: Change) -> None:
        if Change.SOURCE not in change:
            return
        old, source = self._source, self._desk.session.source
        self._source = source
        same = old is not None and source is not None and source.shows_the_same(old)
        for dock in self.docks.values():
            if not same and dock.panel is None:
                dock.set_state({})
            dock.set_missing(dock.spec.missing(source))
        self._leave_the_useless()
        if source is not None and source.played is not None:
            self.bring("capture")  # last, or a tab that is of use again would come before it

    def _leave_the_useless(self) -> None:
        """Where a tab has nothing to show, bring one that has to the front, and back again with the next source."""
        for dock in self._left:
            if not dock.missing:
                dock.raise_()
        self._left = [dock for dock in self._left if dock.missing]
        for dock in self.docks.values():
            if dock.front and dock.missing:
                beside = (self.docks[other.objectName()] for other in self.tabifiedDockWidgets(dock))
                useful = [other for other in beside if not (other.missing or other.isHidden())]
                for other in useful[:1]:
                    other.raise_()
                    self._left.append(dock)
