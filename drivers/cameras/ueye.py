"""IDS uEye cameras through pyueye (the optional extra `ueye`) and IDS' own driver.

`UeyeDevice` is the camera, `UeyeMemory` its stream of frames, `Ueye` the vendor's functions for one open camera.
Everything but the trigger delay is set with the camera stopped: these cameras have frozen when their clock, exposure or
region of interest was set while they were running.
"""

from __future__ import annotations

import ctypes
import importlib
import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import InputError
from slopegate.core.rig.rig import Rig
from slopegate.core.rig.settings import (
    GateSettings,
    PixelClocks,
    ShutterLimits,
    StartDelayUs,
    from_trigger,
    quantise,
    to_trigger,
)
from slopegate.drivers.cameras.device_camera import (
    FREE_RUNNING,
    IN_FLIGHT,
    RESTARTED,
    TRIGGERED,
    Arrival,
    Device,
    DeviceCamera,
    trigger_delay,
    widened,
)
from slopegate.drivers.contract.camera import CameraError, CameraGoneError
from slopegate.drivers.contract.families import Found
from slopegate.drivers.contract.frame import (
    Abilities,
    Ability,
    CameraInfo,
    Modes,
    OpenOptions,
    PixelFormat,
    TriggerEdge,
)

INSTALL_PACKAGE: Final = "uEye cameras need the Python package pyueye: pip install 'slopegate[ueye]'."
INSTALL_LIBRARY: Final = (
    "uEye cameras need IDS' own driver (IDS Software Suite), which is not installed here, "
    "or not where PYUEYE_DLL_PATH says."
)

# Return codes of the vendor's functions.
SUCCESS, TRANSFER_FAILED, TIMED_OUT, BAD_VALUE, NOT_SUPPORTED = 0, 3, 122, 125, 155
MEANINGS: Final = {
    1: "the camera is not there any more",
    2: "the camera does not answer",
    3: "the camera cannot be opened",
    17: "the driver does not answer",
    101: "the camera cannot be opened",
    120: "all cameras are in use",
    122: "it took too long",
    125: "a value is not allowed",
    140: "the camera is running",
    155: "the camera cannot do that",
    178: "the camera is in use",
}
GONE: Final = {1, 2, 17}

# What the vendor's functions are asked for, with the function's name.
CLOCK_NUMBER, CLOCK_LIST, CLOCK_GET, CLOCK_SET = 1, 2, 5, 6  # is_PixelClock
EXPOSURE_RANGE, EXPOSURE_GET, EXPOSURE_SET = 6, 7, 12  # is_Exposure
GET_DELAY, GET_MIN_DELAY, GET_MAX_DELAY, GET_DELAY_STEP = 0x8000, 0x8001, 0x8002, 0x8003  # is_SetTriggerDelay
TRIGGER_OFF, TRIGGER_FALLING, TRIGGER_RISING = 0x0000, 0x1001, 0x1002  # is_SetExternalTrigger
FEATURES_GET, SHUTTER_SET, SHUTTER_GET, ROLLING = 1, 6, 7, 1  # is_DeviceFeature
AOI_SET, AOI_GET, AOI_SIZE_MIN, AOI_POS_STEP, AOI_SIZE_STEP = 0x0001, 0x0002, 0x0008, 0x0011, 0x0012  # is_AOI
QUEUE_START, QUEUE_END, QUEUE_WAIT, QUEUE_PENDING = 0, 1, 2, 4  # is_ImageQueue
DONT_WAIT, FORCE_STOP = 0x0000, 0x4000  # is_CaptureVideo, is_StopLiveVideo
USE_DEVICE_ID: Final = 0x8000  # is_InitCamera
MODE_GET: Final = 0x8000  # is_SetColorMode

RAW_MODES: Final = ((12, 27, 26), (10, 33, 34), (8, 11, 6))
"""Bits a pixel, and the colour modes of a mosaic and of a monochrome sensor."""
COLOUR_SENSOR: Final = 2
MOSAICS: Final = {0: "rg", 1: "gr", 2: "bg"}
"""By the colour of the first pixel; a first row that begins with green is taken to go on with red."""
BUFFERS: Final = 8
"""Frames that the image memory holds."""
ROOM: Final = 1.05
"""A frame that is not triggered takes this much longer than its exposure, at least."""
TICK_S: Final = 1e-7
"""Unit of a camera's clock, seconds."""


