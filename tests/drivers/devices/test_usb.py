"""The USB list over pyusb itself, with a bus of our own behind it."""

from __future__ import annotations

import array
import errno
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import libusb_package
import pytest
import usb.backend
import usb.backend.libusb1
import usb.core
import usb.util

from slopegate.drivers.devices import usb as usb_list
from slopegate.drivers.devices.usb import UsbError, list_usb, missing_usb, permission_advice, udev_rule


@dataclass
class Plugged:
    """A device on the simulated bus."""

    vendor: int
    product: int
    strings: tuple[str, str, str] = ("", "", "")
    device_class: int = 0
    interface: tuple[int, int] = (0xFF, 0)
    speed: int = 3
    bcd: int = 0x0200
    address: int = 1
    denied: int = 0
    opened: list[str] = field(default_factory=list)


class Bus(usb.backend.IBackend):
    """What libusb says, as far as a list needs it."""

    def __init__(self, *devices: Plugged) -> None:
        self.devices = devices
        self.open_devices = 0

    def enumerate_devices(self) -> Iterator[Plugged]:
        yield from self.devices

    def get_device_descriptor(self, dev: Plugged) -> Any:
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=dev.bcd, bDeviceClass=dev.device_class, bDeviceSubClass=0,
            bDeviceProtocol=0, bMaxPacketSize0=64, idVendor=dev.vendor, idProduct=dev.product, bcdDevice=0x100,
            iManufacturer=1, iProduct=2, iSerialNumber=3, bNumConfigurations=1, address=dev.address, bus=9,
            port_number=1, port_numbers=(1, 4), speed=dev.speed,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: Plugged, config: int) -> Any:
        if config >= 1:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=18, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=0x80, bMaxPower=50, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev: Plugged, intf: int, alt: int, config: int) -> Any:
        if intf or alt:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=0,
            bInterfaceClass=dev.interface[0], bInterfaceSubClass=dev.interface[1], bInterfaceProtocol=0, iInterface=0,
            extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: Plugged) -> Plugged:
        if dev.denied:
            raise usb.core.USBError("Access denied (insufficient permissions)", -3, dev.denied)
        self.open_devices += 1
        return dev

    def close_device(self, dev_handle: Plugged) -> None:
        self.open_devices -= 1

    def ctrl_transfer(
        self, dev_handle: Plugged, request_type: int, request: int, value: int, index: int, data: Any, timeout: int
    ) -> int:
        number = value & 0xFF
        payload = b"\x09\x04" if number == 0 else dev_handle.strings[number - 1].encode("utf-16-le")
        answer = array.array("B", bytes([len(payload) + 2, 3]) + payload)[: len(data)]
        data[: len(answer)] = answer
        return len(answer)


IDS = Plugged(0x1409, 0x3250, ("IDS Imaging", "UI-325xCP-C", "4103"), speed=4, bcd=0x0300, address=5)
FTDI = Plugged(0x0403, 0x6001, ("FTDI", "FT232R", "A10K"), address=6)


def test_cameras_boards_and_the_rest_are_named() -> None:
    hub = Plugged(0x1D6B, 2, ("Linux", "hub", ""), device_class=9)
    mouse = Plugged(0x046D, 0xC077, ("Logitech", "Mouse", ""), interface=(3, 1), speed=1, address=7)
    webcam = Plugged(0x046D, 0x0825, ("", "", ""), interface=(0x0E, 1), address=8)
    vision = Plugged(0xABCD, 1, ("Acme", "U3V", "1"), interface=(0xEF, 0x05), speed=4, bcd=0x0300, address=9)
    cdc = Plugged(0xABCD, 2, ("Acme", "Sync", "2"), interface=(0x02, 2), address=10)
    bus = Bus(hub, mouse, FTDI, cdc, IDS, webcam, vision)
    found = list_usb(bus)
    assert [(device.role, device.name) for device in found] == [
        ("camera", "Acme U3V"),
        ("camera", "IDS Imaging UI-325xCP-C"),
        ("camera", "device 046d:0825"),
        ("serial", "Acme Sync"),
        ("serial", "FTDI FT232R"),
        ("other", "Logitech Mouse"),
    ]
    camera = found[1]
    assert (camera.serial, camera.link, camera.ids, camera.problem) == ("4103", "USB 3", "1409:3250", "")
    assert found[-1].link == "USB 1"


def test_a_usb3_camera_on_a_usb2_link_is_told() -> None:
    slow = Plugged(0x1409, 0x3250, ("IDS", "UI-325xCP-C", "1"), speed=3, bcd=0x0210)
    old = Plugged(0x1409, 0x1540, ("IDS", "UI-1540", "1"), speed=3, bcd=0x0200, address=2)
    problems = {device.product: (device.link, device.problem) for device in list_usb(Bus(slow, old))}
    assert problems["UI-1540"] == ("USB 2", "")
    assert problems["UI-325xCP-C"][0] == "USB 2"
    assert "USB 3 cable" in problems["UI-325xCP-C"][1]


@pytest.mark.skipif(sys.platform != "linux", reason="udev is of Linux")
@pytest.mark.parametrize("code", [errno.EACCES, errno.EPERM])
def test_a_missing_permission_gives_the_rule_to_add(code: int) -> None:
    device = list_usb(Bus(Plugged(0x1409, 0x3250, denied=code)))[0]
    assert device.name == "IDS"
    rule = 'SUBSYSTEM=="usb", ATTRS{idVendor}=="1409", MODE:="0666", TAG+="uaccess"'
    assert udev_rule(0x1409) == rule
    assert f"echo '{rule}' | sudo tee -a {usb_list.RULES_FILE}" in device.problem
    assert "udevadm control --reload" in device.problem


def test_a_device_that_does_not_answer_is_listed_with_its_trouble() -> None:
    device = list_usb(Bus(Plugged(0x0403, 0x6001, denied=errno.EIO)))[0]
    assert device.name == "FTDI"
    assert "does not answer" in device.problem


def test_no_device_is_left_open() -> None:
    bus = Bus(IDS, FTDI)
    assert len(list_usb(bus)) == 2
    assert bus.open_devices == 0


def test_a_libusb_that_does_not_load_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usb.backend.libusb1, "get_backend", lambda find_library=None: None)
    assert "pip install --force-reinstall libusb-package" in missing_usb()
    with pytest.raises(UsbError, match="libusb"):
        list_usb()


def test_the_package_s_libusb_is_used_where_the_system_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    load = usb.backend.libusb1.get_backend
    asked: list[Any] = []

    def only_with_a_path(find_library: Any = None) -> Any:
        asked.append(find_library)
        return load(find_library=find_library) if find_library else None

    monkeypatch.setattr(usb.backend.libusb1, "get_backend", only_with_a_path)
    assert missing_usb() == ""
    assert asked == [None, libusb_package.find_library]


def test_the_real_bus_can_be_looked_at() -> None:
    assert missing_usb() == ""
    assert all(device.link in ("", "USB 1", "USB 2", "USB 3") for device in list_usb())


@pytest.mark.parametrize("platform", ["win32", "darwin"])
def test_advice_elsewhere_names_no_udev(platform: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", platform)
    assert "udev" not in permission_advice(1)
