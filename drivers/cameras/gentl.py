"""Cameras of any vendor through GenTL producers (.cti files) and harvesters (the optional extra `gentl`)."""

from __future__ import annotations

import importlib
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.device_camera import DeviceCamera
from slopegate.drivers.cameras.genicam_device import Block, GenicamDevice
from slopegate.drivers.cameras.pixels import bits_of, layout_of, without_padding
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.families import Found
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.files.library_words import words_of

SEARCH_PATH: Final = "GENICAM_GENTL64_PATH"
"""Folders of producers, set by the vendors' installers (GenTL standard)."""
BUFFERS: Final = 8
INSTALL: Final = "GenTL needs the Python packages harvesters and genicam: pip install 'slopegate[gentl]'."
SHARED: Final = "GenTL's package genicam needs Python as a shared library: sudo apt-get install libpython{}.{}."
GONE: Final = ("TimeoutException", "IoException", "AbortException", "BusyException", "ErrorException")
"""What GenTL raises, besides an invalid handle, once a device does not answer."""


def missing_gentl() -> str:
    """One sentence on what to install; empty when all is here."""
    try:
        _load("harvesters.core")
    except CameraError as error:
        return str(error)
    if not producer_files():
        return f"No GenTL producer is installed: a vendor's software brings one and sets {SEARCH_PATH}."
    return ""


def producer_files() -> tuple[Path, ...]:
    """Every .cti file in the folders of GENICAM_GENTL64_PATH."""
    folders = [Path(part) for part in os.environ.get(SEARCH_PATH, "").split(os.pathsep) if part]
    return tuple(sorted({path for folder in folders if folder.is_dir() for path in folder.glob("*.cti")}))


def find_gentl() -> list[Found]:
    """Every camera that the producers see. While one is open, those that were there when it was opened."""
    return producers(producer_files()).find()


def open_gentl(where: str, rig: Rig, options: OpenOptions | None = None) -> DeviceCamera:
    """A camera by the `where` of `find_gentl`. Raises CameraError."""
    chosen, files = options or OpenOptions(), producer_files()
    return DeviceCamera(lambda: GenicamDevice(GentlTransport(where, producers(files)), rig, chosen))


@cache
def producers(files: tuple[Path, ...]) -> Producers:
    """The producers of this process: GenTL lets each be initialised once."""
    return Producers(files)


class Producers:
    """All GenTL producers together. A new search ends every open camera, so it is done only while none is open."""

    def __init__(self, files: tuple[Path, ...]) -> None:
        """Raises CameraError without harvesters or without a file."""
        core = _load("harvesters.core")
        # it reports what it also raises
        logging.getLogger("harvesters").setLevel(logging.CRITICAL)
        if not files:
            raise CameraError(f"No GenTL producer is installed: a vendor's software brings one and sets {SEARCH_PATH}.")
        self._harvester: Any = core.Harvester()
        for file in files:
            self._harvester.add_file(str(file))
        self._lock = threading.Lock()
        self._open = 0

    def find(self) -> list[Found]:
        """Every camera that is there."""
        with self._lock:
            self._look()
            return [_named(ways[0]) for ways in self._cameras()]

    def open(self, where: str) -> tuple[Any, str]:
        """An ImageAcquirer and the camera's name. Raises CameraError for one that is not there or is in use."""
        with self._lock:
            self._look()
            cameras = {ways[0].id_: ways for ways in self._cameras()}
            ways = next((ways for ways in cameras.values() if where in {info.id_ for info in ways}), None)
            if ways is None:
                raise CameraError(
                    f"No GenTL producer sees a camera {where!r} (it sees: {', '.join(cameras) or 'none'})"
                )
            info, acquirer = self._through_one(ways)
            self._open += 1
            return acquirer, " ".join(part for part in (_named(info).name, info.serial_number) if part)

    def close(self, acquirer: Any) -> None:
        """Let it go."""
        with self._lock:
            self._open -= 1
            with suppress(Exception):  # a device that is gone cannot be told
                acquirer.destroy()

    def _cameras(self) -> list[list[Any]]:
        """Every camera once, with all the ways to it: two interfaces or producers may see the same one."""
        cameras: dict[tuple[str, ...], list[Any]] = {}
        for info in self._harvester.device_info_list:
            numbered = (info.vendor, info.model, info.serial_number) if info.serial_number else ()
            ways = next((known for known in cameras.values() if known[0].id_ == info.id_), None)
            (cameras.setdefault(numbered or (info.id_,), []) if ways is None else ways).append(info)
        return list(cameras.values())

    def _through_one(self, ways: Sequence[Any]) -> tuple[Any, Any]:
        """The first of the ways that opens, and its ImageAcquirer. Raises CameraError."""
        for info in ways:
            try:
                return info, self._harvester.create(info)
            except Exception as error:
                failure = error
        used = "AccessDenied" in type(failure).__name__ or "ResourceInUse" in type(failure).__name__
        why = "is in use" if used else f"cannot be opened ({words_of(failure)})"
        raise CameraError(f"{_named(ways[0]).name} {why}") from None

    def _look(self) -> None:
        if self._open == 0:
            self._harvester.update()


