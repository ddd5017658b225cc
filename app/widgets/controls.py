"""Number controls: a slider and a spin box that share one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from PySide6.QtCore import QObject, QSignalBlocker, Signal
from PySide6.QtWidgets import QLabel, QWidget

from slopegate.app.widgets.number_box import NumberBox
from slopegate.app.widgets.steady import ValueSlider


class Scale(Protocol):
    """Slider positions 0..last and the values they stand for."""

    @property
    def last(self) -> int: ...
    @property
    def page(self) -> int:
        """How many positions a page key moves."""
        ...

    @property
    def decimals(self) -> int: ...
    def value(self, position: int) -> float: ...
    def position(self, value: float) -> int: ...
    def snap(self, value: float) -> float:
        """The value on the scale that is nearest to this one."""
        ...


@dataclass(frozen=True)
class Ladder:
    """A scale with a rising list of values."""

    values: tuple[float, ...]

    @property
    def last(self) -> int:
        """Number of rungs less one."""
        return len(self.values) - 1

    @property
    def page(self) -> int:
        """Five rungs."""
        return 5

    @property
    def decimals(self) -> int:
        """As many as the rungs need, at most three."""
        return _decimals(self.values)

    def value(self, position: int) -> float:
        """The rung's value."""
        return self.values[min(max(position, 0), self.last)]

    def position(self, value: float) -> int:
        """The nearest rung."""
        return min(range(len(self.values)), key=lambda rung: abs(self.values[rung] - value))

    def snap(self, value: float) -> float:
        """The nearest rung's value."""
        return self.values[self.position(value)]


@dataclass(frozen=True)
class Linear:
    """A scale in equal steps: low, low + step, ... up to high."""

    low: float
    high: float
    step: float
    page: int = 100

    @property
    def last(self) -> int:
        """Number of steps."""
        return math.floor((self.high - self.low) / self.step + 1e-9)

    @property
    def decimals(self) -> int:
        """As many as the step needs, at most three."""
        return _decimals((self.low, self.step))

    def value(self, position: int) -> float:
        """low + position * step, without what doubles leave of it in the sixteenth digit."""
        return round(self.low + min(max(position, 0), self.last) * self.step, 9)

    def position(self, value: float) -> int:
        """The nearest step."""
        return min(max(round((value - self.low) / self.step), 0), self.last)

    def snap(self, value: float) -> float:
        """The nearest step's value."""
        return self.value(self.position(value))


@dataclass(frozen=True)
class Logarithmic:
    """A scale in equal ratios from low to high. Each value is rounded to a multiple of `step` above low."""

    low: float
    high: float
    step: float
    last: int = 600
    page: int = 25

    @property
    def decimals(self) -> int:
        """As many as the step needs, at most three."""
        return _decimals((self.low, self.step))

    def value(self, position: int) -> float:
        """low * (high / low) ** (position / last), rounded."""
        share = min(max(position, 0), self.last) / self.last
        return self.snap(self.low * (self.high / self.low) ** share)

    def position(self, value: float) -> int:
        """The nearest position, by ratio."""
        inside = min(max(value, self.low), self.high)
        return round(self.last * math.log(inside / self.low) / math.log(self.high / self.low))

    def snap(self, value: float) -> float:
        """The nearest multiple of step."""
        return Linear(self.low, self.high, self.step).snap(value)


def mnemonic(name: str) -> str:
    """The shortcut of a control, from the letter after & in its name."""
    return f"Alt+{name[name.index('&') + 1].upper()}"


def _decimals(values: Sequence[float]) -> int:
    for count in range(3):
        if all(math.isclose(value, round(value, count), rel_tol=0, abs_tol=1e-9) for value in values):
            return count
    return 3


def stepped(scale: Scale, value: float, steps: int) -> float:
    """The value this many positions away, but at least the next one on the scale, and within it."""
    here = scale.position(value)
    there = min(max(here + steps, 0), scale.last)
    while scale.value(there) == value and 0 < there < scale.last:
        there += 1 if steps > 0 else -1
    return scale.value(there)


