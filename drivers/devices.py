"""The device list: what is plugged in, and what could be if its driver were here."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from slopegate.drivers.families import Family, Found
from slopegate.drivers.serial_port import SerialPort, list_ports, missing_serial
from slopegate.drivers.sync_boards import DIALECTS, identify
from slopegate.drivers.sync_dialect import BoardError
from slopegate.drivers.usb import UsbDevice, list_usb, missing_usb

TIMEOUT_S: Final = 8.0
"""Vendors' libraries broadcast for seconds; one that takes longer is reported as hanging."""


@dataclass(frozen=True)
class Missing:
    """A family that finds nothing because something is not here, or because it failed."""

    family: str
    title: str
    sentence: str


@dataclass(frozen=True)
class Survey:
    """One look at everything."""

    found: tuple[Found, ...]
    missing: tuple[Missing, ...]


def camera_families() -> list[Family]:
    """Every family of cameras that the program knows, whether its driver is here or not."""
    return [VIRTUAL]


def families() -> list[Family]:
    """Everything that can be plugged in."""
    return [*camera_families(), SERIAL, USB]


def survey(known: Sequence[Family] | None = None, timeout_s: float = TIMEOUT_S) -> Survey:
    """Ask every family at the same time; one that fails or hangs costs the others nothing. Never raises."""
    asked = list(families() if known is None else known)
    answers: queue.SimpleQueue[tuple[int, list[Found] | str]] = queue.SimpleQueue()
    for index, family in enumerate(asked):
        name = f"survey-{family.key}"
        threading.Thread(target=_ask, args=(index, family, answers), name=name, daemon=True).start()
    heard: dict[int, list[Found] | str] = {}
    end_s = time.monotonic() + timeout_s
    while len(heard) < len(asked):
        try:
            index, answer = answers.get(timeout=max(0.0, end_s - time.monotonic()))
        except queue.Empty:
            break
        heard[index] = answer
    found: list[Found] = []
    missing: list[Missing] = []
    for index, family in enumerate(asked):
        answer = heard.get(index, f"{family.title}: no answer within {timeout_s:g} s; its driver hangs.")
        if isinstance(answer, str):
            missing.append(Missing(family.key, family.title, answer))
        else:
            found += answer
    return Survey(tuple(found), tuple(missing))


def try_device(device: Found, known: Sequence[Family] | None = None) -> str:
    """Open it, see that it works, let it go; one sentence on what answered. Raises whatever its driver raises."""
    for family in families() if known is None else known:
        if family.key == device.family:
            if family.test is None:
                raise ValueError(f"{device.name}: {family.title} has nothing to test")
            return family.test(device)
    raise ValueError(f"{device.name}: there is no family {device.family!r}")


def _ask(index: int, family: Family, answers: queue.SimpleQueue[tuple[int, list[Found] | str]]) -> None:
    try:
        sentence = family.missing()
        answers.put((index, sentence or family.find()))
    except Exception as error:  # a vendor's library may raise anything
        answers.put((index, f"{family.title}: {str(error) or type(error).__name__}"))


def _find_serial() -> list[Found]:
    return [
        Found("board", "serial", port.usb_key or port.path, port.name or "Serial port", port.path)
        for port in list_ports()
    ]


def _test_serial(device: Found) -> str:
    """Ask in every dialect who is there; greetings change nothing on any of the instruments."""
    for dialect in DIALECTS:
        try:
            name, baud = identify(lambda baud: SerialPort(device.where, baud), dialect)
        except BoardError:
            continue
        return f"{name} answers ({dialect.title}, {baud} baud)."
    raise BoardError(f"Nothing that this program knows answers on {device.detail or device.where}.")


def _found_on_usb(device: UsbDevice) -> Found:
    serial = f"serial number {device.serial}" if device.serial else ""
    detail = ", ".join(part for part in (device.ids, serial, device.link) if part)
    where = f"usb:{device.ids}:{device.serial}" if device.serial else f"usb:{device.bus}:{device.address}"
    return Found("usb", "usb", where, device.name, detail, device.problem)


VIRTUAL: Final = Family(
    "virtual",
    "camera",
    "Virtual camera",
    lambda: "",
    lambda: [Found("camera", "virtual", "virtual", "Virtual camera", "looks at the scene that is open")],
)
SERIAL: Final = Family("serial", "board", "Serial ports", missing_serial, _find_serial, _test_serial)
USB: Final = Family("usb", "usb", "USB", missing_usb, lambda: [_found_on_usb(device) for device in list_usb()])
