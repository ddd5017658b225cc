"""Lists USB devices with names, serial numbers and link speeds, and says what to do if that is not allowed."""

from __future__ import annotations

import errno
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from slopegate.core.rig.checks import UserError
from slopegate.drivers.files.library_words import words_of

Role = Literal["camera", "serial", "other"]

CAMERA_VENDORS: Final = {
    0x1409: "IDS",
    0x1E10: "FLIR",
    0x2676: "Basler",
    0x1AB2: "Allied Vision",
    0x199E: "The Imaging Source",
    0x20F7: "XIMEA",
    0x2BDF: "Hikrobot",
    0x04B4: "Cypress (camera kit)",
    0x2BA2: "Allied Vision",
    0x1CB2: "PCO",
    0x136E: "Andor",
}
SERIAL_VENDORS: Final = {
    0x0403: "FTDI",
    0x10C4: "Silicon Labs",
    0x1A86: "WCH",
    0x067B: "Prolific",
    0x2341: "Arduino",
    0x2E8A: "Raspberry Pi",
    0x16C0: "Teensy",
}
_VIDEO, _COMMUNICATION, _MISCELLANEOUS, _HUB = 0x0E, 0x02, 0xEF, 0x09
_STRINGS: Final = 3
_USB3_VISION: Final = (_MISCELLANEOUS, 0x05)
_SPEEDS: Final = {1: "USB 1", 2: "USB 1", 3: "USB 2", 4: "USB 3", 5: "USB 3"}
RULES_FILE: Final = "/etc/udev/rules.d/70-slopegate.rules"


class UsbError(UserError):
    """The USB cannot be looked at; the message is one sentence that says what to do."""


@dataclass(frozen=True)
class UsbDevice:
    """One device on the USB, hubs left out."""

    vendor_id: int
    product_id: int
    bus: int
    address: int
    role: Role
    vendor: str
    product: str
    serial: str
    link: str
    """USB 1, 2 or 3 as it is connected now; empty when not known."""
    problem: str = ""
    """What stands in the way of using it, and what to do; empty when nothing does."""

    @property
    def ids(self) -> str:
        """Vendor and product number as usually written, such as 1409:3250."""
        return f"{self.vendor_id:04x}:{self.product_id:04x}"

    @property
    def name(self) -> str:
        """What to show for it."""
        return " ".join(part for part in (self.vendor, self.product) if part) or f"device {self.ids}"


def missing_usb() -> str:
    """Why the USB cannot be looked at; empty when it can."""
    if _backend() is not None:
        return ""
    return "The library libusb cannot be loaded: repair it with 'pip install --force-reinstall libusb-package'."


def list_usb(backend: Any = None) -> list[UsbDevice]:
    """Every device but hubs, cameras first. `backend` is pyusb's, by default the one found here. Raises UsbError."""
    if backend is None:
        missing = missing_usb()
        if missing:
            raise UsbError(missing)
        backend = _backend()
    import usb.core

    try:
        devices = list(usb.core.find(find_all=True, backend=backend))
    except (usb.core.USBError, OSError) as error:
        raise UsbError(f"The USB cannot be looked at: {words_of(error)}.") from None
    found = [described for device in devices if (described := _describe(device)) is not None]
    order = {"camera": 0, "serial": 1, "other": 2}
    return sorted(found, key=lambda device: (order[device.role], device.name, device.bus, device.address))


def udev_rule(vendor_id: int) -> str:
    """The line that lets every user at this computer use this vendor's devices."""
    return f'SUBSYSTEM=="usb", ATTRS{{idVendor}}=="{vendor_id:04x}", MODE:="0666", TAG+="uaccess"'


def permission_advice(vendor_id: int) -> str:
    """How to get at a device that the system keeps from this user."""
    if not sys.platform.startswith("linux"):
        return "Another program or driver holds it: close that program, or give the device the WinUSB driver."
    return (
        f"This user may not use it: run  echo '{udev_rule(vendor_id)}' | sudo tee -a {RULES_FILE}  "
        "and  sudo udevadm control --reload && sudo udevadm trigger  and plug it in again."
    )


def _backend() -> Any:
    """pyusb's way to libusb: the system's library, else that of libusb-package; None where neither loads."""
    import libusb_package
    import usb.backend.libusb1

    for finder in (None, libusb_package.find_library):
        with suppress(OSError):
            backend = usb.backend.libusb1.get_backend(find_library=finder)
            if backend is not None:
                return backend
    return None


def _describe(device: Any) -> UsbDevice | None:
    classes = set(_classes(device))
    if int(device.bDeviceClass) == _HUB:
        return None
    vendor_id, product_id = int(device.idVendor), int(device.idProduct)
    role = _role(vendor_id, classes)
    (vendor, product, serial), problem = _names(device)
    vendor = vendor or CAMERA_VENDORS.get(vendor_id, "") or SERIAL_VENDORS.get(vendor_id, "")
    link = _SPEEDS.get(getattr(device, "speed", None) or 0, "")
    # A device that could do USB 3 calls itself 2.1 where the cable or the socket cannot.
    if role == "camera" and link == "USB 2" and int(device.bcdUSB) >= 0x0210 and not problem:
        problem = "It is a USB 3 camera on a USB 2 link: use a USB 3 cable and socket, or expect fewer frames."
    bus, address = int(device.bus or 0), int(device.address or 0)
    return UsbDevice(vendor_id, product_id, bus, address, role, vendor, product, serial, link, problem)


def _classes(device: Any) -> Iterator[tuple[int, int]]:
    import usb.core

    yield int(device.bDeviceClass), int(device.bDeviceSubClass)
    with suppress(usb.core.USBError, NotImplementedError, OSError):
        for configuration in device:
            for interface in configuration:
                yield int(interface.bInterfaceClass), int(interface.bInterfaceSubClass)


def _role(vendor_id: int, classes: set[tuple[int, int]]) -> Role:
    kinds = {kind for kind, _ in classes}
    if vendor_id in CAMERA_VENDORS or _VIDEO in kinds or _USB3_VISION in classes:
        return "camera"
    return "serial" if vendor_id in SERIAL_VENDORS or _COMMUNICATION in kinds else "other"


def _names(device: Any) -> tuple[tuple[str, str, str], str]:
    """Manufacturer, product and serial number, and what kept the device from telling them."""
    import usb.control
    import usb.core
    import usb.util

    try:
        # asked first: pyusb's own properties do not say whether there are no strings or no permission
        usb.control.get_descriptor(device, 4, _STRINGS, 0)
        told = (device.manufacturer, device.product, device.serial_number)
        vendor, product, serial = (str(text or "").strip("\0 ") for text in told)
        return (vendor, product, serial), ""
    except usb.core.USBError as error:
        denied = error.errno in (errno.EACCES, errno.EPERM)
        problem = permission_advice(int(device.idVendor)) if denied else f"It does not answer: {words_of(error)}."
    except (NotImplementedError, ValueError):  # Windows without WinUSB; a device without languages
        problem = ""
    finally:
        usb.util.dispose_resources(device)
    return _names_from_system(device), problem


def _names_from_system(device: Any) -> tuple[str, str, str]:
    """The same from Linux, which lets every user read them."""
    ports = ".".join(str(port) for port in getattr(device, "port_numbers", None) or ())
    folder = Path(f"/sys/bus/usb/devices/{device.bus}-{ports}")
    texts = []
    for name in ("manufacturer", "product", "serial"):
        try:
            texts.append((folder / name).read_text(encoding="utf-8", errors="replace").strip())
        except OSError:
            texts.append("")
    return texts[0], texts[1], texts[2]
