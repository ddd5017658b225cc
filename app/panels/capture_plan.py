"""The part of the capture panel that plans which slices are taken."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal, get_args

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLabel, QLineEdit, QPushButton, QVBoxLayout, QWidget

from slopegate.app.session.describe import number
from slopegate.app.session.session import Session
from slopegate.app.session.source import known_buffers
from slopegate.app.widgets.flow import FlowLayout
from slopegate.app.widgets.number_box import CountBox, NumberBox, read_number, why_no_number
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.gating.slices import (
    Slices,
    at_delays,
    depth_times,
    most_slices,
    occupied_times,
    share_edges,
    tile_depths,
    tile_times,
)
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.captures.limits import MAX_SLICES

Kind = Literal["lit", "delay", "depth", "list", "hand", "live", "found"]
CAPTURED: tuple[Kind, ...] = ("lit", "delay", "depth", "list", "hand")
"""What a capture's slices can be chosen by."""
ACQUIRED: tuple[Kind, ...] = get_args(Kind)
"""The same for light transport."""
_NAMES = {
    "lit": "All that is lit",
    "delay": "Range, equal delay",
    "depth": "Range, equal depth",
    "list": "List of delays",
    "hand": "Gates by hand",
    "live": "The live gate",
    "found": "The target found",
}
USUAL_COUNT = 12
MAX_DISTANCE_M = 1000.0


@dataclass(frozen=True)
class Wish:
    """The slices wanted, in the words of the panel. `far_m` may be infinite."""

    kind: Kind
    count: int
    near_m: float
    far_m: float
    delays_us: tuple[float, ...]
    by_hand: Slices
    found: GateSettings | None = None
    """The gate of a target that a search found."""


def slices_of(session: Session, wish: Wish) -> Slices:
    """The slices, with the line time (and for a list the exposure) of the live gate. Raises InputError."""
    source, resolved = session.source, session.resolved
    if source is None or resolved is None:
        raise InputError("there is no picture yet")
    rig, held = source.rig, resolved.gate
    line = held.line_time_us
    if wish.kind == "list":
        if not wish.delays_us:
            raise InputError("the list is empty: write delays in microseconds with blanks between them")
        return at_delays(rig, line, held.exposure_us, wish.delays_us)
    if wish.kind == "lit":
        buffers = known_buffers(source)
        times = None if buffers is None else occupied_times(rig, line, buffers.projector_row)
        if times is None:
            raise InputError("nothing is known to be lit here: give a range")
        return tile_times(rig, line, *times, min(wish.count, most_slices(rig, *times)))
    if wish.kind in ("delay", "depth"):
        return _ranged(rig, line, wish)
    return _as_they_are(resolved.sent, wish)


def _ranged(rig: Rig, line_time_us: float, wish: Wish) -> Slices:
    if wish.kind == "depth":
        return tile_depths(rig, line_time_us, wish.near_m, wish.far_m, wish.count, "depth")
    times = depth_times(rig, line_time_us, wish.near_m, wish.far_m)
    return tile_depths(rig, line_time_us, wish.near_m, wish.far_m, min(wish.count, most_slices(rig, *times)))


def _as_they_are(live: GateSettings, wish: Wish) -> Slices:
    """Gates that somebody has set or found."""
    if wish.kind == "live":
        return (live,)
    if wish.kind == "found":
        if wish.found is None:
            raise InputError("no target has been found in this scene yet: look for one with Search (Gate workspace)")
        return (wish.found,)
    if not wish.by_hand:
        raise InputError("no gate has been added yet")
    return wish.by_hand


def read_delays(text: str) -> tuple[float, ...]:
    """Numbers with blanks or semicolons between them; a comma before a blank parts them, too. Raises InputError."""
    words = re.split(r"[\s;]+", re.sub(r",(?=\s|$)", " ", text).strip("; \t\n")) if text.strip() else []
    if len(words) > MAX_SLICES:
        raise InputError(f"{len(words)} delays are too many: there must be at most {MAX_SLICES}")
    found = []
    for word in words:
        value = read_number(word)
        if value is None:
            raise InputError(why_no_number(word))
        found.append(value)
    return tuple(found)


def summary(slices: Slices, wish: Wish) -> str:
    """How many, how long, and whether they meet."""
    shortest, longest = (pick(item.exposure_us for item in slices) for pick in (min, max))
    length = number(shortest) if shortest == longest else f"{number(shortest)}\u2013{number(longest)}"
    many = "1 slice" if len(slices) == 1 else f"{len(slices)} slices"
    if wish.kind in ("lit", "delay") and len(slices) < wish.count:
        many += " (no more fit)"
    meet = "" if len(slices) == 1 else ", sharing edges" if share_edges(slices) else ", not sharing edges"
    return f"{many} of {length} \u00b5s{meet}"


