"""Lists the devices that are plugged in, and says what is missing to find others."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from slopegate.core.rig.checks import InputError, UserError
from slopegate.drivers.contract.families import Family, Found
from slopegate.drivers.devices.catalog import CAMERAS, VIRTUAL
from slopegate.drivers.devices.usb import UsbDevice, list_usb, missing_usb
from slopegate.drivers.files.library_words import words_of
from slopegate.drivers.sync.boards import who_answers
from slopegate.drivers.sync.serial_port import list_ports

_log = logging.getLogger(__name__)

TIMEOUT_S: Final = 8.0
"""Vendors' libraries broadcast for seconds; one that takes longer is reported as hanging."""


@dataclass(frozen=True)
class Missing:
    """A family of devices that could not be searched, and why."""

    family: str
    title: str
    sentence: str


@dataclass(frozen=True)
class Survey:
    """The result of one search."""

    found: tuple[Found, ...]
    missing: tuple[Missing, ...]


def families() -> list[Family]:
    """Every family of devices that the program knows, whether its driver is here or not."""
    return [VIRTUAL, *CAMERAS, SERIAL, USB]


class Surveyor:
    """Asks every family for its devices. A family that still hangs from last time is skipped. For use in one thread."""

    def __init__(self, known: Sequence[Family] | None = None) -> None:
        self._families = list(families() if known is None else known)
        self._asking: dict[str, threading.Thread] = {}

    def look(self, timeout_s: float = TIMEOUT_S) -> Survey:
        """Ask all families at the same time; one that fails or hangs does not delay the others. Never raises."""
        answers: queue.SimpleQueue[tuple[str, list[Found] | str]] = queue.SimpleQueue()
        expected = {family.key for family in self._families if self._ask(family, answers)}
        heard: dict[str, list[Found] | str] = {}
        end_s = time.monotonic() + timeout_s
        while expected - heard.keys():
            try:
                key, answer = answers.get(timeout=max(0.0, end_s - time.monotonic()))
            except queue.Empty:
                break
            heard[key] = answer
        found: list[Found] = []
        missing: list[Missing] = []
        for family in self._families:
            answer = heard.get(family.key, f"{family.title}: no answer within {timeout_s:g} s; its driver hangs.")
            if isinstance(answer, str):
                missing.append(Missing(family.key, family.title, answer))
            else:
                found += answer
        return Survey(tuple(found), tuple(missing))

    def _ask(self, family: Family, answers: queue.SimpleQueue[tuple[str, list[Found] | str]]) -> bool:
        before = self._asking.get(family.key)
        if before is not None and before.is_alive():
            return False
        name = f"survey-{family.key}"
        thread = threading.Thread(target=_answer, args=(family, answers), name=name, daemon=True)
        self._asking[family.key] = thread
        thread.start()
        return True


def survey(known: Sequence[Family] | None = None, timeout_s: float = TIMEOUT_S) -> Survey:
    """Search once."""
    return Surveyor(known).look(timeout_s)


def changes(before: Survey, after: Survey) -> tuple[list[Found], list[Found]]:
    """The devices plugged in and the devices pulled between two searches."""
    then, now = ({(device.family, device.where) for device in look.found} for look in (before, after))
    came = [device for device in after.found if (device.family, device.where) not in then]
    return came, [device for device in before.found if (device.family, device.where) not in now]


def try_device(device: Found, known: Sequence[Family] | None = None) -> str:
    """Open a device, see that it works and close it. Returns one sentence on what answered; raises UserError."""
    for family in families() if known is None else known:
        if family.key == device.family:
            if family.test is None:
                raise InputError(f"{device.name}: {family.title} has nothing to test")
            return family.test(device)
    raise InputError(f"{device.name}: there is no family {device.family!r}")


def _answer(family: Family, answers: queue.SimpleQueue[tuple[str, list[Found] | str]]) -> None:
    try:
        answers.put((family.key, family.missing() or family.find()))
    except UserError as error:
        answers.put((family.key, f"{family.title}: {error}"))
    except Exception as error:  # a vendor's library may raise anything; the other families are listed all the same
        _log.exception("%s could not be listed", family.title)
        answers.put((family.key, f"{family.title}: its driver failed ({type(error).__name__}: {words_of(error)})"))


def _find_serial() -> list[Found]:
    return [
        Found("board", "serial", port.usb_key or port.path, port.name or "Serial port", port.path)
        for port in list_ports()
    ]


def _test_serial(device: Found) -> str:
    name, dialect, baud = who_answers(device.where)
    return f"{name} answers ({dialect.title}, {baud} baud)."


def _found_on_usb(device: UsbDevice) -> Found:
    serial = f"serial number {device.serial}" if device.serial else ""
    detail = ", ".join(part for part in (device.ids, serial, device.link) if part)
    where = f"usb:{device.ids}:{device.serial}" if device.serial else f"usb:{device.bus}:{device.address}"
    return Found("usb", "usb", where, device.name, detail, device.problem)


SERIAL: Final = Family("serial", "board", "Serial ports", lambda: "", _find_serial, _test_serial)
USB: Final = Family("usb", "usb", "USB", missing_usb, lambda: [_found_on_usb(device) for device in list_usb()])
