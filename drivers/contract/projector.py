"""The contract for showing patterns on a projector: the application keeps it with a window on the second screen, and a
scene's own projector by lighting what a virtual camera sees.

A pattern that was handed to a screen is not yet on the wall: the desktop, the link and the projector hold frames
back. How many is not told to anybody, so it is counted once per rig and given as a number of frames to wait: the settle
count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from slopegate.core.rig.arrays import Bytes
from slopegate.core.rig.checks import UserError
from slopegate.core.rig.patterns import Raster
from slopegate.drivers.contract.frame import FrameStamp
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.picture_files import read_raw

MAX_SETTLE_FRAMES: Final = 60


class ProjectorError(UserError):
    """A pattern cannot be shown; the message is one sentence for the user."""


@dataclass(frozen=True)
class ProjectorInfo:
    """Fixed facts of a projector."""

    name: str
    raster: Raster
    period_us: float


@dataclass(frozen=True)
class Showing:
    """A pattern on its way to the wall."""

    index: int
    drawn_s: float
    """When it was handed to the screen, on the clock of `FrameStamp.time_s`."""
    certain_from_s: float
    """From here on nothing else is on the wall."""

    def certainly_in(self, stamp: FrameStamp, transfer_us: float) -> bool:
        """Whether a camera frame saw nothing but this pattern.

        `transfer_us` is how long a frame may have been on its way: so much earlier than its stamp it may have begun.
        """
        return stamp.time_s - transfer_us * 1e-6 >= self.certain_from_s


class Projector(Protocol):
    """Shows patterns. Open when constructed. Its methods wait for the screen: call them outside the drawing thread."""

    @property
    def info(self) -> ProjectorInfo:
        """Fixed facts."""
        ...

    def load(self, patterns: Sequence[Bytes]) -> None:
        """Keep these patterns ready to be shown, in place of those before. Raises ProjectorError for another size."""
        ...

    def show(self, index: int) -> Showing:
        """Show one of the loaded patterns, by its number from 0; returns once it was handed to the screen.

        Raises ProjectorError when the screen is gone, IndexError for a number that was not loaded.
        """
        ...

    def black(self) -> Showing:
        """Show black; the index is -1."""
        ...

    def white(self) -> Showing:
        """Show white; the index is -1."""
        ...

    def stop(self) -> None:
        """Show no pattern from now on: what would show one raises ProjectorError. A second call does nothing."""
        ...


def check_picture(picture: Bytes, raster: Raster, name: str) -> None:
    """Raise ProjectorError, with `name` in the sentence, unless the picture fits the projector pixel by pixel."""
    if picture.dtype != np.uint8 or picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[2] != 3):
        shape = " x ".join(map(str, picture.shape))
        raise ProjectorError(
            f"{name} has {picture.dtype} pixels of shape {shape}: a projector shows 8-bit grey (height x width) or"
            " RGB (height x width x 3)"
        )
    height, width = picture.shape[:2]
    if (width, height) != (raster.width, raster.height):
        raise ProjectorError(
            f"{name} has {width} x {height} pixels and the projector has {raster}: patterns are shown pixel by pixel,"
            " so the sizes must be the same"
        )


def read_picture(path: Path, raster: Raster) -> Bytes:
    """Read a picture file of exactly the projector's size, without changing its numbers. Raises ProjectorError."""
    try:
        pixels: NDArray[Any] = read_raw(path)
    except SceneError as error:
        raise ProjectorError(str(error)) from None
    check_picture(pixels, raster, path.name)
    return np.ascontiguousarray(pixels)
