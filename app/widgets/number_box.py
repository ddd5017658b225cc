"""Fields for numbers: one notation everywhere, and never another number than the one typed without saying so."""

from __future__ import annotations

import math
import re

from PySide6.QtCore import QEvent, QLocale, Qt, Signal
from PySide6.QtGui import QKeyEvent, QKeySequence, QValidator, QWheelEvent
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QDoubleSpinBox, QLabel, QVBoxLayout, QWidget

from slopegate.app.widgets.steady import wheel_is_meant

_NUMBER = re.compile(r"[+-]?(\d+[.]?\d*|[.]\d+)(e[+-]?\d+)?")
_GROUPED = re.compile(r"[+-]?\d+([.,\u066c'\u2019\s]\d+)+([.,\u066b]\d+)?")
_SAME_SIGNS = str.maketrans({",": ".", "\u066b": ".", "\u2212": "-", "E": "e"})
_QUOTED_LETTERS = 40


def read_number(text: str) -> float | None:
    """The number that is written there with a dot or a comma as its decimal mark; None where it is none.

    Digits of every script count. Marks between groups of digits do not: what they would mean differs from place to
    place.
    """
    plain = text.strip().translate(_SAME_SIGNS)
    number = float(plain) if _NUMBER.fullmatch(plain) else math.nan
    return number if math.isfinite(number) else None


def why_no_number(text: str) -> str:
    """What is wrong with a text that is no number, as the end of a sentence."""
    quoted = repr(text if len(text) <= _QUOTED_LETTERS else f"{text[: _QUOTED_LETTERS - 1]}\u2026")
    if _GROUPED.fullmatch(text.strip()):
        return f"{quoted} has marks between groups of digits: write it with one decimal mark, such as 1234.5"
    return f"{quoted} is not a number"