def missing_ueye() -> str:
    """One sentence on what to install; empty when all is here."""
    try:
        _load()
    except CameraError as error:
        return str(error)
    return ""


def find_ueye() -> list[Found]:
    """Every uEye camera that IDS' driver sees."""
    found = []
    for info in _cameras(_load()):
        serial, model = _text(info.SerNo), _text(info.FullModelName) or _text(info.Model)
        problem = "It is in use by another program." if int(info.dwInUse) else ""
        found.append(Found("camera", "ueye", serial, f"IDS {model}", f"serial number {serial}", problem))
    return found


def open_ueye(where: str, rig: Rig, options: OpenOptions | None = None) -> DeviceCamera:
    """A camera by its serial number, the `where` of `find_ueye`. Raises CameraError."""
    chosen = options or OpenOptions()
    return DeviceCamera(lambda: UeyeDevice(where, rig, chosen))


class UeyeDevice(Device):
    """An open uEye camera with its trigger, gate and region of interest."""

    def __init__(self, serial: str, rig: Rig, options: OpenOptions) -> None:
        """Raises CameraError when it cannot be opened, or has nothing in common with the rig file."""
        self._period_us, self._triggered = rig.projector.period_us, options.triggered
        self._rate_hz = None if options.triggered else options.rate_hz
        self._memory: UeyeMemory | None = None
        self._asked: GateSettings | None = None
        self._applied: GateSettings | None = None
        self._shutter: tuple[int, float] | None = None
        """Clock in MHz and exposure in microseconds as they were asked for last."""
        self._exposure_us = 0.0
        self._number = 0
        self._frame: int | None = None
        self._api = _open(_load(), serial)
        try:
            self._set_up(rig, options)
        except BaseException:
            with suppress(CameraError):
                self._api.call("ExitCamera")
            raise

    @property
    def info(self) -> CameraInfo:
        """Fixed facts."""
        return self._info

    def apply(self, settings: GateSettings) -> tuple[GateSettings, int]:
        """Set the gate and read it back; the camera runs on only when nothing but the delay changes."""
        wanted = to_trigger(quantise(self._limits, settings, self._period_us))
        first_us = self._rows[0] * wanted.line_time_us + self._limits.delay_offset_us
        self._delay(wanted.start_us + first_us)  # refuses before anything is written
        shutter = round(self._clocks.clock_mhz(wanted.line_time_us)), wanted.exposure_us
        before, pending = self._applied, self._memory.waiting() if self._memory else 0
        with self._paused(shutter != self._shutter) as paused:
            if shutter != self._shutter:
                self._shutter = None
                self._exposure_us = _set_shutter(self._api, *shutter, self._rate_hz)
                self._shutter = shutter
            # the middle of the exposure stays where it was asked for
            start_us = wanted.start_us + (wanted.exposure_us - self._exposure_us) / 2
            with suppress(InputError):
                delay_us, turns = self._delay(start_us + first_us)
                got_us = _set_delay(self._api, delay_us) if self._triggered else 0.0
                start_us = got_us - turns * self._period_us - first_us
        self._asked = settings
        at = replace(wanted, start_us=StartDelayUs(start_us), exposure_us=self._exposure_us)
        self._applied = from_trigger(at)
        if paused or self._memory is None:
            return self._applied, RESTARTED
        return self._applied, 0 if self._applied == before else pending + IN_FLIGHT

    def set_rows(self, first: int, last: int) -> tuple[tuple[int, int], int]:
        """Read these rows only; the gate is set again, for another height changes every range."""
        least = self._api.tell("AOI", AOI_SIZE_MIN, self._api.ueye.IS_SIZE_2D()).s32Height
        size = self._api.tell("AOI", AOI_SIZE_STEP, self._api.ueye.IS_SIZE_2D()).s32Height
        place = self._api.tell("AOI", AOI_POS_STEP, self._api.ueye.IS_POINT_2D()).s32Y
        unit = 1 if self._info.pixel_format.startswith("mono") else 2  # a mosaic keeps its colours
        step = math.lcm(max(1, int(size)), max(1, int(place)), unit)
        rows, before = widened((first, last), self._info.height, int(least), step), self._rows
        if rows == before:
            return rows, 0
        with self._paused(True):
            self._read_only(rows)
            if self._asked is not None:
                try:
                    self.apply(self._asked)
                except InputError:
                    self._read_only(before)
                    self.apply(self._asked)
                    raise
        return rows, RESTARTED

    def trigger_on(self, edge: TriggerEdge) -> int:
        """Choose the edge with the camera stopped, so that no frame of the other one is left."""
        with self._paused(True):
            self._api.call("SetExternalTrigger", TRIGGER_RISING if edge == "rising" else TRIGGER_FALLING)
        return RESTARTED

    def start(self) -> None:
        """Begin to make frames, in a new image memory."""
        if self._memory is None:
            self._memory = UeyeMemory(self._api, self._info.width, self._rows[1] - self._rows[0], self._bits)
            self._frame = None

    def stop(self) -> None:
        """Make no more frames, and free the image memory."""
        memory, self._memory = self._memory, None
        if memory is not None:
            memory.close()

    def fetch(self, buffer: Counts, timeout_s: float) -> Arrival | None:
        """Take the next frame from the image memory."""
        if self._memory is None:
            return None
        first, last = self._rows
        taken = self._memory.take(buffer[first:last], timeout_s)
        if taken is None:
            return None
        frame, clock_s = taken
        buffer[:first] = buffer[last:] = 0
        self._number += 1 if self._frame is None else frame - self._frame
        self._frame = frame
        return Arrival(self._number, clock_s=clock_s)

    def check(self) -> None:
        """Raise CameraGoneError when the camera does not answer."""
        self._api.ask("PixelClock", CLOCK_GET, ctypes.c_uint)

    def close(self) -> None:
        """Let the camera go."""
        try:
            self.stop()
        finally:
            self._api.call("ExitCamera")

    def _set_up(self, rig: Rig, options: OpenOptions) -> None:
        api, lens = self._api, rig.camera.lens
        sensor = api.ueye.SENSORINFO()
        api.call("GetSensorInfo", sensor)
        colour = _number(sensor.nColorMode) == COLOUR_SENSOR
        mosaic = MOSAICS[_number(sensor.nUpperLeftBayerPixel)] if colour else ""
        offered = _offered(api, colour)
        names = {f"Bayer{mosaic.upper()}{bits}" if colour else f"Mono{bits}": bits for bits in offered}
        self._bits = _set_depth(api, offered, names, options.pixel_format)
        _set_rolling(api)
        api.call("SetExternalTrigger", TRIGGER_RISING if self._triggered else TRIGGER_OFF)
        self._span = _delay_span(api)
        most = int(sensor.nMaxWidth), int(sensor.nMaxHeight)
        self._size = (lens.width, lens.height) if lens.width <= most[0] and lens.height <= most[1] else most
        self._read_only((0, self._size[1]))
        self._limits, self._clocks = _shutter_limits(api, rig)
        free = Ability("" if self._triggered else FREE_RUNNING)
        can = Abilities(
            delay=free,
            trigger=free,
            rows=Ability(),
            choose_format=Ability("" if len(names) > 1 else "The camera has no other raw pixel format."),
            choose_rate=Ability(TRIGGERED if self._triggered else ""),
            edge=free,
        )
        form = cast(PixelFormat, f"bayer_{mosaic}{self._bits}" if colour else f"mono{self._bits}")
        top, modes = 2**self._bits - 1, self._modes(names)
        self._info = CameraInfo(api.name, *self._size, form, top, 0.0, self._limits, can, modes)

    def _modes(self, names: dict[str, int]) -> Modes:
        """Format, and rate as asked for: what comes of the rate depends on the clock and exposure of each gate."""
        present = next(name for name, bits in names.items() if bits == self._bits)
        return Modes(present, tuple(names), self._rate_hz or math.inf)

    def _delay(self, exact_us: float) -> tuple[float, int]:
        return trigger_delay(self._span, exact_us, self._period_us) if self._triggered else (0.0, 0)

    def _read_only(self, rows: tuple[int, int]) -> None:
        wanted = (0, rows[0], self._size[0], rows[1] - rows[0])
        area = self._api.ueye.IS_RECT()
        area.s32X, area.s32Y, area.s32Width, area.s32Height = wanted
        self._api.tell("AOI", AOI_SET, area)
        area = self._api.tell("AOI", AOI_GET, self._api.ueye.IS_RECT())
        got = tuple(int(part) for part in (area.s32X, area.s32Y, area.s32Width, area.s32Height))
        if got != wanted:
            raise CameraError(f"{self._api.name} was told to read x, y, width, height {wanted} and reads {got}")
        self._rows, self._shutter = rows, None

    @contextmanager
    def _paused(self, wanted: bool) -> Iterator[bool]:
        """Stop the camera meanwhile, if wanted and running; tells whether it was."""
        pause = wanted and self._memory is not None
        if pause:
            self.stop()
        try:
            yield pause
        finally:
            if pause:
                self.start()


