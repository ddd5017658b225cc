"""GigE Vision and USB3 Vision cameras through aravis: no vendor's software, Linux only (Debian: gir1.2-aravis-0.8)."""

from __future__ import annotations

import importlib
import os
import socket
import struct
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.rig import Rig
from slopegate.drivers.cameras.device_camera import DeviceCamera
from slopegate.drivers.cameras.genicam_device import Block, GenicamDevice
from slopegate.drivers.cameras.pixels import bits_of, without_padding
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.families import Found
from slopegate.drivers.contract.frame import OpenOptions
from slopegate.drivers.files.library_words import words_of

PORT: Final = 3956
CONTROL_REGISTER: Final = 0x0A00
"""Control channel privilege; 0 while nobody controls the camera."""
KEY, ACKNOWLEDGE, READ, READ_ANSWER = 0x42, 0x01, 0x0080, 0x0081


def control_privilege(host: str, timeout_s: float = 0.25, tries: int = 3) -> int | None:
    """The register's value, -1 for an answer that refuses it, None when the camera at this address does not answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        asker.settimeout(timeout_s)
        for number in range(1, tries + 1):
            question = struct.pack(">BBHHHI", KEY, ACKNOWLEDGE, READ, 4, number, CONTROL_REGISTER)
            try:
                asker.sendto(question, (host, PORT))
                answer = asker.recv(64)
            except OSError:  # no answer, or nobody at this port
                continue
            if len(answer) >= 8:
                status, command, length, _ = struct.unpack(">HHHH", answer[:8])
                whole = command == READ_ANSWER and status == 0 and length >= 4 and len(answer) >= 12
                return int(struct.unpack(">I", answer[8:12])[0]) if whole else -1
    return None


BUFFERS: Final = 8
SYSTEM_PACKAGES: Final = Path("/usr/lib/python3/dist-packages")
"""Where Debian keeps the bindings; they work in a virtual environment of the same Python version."""
INSTALL: Final = "aravis is not here: on Debian and Ubuntu, apt-get install gir1.2-aravis-0.8 python3-gi."

NO_SEARCH: Final = "SLOPEGATE_NO_NETWORK_SEARCH"
"""Set to anything, this environment variable keeps the search for cameras off the network: GigE Vision broadcasts."""

GONE: Final = {("arv-device-error-quark", code) for code in (3, 4, 5, 6)}
"""Transfer error, no stream, time-out, not found (ArvDeviceError)."""


def missing_aravis() -> str:
    """One sentence on what to install; empty when aravis is here."""
    try:
        _load()
    except CameraError as error:
        return str(error)
    return ""


def find_aravis() -> list[Found]:
    """Every camera that answers; asks on all network interfaces and takes about a second."""
    aravis, glib = _load()
    if os.environ.get(NO_SEARCH):
        aravis.disable_interface("GigEVision")
    with _sentences(glib, "The search for cameras", {}):
        aravis.update_device_list()
        found = []
        for index in range(aravis.get_n_devices()):
            vendor, model = aravis.get_device_vendor(index), aravis.get_device_model(index)
            serial, address = aravis.get_device_serial_nbr(index), aravis.get_device_address(index)
            detail = ", ".join(part for part in (serial, aravis.get_device_protocol(index), address) if part)
            where = aravis.get_device_id(index)
            found.append(Found("camera", "aravis", where, f"{vendor} {model}".strip() or where, detail))
    return found


def open_aravis(where: str, rig: Rig, options: OpenOptions | None = None) -> DeviceCamera:
    """A camera by the `where` of `find_aravis` or by its address. Raises CameraError."""
    chosen = options or OpenOptions()
    return DeviceCamera(lambda: GenicamDevice(AravisTransport(where), rig, chosen))


class AravisFeatures:
    """Features of an ArvDevice."""

    def __init__(self, device: Any, aravis: Any, talk: Callable[[str], Any]) -> None:
        """`talk` is a context manager that turns aravis' errors into CameraError."""
        self._device, self._aravis, self._talk = device, aravis, talk

    def has(self, name: str) -> bool:
        """Whether it is available now."""
        with self._talk(name):
            return bool(self._device.is_feature_available(name))

    def writable(self, name: str) -> bool:
        """Whether it can be written; aravis calls some features write-only that can be read too."""
        with self._talk(name):
            return bool(self._device.get_feature_access_mode(name) != self._aravis.GcAccessMode.RO)

    def number(self, name: str) -> float:
        """The value of an integer or float."""
        with self._talk(name):
            if self._is_integer(name):
                return float(self._device.get_integer_feature_value(name))
            return float(self._device.get_float_feature_value(name))

    def span(self, name: str) -> tuple[float, float, float]:
        """Bounds and increment."""
        with self._talk(name):
            if self._is_integer(name):
                low, high = self._device.get_integer_feature_bounds(name)
                return float(low), float(high), float(self._device.get_integer_feature_increment(name))
            low, high = self._device.get_float_feature_bounds(name)
            step = float(self._device.get_float_feature_increment(name))
            # without an increment aravis gives the smallest positive number
            return float(low), float(high), step if step > sys.float_info.min else 0.0

    def set_number(self, name: str, value: float) -> None:
        """Write an integer or float."""
        with self._talk(name):
            if self._is_integer(name):
                self._device.set_integer_feature_value(name, round(value))
            else:
                self._device.set_float_feature_value(name, float(value))

    def is_on(self, name: str) -> bool:
        """The value of a boolean."""
        with self._talk(name):
            return bool(self._device.get_boolean_feature_value(name))

    def switch(self, name: str, on: bool) -> None:
        """Write a boolean."""
        with self._talk(name):
            self._device.set_boolean_feature_value(name, on)

    def unit(self, name: str) -> str:
        """The unit that the camera's description gives."""
        with self._talk(name):
            return str(self._device.get_feature(name).get_unit() or "")

    def choice(self, name: str) -> str:
        """The present entry."""
        with self._talk(name):
            return str(self._device.get_string_feature_value(name))

    def choices(self, name: str) -> tuple[str, ...]:
        """The entries available."""
        with self._talk(name):
            return tuple(self._device.dup_available_enumeration_feature_values_as_strings(name))

    def choose(self, name: str, entry: str) -> None:
        """Write an enumeration."""
        with self._talk(name):
            self._device.set_string_feature_value(name, entry)

    def release(self) -> None:
        """Let go of the device, which ends with its last user."""
        self._device = None

    def _is_integer(self, name: str) -> bool:
        node = self._device.get_feature(name)
        return isinstance(node, self._aravis.GcInteger) and not isinstance(node, self._aravis.GcFloat)