class NumberBox(QDoubleSpinBox):
    """Lets anything be typed and checks it when editing ends. What is not possible leaves the value as it was.

    Dot and comma are the decimal mark, whatever the desktop's language; shown are a dot, European digits and no
    groups. The mouse wheel changes only the field that has the focus.
    """

    fate = "It is still"
    """What becomes of a number that is not possible."""
    refused = Signal(str)
    """One sentence that says why the number typed is not possible."""
    typed = Signal()
    """The text was changed by a key."""
    withdrawn = Signal(str)
    """The sentence of a refusal, out of date: it tells the value that it left, and another one is shown."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._told: tuple[float, str] | None = None
        """The value that the last refusal left and its sentence, until another value is shown."""
        self._limits: tuple[float, float] | None = None
        self.setLocale(QLocale.c())
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setKeyboardTracking(False)
        self.lineEdit().textEdited.connect(lambda _: self.typed.emit())
        self.valueChanged.connect(self._outdate)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)

    def setValue(self, value: float) -> None:
        super().setValue(value)
        self._outdate()

    def _outdate(self) -> None:
        if self._told is None or abs(self.value() - self._told[0]) < 0.75 * 10.0 ** -self.decimals():
            return
        _, sentence = self._told
        self._told = None
        blocked = self.blockSignals(False)  # whoever sets a value need not hear of it, but whoever shows the sentence
        self.withdrawn.emit(sentence)
        self.blockSignals(blocked)

    def _refuse(self, sentence: str, left: float) -> None:
        self._told = left, sentence
        self.refused.emit(sentence)

    def set_limits(self, low: float, high: float) -> None:
        """Set what may be typed, where a wider range can be shown."""
        self._limits = low, high

    @property
    def limits(self) -> tuple[float, float]:
        """The lowest and the highest number that may be typed."""
        return self._limits or (self.minimum(), self.maximum())

    def validate(self, text: str, position: int) -> tuple[QValidator.State, str, int]:
        """Accept every key; only a number that can be set counts as finished."""
        number = self._number(text)
        if text == self._text_of(self.value()) or (number is not None and not self.is_other(number)):
            return QValidator.State.Acceptable, text, position
        return QValidator.State.Intermediate, text, position

    def valueFromText(self, text: str) -> float:
        number = self._number(text)
        return self.value() if number is None else number

    def fixup(self, text: str) -> str:
        """The text to show when editing ends: the number as it can be set, or the value from before."""
        number = self._number(text)
        if text == self._text_of(self.value()):
            return text
        low, high = self.limits
        allowed = f"{low:.7g} to {high:.7g}{self.suffix()}"
        if number is None:
            bare = self._bare(text)
            if bare:
                why = f"{why_no_number(bare)}; {allowed} is possible"
                self._refuse(f"{self._name}: {why}. {self._kept(self.value())}", self.value())
            return self._text_of(self.value())
        kept = self.settable(number)
        if not low <= number <= high:
            self._refuse(f"{self._name}: {number:.15g} is not possible: {allowed}. {self._fate_of(kept)}", kept)
        elif self.is_other(number):
            self.say_nearest(number, kept)
        return self._text_of(kept)

    def say_nearest(self, number: float, kept: float) -> None:
        """Say that another number than the one typed is set, the nearest that there is."""
        unit = self.suffix()
        sentence = f"{self._name}: there is no {number:.15g}{unit}, the nearest is set: {kept:.10g}{unit}."
        self._refuse(sentence, kept)

    def settable(self, number: float) -> float:
        """The number that is set when this one is typed: it itself, with as many decimals as the field has."""
        low, high = self.limits
        if not low <= number <= high:
            return self.value()
        return min(max(round(number, self.decimals()), low), high)

    def is_other(self, number: float) -> bool:
        """Whether another number than this one would be set for it. What rounding leaves of the same one is not."""
        low, high = self.limits
        kept = self.settable(number)
        shown = round(kept, self.decimals())
        met = any(math.isclose(number, near, rel_tol=1e-12, abs_tol=1e-9) for near in (kept, shown))
        return not (low <= number <= high and met)

    def event(self, event: QEvent) -> bool:
        """Undo and redo are the field's own only while something is typed in it."""
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent):
            steps = QKeySequence.StandardKey.Undo, QKeySequence.StandardKey.Redo
            if any(event.matches(step) for step in steps) and self.text() == self._text_of(self.value()):
                event.ignore()
                return False
        return super().event(event)

    def wheelEvent(self, event: QWheelEvent) -> None:
        if wheel_is_meant(self, event):
            super().wheelEvent(event)

    @property
    def _name(self) -> str:
        return self.accessibleName() or "Number"

    def _fate_of(self, kept: float) -> str:
        return f"{self.fate} {kept:.{self.decimals()}f}{self.suffix()}."

    def _kept(self, value: float) -> str:
        return f"It is still {self._text_of(value)}."

    def _bare(self, text: str) -> str:
        """The text without name and unit: they stay while the number between them is typed, and may be typed again."""
        before, after = self.prefix().strip(), self.suffix().strip()
        bare = text.strip()
        while before and bare.startswith(before):
            bare = bare.removeprefix(before).strip()
        while after and bare.endswith(after):
            bare = bare.removesuffix(after).strip()
        return bare

    def _number(self, text: str) -> float | None:
        if self.specialValueText() and text.strip() == self.specialValueText():
            return self.minimum()
        return read_number(self._bare(text))

    def _text_of(self, value: float) -> str:
        if self.specialValueText() and value == self.minimum():
            return self.specialValueText()
        return self.prefix() + self.textFromValue(value) + self.suffix()


class CountBox(NumberBox):
    """A field for whole numbers."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setDecimals(0)

    def value(self) -> int:
        """The number."""
        return round(super().value())


class FrameCount(CountBox):
    """How many frames are taken: says "1 frame" or "2 frames"."""

    def __init__(self, most: int, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setRange(1, most)
        self.setSuffix(" frame")
        self.valueChanged.connect(lambda count: self.setSuffix(" frame" if count == 1 else " frames"))

    def _bare(self, text: str) -> str:
        return super()._bare(re.sub(r"\s*frames?\s*$", "", text))


def ask_number(parent: QWidget, title: str, text: str, box: NumberBox) -> float | None:
    """Ask for a number in a dialog with this field; None where it is given up."""
    dialog = QDialog(parent)
    dialog.setWindowTitle(title)
    told = QLabel()
    told.setWordWrap(True)
    box.setAccessibleName(title)
    box.refused.connect(told.setText)
    box.typed.connect(told.clear)
    kinds = QDialogButtonBox.StandardButton
    buttons = QDialogButtonBox(kinds.Ok | kinds.Cancel)
    buttons.accepted.connect(dialog.accept)
    buttons.rejected.connect(dialog.reject)
    column = QVBoxLayout(dialog)
    for part in (QLabel(text), box, told, buttons):
        column.addWidget(part)
    box.selectAll()
    given = dialog.exec() == QDialog.DialogCode.Accepted
    value = box.value()
    dialog.deleteLater()
    return value if given else None