class UeyeMemory:
    """The image memory of a camera that is live, from construction to `close`."""

    def __init__(self, api: Ueye, width: int, height: int, bits: int) -> None:
        """Pixels of more than 8 bits lie in 16, lowest bit first. Frees everything when it raises CameraError."""
        self._api, self._width, self._bytes = api, width, 1 if bits == 8 else 2
        self._height = height
        self._held: list[tuple[Any, Any]] = []
        try:
            for _ in range(BUFFERS):
                address, number = api.ueye.c_mem_p(), ctypes.c_int()
                api.call("AllocImageMem", width, height, 8 * self._bytes, address, number)
                self._held.append((address, number))
                api.call("AddToSequence", address, number)
            self._pitch = self._ask_pitch()
            api.call("ImageQueue", QUEUE_START, None, 0)
            api.call("CaptureVideo", DONT_WAIT)
        except BaseException:
            self._free()
            raise

    def take(self, out: Counts, timeout_s: float) -> tuple[int, float | None] | None:
        """Copy the next frame into `out` (height, width); its number and its time by the camera's clock, seconds.

        None after the time-out or a failed transfer; no time from a camera that has no clock.
        """
        api = self._api
        address, number = api.ueye.c_mem_p(), ctypes.c_int()
        place = ctypes.cast(ctypes.pointer(address), ctypes.POINTER(ctypes.c_void_p))
        wait = _Wait(max(1, int(timeout_s * 1000)), place, ctypes.pointer(number))
        if api.call("ImageQueue", QUEUE_WAIT, wait, ctypes.sizeof(wait), allowed=(TIMED_OUT, TRANSFER_FAILED)) != 0:
            return None
        try:
            info = api.ueye.UEYEIMAGEINFO()
            api.call("GetImageInfo", number, info, ctypes.sizeof(info))
            raw = (ctypes.c_uint8 * (self._pitch * self._height)).from_address(address.value)
            rows = np.frombuffer(memoryview(raw), np.uint8).reshape(self._height, self._pitch)[
                :, : self._width * self._bytes
            ]
            out[:] = rows if self._bytes == 1 else rows.view("<u2")
            return int(info.u64FrameNumber), int(info.u64TimestampDevice) * TICK_S or None
        finally:
            api.call("UnlockSeqBuf", number, address)

    def waiting(self) -> int:
        """Frames in the queue that nobody took yet."""
        return int(self._api.ask("ImageQueue", QUEUE_PENDING, ctypes.c_uint)[0])

    def close(self) -> None:
        """Stop and free; raises the first error after having tried everything."""
        stopped, freed = self._try("StopLiveVideo", FORCE_STOP), self._free()
        error = stopped or freed
        if error is not None:
            raise error

    def _free(self) -> CameraError | None:
        errors = [self._try("ImageQueue", QUEUE_END, None, 0), self._try("ClearSequence")]
        errors += [self._try("FreeImageMem", address, number) for address, number in self._held]
        self._held = []
        return next((error for error in errors if error is not None), None)

    def _try(self, function: str, *arguments: Any) -> CameraError | None:
        try:
            self._api.call(function, *arguments)
        except CameraError as error:
            return error
        return None

    def _ask_pitch(self) -> int:
        width, height, bits, pitch = (ctypes.c_int() for _ in range(4))
        address, number = self._held[0]
        self._api.call("InquireImageMem", address, number, width, height, bits, pitch)
        if pitch.value < self._width * self._bytes:
            row = f"rows of {self._width} pixels of {self._bytes} bytes"
            raise CameraError(f"{self._api.name} keeps {row} {pitch.value} bytes apart")
        return pitch.value


