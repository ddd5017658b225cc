"""Aravis' fake GigE Vision camera, in a network namespace of the test's own: its discovery broadcasts everywhere.

A test that needs the camera is written as usual and skipped outside; `run_inside` runs it again with pytest inside.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

SERVER = "arv-fake-gv-camera-0.8"
MARK = "SLOPEGATE_TEST_NETNS"
ROOT = Path(__file__).resolve().parents[2]


def inside() -> bool:
    """Whether this process is in the namespace."""
    return os.environ.get(MARK) == "1"


def why_not() -> str:
    """Why the fake camera cannot run here; empty when it can."""
    if sys.platform != "linux":
        return "network namespaces exist on Linux only"
    for program in ("unshare", "ip", SERVER):
        if shutil.which(program, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin") is None:
            return f"{program} is not here (apt-get install aravis-tools iproute2 util-linux)"
    tried = subprocess.run([*_unshare(), "ip link set lo up"], capture_output=True, text=True, check=False)
    return f"no network namespace can be made here ({tried.stderr.strip()})" if tried.returncode else ""


def run_inside(*arguments: str, timeout_s: float = 800.0) -> str:
    """Run pytest with these arguments inside; fails the test with pytest's output, else returns it."""
    if inside():
        pytest.skip("already inside")
    if reason := why_not():
        pytest.skip(reason)
    options = ["-p", "no:cacheprovider", "-rs"]
    command = ["exec", sys.executable, "-m", "pytest", *options, *arguments]
    script = "ip link set lo up && " + " ".join(f"'{part}'" if k else part for k, part in enumerate(command))
    kept = {name: value for name, value in os.environ.items() if name != "SLOPEGATE_NO_NETWORK_SEARCH"}
    environment = {**kept, MARK: "1", "PATH": f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"}
    done = subprocess.run(
        [*_unshare(), script], cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=timeout_s
    )
    assert done.returncode == 0, done.stdout[-8000:] + done.stderr[-2000:]
    return done.stdout


def _unshare() -> list[str]:
    path = shutil.which("unshare") or "unshare"
    return [path, "--net", *([] if os.geteuid() == 0 else ["--map-root-user"]), "bash", "-c"]


class FakeCamera:
    """The server as a process that can be killed and started again."""

    def __init__(self, serial: str = "GV01", lost_per_thousand: int = 0, description: Path | None = None) -> None:
        assert inside(), "the fake camera must not be seen outside"
        self.where = f"Aravis-Fake-{serial}"
        self._command = [SERVER, "-i", "127.0.0.1", "-s", serial]
        if lost_per_thousand:
            self._command += ["-r", str(lost_per_thousand)]
        if description is not None:
            self._command += ["-g", str(description)]
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        """Answering when this returns."""
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(self._command, stdout=quiet, stderr=quiet)
        end = time.monotonic() + 60.0
        # its control port, 3956 (hexadecimal 0F74), appears among the UDP sockets
        while ":0F74 " not in Path("/proc/self/net/udp").read_text():
            assert self._process.poll() is None, "the fake camera did not start"
            assert time.monotonic() < end
            time.sleep(0.005)

    def kill(self) -> None:
        """At once, as when the cable is pulled."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


def serving(folder: Path) -> Iterator[Callable[..., FakeCamera]]:
    """For a fixture: starts fake cameras, their descriptions in `folder`, and kills them in the end."""
    if not inside():
        pytest.skip("runs in a network namespace of its own, from the first test")
    servers: list[FakeCamera] = []

    def serve(description: str = "", lost_per_thousand: int = 0) -> FakeCamera:
        path = folder / "camera.xml"
        path.write_text(description)
        servers.append(FakeCamera("GV01", lost_per_thousand, path if description else None))
        return servers[-1]

    yield serve
    for server in servers:
        server.kill()


MEMORY = {
    "Width": 0x100, "Height": 0x104, "SensorHeight": 0x118, "SensorWidth": 0x11C, "ExposureTime": 0x120,
    "Acquisition": 0x124, "PixelFormat": 0x128, "AcquisitionMode": 0x12C, "OffsetX": 0x130, "OffsetY": 0x134,
    "FramePeriod": 0x138,
    "TriggerMode": 0x300, "TriggerSource": 0x304, "TriggerActivation": 0x308,
    "TriggerDelay": 0x1000, "DeviceClockSelector": 0x1004, "DeviceClockFrequency": 0x1008, "SensorShutterMode": 0x100C,
    "ExposureMode": 0x1010, "LineTime": 0x1014, "TriggerModeUnused": 0x1018,
    "AcquisitionFrameRateEnable": 0x101C,
}  # fmt: skip
"""Registers of the fake camera; those from 0x1000 on are memory that it keeps but does not use."""


def rolling_shutter(line: str = "clock", triggers: bool = True, pretends: str = "") -> str:
    """A description that makes of the fake camera one with all that a gate needs, in the registers of `MEMORY`.

    `line` is "clock" (10 to 128 MHz), "time" (LineTime in nanoseconds) or "none". `triggers`: as if a projector sent
    25 a second, for the fake camera runs on where its own register of the trigger mode stays 0.
    `pretends`: a pixel format that is offered, and then Mono8 is read back.
    """
    parts = [_integer("Width", 1, "<pMax>SensorWidth</pMax>"), _integer("Height", 1, "<pMax>SensorHeight</pMax>")]
    parts += [_integer(f"Offset{axis}", 0, "<Max>2047</Max>") for axis in "XY"]
    parts += [_integer(f"Sensor{side}", 1, "<Max>4096</Max>") for side in ("Width", "Height")]
    formats = {"Mono8": 0x01080001, "Mono12p": 0x010C0047, "Mono16": 0x01100007, "BayerRG8": 0x01080009}
    # aravis reads back the last one of equal value
    formats = {pretends: formats["Mono8"], **formats} if pretends else formats
    parts.append(_enumeration("PixelFormat", formats))
    parts.append(_enumeration("AcquisitionMode", {"Continuous": 1}))
    parts.append(_enumeration("TriggerMode", {"Off": 0, "On": 1}, "TriggerModeUnused" if triggers else "TriggerMode"))
    parts.append(_enumeration("TriggerSource", {"Software": 1, "Line0": 0}))
    parts.append(_enumeration("TriggerActivation", {"RisingEdge": 0, "FallingEdge": 1}))
    parts.append(_enumeration("SensorShutterMode", {"Global": 0, "Rolling": 1}))
    parts.append(_enumeration("ExposureMode", {"TriggerWidth": 0, "Timed": 1}))
    parts.append(_frame_rate())
    parts.append(_float("ExposureTime", 20, 1_000_000, "us"))
    parts.append(_float("TriggerDelay", 0, 100_000, "us"))
    if line == "clock":
        parts.append(_enumeration("DeviceClockSelector", {"CameraLink": 0, "Sensor": 1}))
        parts.append(_float("DeviceClockFrequency", 10e6, 128e6, "Hz", offset=10_000_000))
    if line == "time":
        parts.append(_float("LineTime", 8_000, 100_000, "ns", offset=10_000))
    for name, value in (("AcquisitionStart", 1), ("AcquisitionStop", 0)):
        parts.append(f'<Command Name="{name}"><pValue>AcquisitionRegister</pValue>'
                     f"<CommandValue>{value}</CommandValue></Command>")  # fmt: skip
    parts.append(_register("Acquisition"))
    parts.append(
        '<IntSwissKnife Name="PayloadSize"><pVariable Name="W">Width</pVariable><pVariable Name="H">Height</pVariable>'
        '<pVariable Name="F">PixelFormat</pVariable><Formula>W * H * ((F &gt;&gt; 16) &amp; 0xFF) / 8</Formula>'
        "</IntSwissKnife>"
    )
    for name, address, length in (("Vendor", 0x48, 32), ("Model", 0x68, 32)):
        parts.append(f'<StringReg Name="Device{name}Name"><Address>{address}</Address><Length>{length}</Length>'
                     "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>")  # fmt: skip
    names = sorted({part.split('"')[1] for part in parts})
    root = "".join(f"<pFeature>{name}</pFeature>" for name in names if not name.endswith("Register"))
    return (
        '<?xml version="1.0" encoding="utf-8"?><RegisterDescription ModelName="Fake" VendorName="Aravis" '
        'StandardNameSpace="None" SchemaMajorVersion="1" SchemaMinorVersion="0" SchemaSubMinorVersion="1" '
        'MajorVersion="1" MinorVersion="0" SubMinorVersion="0" ToolTip="Fake" ProductGuid="0" VersionGuid="0" '
        'xmlns="http://www.genicam.org/GenApi/Version_1_0">'
        f'<Category Name="Root">{root}</Category>{"".join(parts)}<Port Name="Device"/></RegisterDescription>'
    )


def _frame_rate() -> str:
    """In the register that paces the fake camera, and a switch that does nothing."""
    name, switch = "AcquisitionFrameRate", "AcquisitionFrameRateEnable"
    return (
        f'<Float Name="{name}"><pValue>{name}Converter</pValue><Min>1</Min><Max>200</Max><Unit>Hz</Unit></Float>'
        f'<Converter Name="{name}Converter"><FormulaTo>1000000 / FROM</FormulaTo>'
        "<FormulaFrom>1000000 / TO</FormulaFrom><pValue>FramePeriod</pValue></Converter>"
        f'{_integer("FramePeriod", 1000, "<Max>10000000</Max>")}<Boolean Name="{switch}">'
        f"<pValue>{switch}Register</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>{_register(switch)}"
    )


def _register(name: str) -> str:
    return (
        f'<IntReg Name="{name}Register"><Address>{MEMORY[name]}</Address><Length>4</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )


def _integer(name: str, low: int, high: str) -> str:
    bounds = f"<Min>{low}</Min>{high}<Inc>1</Inc>"
    return f'<Integer Name="{name}"><pValue>{name}Register</pValue>{bounds}</Integer>{_register(name)}'


def _enumeration(name: str, entries: dict[str, int], register: str = "") -> str:
    inner = "".join(f'<EnumEntry Name="{key}"><Value>{value}</Value></EnumEntry>' for key, value in entries.items())
    register = register or name
    return f'<Enumeration Name="{name}">{inner}<pValue>{register}Register</pValue></Enumeration>{_register(register)}'


def _float(name: str, low: float, high: float, unit: str, offset: int = 0) -> str:
    """A whole number in a register; `offset` is its value while the register holds 0."""
    limits = f"<Min>{low}</Min><Max>{high}</Max>"
    return (
        f'<Float Name="{name}"><pValue>{name}Converter</pValue>{limits}<Unit>{unit}</Unit></Float>'
        f'<Converter Name="{name}Converter"><FormulaTo>FROM - {offset}</FormulaTo>'
        f"<FormulaFrom>TO + {offset}</FormulaFrom><pValue>{name}Register</pValue></Converter>{_register(name)}"
    )
