"""What a camera says about itself and about each frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from slopegate.core.rig.arrays import Counts
from slopegate.core.rig.settings import GateSettings, ShutterLimits

PixelFormat = Literal[
    "mono8", "mono10", "mono12", "mono14", "mono16",
    "bayer_rg8", "bayer_rg10", "bayer_rg12", "bayer_rg14", "bayer_rg16",
    "bayer_gr8", "bayer_gr10", "bayer_gr12", "bayer_gr14", "bayer_gr16",
    "bayer_gb8", "bayer_gb10", "bayer_gb12", "bayer_gb14", "bayer_gb16",
    "bayer_bg8", "bayer_bg10", "bayer_bg12", "bayer_bg14", "bayer_bg16",
]  # fmt: skip
"""Grey or colour mosaic, and bits a pixel. A mosaic is named after the first two pixels of its first row."""


TriggerEdge = Literal["rising", "falling"]
"""Of the signal at the camera's trigger input."""


def filters(pixel_format: str) -> str:
    """Colour filters of the first two rows and columns, such as RGGB; empty for a format without a mosaic."""
    if not pixel_format.startswith("bayer_"):
        return ""
    first = pixel_format.removeprefix("bayer_")[:2].upper()
    return first + {"RG": "GB", "GR": "BG", "GB": "RG", "BG": "GR"}[first]


@dataclass(frozen=True)
class Ability:
    """Whether a camera can do something; false with a sentence in `missing` that says why not."""

    missing: str = ""

    def __bool__(self) -> bool:
        return not self.missing


@dataclass(frozen=True)
class Abilities:
    """What a camera can do besides sending frames. Each one that it lacks says why."""

    line_time: Ability = Ability()
    """Take another line time in `configure`."""
    delay: Ability = Ability()
    """Take another delay in `configure`."""
    exposure: Ability = Ability()
    """Take another exposure time in `configure`. A camera that cannot has no gate, and then its `limits` are None, or
    always the same one (`device_rig.fixed_gate`)."""
    trigger: Ability = Ability()
    """Let the projector's sync signal start its frames."""
    rows: Ability = Ability("It always reads all of its rows.")
    """Read some of its rows only: `set_rows`."""
    cover: Ability = Ability("Its lens is covered by hand.")
    """Cover its lens for dark frames: `cover`."""
    choose_format: Ability = Ability("Its pictures come in one pixel format only.")
    """Be opened with another pixel format: `OpenOptions.pixel_format`."""
    choose_rate: Ability = Ability("Its pictures come at a pace of their own.")
    """Be opened with another frame rate: `OpenOptions.rate_hz`."""
    edge: Ability = Ability("It cannot be told which edge of the trigger starts its frames.")
    """Be triggered by the falling edge instead of the rising one: `trigger_on`."""


@dataclass(frozen=True)
class OpenOptions:
    """How a camera is opened. What is None stays as the camera has it, or is chosen by what the camera offers."""

    triggered: bool = True
    """By the projector's sync signal. False: the camera runs by itself, and its delay means nothing."""
    pixel_format: str | None = None
    """A name of `Modes.formats`; for most cameras that of the GenICam convention (PFNC), such as Mono12p."""
    rate_hz: float | None = None
    """Frames a second of a camera that runs by itself; infinite: as fast as it can."""


@dataclass(frozen=True)
class Modes:
    """Pixel format and frame rate of an open camera, and what `OpenOptions` can ask for instead."""

    format: str = ""
    """The camera's own name of its pixel format, such as Mono12p."""
    formats: tuple[str, ...] = ()
    """The pixel formats on offer that the program reads."""
    rate_hz: float = math.inf
    """Frames a second, as read back; infinite: as fast as it can."""
    rates_hz: tuple[float, float] = (0.0, math.inf)
    """Lowest and highest."""
    on_demand: bool = False
    """A frame is made whenever `read` asks for one, and none goes missing meanwhile: nobody need hurry to read."""
    replayed: bool = False
    """Frames were taken before, and come at a pace that the program sets: one that is late now tells of no trigger."""


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
    can: Abilities = Abilities()
    modes: Modes = field(default=Modes(), compare=False)
    """Not compared: what is on offer may depend on the gate that the camera still had."""
    board: str = ""
    """The sync board that makes the gate's delay; empty: the camera does."""


def exposed_s(applied: GateSettings | None, rows: int) -> float:
    """Seconds from the start of row 0's exposure to the end of the last one's of so many rows; 0 without a gate."""
    return 0.0 if applied is None else (applied.exposure_us + max(rows - 1, 0) * applied.line_time_us) * 1e-6


@dataclass(frozen=True)
class FrameStamp:
    """Number, time and settings of one frame."""

    sequence: int
    """Counts every frame the camera made, so that a gap is a lost frame."""
    time_s: float
    """When the exposure of row 0 began, whether that row was read or not, on the computer's monotonic clock.

    It is counted back from the arrival of the frame, which cannot be before the last row's exposure has ended
    (`exposed_s`). No camera tells how long a frame is on its way to the program: the exposure may have begun earlier by
    that, but not later. Where a device stamps its frames by a clock of its own, they keep the intervals of that clock.
    A camera without a gate tells no exposure: it is the arrival itself, and of a film the time when a picture was due.
    """
    asked: GateSettings | None
    applied: GateSettings | None
    settled: bool = True
    """False for the first frames after a change, which the old gate may have made: show them, do not measure them."""
    skipped_fraction: float = 0.0
    """Share of the pixels whose projector light was not looked at for this frame: the gate cannot light them, they were
    not read, or nothing had changed since the frame before."""
    lost_packets: int = 0
    """Packets that went missing on the wire since the camera was opened; a frame that lacks some is never given."""
    rows: tuple[int, int] | None = None
    """First row that was read and one past the last, None for all of them; the others hold the black level."""
    cast_fraction: float = 0.0
    """Share of the pixels that were rendered anew for this frame, by a camera that renders."""
    lost: int = 0
    """Frames that went missing between the frame before and this one; told by the stream (`FrameWatch`)."""
    repeated: bool = False
    """This frame, or a later one, has come before; told by the stream."""


@dataclass(frozen=True)
class Frame:
    """A frame lent by the stream: the pixels stay as they are until it is given back."""

    image: Counts
    stamp: FrameStamp
