"""Builds ueye_stub.c, a small library with the vendor's functions, order and ranges, and lets pyueye load it."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

SERIAL = "4103123456"
CLOCKS_PER_LINE = 996.67


class Stub:
    """The library's own side, past pyueye and the driver."""

    def __init__(self, path: Path) -> None:
        self._library = ctypes.CDLL(str(path))

    def fresh(self, mosaic: bool = True, trigger_hz: int = 60) -> None:
        """Plugged in, nobody's, without complaints."""
        self.plug(False)
        self.plug(True)
        self._library.stub_mosaic(int(mosaic))
        self.trigger(trigger_hz)
        self.faults()

    def plug(self, plugged: bool) -> None:
        """In or out."""
        self._library.stub_plug(int(plugged))

    def trigger(self, rate_hz: int) -> None:
        """How often the projector's signal comes; 0 for never."""
        self._library.stub_trigger_hz(rate_hz)

    def occupy(self, occupied: bool) -> None:
        """As if another program had opened it."""
        self._library.stub_occupy(int(occupied))

    def faults(self) -> tuple[int, str]:
        """How often the vendor's rules were broken since the last time asked, and the last of them."""
        text = ctypes.create_string_buffer(256)
        return int(self._library.stub_faults(text, len(text))), text.value.decode()

    @property
    def memories(self) -> int:
        """Image memories that were allocated and not freed."""
        return int(self._library.stub_memories())

    @property
    def trigger_mode(self) -> int:
        """As the camera was told last."""
        return int(self._library.stub_trigger_mode())

    @property
    def frames(self) -> int:
        """Frames made so far, whoever was there to take them."""
        return int(self._library.stub_frames())


@cache
def stub() -> Stub:
    """Built and loaded once for all tests of a run; skips the test where that cannot be."""
    if sys.platform != "linux" or (compiler := shutil.which("gcc")) is None:
        pytest.skip("the stand-in for the uEye library needs gcc on Linux")
    if find_spec("pyueye") is None:
        pytest.skip("the extra ueye (pyueye) is not installed")
    folder = Path(tempfile.mkdtemp(prefix="slopegate-ueye-"))
    path = folder / "libueye_api_64.so"
    source = Path(__file__).with_suffix(".c")
    command = [
        compiler,
        "-shared",
        "-fPIC",
        "-O1",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-o",
        str(path),
        str(source),
        "-lpthread",
    ]
    subprocess.run(command, check=True)
    os.environ["PYUEYE_DLL_PATH"] = str(folder)
    with warnings.catch_warnings():
        # pyueye tells of every function that the stand-in does not have
        warnings.simplefilter("ignore")
        __import__("pyueye.ueye")
    loaded = Stub(path)
    shutil.rmtree(folder)
    return loaded
