"""The menu of faults that the virtual camera can imitate."""

from __future__ import annotations

from typing import Final

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QAction, QActionGroup
from PySide6.QtWidgets import QMenu

from slopegate.app.widgets.menus import Menu
from slopegate.drivers.cameras.faults import PRESETS, Faults

_NAMES: Final = {
    "trigger": ("A bad &trigger line", "Triggers are missed, and come a little early or late"),
    "link": ("An overloaded &link", "Frames are lost, arrive late, or arrive twice"),
    "plug": ("A loose &plug", "The camera is gone for two seconds now and then"),
    "all": ("&All of it at once", "Missed triggers, jitter, lost, late and repeated frames, and a loose plug"),
}


class FaultMenu(QObject):
    """Offers one of the named faults, or none."""

    chosen = Signal(object)
    """Faults, or None."""

    def __init__(self, parent: QMenu) -> None:
        super().__init__(parent)
        self.menu = Menu.below(parent, "Imitate a &faulty rig")
        self.menu.menuAction().setToolTip("Let frames and triggers go wrong as they do on a real rig")
        self.menu.setToolTipsVisible(True)
        group = QActionGroup(self)
        # faults that were given by numbers tick none of them
        group.setExclusionPolicy(QActionGroup.ExclusionPolicy.ExclusiveOptional)
        self.actions: dict[Faults | None, QAction] = {}
        self._add(group, None, "&Nothing goes wrong", "The virtual camera has no faults")
        for key, faults in PRESETS.items():
            self._add(group, faults, *_NAMES[key])

    def show_faults(self, faults: Faults | None) -> None:
        """Tick the faults that the camera has."""
        for known, action in self.actions.items():
            action.setChecked(known == faults)

    def _add(self, group: QActionGroup, faults: Faults | None, text: str, hint: str) -> None:
        action = self.menu.addAction(text)
        action.setCheckable(True)
        action.setToolTip(hint)
        action.setStatusTip(hint)
        action.triggered.connect(lambda: self._choose(faults))
        group.addAction(action)
        self.actions[faults] = action

    def _choose(self, faults: Faults | None) -> None:
        # the same chosen again must stay ticked
        self.actions[faults].setChecked(True)
        self.chosen.emit(faults)
