"""What a camera says of itself and of each frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from slopegate.core.settings import GateSettings, ShutterLimits

PixelFormat = Literal["mono12", "bayer_rg12"]


@dataclass(frozen=True)
class CameraInfo:
    """Fixed facts of an open camera. Frames are (height, width) uint16, 0..max_count."""

    name: str
    width: int
    height: int
    pixel_format: PixelFormat
    max_count: int
    black_count: float
    limits: ShutterLimits | None
    """None: a plain camera without a gate."""


@dataclass(frozen=True)
class FrameStamp:
    """What belongs to one frame besides its pixels."""

    sequence: int
    """Counts every frame the camera made, so that a gap is a lost frame."""
    time_s: float
    """Monotonic clock at the end of readout."""
    asked: GateSettings | None
    applied: GateSettings | None
    settled: bool = True
    """False for the first frames after a change: show them, do not measure them."""
    skipped_fraction: float = 0.0
    """Share of the pixels that needed no work because the slab cannot light them."""


@dataclass(frozen=True)
class Frame:
    """A frame lent by the stream: the pixels stay as they are until it is given back."""

    image: NDArray[np.uint16]
    stamp: FrameStamp
