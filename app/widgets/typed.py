"""Spin boxes that never set another number than the one typed without saying so."""

from __future__ import annotations

import math

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QValidator
from PySide6.QtWidgets import QDoubleSpinBox, QWidget


class TypedSpinBox(QDoubleSpinBox):
    """Lets anything be typed and checks it when editing ends. What is not possible leaves the value as it was."""

    fate = "It is still"
    """What becomes of a number that is not possible."""
    refused = Signal(str)
    """One sentence that says why the number typed is not possible."""
    edited = Signal()
    """The text was changed by a key."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._limits: tuple[float, float] | None = None
        self.setKeyboardTracking(False)
        self.lineEdit().textEdited.connect(lambda _: self.edited.emit())
        self.setAlignment(Qt.AlignmentFlag.AlignRight)

    def set_limits(self, low: float, high: float) -> None:
        """Set what may be typed, where a wider range can be shown."""
        self._limits = low, high

    @property
    def limits(self) -> tuple[float, float]:
        """The lowest and the highest number that may be typed."""
        return self._limits or (self.minimum(), self.maximum())

    def validate(self, text: str, position: int) -> tuple[QValidator.State, str, int]:
        """Accept every key; only a number that can be set counts as finished."""
        state, shown, cursor = super().validate(text, position)
        number = self._number(text)
        typed_beyond = number is not None and not self.limits[0] <= number <= self.limits[1]
        if state == QValidator.State.Invalid or (typed_beyond and text != self._text_of(self.value())):
            return QValidator.State.Intermediate, text, position
        return state, shown, cursor

    def fixup(self, text: str) -> str:
        """The text to show when editing ends: the number as it can be set, or the value from before."""
        number = self._number(text)
        if text == self._text_of(self.value()):
            return text
        if number is None:
            bare = text.removesuffix(self.suffix()).strip()
            if bare:
                self.refused.emit(f"{self.accessibleName()}: {bare!r} is not a number.")
            return self._text_of(self.value())
        low, high = self.limits
        kept = self.settable(number)
        if not low <= number <= high:
            fate = f"{self.fate} {kept:.{self.decimals()}f}{self.suffix()}"
            allowed = f"{low:.7g} to {high:.7g}{self.suffix()}"
            self.refused.emit(f"{self.accessibleName()}: {number:.15g} is not possible: {allowed}. {fate}.")
        elif kept != number:
            self.say_nearest(number, kept)
        return self._text_of(kept)

    def say_nearest(self, number: float, kept: float) -> None:
        """Say that another number than the one typed is set, the nearest that there is."""
        unit = self.suffix()
        self.refused.emit(
            f"{self.accessibleName()}: there is no {number:.15g}{unit}, the nearest is set: {kept:g}{unit}."
        )

    def settable(self, number: float) -> float:
        """The number that is set when this one is typed; here the same."""
        low, high = self.limits
        return number if low <= number <= high else self.value()

    def _number(self, text: str) -> float | None:
        bare = text.removesuffix(self.suffix()).strip()
        number, good = self.locale().toDouble(bare)
        return number if good and math.isfinite(number) else None

    def _text_of(self, value: float) -> str:
        if self.specialValueText() and value == self.minimum():
            return self.specialValueText()
        return self.textFromValue(value) + self.suffix()