class PlanRow(QWidget):
    """How the slices are chosen, with the numbers that this way needs."""

    changed = Signal()

    def __init__(
        self,
        session: Session,
        kinds: tuple[Kind, ...] = CAPTURED,
        usual_count: int = USUAL_COUNT,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._session, self._kinds = session, kinds
        self._found: GateSettings | None = None
        self._by_hand: tuple[GateSettings, ...] = ()
        self.kind = ChoiceBox()
        for kind in kinds:
            self.kind.addItem(_NAMES[kind], kind)
        self.kind.setAccessibleName("How the slices are chosen")
        self.kind.setToolTip("How the slices are chosen; their tilt is that of the live gate")
        self.count = CountBox()
        self.count.setRange(1, 1000)
        self.count.setValue(usual_count)
        self.count.setSuffix(" slices")
        self.count.setAccessibleName("Slices")
        self.count.setToolTip("Fewer are taken where the camera's shortest exposure lets no more fit")
        self.near, self.far = _metres(0.5, "Where the slices begin"), _metres(2.0, "Where the slices end")
        self.dash = QLabel("to")
        self.delays = QLineEdit()
        self.delays.setMaxLength(10_000_000)  # Qt's own limit would cut a long list, and say nothing
        self.delays.setPlaceholderText("delays in \u00b5s: 1800 2000 2200")
        self.delays.setAccessibleName("Delays in microseconds")
        self.add, self.clear = QPushButton("Add live gate"), QPushButton("Clear")
        self.add.setToolTip("Add the gate that is set now to the list")
        self.held = QLabel()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        numbers = [self.kind, self.count, self.near, self.dash, self.far, self.add, self.clear, self.held]
        column.addLayout(FlowLayout(numbers))
        column.addWidget(self.delays)
        self.kind.currentIndexChanged.connect(self._on_kind)
        for spin in (self.count, self.near, self.far):
            spin.valueChanged.connect(self.changed)
        self.delays.textChanged.connect(self.changed)
        self.add.clicked.connect(self._add)
        self.clear.clicked.connect(self._clear)
        self._on_kind()

    def wish(self) -> Wish:
        """The slices that are asked for. Raises InputError where the delays are no list of numbers."""
        kind: Kind = self.kind.currentData()
        delays = read_delays(self.delays.text()) if kind == "list" else ()
        far = math.inf if self.far.value() >= MAX_DISTANCE_M else self.far.value()
        return Wish(kind, self.count.value(), self.near.value(), far, delays, self._by_hand, self._found)

    def choose(self, kind: Kind) -> None:
        """Choose the slices in this way."""
        self.kind.setCurrentIndex(self._kinds.index(kind))

    def keep_found(self, settings: GateSettings | None) -> None:
        """The gate of the target that the last search found; None when there is none."""
        self._found = settings
        self.changed.emit()

    def _on_kind(self) -> None:
        kind = self.kind.currentData()
        ranged = kind in ("delay", "depth")
        self.count.setVisible(kind == "lit" or ranged)
        of_range: list[QWidget] = [self.near, self.dash, self.far]
        of_hand: list[QWidget] = [self.add, self.clear, self.held]
        for widget in of_range:
            widget.setVisible(ranged)
        self.delays.setVisible(kind == "list")
        for widget in of_hand:
            widget.setVisible(kind == "hand")
        self._show_held()
        self.changed.emit()

    def _add(self) -> None:
        resolved = self._session.resolved
        if resolved is not None:
            self._by_hand = (*self._by_hand, resolved.sent)
            self._show_held()
            self.changed.emit()

    def _clear(self) -> None:
        self._by_hand = ()
        self._show_held()
        self.changed.emit()

    def _show_held(self) -> None:
        count = len(self._by_hand)
        self.held.setText("no gate yet" if not count else "1 gate" if count == 1 else f"{count} gates")


def _metres(value: float, tip: str) -> NumberBox:
    spin = NumberBox()
    spin.setRange(0.05, MAX_DISTANCE_M)
    spin.setDecimals(3)
    spin.setSingleStep(0.05)
    spin.setSuffix(" m")
    spin.setValue(value)
    spin.setToolTip(f"{tip}, straight ahead ({MAX_DISTANCE_M:g} m: infinity)")
    spin.setAccessibleName(tip)
    return spin