class GentlFeatures:
    """Features of a GenApi node map."""

    def __init__(self, nodes: Any, talk: Callable[[str], Any]) -> None:
        """`talk` is a context manager that turns GenApi's errors into CameraError."""
        self._nodes, self._talk = nodes, talk
        self._modes = _load("genicam.genapi").EAccessMode

    def has(self, name: str) -> bool:
        """Whether it can be read now."""
        with self._talk(name):
            return self._mode(name) in (self._modes.RO, self._modes.RW)

    def writable(self, name: str) -> bool:
        """Whether it can be written now."""
        with self._talk(name):
            return self._mode(name) in (self._modes.WO, self._modes.RW)

    def number(self, name: str) -> float:
        """The value of an integer or float."""
        with self._talk(name):
            return float(self._nodes.get_node(name).value)

    def span(self, name: str) -> tuple[float, float, float]:
        """Bounds and increment."""
        with self._talk(name):
            node = self._nodes.get_node(name)
            stepped = not hasattr(node, "has_inc") or node.has_inc()
            return float(node.min), float(node.max), float(node.inc) if stepped else 0.0

    def set_number(self, name: str, value: float) -> None:
        """Write an integer or float."""
        with self._talk(name):
            node = self._nodes.get_node(name)
            # only floats have a display precision
            node.value = float(value) if hasattr(node, "display_precision") else round(value)

    def is_on(self, name: str) -> bool:
        """The value of a boolean."""
        with self._talk(name):
            return bool(self._nodes.get_node(name).value)

    def switch(self, name: str, on: bool) -> None:
        """Write a boolean."""
        with self._talk(name):
            self._nodes.get_node(name).value = on

    def unit(self, name: str) -> str:
        """The unit that the camera's description gives."""
        with self._talk(name):
            return str(self._nodes.get_node(name).unit)

    def choice(self, name: str) -> str:
        """The present entry."""
        with self._talk(name):
            return str(self._nodes.get_node(name).value)

    def choices(self, name: str) -> tuple[str, ...]:
        """The entries that can be chosen now."""
        with self._talk(name):
            return tuple(self._nodes.get_node(name).symbolics)

    def choose(self, name: str, entry: str) -> None:
        """Write an enumeration."""
        with self._talk(name):
            self._nodes.get_node(name).value = entry

    def _mode(self, name: str) -> Any:
        if not self._nodes.has_node(name):
            return self._modes.NI
        node = self._nodes.get_node(name)
        return node.get_access_mode() if hasattr(node, "get_access_mode") else self._modes.NI


