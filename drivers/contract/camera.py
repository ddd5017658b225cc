"""The contract that every camera keeps."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import CameraInfo, FrameStamp


class CameraError(UserError):
    """A camera failed; the message is one sentence for the user."""


class CameraGoneError(CameraError):
    """The device cannot be reached now; every further `read` tries to, and may well succeed."""


class Camera(Protocol):
    """Open when constructed. One thread at a time calls it, except `stop`, which may come from any."""

    @property
    def info(self) -> CameraInfo:
        """Fixed facts of this camera."""
        ...

    def configure(self, settings: GateSettings) -> GateSettings:
        """Ask for a gate; return what is applied from the next frame on.

        Raises InputError when it cannot be done, and then the camera goes on with the gate it had: a plain camera
        (`info.limits` is None) has none.
        """
        ...

    def start(self) -> None:
        """Make frames from now on."""
        ...

    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """Fill the buffer with the next frame; None after the time-out, when stopped or closed.

        Raises CameraError when the camera failed, ValueError when the buffer is not (height, width) uint16.
        """
        ...

    def stop(self) -> None:
        """Make no more frames; a `read` under way returns None."""
        ...

    def close(self) -> None:
        """Stop and let the device go; the object is of no use afterwards. Harmless when closed."""
        ...


@runtime_checkable
class RowCropping(Protocol):
    """What a camera has besides when `info.can.rows`: reading fewer rows takes less time, so frames can come faster."""

    def set_rows(self, first: int, last: int) -> tuple[int, int]:
        """Ask that only rows first .. last - 1 are read; return what is applied from the next frame on.

        That is at least what was asked for, widened to what the camera can do. Frames keep their size: rows that were
        not read hold the black level, and `FrameStamp.rows` says which were. What a row records does not change.
        Raises InputError unless 0 <= first <= last <= height.
        """
        ...