class AravisTransport:
    """A GenICam transport over an ArvCamera."""

    def __init__(self, where: str) -> None:
        """Raises CameraError for a camera in use, CameraGoneError for one that does not answer."""
        self._aravis, self._glib = _load()
        self.name = where
        self._stream: Any = None
        self._lost = 0
        self._dead = False
        with self._talk(""):
            self._camera: Any = self._aravis.Camera.new(where)
            self._device: Any = self._camera.get_device()
            vendor, model = self._camera.get_vendor_name(), self._camera.get_model_name()
            serial = self._camera.get_device_serial_number()
        self.name = " ".join(part for part in (vendor, model, serial) if part)
        self.features = AravisFeatures(self._device, self._aravis, self._talk)
        self._gigabit = bool(self._camera.is_gv_device())
        if self._gigabit and not self._device.is_controller():
            self._dead = True
            self.close()
            raise CameraError(f"{self.name} is in use by another program")
        self._device.set_range_check_policy(self._aravis.RangeCheckPolicy.ENABLE)

    def begin(self) -> None:
        """Make a stream with its buffers and start the acquisition."""
        with self._talk("acquisition"):
            if self._gigabit:
                self._camera.gv_auto_packet_size()
            self._stream = self._camera.create_stream(None, None)
            if self._stream is None:
                raise CameraError(f"{self.name} has no stream")
            payload = self._camera.get_payload()
            for _ in range(BUFFERS):
                self._stream.push_buffer(self._aravis.Buffer.new_allocate(payload))
            self._camera.set_acquisition_mode(self._aravis.AcquisitionMode.CONTINUOUS)
            self._camera.start_acquisition()

    def end(self) -> None:
        """Stop the acquisition and drop the stream with its buffers."""
        if self._stream is None or self._dead:
            return
        try:
            with self._talk("acquisition"):
                self._camera.stop_acquisition()
        finally:
            self._lost = self.lost_packets()
            self._stream = None

    def fetch(self, take: Callable[[Block], None], timeout_s: float) -> bool:
        """Show the next buffer to `take`; a frame with parts missing is left out."""
        buffer = self._stream.timeout_pop_buffer(int(timeout_s * 1e6))
        if buffer is None:
            return False
        try:
            if buffer.get_status() != self._aravis.BufferStatus.SUCCESS:
                return False
            clock_s = buffer.get_timestamp() * 1e-9 or None  # 0: this camera has no clock
            width, height = buffer.get_image_width(), buffer.get_image_height()
            take(Block(buffer.get_frame_id(), _pixels(buffer), width, height, clock_s))
            return True
        finally:
            self._stream.push_buffer(buffer)

    def waiting(self) -> int:
        """Buffers filled and not fetched."""
        return 0 if self._stream is None else int(self._stream.get_n_buffers()[1])

    def lost_packets(self) -> int:
        """Packets that never came, not even when aravis asked for them again."""
        if self._stream is None:
            return self._lost
        return self._lost + int(self._stream.get_info_uint64_by_name("n_missing_packets"))

    def check(self) -> None:
        """Raise CameraGoneError unless the camera answers and is still ours: one that was restarted is nobody's."""
        if not self._gigabit:
            with self._talk(""):
                self._device.get_integer_feature_value("Width")
            return
        with self._talk(""):
            host = self._device.get_device_address().get_address().to_string()
        privilege = control_privilege(host)
        if not privilege:
            self._dead = True
            raise CameraGoneError(f"{self.name} {'does not answer' if privilege is None else 'was restarted'}")

    def close(self) -> None:
        """Release the camera; one that is gone in a thread, for aravis waits seconds for its answer."""
        held = [self._stream, self._device, self._camera]
        self._stream = self._device = self._camera = None
        self.features.release()
        if self._dead:
            threading.Thread(target=held.clear, name="slopegate-aravis-drop", daemon=True).start()

    @contextmanager
    def _talk(self, what: str) -> Iterator[None]:
        about = f"{self.name}: {what}" if what else self.name
        try:
            with _sentences(self._glib, about, GONE):
                yield
        except CameraGoneError:
            self._dead = True
            raise


