"""The device list: every family heard, none able to hold up or break the others."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from slopegate.drivers.contract.camera import CameraError
from slopegate.drivers.contract.families import Family, Found
from slopegate.drivers.devices.survey import (
    SERIAL,
    Survey,
    Surveyor,
    changes,
    families,
    survey,
    try_device,
)
from slopegate.drivers.sync import boards as sync_boards
from slopegate.drivers.sync import serial_port
from slopegate.drivers.sync.boards import identify
from slopegate.drivers.sync.dialect import BoardError, Dialect
from slopegate.drivers.sync.serial_port import Port, list_ports
from sync_instruments import KINDS


def family(key: str, find: object, missing: str = "") -> Family:
    return Family(key, "camera", f"Family {key}", lambda: missing, find)  # type: ignore[arg-type]


def one(key: str) -> list[Found]:
    return [Found("camera", key, "1", f"camera {key}")]


def fails() -> list[Found]:
    raise RuntimeError("GenTL error -1013")


def refuses() -> list[Found]:
    raise CameraError("The producer is in use.")


def asking_for(reply_timeout_s: float) -> Callable[[Callable[[int], Port], Dialect], tuple[str, int]]:
    """`identify` that waits so long for a reply."""
    return lambda open_port, dialect: identify(open_port, dialect, reply_timeout_s)


@pytest.fixture
def release() -> Iterator[threading.Event]:
    event = threading.Event()
    yield event
    event.set()


def test_failing_hanging_and_missing_families_cost_the_others_nothing(
    release: threading.Event, bugs: list[logging.LogRecord]
) -> None:
    asked = [
        family("a", lambda: one("a")),
        family("broken", fails),
        family("refusing", refuses),
        family("hanging", lambda: release.wait(120) and []),
        family("absent", lambda: one("never"), "It needs a driver: install it."),
        family("b", lambda: one("b")),
    ]
    started_s = time.monotonic()
    seen = survey(asked, timeout_s=1.5)
    assert time.monotonic() - started_s < 30.0
    assert [device.family for device in seen.found] == ["a", "b"]
    assert {missing.family: missing.sentence for missing in seen.missing} == {
        "broken": "Family broken: its driver failed (RuntimeError: GenTL error -1013)",
        "refusing": "Family refusing: The producer is in use.",
        "hanging": "Family hanging: no answer within 1.5 s; its driver hangs.",
        "absent": "It needs a driver: install it.",
    }
    (record,) = bugs
    assert record.exc_info[0] is RuntimeError
    bugs.clear()


def test_a_family_that_hangs_is_not_asked_again_until_it_has_answered(release: threading.Event) -> None:
    asked: list[int] = []

    def hangs() -> list[Found]:
        asked.append(1)
        release.wait(120)
        return one("slow")

    surveyor = Surveyor([family("slow", hangs), family("a", lambda: one("a"))])
    for timeout_s in (1.5, 60.0, 60.0, 60.0):  # only the first one waits for it
        seen = surveyor.look(timeout_s)
        assert [device.family for device in seen.found] == ["a"]
        assert "hangs" in seen.missing[0].sentence
    assert len(asked) == 1
    release.set()
    end_s = time.monotonic() + 60
    while surveyor.look(timeout_s=60.0).missing:
        assert time.monotonic() < end_s
    assert len(asked) == 2


def test_what_was_plugged_in_and_what_was_pulled() -> None:
    stays, goes, comes = one("a")[0], one("b")[0], one("c")[0]
    renamed = replace(stays, name="other name", problem="busy")
    before, after = Survey((stays, goes), ()), Survey((comes, renamed), ())
    assert changes(before, after) == ([comes], [goes])
    assert changes(after, after) == ([], [])


def test_the_virtual_camera_is_always_there() -> None:
    cameras = [family for family in families() if family.kind == "camera"]
    assert "virtual" in [device.family for device in survey(cameras).found]


def test_no_driver_is_imported_by_knowing_of_it() -> None:
    code = (
        "import sys; from slopegate.drivers.devices.survey import families; families(); "
        "print([name for name in ('serial', 'usb', 'pyueye', 'harvesters', 'gi', 'pypylon') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=240)
    assert done.stdout == "[]\n"


def test_without_any_extra_the_list_says_what_is_missing(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules.update({name: None for name in ('pyueye', 'harvesters', 'harvesters.core', 'gi')})\n"
        "from slopegate.drivers.devices.survey import survey\n"
        "for missing in survey().missing: print(missing.family, missing.sentence)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=240)
    lines = done.stdout.splitlines()
    assert any(line.startswith("ueye ") and "slopegate[ueye]" in line for line in lines)
    assert any(line.startswith("gentl ") and "slopegate[gentl]" in line for line in lines)
    assert not any(line.startswith("serial ") for line in lines)
    assert done.stderr == ""


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are of Unix")
def test_an_instrument_on_a_port_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sync_boards, "identify", asking_for(3.0))
    path = tmp_path / "port"
    instrument = KINDS["dg645"](path)
    device = Found("board", "serial", str(path), "Serial port", str(path))
    try:
        sentence = try_device(device, [SERIAL])
    finally:
        instrument.close()
    assert sentence.startswith("DG645 s/n001776 answers (Stanford Research DG645, 9600 baud)")


def test_a_device_of_no_family_and_one_without_a_test() -> None:
    device = Found("camera", "x", "1", "camera x")
    with pytest.raises(ValueError, match="no family 'x'"):
        try_device(device, [])
    with pytest.raises(ValueError, match="nothing to test"):
        try_device(device, [family("x", list)])


def test_ports_are_named_by_their_adapter(monkeypatch: pytest.MonkeyPatch) -> None:
    from serial.tools import list_ports as tool
    from serial.tools.list_ports_common import ListPortInfo

    adapter, plain = (
        ListPortInfo("/dev/ttyUSB3", skip_link_detection=True),
        ListPortInfo("/dev/ttyS0", skip_link_detection=True),
    )
    adapter.vid, adapter.pid, adapter.serial_number = 0x0403, 0x6001, "A10K"
    adapter.manufacturer, adapter.product = "FTDI", "FT232R"
    monkeypatch.setattr(tool, "comports", lambda: [plain, adapter])
    first, second = list_ports()
    assert (first.usb_key, first.name) == ("usb:0403:6001:A10K", "FTDI FT232R")
    assert second.usb_key == ""
    assert serial_port.find_port("usb:0403:6001:A10K") == "/dev/ttyUSB3"
    adapter.device = "/dev/ttyUSB0"
    assert serial_port.find_port("usb:0403:6001:A10K") == "/dev/ttyUSB0"
    assert serial_port.find_port("/dev/ttyS9") == "/dev/ttyS9"


def test_everything_has_a_title_and_a_kind() -> None:
    keys = [known.key for known in families()]
    assert len(set(keys)) == len(keys)
    assert all(known.title and known.kind in ("camera", "board", "usb") for known in families())


def test_a_port_where_nobody_answers_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sync_boards, "identify", asking_for(0.02))
    instrument = KINDS["dg645"](tmp_path / "port")
    instrument.misbehave("silent", times=10**6)
    device = Found("board", "serial", str(tmp_path / "port"), "Serial port", "the port")
    with pytest.raises(BoardError, match=r"Nothing .* answers on .*port"):
        try_device(device, [SERIAL])
    instrument.close()
