"""PySide6 6.12 on Python 3.10 and 3.11 loses references to constants at signal emits, and so ends the process."""

from __future__ import annotations

import gc
import sys

import pytest
from PySide6.QtCore import QObject, Signal

EMITS = 1000
SPARE = [[constant] * (10 * EMITS) for constant in (None, True)]
"""References to lose, so that a leak fails the test before it ends the process."""


class Source(QObject):
    """Emits as the window does: nothing, a flag, an object."""

    nothing = Signal()
    flag = Signal(bool)
    thing = Signal(object)


def reference_change(value: object, source: Source) -> int:
    """How the reference count of a value changes over many emits."""
    gc.collect()
    before = sys.getrefcount(value)
    for _ in range(EMITS):
        source.nothing.emit()
        source.flag.emit(True)
        source.thing.emit(value)
    return sys.getrefcount(value) - before


@pytest.mark.parametrize("value", [None, True])
def test_emitting_signals_keeps_the_references_of_constants(value: object) -> None:
    """A leak shows as a thousand or more; a few references come and go with the interpreter's own work."""
    source = Source()
    received: list[int] = []
    for signal in (source.nothing, source.flag, source.thing):
        signal.connect(lambda *values: received.append(len(values)))
    assert abs(reference_change(value, source)) < EMITS // 10
    assert received == [0, 1, 1] * EMITS


def test_the_check_sees_a_leak() -> None:
    """Holding on to one reference an emit is counted as such."""
    source = Source()
    held: list[object] = []
    source.thing.connect(held.append)
    assert reference_change(object(), source) == EMITS