def _pixels(buffer: Any) -> Bytes:
    """The bytes of the image without padding. Raises CameraError."""
    data = np.frombuffer(buffer.get_image_data(), np.uint8)
    # an older aravis does not tell it
    padding = int(buffer.get_image_padding()[0]) if hasattr(buffer, "get_image_padding") else 0
    shape = buffer.get_image_height(), buffer.get_image_width()
    return without_padding(data, shape, bits_of(buffer.get_image_pixel_format()) or 8, padding)


@contextmanager
def _sentences(glib: Any, about: str, gone: Any) -> Iterator[None]:
    try:
        yield
    except glib.Error as error:
        kind = CameraGoneError if (error.domain, error.code) in gone else CameraError
        raise kind(f"{about}: {words_of(error)}") from None


def _load() -> tuple[Any, Any]:
    """Aravis and GLib, found beside the system's own Python where this one has no bindings of its own."""
    path = str(SYSTEM_PACKAGES)
    lent = path not in sys.path and "gi" not in sys.modules
    if lent:
        sys.path.append(path)
    try:
        with warnings.catch_warnings():
            # the bindings' own importer is of an older kind than Python wants
            warnings.filterwarnings("ignore", r"DynamicImporter\.exec_module\(\) not found", ImportWarning)
            gi = importlib.import_module("gi")
            gi.require_version("Aravis", "0.8")
            return importlib.import_module("gi.repository.Aravis"), importlib.import_module("gi.repository.GLib")
    except (ImportError, ValueError, AttributeError) as error:
        raise CameraError(f"{INSTALL} ({words_of(error)})") from None
    finally:
        if lent:
            sys.path.remove(path)