class GentlTransport:
    """A GenICam transport over harvesters' ImageAcquirer."""

    def __init__(self, where: str, owner: Producers) -> None:
        """Raises CameraError when it cannot be opened."""
        self._owner = owner
        self._bits = 8
        self.name = where
        self._acquirer, self.name = owner.open(where)
        self.features = GentlFeatures(self._acquirer.remote_device.node_map, self._talk)
        self._acquirer.num_buffers = max(BUFFERS, self._acquirer.min_num_buffers)

    def begin(self) -> None:
        """Announce buffers and start the acquisition."""
        layout = layout_of(self.features.choice("PixelFormat"))
        self._bits = 8 if layout is None else layout.bytes_of(8)
        with self._talk("acquisition"):
            self._acquirer.start()

    def end(self) -> None:
        """Stop the acquisition and revoke the buffers."""
        with self._talk("acquisition"):
            self._acquirer.stop()

    def fetch(self, take: Callable[[Block], None], timeout_s: float) -> bool:
        """Show the next buffer to `take`; harvesters leaves out frames with parts missing."""
        with self._talk("acquisition"):
            # a time-out of 0 would be none at all
            buffer = self._acquirer.try_fetch(timeout=max(timeout_s, 1e-3), is_raw=True)
        if buffer is None:
            return False
        try:
            with self._talk("frame"):
                clock_s = _known(buffer, "timestamp_ns") * 1e-9 or None
                block = Block(buffer.frame_id, _pixels(buffer, self._bits), buffer.width, buffer.height, clock_s)
            take(block)
            return True
        finally:
            buffer.parent.queue_buffer(buffer)

    def waiting(self) -> int:
        """Buffers filled and not fetched."""
        with self._talk("acquisition"):
            return int(self._acquirer.data_streams[0].module.num_awaiting_delivery)

    def lost_packets(self) -> int:
        """0: GenTL does not count packets."""
        return 0

    def check(self) -> None:
        """Raise CameraGoneError unless the device itself answers, past the cache."""
        try:
            self._acquirer.remote_device.node_map.get_node("Width").get_value(False, True)
        except Exception as error:
            raise CameraGoneError(f"{self.name} does not answer ({words_of(error)})") from None

    def close(self) -> None:
        """Let the camera go."""
        if self._acquirer is not None:
            self._owner.close(self._acquirer)
            self._acquirer = None

    @contextmanager
    def _talk(self, what: str) -> Iterator[None]:
        try:
            yield
        except CameraError:
            raise
        except Exception as error:
            kind = CameraGoneError if type(error).__name__ in GONE else CameraError
            raise kind(f"{self.name}: {what}: {words_of(error)}") from None


def _pixels(buffer: Any, bits: int = 8) -> Bytes:
    """The bytes of the image without padding. `bits`: of a pixel, where its format's number does not tell them.

    Behind the image may lie chunk data, which the filled size counts. Raises CameraError.
    """
    offset, padding = _known(buffer, "image_offset"), _known(buffer, "padding_x")
    size = _known(buffer, "size_filled") or buffer.size
    data = np.frombuffer(buffer.raw_buffer, np.uint8)[offset : max(size, offset)]
    bits = bits_of(_known(buffer, "pixel_format")) or bits
    return without_padding(data, (buffer.height, buffer.width), bits, padding)


def _known(buffer: Any, name: str) -> int:
    """A number that the producer may leave out; 0 then."""
    try:
        return int(getattr(buffer, name))
    except Exception:
        return 0


def _named(info: Any) -> Found:
    name = " ".join(part for part in (info.vendor, info.model) if part) or info.id_
    detail = ", ".join(part for part in (info.serial_number, info.tl_type) if part)
    return Found("camera", "gentl", info.id_, name, detail)


def _load(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        if "libpython" in str(error):  # a Debian Python comes without it
            raise CameraError(SHARED.format(*sys.version_info)) from None
        raise CameraError(f"{INSTALL} ({words_of(error)})") from None