class ScaleSpinBox(NumberBox):
    """A spin box that steps along a scale and snaps what is typed."""

    fate = "It is now"

    def __init__(self, scale: Scale, suffix: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.set_scale(scale)
        self.setSuffix(suffix)

    def set_scale(self, scale: Scale) -> None:
        """Use another range and other steps."""
        self.scale = scale
        self.setDecimals(scale.decimals)
        self.setRange(scale.value(0), scale.value(scale.last))

    def stepBy(self, steps: int) -> None:
        """Arrow keys move by one position, page keys by ten."""
        self.interpretText()
        if abs(steps) > 1:
            steps = self.scale.page if steps > 0 else -self.scale.page
        self.setValue(stepped(self.scale, self.value(), steps))
        self.selectAll()

    def settable(self, number: float) -> float:
        """The nearest value on the scale."""
        return self.scale.snap(number)


class NumberControl(QObject):
    """Name, slider and spin box for one number. The caller lays out the three widgets."""

    edited = Signal(float)
    """A new value chosen by the user, on the scale."""

    def __init__(self, scale: Scale, parent: QWidget) -> None:
        super().__init__(parent)
        self.label = QLabel(parent)
        self.slider = ValueSlider(parent)
        self.spin = ScaleSpinBox(scale, "", parent)
        self.label.setBuddy(self.spin)
        self._scale = scale
        self._reach = (0, scale.last)
        self._value = scale.value(0)
        self._hint = ""
        self.slider.valueChanged.connect(self._on_slider)
        self.spin.valueChanged.connect(self._on_spin)

    def describe(self, name: str, suffix: str, hint: str) -> None:
        """Set name (with & before its shortcut, if it has one), unit and tool tip."""
        self.label.setText(name)
        self.spin.setSuffix(suffix)
        plain = name.replace("&", "")
        self.slider.setAccessibleName(f"{plain} slider")
        self.spin.setAccessibleName(plain)
        self._hint = f"{hint}, {mnemonic(name)}" if "&" in name else hint
        self.set_missing("")

    def set_missing(self, why: str) -> None:
        """Switch the control off, with the reason as its tool tip; an empty reason switches it on again."""
        for widget in (self.label, self.slider, self.spin):
            widget.setEnabled(not why)
            widget.setToolTip(why or self._hint)

    def set_scale(self, scale: Scale) -> None:
        """Use another scale, such as another camera's. Call `show_value` next."""
        self._scale, self._reach = scale, (0, scale.last)
        with QSignalBlocker(self.slider), QSignalBlocker(self.spin):
            self.slider.setRange(0, scale.last)
            self.slider.setPageStep(scale.page)
            self.spin.set_scale(scale)

    def set_reach(self, low: float, high: float) -> None:
        """Let the slider go from one value to another, within the scale; the field takes all of it.

        A value beyond them makes the slider longer, until it is shown another one.
        """
        self._reach = self._scale.position(low), self._scale.position(high)
        self._stretch()

    def _stretch(self) -> None:
        here, (low, high) = self._scale.position(self._value), self._reach
        with QSignalBlocker(self.slider):
            if not self.slider.isSliderDown():  # the hand holds a place on the track, which must not move
                self.slider.setRange(min(low, here), max(high, here, low + 1))
            self.slider.setValue(here)

    @property
    def value(self) -> float:
        """The value shown."""
        return self._value

    def show_value(self, value: float) -> None:
        """Show a value without emitting `changed`. One beyond the scale stands at its end."""
        self._value = value
        with QSignalBlocker(self.slider), QSignalBlocker(self.spin):
            # a slider under the mouse stays where the hand put it
            if self._scale.value(self.slider.value()) != value:
                self._stretch()
            if self.spin.value() != value:
                self.spin.setValue(value)

    def step(self, steps: int) -> None:
        """Move by whole positions, as the arrow keys do. Nothing happens while the control is switched off."""
        if self.spin.isEnabled():
            self._choose(stepped(self._scale, self._value, steps))

    def _choose(self, value: float) -> None:
        if value != self._value:
            self.show_value(value)
            self.edited.emit(value)

    def _on_slider(self, position: int) -> None:
        self._choose(self._scale.value(position))

    def _on_spin(self, value: float) -> None:
        snapped = self._scale.snap(value)
        if snapped != value:
            if self.spin.is_other(value):
                self.spin.say_nearest(value, snapped)
            with QSignalBlocker(self.spin):
                self.spin.setValue(snapped)
        self._choose(snapped)
