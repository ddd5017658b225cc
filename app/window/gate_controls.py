"""The gate as settings and as a plane, side by side: what was asked, what the hardware does, what is sent."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, QSize, Qt, Signal
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QCheckBox,
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from slopegate.app.session.delays import lit_ends, useful_delays_us
from slopegate.app.session.describe import gate_text, line_text, meaning_text, measured
from slopegate.app.session.session import Change, Intent, PlaneWish, Resolved, Session
from slopegate.app.session.source import Source
from slopegate.app.widgets.checked import MarkWhenChecked
from slopegate.app.widgets.controls import Ladder, Linear, Logarithmic, NumberControl, mnemonic
from slopegate.app.widgets.elided import ElidedLabel
from slopegate.app.widgets.number_box import NumberBox
from slopegate.app.widgets.steady import ChoiceBox
from slopegate.core.rig.arrays import Singles
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import GateSettings, PixelClocks, gate
from slopegate.drivers.contract.frame import Abilities


class NamedBox(QGroupBox):
    """Named gates, the complement, and what the camera is told."""

    def __init__(self, session: Session, parent: QWidget) -> None:
        super().__init__("Gate", parent)
        self._session = session
        self.choice = ChoiceBox(self)
        self.choice.setPlaceholderText("Named gates ...")
        self.choice.setToolTip("Gates that suit this scene. Keys: Ctrl+1, Ctrl+2, ...")
        self.choice.setAccessibleName("Named gates")
        self.choice.setSizeAdjustPolicy(ChoiceBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.choice.setMinimumContentsLength(14)
        self.choice.activated.connect(self._on_chosen)
        self.complement = QCheckBox("C&omplement", self)
        self.complement.setToolTip("Record all but this gate: the rest of the projector's period (Ctrl+M, Alt+O)")
        shortcut = QShortcut(QKeySequence("Ctrl+M"), self)
        shortcut.setWhatsThis("Record all but this gate, or the gate itself")
        shortcut.activated.connect(self.complement.click)
        self.complement.toggled.connect(session.ask_complement)
        self._why = ""
        self._hints: dict[QWidget, str] = {widget: widget.toolTip() for widget in (self.choice, self.complement)}
        self.sent = ElidedLabel(self)
        self.warning = ElidedLabel(self)
        layout = QVBoxLayout(self)
        layout.setSpacing(2)
        for widget in (self.choice, self.complement, self.sent, self.warning):
            layout.addWidget(widget)

    def set_missing(self, why: str) -> None:
        """Switch everything off, with the reason; on again with an empty one."""
        self._why = why
        for widget in (self.choice, self.complement):
            widget.setEnabled(not why)
            widget.setToolTip(why or self._hints[widget])

    def set_presets(self, names: list[str]) -> None:
        """The names of this scene's gates."""
        with QSignalBlocker(self.choice):
            self.choice.clear()
            self.choice.addItems(names)

    def refresh(self, rig: Rig, resolved: Resolved, intent: Intent) -> None:
        """Show the present gate's name, if it has one, and what is sent."""
        source = self._session.source
        assert source is not None
        now = (intent.wish, resolved.gate)
        named = [preset.settings in now and preset.complement == intent.complement for preset in source.presets]
        with QSignalBlocker(self.choice), QSignalBlocker(self.complement):
            self.choice.setCurrentIndex(named.index(True) if True in named else -1)
            self.complement.setChecked(intent.complement)
        line = line_text(rig, resolved.sent.line_time_us)
        told = source.camera.info.limits is not None
        by = " (delay by the board)" if source.camera.info.board else ""
        self.sent.set_full_text(f"Sent: {line}, {gate_text(resolved.sent)}{by}" if told else "This camera has no gate.")
        self.warning.set_full_text(self._why or "; ".join(resolved.read_out.warnings))

    def _on_chosen(self, index: int) -> None:
        source = self._session.source
        if source is not None and 0 <= index < len(source.presets):
            self._session.use(source.presets[index])


