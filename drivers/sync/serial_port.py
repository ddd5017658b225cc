"""Serial ports, each opened for one owner; whatever fails is told in one sentence."""

from __future__ import annotations

import errno
import getpass
import os
import sys
from dataclasses import dataclass
from typing import Any, Final, Protocol

from slopegate.core.rig.checks import UserError
from slopegate.drivers.files.library_words import words_of

WRITE_TIMEOUT_S: Final = 1.0


class PortError(UserError):
    """The port cannot be opened or has gone; the message is one sentence for the user."""


class Port(Protocol):
    """An open port. Every method but `close` raises PortError when the port has gone."""

    def write(self, data: bytes) -> None:
        """Send all of it."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """What has come; waits for the first byte, and returns nothing after the time-out."""
        ...

    def close(self) -> None:
        """Let it go; never raises."""
        ...


@dataclass(frozen=True)
class PortFacts:
    """A serial port of this computer."""

    path: str
    name: str
    """How the system describes it."""
    usb_key: str = ""
    """`usb:0403:6001:SERIAL` for an adapter with a serial number: stays the same in another socket."""


class SerialPort:
    """pyserial behind `Port`; open when constructed."""

    def __init__(self, where: str, baud: int) -> None:
        """`where` is a path or a `usb_key`. Raises PortError."""
        self._where = where
        path = find_port(where)
        import serial

        try:
            self._serial: Any = serial.Serial(path, baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise PortError(why_closed(path, error)) from None

    def write(self, data: bytes) -> None:
        """Send all of it."""
        try:
            self._serial.write(data)
        except OSError as error:
            raise PortError(_gone(self._where, error)) from None

    def read(self, timeout_s: float) -> bytes:
        """What has come within the time-out."""
        try:
            self._serial.timeout = timeout_s
            first = self._serial.read(1)
            return bytes(first) + bytes(self._serial.read(self._serial.in_waiting)) if first else b""
        except (OSError, TypeError) as error:  # pyserial's TypeError: closed by another thread in the middle
            raise PortError(_gone(self._where, error)) from None

    def close(self) -> None:
        """Let it go."""
        try:
            self._serial.close()
        except OSError:
            return


def list_ports() -> list[PortFacts]:
    """The serial ports of this computer, those of USB adapters first."""
    from serial.tools.list_ports import comports

    found = []
    for port in comports():
        key = f"usb:{port.vid:04x}:{port.pid:04x}:{port.serial_number}" if port.vid and port.serial_number else ""
        text = " ".join(str(part) for part in (port.manufacturer, port.product) if part)
        described = port.description if port.description not in (None, "n/a") else ""
        found.append((port.vid is None, PortFacts(str(port.device), text or described, key)))
    return [facts for _, facts in sorted(found, key=lambda entry: (entry[0], entry[1].path))]


def find_port(where: str) -> str:
    """The path of a port by path or `usb_key`; raises PortError when that adapter is not plugged in."""
    if not where.startswith("usb:"):
        return where
    for port in list_ports():
        if port.usb_key == where:
            return port.path
    raise PortError(f"The adapter {where} is not plugged in.")


def why_closed(path: str, error: Exception) -> str:
    """Why a port does not open, and what to do about it."""
    number = getattr(error, "errno", None)
    text = str(error)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "FileNotFoundError" in text:
        return f"There is no port {path}: is the cable plugged in?"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        return f"The port {path} is busy: another program has it open."
    if number in (errno.EACCES, errno.EPERM) or "PermissionError" in text:
        if sys.platform == "win32":  # where a port in use is refused with this error
            return f"The port {path} is busy: another program has it open."
        return f"The port {path} may not be opened by {_user()}: {permission_advice(path)}"
    if number == errno.ENOTTY or f"({errno.ENOTTY}," in text:  # a termios.error, quoted
        return f"{path} is not a serial port."
    return f"The port {path} does not open: {words_of(error)}."


def permission_advice(path: str) -> str:
    """The command that gives this user the port, by the group that owns it."""
    group = "dialout"
    try:
        import grp

        group = grp.getgrgid(os.stat(path).st_gid).gr_name
    except (ImportError, OSError, KeyError):
        pass
    if group == "root":
        group = "dialout"
    return f"run 'sudo usermod -aG {group} {_user()}', then log out and in again."


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "this user"


def _gone(where: str, error: Exception) -> str:
    if type(error).__name__ == "SerialTimeoutException":
        return f"The port {where} takes no more data."
    return f"The port {where} has gone: was the cable pulled?"
