"""`slopegate devices` and `slopegate doctor`: what they say where things are missing, broken or fine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from slopegate.app.cli import main
from slopegate.app.commands import devices as devices_command
from slopegate.app.commands import doctor
from slopegate.app.commands.doctor import Check, check_drivers, check_folders, check_ports, check_screens
from slopegate.app.session.log import log_path
from slopegate.drivers.contract.families import Found
from slopegate.drivers.devices.survey import Missing, Survey
from slopegate.drivers.sync.serial_port import PortError, PortFacts

Capture = pytest.CaptureFixture[str]

CAMERA = Found("camera", "ueye", "4103", "UI-3250CP", "serial number 4103, USB 3")
VIRTUAL = Found("camera", "virtual", "1", "Virtual camera")
SLOW = Found("usb", "usb", "usb:1", "IDS UI-3250", "1409:3250, USB 2", "Use a USB 3 cable.")
SEEN = Survey((CAMERA, SLOW), (Missing("serial", "Serial ports", "They need pyserial: install it."),))
SCREEN: dict[str, Any] = {
    "name": "DP-1", "x": 0, "y": 0, "width_px": 2560, "height_px": 1440, "scale": 1.5, "rate_hz": 59.95,
}  # fmt: skip
PROJECTOR: dict[str, Any] = {
    "name": "HDMI-1", "x": 1707, "y": 0, "width_px": 1280, "height_px": 720, "scale": 1.0, "rate_hz": 60.0,
}  # fmt: skip
DRAWN = {"renderer": "Mesa Intel(R) UHD", "version": "4.6"}


def test_devices_lists_what_is_there_and_what_could_be(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices_command, "survey", lambda: SEEN)
    assert main(["devices"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.splitlines() == [
        "Cameras",
        "  UI-3250CP (serial number 4103, USB 3)",
        "    slopegate --camera ueye:4103",
        "Serial ports",
        "  none",
        "USB",
        "  IDS UI-3250 (1409:3250, USB 2)",
        "    Use a USB 3 cable.",
        "Not looked at",
        "  Serial ports: They need pyserial: install it.",
    ]


def test_devices_as_json(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices_command, "survey", lambda: SEEN)
    assert main(["devices", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [device["name"] for device in told["found"]] == ["UI-3250CP", "IDS UI-3250"]
    assert set(told["found"][0]) == {"kind", "family", "where", "name", "detail", "problem"}
    assert told["missing"][0]["family"] == "serial"


def test_devices_tests_what_can_be_tested(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    port, silent = Found("board", "serial", "A", "FT232R", "port A"), Found("board", "serial", "B", "FT232R", "port B")

    def answer(device: Found) -> str:
        if device == silent:
            raise PortError("Nobody answers.")
        return "DG645 answers."

    monkeypatch.setattr(devices_command, "survey", lambda: Survey((VIRTUAL, port, silent), ()))
    monkeypatch.setattr(devices_command, "try_device", answer)
    assert main(["devices", "--test", "--json"]) == 0
    told = {device["where"]: device["answer"] for device in json.loads(capsys.readouterr().out)["found"]}
    assert told == {"1": None, "A": "DG645 answers.", "B": "Nobody answers."}


def test_the_real_list_is_quick_and_needs_no_window() -> None:
    code = (
        "import sys; from slopegate.app.cli import main; main(['devices', '--json']); "
        "print([name for name in ('PySide6', 'numba', 'cv2') if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=280)
    assert "virtual" in [device["family"] for device in json.loads(done.stdout)["found"]]
    assert "PySide6" not in done.stderr


def states(checks: list[Check]) -> dict[str, str]:
    return {check.name: check.state for check in checks}


def facts(*screens: dict[str, Any], opengl: dict[str, str] | None = None) -> dict[str, Any]:
    return {"platform": "xcb", "screens": list(screens), "opengl": opengl or DRAWN}


def test_a_good_bench_is_good() -> None:
    checks = list(check_screens(facts(SCREEN, PROJECTOR)))
    assert states(checks) == {"display": "good", "projector screen": "good", "OpenGL": "good"}
    assert checks[0].found == "DP-1 2560 x 1440 at 60 Hz; HDMI-1 1280 x 720 at 60 Hz"
    assert not any(check.advice for check in checks)


@pytest.mark.parametrize(
    ("seen", "name", "state", "advice"),
    [
        (facts(SCREEN), "projector screen", "optional", "extends"),
        (facts(SCREEN, {**PROJECTOR, "x": 0}), "projector screen", "bad", "extend"),
        (facts(SCREEN, {**PROJECTOR, "scale": 1.25}), "projector screen", "bad", "100 %"),
        (facts(SCREEN, PROJECTOR, opengl={"error": "none"}), "OpenGL", "optional", "libgl1"),
        (facts(PROJECTOR, opengl={"renderer": "llvmpipe", "version": "4.5"}), "OpenGL", "good", "software"),
        (facts(), "display", "bad", "connect"),
        ("could not connect to display", "display", "bad", "Qt needs"),
    ],
)
def test_screens_that_need_something(
    seen: dict[str, Any] | str, name: str, state: str, advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":77")
    check = next(check for check in check_screens(seen) if check.name == name)
    if sys.platform.startswith("linux") or isinstance(seen, dict):
        assert (check.state, advice in check.advice) == (state, True), check


def test_a_port_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = PortFacts(str(tmp_path / "port"), "FT232R")
    monkeypatch.setattr(doctor, "list_ports", lambda: [port])
    checks = list(check_ports())
    if sys.platform != "win32":
        assert checks[0].state == "bad"
        assert "usermod" in checks[0].advice
    (tmp_path / "port").touch()
    assert next(check_ports()).state == "good"


def test_drivers_that_are_missing_are_optional_and_problems_are_not() -> None:
    checks = list(check_drivers(SEEN))
    named = {(check.name, check.state): check for check in checks}
    assert named["Serial ports", "optional"].advice == "They need pyserial: install it."
    assert named["IDS uEye", "good"].found == "1 found"
    assert named["USB", "bad"].advice == "Use a USB 3 cable."


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tmp_path.chmod(0o500)
    monkeypatch.setattr(doctor, "default_path", lambda: tmp_path / "slopegate" / "window.json")
    assert states(list(check_folders()))["settings folder"] == "optional"
    tmp_path.chmod(0o700)


def test_a_folder_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(doctor, "default_path", lambda: tmp_path / "file" / "window.json")
    check = next(check for check in check_folders() if check.name == "settings folder")
    assert check.state == "optional"
    assert "cannot be written" in check.found
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]


@pytest.mark.skipif(sys.platform != "linux", reason="the variables are of Linux")
def test_a_home_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    for name in ("XDG_CACHE_HOME", "XDG_STATE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "file"))
    found = [doctor.check_bakes(), doctor.check_log()]
    assert [(check.name, check.state) for check in found] == [("baked light", "optional"), ("log", "optional")]
    assert all("cannot be written" in check.found for check in found)


def test_doctor_leaves_nothing_behind_and_is_healthy_only_with_a_display(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "PROBE_TIMEOUT_S", 120.0)
    here = Path.cwd()
    try:
        os.chdir(tmp_path)
        code = main(["doctor", "--json"])
    finally:
        os.chdir(here)
    told = json.loads(capsys.readouterr().out)
    assert told["healthy"] is (code == 0)
    assert list(tmp_path.iterdir()) == []
    names = [check["name"] for check in told["checks"]]
    assert {"display", "OpenGL", "Serial ports", "USB", "settings folder", "current folder"} <= set(names)
    assert str(log_path()) in next(check["found"] for check in told["checks"] if check["name"] == "log")
    assert main(["doctor"]) == code
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("  ok  display") for line in lines)


def test_without_a_display_the_doctor_survives_qt(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("only there can Qt find no display")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("QT_QPA_PLATFORM", "xcb")
    assert main(["doctor", "--json"]) == 1
    first = json.loads(capsys.readouterr().out)["checks"][0]
    assert (first["name"], first["state"]) == ("display", "bad")
    assert "desktop" in first["advice"]