PLANE_FIELDS = ("tilt_deg", "distance_m", "thickness_m")
_NO_VALUE = "\u221e"
_NO_SLAB = "\u2013"
_MOST_DEG = 89.9
_LEAST_M = 0.0001
_ASKED, _ACHIEVED, _WITH_ERRORS, _OFF = (
    "asked -16666.667",
    "= 999.9999 m",
    "= 0.00000 \u00b1 0.00000 m ",
    "(+99.9999)",
)
"""What read-outs have room for, as long as they need no more."""
_WITH_ERROR = "; \u00b1 one standard error, by the rig's calibration"


class GateControls(QWidget):
    """Controls that edit the session's gate and show what the hardware makes of it. They hold no gate of their own."""

    refused = Signal(str)
    """One sentence on what was typed and cannot be set."""
    edited = Signal()
    """Something else is being typed."""
    withdrawn = Signal(str)
    """Such a sentence that is out of date."""

    def __init__(self, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._session = session
        self._rig: Rig | None = None
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        self.settings = SettingsBox(session, self)
        self.plane = PlaneBox(session, self)
        self.named = NamedBox(session, self)
        row.addWidget(self.settings, 5)
        row.addWidget(self.plane, 3)
        row.addWidget(self.named, 3)
        controls = (self.settings.line, self.settings.delay, self.settings.exposure)
        for spin in (*(control.spin for control in controls), *self.plane.spins):
            spin.refused.connect(self.refused)
            spin.typed.connect(self.edited)
            spin.withdrawn.connect(self.withdrawn)
        self.setEnabled(False)
        session.changed.connect(self._on_changed)

    def _on_changed(self, change: Change) -> None:
        source, present = self._session.source, self._session.present
        if source is None or present is None:
            return
        resolved, intent = present
        if Change.SOURCE in change:
            self.setEnabled(True)
            self.settings.set_rig(source.rig)
            self.named.set_presets([preset.name for preset in source.presets])
        if change & (Change.SOURCE | Change.DEPTH):
            self.settings.set_scene(source)
        if change & (Change.SOURCE | Change.HOLD):
            held = self._session.held("gate")
            why = "" if held is None else held.sentence
            self.settings.set_abilities(source.camera.info.can, why)
            self.plane.set_missing(source.no_plane or why)
            self.named.set_missing(source.no_gate or why)
        if change & (Change.GATE | Change.REFUSED | Change.HOLD | Change.PRESENT):
            self.settings.refresh(source.rig, resolved)
            self.plane.refresh(source.rig, resolved, intent.complement)
            self.named.refresh(source.rig, resolved, intent)


class SettingsBox(QGroupBox):
    """Pixel clock or line time, delay and exposure."""

    def __init__(self, session: Session, parent: QWidget) -> None:
        super().__init__("Settings", parent)
        self._session = session
        unit = Linear(0.0, 1.0, 1.0)
        self.line, self.delay, self.exposure = (NumberControl(unit, self) for _ in range(3))
        self.asked = [QLabel(self) for _ in range(3)]
        self.delay.describe(
            "&Delay",
            " \u00b5s",
            "To the middle of row 0's exposure: turns the slab about its hinge; drag with Shift: finely. Keys: , and .",
        )
        self.exposure.describe("&Exposure", " \u00b5s", "How long each row looks: opens the slab. Keys: ; and '")
        grid = QGridLayout(self)
        grid.setColumnStretch(1, 1)
        grid.setVerticalSpacing(4)
        self._ends: Singles | None = None
        self.whole = QToolButton(self)
        self.whole.setText("\u2194")
        self.whole.setCheckable(True)
        self.whole.setAutoRaise(True)
        MarkWhenChecked(self.whole)
        self.whole.setAccessibleName("Whole range of delays")
        self.whole.setToolTip(
            "Let the slider go through all delays that the camera takes, not only those that meet the scene"
        )
        self.whole.toggled.connect(self._show_reach)
        QWidget.setTabOrder(self.delay.slider, self.whole)
        QWidget.setTabOrder(self.whole, self.delay.spin)
        for row, (control, asked) in enumerate(zip(self._controls(), self.asked, strict=True)):
            grid.addWidget(control.label, row, 0)
            track = QHBoxLayout()
            track.setSpacing(2)
            track.addWidget(control.slider, 1)
            if control is self.delay:
                track.addWidget(self.whole)
            grid.addLayout(track, row, 1)
            grid.addWidget(control.spin, row, 2)
            grid.addWidget(asked, row, 3)
            _write(asked, "", _ASKED)
            asked.setToolTip("The exact value for what was asked; the hardware uses the one to its left")
            control.slider.setMinimumWidth(80)
        self.line.edited.connect(self._on_line)
        self.delay.edited.connect(lambda value: self._ask(delay_us=value))
        self.exposure.edited.connect(lambda value: self._ask(exposure_us=value))
        keys = (("[", self.line, -1), ("]", self.line, 1), (",", self.delay, -10), (".", self.delay, 10))
        names = {self.line: "pixel clock or line time", self.delay: "delay", self.exposure: "exposure"}
        for key, control, steps in (*keys, (";", self.exposure, -5), ("'", self.exposure, 5)):
            shortcut = QShortcut(QKeySequence(key), self)
            shortcut.setWhatsThis(f"{'Less' if steps < 0 else 'More'} {names[control]}")
            shortcut.setContext(Qt.ShortcutContext.WindowShortcut)
            shortcut.activated.connect(lambda control=control, steps=steps: control.step(steps))

    def _controls(self) -> tuple[NumberControl, NumberControl, NumberControl]:
        return self.line, self.delay, self.exposure

    def set_rig(self, rig: Rig) -> None:
        """The scales of this rig's camera."""
        limits = rig.camera.shutter
        if isinstance(limits.line, PixelClocks):
            self.line.set_scale(Ladder(limits.line.ladder_mhz))
            self.line.describe("&Pixel clock", " MHz", "Sets the line time: places the slab's hinge. Keys: [ and ]")
        else:
            self.line.set_scale(Linear(limits.line.min_us, limits.line.max_us, limits.line.step_us))
            self.line.describe("&Line time", " \u00b5s", "Time from row to row: places the slab's hinge. Keys: [ and ]")
        delay, exposure = limits.delay_us, limits.exposure_us
        self.delay.set_scale(Linear(delay.min, delay.max, delay.step))
        self.exposure.set_scale(Logarithmic(exposure.min, exposure.max, exposure.step))
        width = max(control.spin.sizeHint().width() for control in self._controls())
        for control in self._controls():
            control.spin.setFixedWidth(width)

    def set_scene(self, source: Source) -> None:
        """What the slider of the delay is to meet."""
        self._ends = lit_ends(source)

    def _show_reach(self) -> None:
        source, present = self._session.source, self._session.present
        if source is None or present is None:
            return
        delay = source.rig.camera.shutter.delay_us
        useful = useful_delays_us(source.rig, present[0].gate, self._ends)
        self.delay.set_reach(*((delay.min, delay.max) if self.whole.isChecked() else useful))

    def set_abilities(self, can: Abilities, held: str) -> None:
        """Switch off what this camera cannot be told, or everything where the gate is held, with the reason."""
        for control, ability in zip(self._controls(), (can.line_time, can.delay, can.exposure), strict=True):
            control.set_missing(ability.missing or held)

    def refresh(self, rig: Rig, resolved: Resolved) -> None:
        """Show the hardware's values, and the exact ones where they differ."""
        line = rig.camera.shutter.line
        got, asked = resolved.gate, resolved.asked
        lines = got.line_time_us, asked.line_time_us
        if isinstance(line, PixelClocks):
            ladder = Ladder(line.ladder_mhz)
            lines = ladder.snap(line.clock_mhz(got.line_time_us)), line.clock_mhz(asked.line_time_us)
        pairs = (
            lines,
            (float(got.delay_us), float(asked.delay_us)),
            (got.exposure_us, asked.exposure_us),
        )
        for control, label, (value, wanted) in zip(self._controls(), self.asked, pairs, strict=True):
            control.show_value(value)
            met = abs(wanted - value) < 5e-4 or not control.spin.isEnabled()
            _write(label, "" if met else f"asked {wanted:.3f}", _ASKED)
        self._show_reach()

    def _on_line(self, value: float) -> None:
        source = self._session.source
        if source is not None:
            line = source.rig.camera.shutter.line
            self._ask(line_time_us=line.line_time_us(value) if isinstance(line, PixelClocks) else value)

    def _ask(self, **changes: float) -> None:
        resolved = self._session.resolved
        if resolved is not None:
            self._session.ask_wish(with_changes(resolved.gate, changes))


def with_changes(settings: GateSettings, changes: dict[str, float]) -> GateSettings:
    """The same gate but for these fields."""
    values = {"line_time_us": settings.line_time_us, "delay_us": float(settings.delay_us)}
    values["exposure_us"] = settings.exposure_us
    return gate(**{**values, **changes})


class RoomyLabel(QLabel):
    """Wrapped text that takes the room there is and asks for none: the layout does not move with its words."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWordWrap(True)

    def hasHeightForWidth(self) -> bool:
        """Qt would reserve the height that the text takes at its narrowest."""
        return False

    def sizeHint(self) -> QSize:
        return QSize(0, 0)

    def minimumSizeHint(self) -> QSize:
        return QSize(0, 0)


def _achieved(value: float | None, error: float | None, digits: int, unit: str) -> str:
    if value is None:
        return _NO_VALUE
    shown = f"{round(value, digits) + 0.0:.{digits}f}" if error is None else measured(value, error)
    return f"{shown}{unit}"


def _write(label: QLabel, text: str, usual: str) -> None:
    """Write into a label that is wide enough for what may follow, so that the layout does not move with the numbers;
    one that takes more room gets it.
    """
    label.setText(text)
    label.setMinimumWidth(max(label.fontMetrics().horizontalAdvance(some) for some in (text, usual)))


class PlaneBox(QGroupBox):
    """Tilt, distance and thickness: asked, achieved, and the difference."""

    def __init__(self, session: Session, parent: QWidget) -> None:
        super().__init__("Plane on the axis", parent)
        self._session = session
        rows = (
            ("&Tilt", "\u00b0", -180.0, 180.0, 2, 1.0, "From the vertical; positive when the top leans away"),
            ("D&istance", " m", 0.0, 999.0, 3, 0.01, "Of the slab's middle along the axis, from the rig's origin"),
            ("Thic&kness", " m", 0.0, 999.0, 4, 0.005, "Of the slab along the axis"),
        )
        self._grid = grid = QGridLayout(self)
        grid.setVerticalSpacing(4)
        self.spins: list[NumberBox] = []
        self._hints: list[str] = []
        self.labels: list[QLabel] = []
        self.achieved: list[QLabel] = []
        self.residuals: list[QLabel] = []
        for row, (name, suffix, low, high, decimals, step, hint) in enumerate(rows):
            spin = NumberBox(self)
            spin.setRange(low, high)
            spin.setDecimals(decimals)
            spin.setSingleStep(step)
            spin.setSuffix(suffix)
            if low == 0:
                spin.setSpecialValueText(_NO_VALUE)
                spin.set_limits(_LEAST_M, high)
            else:  # planes beyond infinity are shown with their tilt, which nobody can ask for
                spin.set_limits(-_MOST_DEG, _MOST_DEG)
            label = QLabel(name, self)
            label.setBuddy(spin)
            spin.setAccessibleName(name.replace("&", ""))
            for widget in (label, spin):
                widget.setToolTip(f"{hint}. {mnemonic(name)}")
            self._hints.append(spin.toolTip())
            got, off = QLabel(self), QLabel(self)
            _write(got, "", _ACHIEVED)
            _write(off, "", _OFF)
            off.setToolTip("Achieved minus asked")
            for column, cell in enumerate((label, spin, got, off)):
                grid.addWidget(cell, row, column)
            spin.valueChanged.connect(lambda value, field=PLANE_FIELDS[row]: self._ask(field, value))
            self.labels.append(label)
            self.spins.append(spin)
            self.achieved.append(got)
            self.residuals.append(off)
        grid.setColumnStretch(1, 1)
        self.meaning = RoomyLabel(self)
        """What the gate keeps, in place of the numbers of a slab that it is not."""
        self.meaning.hide()
        grid.addWidget(self.meaning, 0, 2, len(rows), 2)

    def set_missing(self, why: str) -> None:
        """Switch the fields off, with the reason; on again with an empty one."""
        self.setToolTip(why)
        for spin, label in zip(self.spins, self.labels, strict=True):
            spin.setEnabled(not why)
            label.setEnabled(not why)
        for spin, hint in zip(self.spins, self._hints, strict=True):
            spin.setToolTip(why or hint)

    def refresh(self, rig: Rig, resolved: Resolved, left_out: bool) -> None:
        """Show the wish and what the hardware makes of it; `left_out` when the complement of this slab is recorded.

        Of a gate that is no slab, what it keeps.
        """
        wish, got = resolved.asked_plane, resolved.slab
        for label in (*self.achieved, *self.residuals):
            label.setVisible(got is not None)
        self.meaning.setVisible(got is None)
        self._grid.setColumnStretch(1, 0 if got is None else 1)
        self._grid.setColumnStretch(2, 1 if got is None else 0)
        if got is None:
            self._show_no_slab(rig, resolved)
            return
        self.setTitle("Plane on the axis: left out" if left_out else "Plane on the axis")
        for index, field in enumerate(PLANE_FIELDS):
            value, spin = getattr(got, field), self.spins[index]
            asked = value if wish is None else float(getattr(wish, field))
            with QSignalBlocker(spin):
                spin.setSpecialValueText(_NO_VALUE if spin.minimum() == 0 else "")
                spin.setValue(0.0 if asked is None else asked)
            digits = spin.decimals()
            shown = self.achieved[index]
            text = f"= {_achieved(value, got.error(field), digits, spin.suffix())}"
            _write(shown, text, _ACHIEVED if got.errors is None else _WITH_ERRORS)
            shown.setToolTip(f"Achieved by the hardware{'' if got.errors is None else _WITH_ERROR}")
            off = 0.0 if value is None or asked is None else value - asked
            _write(self.residuals[index], "" if abs(off) < 0.5 * 10**-digits else f"({off:+.{digits}f})", _OFF)

    def _show_no_slab(self, rig: Rig, resolved: Resolved) -> None:
        self.setTitle("What the gate keeps")
        self.meaning.setText(f"{meaning_text(rig, resolved.sent)}.")
        self.meaning.setToolTip(resolved.read_out.why)
        for spin in self.spins:
            with QSignalBlocker(spin):
                spin.setSpecialValueText(_NO_SLAB)
                spin.setValue(spin.minimum())

    def _ask(self, field: str, value: float) -> None:
        session = self._session
        resolved = session.resolved
        if resolved is None:
            return
        base = resolved.asked_plane or session.last_plane or PlaneWish(0.0, 1.0, 0.1)
        values = {name: float(getattr(base, name)) for name in PLANE_FIELDS}
        session.ask_wish(PlaneWish(**{**values, field: value}))