class _Wait(ctypes.Structure):
    """IMAGEQUEUEWAITBUFFER."""

    _fields_ = (
        ("timeout_ms", ctypes.c_uint),
        ("address", ctypes.POINTER(ctypes.c_void_p)),
        ("number", ctypes.POINTER(ctypes.c_int)),
    )


class Ueye:
    """The vendor's functions for one open camera. `name` is what the camera is called in errors."""

    def __init__(self, ueye: Any, handle: int, name: str) -> None:
        self.ueye, self.handle, self.name = ueye, handle, name

    def call(self, function: str, *arguments: Any, allowed: tuple[int, ...] = ()) -> int:
        """Call is_`function` for this camera. Raises CameraError unless it succeeds or gives an allowed code."""
        code = int(getattr(self.ueye, f"is_{function}")(self.handle, *arguments))
        if code not in allowed:
            _raise_for(code, f"{self.name}: is_{function}")
        return code

    def ask(self, function: str, command: int, kind: Any, count: int = 1) -> list[Any]:
        """Ask is_`function` for `count` values of a ctypes number."""
        values = (kind * count)()
        self.call(function, command, values, ctypes.sizeof(values))
        return list(values)

    def tell(self, function: str, command: int, value: Any) -> Any:
        """Give is_`function` a ctypes number or structure; return it, for the function may change it."""
        self.call(function, command, value, ctypes.sizeof(value))
        return value


