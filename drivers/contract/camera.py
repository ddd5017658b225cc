"""The contract that every camera keeps, and the checks that every driver makes."""

from __future__ import annotations

from abc import abstractmethod
from typing import Protocol

import numpy as np

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.checks import InputError, UserError
from slopegate.core.rig.settings import GateSettings
from slopegate.drivers.contract.frame import Ability, CameraInfo, FrameStamp, TriggerEdge


class CameraError(UserError):
    """A camera failed; the message is one sentence for the user."""


class CameraGoneError(CameraError):
    """The device cannot be reached now. Every further `read` tries again, and may succeed."""


class Camera(Protocol):
    """A source of frames. Open when constructed. One thread at a time calls it, except `stop`: any thread may.

    `info.can` says what it can do. A driver inherits from this class and gets the methods of what it cannot do: they
    raise InputError with the sentence that `info.can` gives.
    """

    @property
    @abstractmethod
    def info(self) -> CameraInfo:
        """Fixed facts of this camera."""
        ...

    @property
    def trouble(self) -> str:
        """What keeps the gate from being known although frames come, in one sentence; empty when nothing does."""
        return ""

    def configure(self, settings: GateSettings) -> GateSettings:
        """Ask for a gate; return what is applied from the next frame on.

        Raises InputError when it cannot be done, and then the camera goes on with the gate it had.
        """
        raise unable(self.info, self.info.can.exposure)

    def set_rows(self, first: int, last: int) -> tuple[int, int]:
        """Ask that only rows first .. last - 1 are read; return what is applied from the next frame on.

        Fewer rows take less time, so frames can come faster. What is applied is at least what was asked for, widened to
        what the camera can do. Frames keep their size: rows that were not read hold the black level, and
        `FrameStamp.rows` says which were. What a row records does not change.
        Raises ValueError unless 0 <= first <= last <= height, InputError when the gate cannot be kept with these rows.
        """
        raise unable(self.info, self.info.can.rows)

    def cover(self, covered: bool) -> None:
        """Cover or uncover the lens, from any thread; the first frame after it is flagged as not settled."""
        raise unable(self.info, self.info.can.cover)

    def trigger_on(self, edge: TriggerEdge) -> None:
        """Let this edge of the trigger start the frames, which is the rising one until another is asked for.

        Frames that the other edge may have started are flagged as not settled.
        """
        raise unable(self.info, self.info.can.edge)

    @abstractmethod
    def start(self) -> None:
        """Make frames from now on."""
        ...

    @abstractmethod
    def read(self, buffer: Counts, timeout_s: float) -> FrameStamp | None:
        """Fill the buffer with the next frame; None after the time-out, when stopped or closed.

        Raises CameraError when the camera failed, ValueError for a buffer that `check_buffer` refuses.
        """
        ...

    @abstractmethod
    def stop(self) -> None:
        """Make no more frames; a `read` under way returns None."""
        ...

    @abstractmethod
    def close(self) -> None:
        """Stop and release the device; the object cannot be used afterwards. Harmless when closed."""
        ...


def unable(info: CameraInfo, ability: Ability) -> InputError:
    """The error that refuses what this camera cannot do."""
    return InputError(f"{info.name}: {ability.missing}")


def check_buffer(info: CameraInfo, buffer: Counts) -> None:
    """Raise ValueError unless a frame of the camera fits: (height, width) uint16, C-contiguous."""
    if buffer.shape != (info.height, info.width) or buffer.dtype != np.uint16 or not buffer.flags.c_contiguous:
        raise ValueError(
            f"the buffer is {buffer.shape} {buffer.dtype}, not C-ordered {(info.height, info.width)} uint16"
        )


def check_rows(info: CameraInfo, first: int, last: int) -> None:
    """Raise ValueError unless rows first .. last - 1 are rows of the camera."""
    if not 0 <= first <= last <= info.height:
        raise ValueError(f"rows {first} to {last} are not in order from 0 to {info.height}")
