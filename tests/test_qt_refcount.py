"""PySide6 6.12 on Python 3.10 and 3.11 loses references to None and True at signal emits, and so ends the process."""

from __future__ import annotations

import gc
import sys

from PySide6.QtCore import QObject, Signal

EMITS = 20_000


class Source(QObject):
    """Emits as the window does: nothing, a flag, an object."""

    nothing = Signal()
    flag = Signal(bool)
    thing = Signal(object)


def reference_change(value: object, source: Source) -> int:
    """How the reference count of a constant changes over many emits."""
    gc.collect()
    before = sys.getrefcount(value)
    for _ in range(EMITS):
        source.nothing.emit()
        source.flag.emit(True)
        source.thing.emit(value)
    return sys.getrefcount(value) - before


def test_emitting_signals_keeps_the_references_of_constants() -> None:
    """A leak of one reference an emit would show as 20 000; a few come and go with the interpreter's own work."""
    source = Source()
    received: list[int] = []
    for signal in (source.nothing, source.flag, source.thing):
        signal.connect(lambda *values: received.append(len(values)))
    for value in (None, True):
        received.clear()
        assert abs(reference_change(value, source)) < EMITS // 100
        assert len(received) == 3 * EMITS


def test_the_check_sees_a_leak() -> None:
    """Holding on to one reference an emit is counted as such."""
    source = Source()
    held: list[object] = []
    value = object()
    source.thing.connect(held.append)
    assert reference_change(value, source) == EMITS