def _load() -> Any:
    """The module pyueye.ueye. Raises CameraError saying which part is missing."""
    try:
        return importlib.import_module("pyueye.ueye")
    except ModuleNotFoundError:
        raise CameraError(INSTALL_PACKAGE) from None
    except (ImportError, OSError):
        raise CameraError(INSTALL_LIBRARY) from None


def _raise_for(code: int, about: str) -> None:
    """Raise the error that a return code stands for, none for success."""
    if code != SUCCESS:
        kind = CameraGoneError if code in GONE else CameraError
        raise kind(f"{about}: {MEANINGS.get(code, 'it failed')} (uEye error {code})")


def _cameras(ueye: Any) -> list[Any]:
    """Every camera that the driver lists (UEYE_CAMERA_INFO)."""
    count = ctypes.c_int()
    _raise_for(int(ueye.is_GetNumberOfCameras(count)), "The search for uEye cameras")
    if count.value < 1:
        return []
    listed = ueye.UEYE_CAMERA_LIST(uci=(ueye.UEYE_CAMERA_INFO * count.value)())
    listed.dwCount = count.value
    _raise_for(int(ueye.is_GetCameraList(listed)), "The search for uEye cameras")
    return list(listed.uci)[: int(listed.dwCount)]


def _open(ueye: Any, serial: str) -> Ueye:
    known = {_text(info.SerNo): info for info in _cameras(ueye)}
    if serial not in known:
        raise CameraError(f"No uEye camera has the serial number {serial!r} (there are: {', '.join(known) or 'none'})")
    info = known[serial]
    name = f"IDS {_text(info.FullModelName) or _text(info.Model)} {serial}"
    if int(info.dwInUse):
        raise CameraError(f"{name} is in use by another program")
    handle = ctypes.c_uint(int(info.dwDeviceID) | USE_DEVICE_ID)
    _raise_for(int(ueye.is_InitCamera(handle, None)), name)
    return Ueye(ueye, handle.value, name)


def _shutter_limits(api: Ueye, rig: Rig) -> tuple[ShutterLimits, PixelClocks]:
    """The rig file's limits with those of its clocks that the camera has. Raises CameraError when that is none."""
    limits, line = rig.camera.shutter, rig.camera.shutter.line
    if not isinstance(line, PixelClocks):
        raise CameraError(f"{api.name} has pixel clocks: the rig file must give clocks_per_line and ladder_mhz")
    count = api.ask("PixelClock", CLOCK_NUMBER, ctypes.c_uint)[0]
    offered = api.ask("PixelClock", CLOCK_LIST, ctypes.c_uint, count)
    ladder = tuple(mhz for mhz in line.ladder_mhz if mhz in offered)
    if not ladder:
        raise CameraError(f"{api.name} has the clocks {offered} MHz, and none of them is on the rig file's ladder")
    clocks = PixelClocks(line.clocks_per_line, ladder)
    return replace(limits, line=clocks), clocks


