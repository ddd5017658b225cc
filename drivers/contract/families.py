"""Families of devices for the device list: whether the driver is installed, what is plugged in, whether it works."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from slopegate.core.rig.checks import InputError

Kind = Literal["camera", "board", "usb"]


@dataclass(frozen=True)
class Address:
    """Family and place of a device; it stays the same when the device is plugged in again."""

    family: str
    where: str

    def __str__(self) -> str:
        """FAMILY:WHERE, as `read_address` reads it."""
        return f"{self.family}:{self.where}"


def read_address(text: str) -> Address:
    """The address in a text FAMILY:WHERE, as the device list shows it. Raises InputError."""
    family, colon, where = text.partition(":")
    if not (family and colon and where):
        raise InputError(f"{text!r} is no camera: it must be FAMILY:WHERE, as 'slopegate devices' lists them")
    return Address(family, where)


@dataclass(frozen=True)
class Found:
    """A device that is plugged in."""

    kind: Kind
    family: str
    """`Family.key`."""
    where: str
    """What opens it, also after it was plugged in again."""
    name: str
    detail: str = ""
    """Where it is, its serial number, its link."""
    problem: str = ""
    """What stands in its way and what to do, in one sentence; empty when nothing does."""

    @property
    def address(self) -> Address:
        """What opens it."""
        return Address(self.family, self.where)


@dataclass(frozen=True)
class Family:
    """One kind of device. Its functions block and may hang: the device list calls them in threads of their own."""

    key: str
    kind: Kind
    title: str
    missing: Callable[[], str]
    """One sentence naming the extra or driver to install; empty when all is installed. Must not raise."""
    find: Callable[[], list[Found]]
    """What is plugged in; any exception becomes a sentence in the list."""
    test: Callable[[Found], str] | None = None
    """Open a device, see that it works, close it; one sentence on what answered. Its exceptions are sentences too."""
