"""Keys that a widget understands by itself while it has the focus, told in one place: for it and for lists of keys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeyEvent, QKeySequence


@dataclass(frozen=True)
class OwnKey:
    """What some keys do in a widget."""

    keys: tuple[Qt.Key, ...]
    does: str
    act: Callable[[Qt.Key], object]

    @property
    def shown(self) -> str:
        """The keys as they are written on them."""
        return ", ".join(QKeySequence(key).toString(QKeySequence.SequenceFormat.NativeText) for key in self.keys)


@runtime_checkable
class HasOwnKeys(Protocol):
    """A widget with keys of its own."""

    def own_keys(self) -> tuple[OwnKey, ...]:
        """All of them."""
        ...

    def accessibleName(self) -> str:
        """What it is called."""
        ...


def act_on(event: QKeyEvent, keys: tuple[OwnKey, ...]) -> bool:
    """Do what the pressed key is for; False where it is none of them."""
    pressed = Qt.Key(event.key())
    for one in keys:
        if pressed in one.keys:
            one.act(pressed)
            return True
    return False
