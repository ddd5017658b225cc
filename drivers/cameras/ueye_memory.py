"""Image memory of a running uEye camera: a ring of buffers and the queue that frames are taken from."""

from __future__ import annotations

import ctypes
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from slopegate.drivers.cameras.ueye_api import Ueye
from slopegate.drivers.contract.camera import CameraError

BUFFERS: Final = 8
TIMED_OUT, TRANSFER_FAILED = 122, 3
DONT_WAIT, FORCE_STOP = 0x0000, 0x4000
QUEUE_START, QUEUE_END, QUEUE_WAIT, QUEUE_PENDING = 0, 1, 2, 4


class _Wait(ctypes.Structure):
    """IMAGEQUEUEWAITBUFFER."""

    _fields_ = (
        ("timeout_ms", ctypes.c_uint),
        ("address", ctypes.POINTER(ctypes.c_void_p)),
        ("number", ctypes.POINTER(ctypes.c_int)),
    )


class UeyeMemory:
    """A live stream from construction to `close`."""

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

    def take(self, out: NDArray[np.uint16], timeout_s: float) -> int | None:
        """Copy the next frame into `out` (height, width); its number, None after time-out or a failed transfer."""
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
            return int(info.u64FrameNumber)
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
        return pitch.value
