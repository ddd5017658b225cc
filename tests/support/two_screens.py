"""A virtual X server of the test's own whose picture is two screens side by side, the second a projector's.

Qt looks at its screens when it starts, so a test that needs two is written as usual and skipped elsewhere; `run_inside`
runs it again with pytest inside. Screens are added and removed by speaking X's own protocol (RandR 1.5 monitors), and
pixels are read from the server's memory, so that nothing of Qt's is between them and the test.
"""

from __future__ import annotations

import os
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

MARK = "SLOPEGATE_TEST_TWO_SCREENS"
ROOT = Path(__file__).resolve().parents[2]
CONTROL, PROJECTOR = ("control", 0, 0, 1280, 900), ("HDMI-1", 1280, 60, 1280, 720)
DESKTOP = (2700, 900)
"""Its middle, where the pointer is, lies well inside the projector's screen."""


def inside() -> bool:
    """Whether this process has the two screens."""
    return MARK in os.environ


def why_not() -> str:
    """Why they cannot be had here; empty when they can."""
    if sys.platform != "linux":
        return "virtual X servers are for Linux"
    return "" if shutil.which("Xvfb") else "Xvfb is not here (apt-get install xvfb)"


def run_inside(*arguments: str, scale: float = 1.0, timeout_s: float = 800.0) -> str:
    """Run pytest with these arguments inside; fails the test with pytest's output, else returns it."""
    if inside():
        pytest.skip("already inside")
    if reason := why_not():
        pytest.skip(reason)
    with tempfile.TemporaryDirectory() as folder:
        display, server = _start(folder)
        try:
            kept = {name: value for name, value in os.environ.items() if name != "WAYLAND_DISPLAY"}
            facts = {MARK: folder, "DISPLAY": f":{display}", "QT_QPA_PLATFORM": "xcb", "QT_SCALE_FACTOR": str(scale)}
            screens = Screens(display)
            screens.add(*CONTROL, primary=True)
            screens.add(*PROJECTOR)
            screens.close()
            command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-rs", *arguments]
            done = subprocess.run(
                command, cwd=ROOT, env={**kept, **facts}, capture_output=True, text=True, check=False, timeout=timeout_s
            )
        finally:
            server.terminate()
            server.wait()
    assert done.returncode == 0, done.stdout[-8000:] + done.stderr[-2000:]
    return done.stdout


def _start(folder: str) -> tuple[int, subprocess.Popen[bytes]]:
    """An X server without screens of its own choice; its display number."""
    told, write = os.pipe()
    size = "x".join(map(str, (*DESKTOP, 24)))
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", size, "-fbdir", folder, "-noreset", "-nolisten", "tcp"]
    quiet = subprocess.DEVNULL
    server = subprocess.Popen(command, pass_fds=[write], stdout=quiet, stderr=quiet)
    os.close(write)
    with open(told, "rb") as pipe:
        number = pipe.readline()
    assert number, "Xvfb did not start"
    return int(number), server


def screen_pixels(screen: tuple[str, int, int, int, int]) -> NDArray[np.uint8]:
    """What is on a screen now: (height, width, 3) RGB, from the server's memory (an X window dump, XWDFile.h)."""
    data = (Path(os.environ[MARK]) / "Xvfb_screen0").read_bytes()
    header = struct.unpack(">25I", data[:100])
    line_bytes, colours = header[12], header[19]
    body = np.frombuffer(data, np.uint8, line_bytes * DESKTOP[1], header[0] + 12 * colours)
    _, x, y, width, height = screen
    return body.reshape(DESKTOP[1], line_bytes // 4, 4)[y : y + height, x : x + width, 2::-1]


class Screens:
    """A client of the server that says which parts of its picture are screens."""

    def __init__(self, display: int) -> None:
        self._wire = socket.socket(socket.AF_UNIX)
        self._wire.connect(str(Path("/tmp") / ".X11-unix" / f"X{display}"))
        self._wire.sendall(struct.pack("<BxHHHHxx", ord("l"), 11, 0, 0, 0))
        said, length = struct.unpack("<BxxxxxH", self._receive(8))
        setup = self._receive(4 * length)
        assert said == 1, setup
        (vendor,) = struct.unpack_from("<H", setup, 16)
        (self._root,) = struct.unpack_from("<I", setup, 32 + (vendor + 3) // 4 * 4 + 8 * setup[21])
        self._randr = self._ask(98, 0, struct.pack("<Hxx", 5) + b"RANDR\0\0\0")[9]
        self._ask(self._randr, 0, struct.pack("<II", 1, 5))

    @classmethod
    def here(cls) -> Screens:
        """Of the server that this process draws on."""
        return cls(int(os.environ["DISPLAY"].partition(":")[2].partition(".")[0]))

    def add(self, name: str, x: int, y: int, width: int, height: int, primary: bool = False) -> None:
        """Make this part of the picture a screen; the primary one has the server's output."""
        outputs = self._outputs() if primary else ()
        facts = struct.pack("<BBHhhHHII", primary, 0, len(outputs), x, y, width, height, width // 4, height // 4)
        body = struct.pack("<II", self._root, self._atom(name)) + facts
        self._do(43, body + struct.pack(f"<{len(outputs)}I", *outputs))

    def remove(self, name: str) -> None:
        """Pull its cable."""
        self._do(44, struct.pack("<II", self._root, self._atom(name)))

    def close(self) -> None:
        """Hang up."""
        self._wire.close()

    def _outputs(self) -> tuple[Any, ...]:
        reply = self._ask(self._randr, 25, struct.pack("<I", self._root))
        crtcs, outputs = struct.unpack_from("<HH", reply, 16)
        return struct.unpack_from(f"<{outputs}I", reply, 32 + 4 * crtcs)

    def _atom(self, name: str) -> int:
        text = name.encode()
        body = struct.pack("<Hxx", len(text)) + text + b"\0" * (-len(text) % 4)
        return int(struct.unpack_from("<I", self._ask(16, 0, body), 8)[0])

    def _do(self, minor: int, body: bytes) -> None:
        """A request without a reply; another one after it, to hear of an error."""
        self._send(self._randr, minor, body)
        self._ask(43, 0, b"")

    def _ask(self, major: int, minor: int, body: bytes) -> bytes:
        self._send(major, minor, body)
        while True:
            head = self._receive(32)
            assert head[0] != 0, f"X error {head[1]}"
            if head[0] == 1:
                return head + self._receive(4 * struct.unpack_from("<I", head, 4)[0])

    def _send(self, major: int, minor: int, body: bytes) -> None:
        self._wire.sendall(struct.pack("<BBH", major, minor, 1 + len(body) // 4) + body)

    def _receive(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            part = self._wire.recv(count - len(data))
            assert part, "the X server hung up"
            data += part
        return data