def _set_shutter(api: Ueye, clock_mhz: int, exposure_us: float, rate_hz: float | None) -> float:
    """Set clock, frame rate and exposure of a stopped camera; returns the exposure in microseconds that it has now."""
    api.tell("PixelClock", CLOCK_SET, ctypes.c_uint(clock_mhz))
    got = api.ask("PixelClock", CLOCK_GET, ctypes.c_uint)[0]
    if got != clock_mhz:
        raise CameraError(f"{api.name} was told a pixel clock of {clock_mhz} MHz and has {got} MHz")
    shortest_s, longest_s, step_s = ctypes.c_double(), ctypes.c_double(), ctypes.c_double()
    api.call("GetFrameTimeRange", shortest_s, longest_s, step_s)
    frame_s = max(shortest_s.value, ROOM * exposure_us * 1e-6, 0.0 if rate_hz is None else 1 / rate_hz)
    api.call("SetFrameRate", 1 / min(frame_s, longest_s.value), ctypes.c_double())
    low_ms, high_ms, _ = api.ask("Exposure", EXPOSURE_RANGE, ctypes.c_double, 3)
    api.tell("Exposure", EXPOSURE_SET, ctypes.c_double(min(max(exposure_us * 1e-3, low_ms), high_ms)))
    return float(api.ask("Exposure", EXPOSURE_GET, ctypes.c_double)[0]) * 1e3


def _delay_span(api: Ueye) -> tuple[float, float, float]:
    """Smallest and largest trigger delay and its step, microseconds. The function returns them instead of a code."""
    low, high, step = (
        float(api.ueye.is_SetTriggerDelay(api.handle, what)) for what in (GET_MIN_DELAY, GET_MAX_DELAY, GET_DELAY_STEP)
    )
    return low, high, step


def _set_delay(api: Ueye, delay_us: float) -> float:
    """Set the trigger delay in microseconds; return the one read back."""
    api.call("SetTriggerDelay", round(delay_us))
    return float(api.ueye.is_SetTriggerDelay(api.handle, GET_DELAY))


def _offered(api: Ueye, colour: bool) -> dict[int, int]:
    """Colour modes of the raw formats that the camera has, by bits a pixel. They are found by trying."""
    modes = {bits: mosaic if colour else mono for bits, mosaic, mono in reversed(RAW_MODES)}
    takes = {
        bits: api.call("SetColorMode", mode, allowed=(NOT_SUPPORTED, BAD_VALUE)) == 0 for bits, mode in modes.items()
    }
    return {bits: mode for bits, mode in modes.items() if takes[bits]}


def _set_depth(api: Ueye, offered: dict[int, int], names: dict[str, int], wanted: str | None) -> int:
    """Set the raw format of this name, or the deepest one for None; return its bits a pixel, as read back."""
    if not offered:
        raise CameraError(f"{api.name} has no raw format of 8, 10 or 12 bits")
    if wanted is not None and wanted not in names:
        raise CameraError(f"{api.name} offers the pixel formats {', '.join(names)}: not {wanted}")
    bits = max(offered) if wanted is None else names[wanted]
    api.call("SetColorMode", offered[bits])
    got = int(api.ueye.is_SetColorMode(api.handle, MODE_GET))
    if got != offered[bits]:
        raise CameraError(f"{api.name} was told colour mode {offered[bits]} and has {got}")
    return bits


def _set_rolling(api: Ueye) -> None:
    """Switch to the rolling shutter, where the sensor has others too."""
    if api.ask("DeviceFeature", FEATURES_GET, ctypes.c_uint)[0] & ROLLING:
        api.tell("DeviceFeature", SHUTTER_SET, ctypes.c_uint(ROLLING))
        got = api.ask("DeviceFeature", SHUTTER_GET, ctypes.c_uint)[0]
        if got != ROLLING:
            raise CameraError(f"{api.name} was told to use its rolling shutter and uses shutter mode {got}")


def _text(field: Any) -> str:
    return bytes(field).split(b"\0")[0].decode("latin-1").strip()


def _number(field: Any) -> int:
    """The number in a C char."""
    return bytes(field)[0]
