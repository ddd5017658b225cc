"""Choices of the camera's pixel format and frame rate, in the tool bar and in the menu."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QAction, QActionGroup
from PySide6.QtWidgets import QMenu

from slopegate.app.widgets.menus import Menu
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.drivers.contract.frame import Ability, Modes

RATES_HZ: Final = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 100.0, 200.0)
OTHER: Final = 0.0
"""The value of 'Other ...', in place of a rate."""
FULL_SPEED: Final = "Full speed"
SENSORS: Final = {"mono12": "Mono sensor", "bayer_rg12": "Colour sensor"}
"""Names for the virtual camera's formats; those of others keep the camera's own names."""


class Choice(QObject):
    """A choice from a list, shown as a box and as a menu."""

    chosen = Signal()

    def __init__(self, menu: QMenu, title: str, name: str, hint: str) -> None:
        super().__init__(menu)
        self._hint = hint
        self.box = ChoiceBox()
        self.box.setAccessibleName(name)
        self.box.setObjectName(name)
        self.box.setPlaceholderText(name)
        self.box.setSizeAdjustPolicy(ChoiceBox.SizeAdjustPolicy.AdjustToContents)
        self.box.activated.connect(self._choose)
        self.menu = Menu.below(menu, title)
        self.menu.setToolTipsVisible(True)
        self._group = QActionGroup(self)
        self._group.triggered.connect(lambda action: self._choose(action.data()))

    @property
    def value(self) -> Any:
        """The value that is marked; None where nothing can be chosen."""
        return self.box.currentData() if self.box.isEnabled() else None

    def show_items(self, items: Sequence[tuple[str, object]], present: object, able: Ability) -> None:
        """Show the items and mark the one in use; where nothing can be chosen, say why."""
        self.box.clear()
        for action in self._group.actions():
            self._group.removeAction(action)
        self.menu.clear()
        for index, (text, value) in enumerate(items):
            self.box.addItem(text, value)
            action = QAction(text, self.menu, checkable=True, checked=value == present)
            action.setData(index)
            self._group.addAction(action)
            self.menu.addAction(action)
        self.box.setCurrentIndex(next((k for k, (_, value) in enumerate(items) if value == present), -1))
        said = able.missing or self._hint
        entry = self.menu.menuAction()
        for widget in (self.box, entry):
            widget.setEnabled(bool(able))
            widget.setToolTip(said)
        entry.setStatusTip(said)

    def _choose(self, index: int) -> None:
        self.box.setCurrentIndex(index)
        self._group.actions()[index].setChecked(True)
        self.chosen.emit()


def format_items(modes: Modes) -> list[tuple[str, object]]:
    """Every pixel format on offer, or the one in use where none can be chosen."""
    names = modes.formats or ((modes.format,) if modes.format else ())
    return [(SENSORS.get(name, name), name) for name in names]


def rate_items(modes: Modes, rate_hz: float) -> list[tuple[str, object]]:
    """Usual rates within the camera's range, its highest, the one in use, full speed, and any other."""
    low, high = modes.rates_hz
    rates = {rate for rate in RATES_HZ if low <= rate <= high} | {rate_hz, math.inf}
    if RATES_HZ[0] <= high <= 10 * RATES_HZ[-1]:
        rates.add(high)
    return [*((rate_text(rate), rate) for rate in sorted(rates)), ("Other ...", OTHER)]


def rate_text(rate_hz: float) -> str:
    """The rate as it is shown, such as 59.94 fps."""
    return FULL_SPEED if math.isinf(rate_hz) else f"{rate_hz:.4g} fps"
