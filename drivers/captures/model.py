"""The JSON that is written down about a capture. `Sidecar` is published as resources/schemas/capture.schema.json."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from slopegate.core.gating.gate import Slab
from slopegate.core.rig.checks import plain_name
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.drivers.captures.limits import MAX_FRAMES, MAX_SLICES
from slopegate.drivers.contract.frame import CameraInfo, PixelFormat

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Name = Annotated[str, AfterValidator(plain_name)]

VERSION: Final = 1
"""Of the manifest."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Gate(_Model):
    """A gate; the delay is to the centre of the exposure of row coordinate 0, microseconds."""

    line_time_us: Positive
    delay_us: float
    exposure_us: Positive

    @classmethod
    def of(cls, settings: GateSettings) -> Self:
        """From the settings that the program uses."""
        return cls(**{key: float(value) for key, value in asdict(settings).items()})

    def settings(self) -> GateSettings:
        """The same for the program, to the last bit."""
        return gate(self.line_time_us, self.delay_us, self.exposure_us)


class SlabFacts(_Model):
    """Where a gate lies on the camera's axis, metres from the rig's origin; null for what is not finite."""

    tilt_deg: float
    distance_m: float | None
    near_m: float | None
    far_m: float | None
    thickness_m: float | None

    @classmethod
    def of(cls, found: Slab | None) -> Self | None:
        """The read-outs that are kept; None of no slab."""
        if found is None:
            return None

        def finite(value: float | None) -> float | None:
            return value if value is not None and math.isfinite(value) else None

        return cls(
            tilt_deg=found.tilt_deg,
            distance_m=finite(found.distance_m),
            near_m=finite(found.near_m),
            far_m=finite(found.far_m),
            thickness_m=finite(found.thickness_m),
        )


class CameraFacts(_Model):
    """The camera's fixed facts. Counts run from 0 to max_count; black_count is what it counts in the dark."""

    name: Name
    width: Annotated[int, Field(ge=1)]
    height: Annotated[int, Field(ge=1)]
    pixel_format: PixelFormat
    max_count: Annotated[int, Field(ge=1, le=65535)]
    black_count: float

    @classmethod
    def of(cls, info: CameraInfo) -> Self:
        """From an open camera."""
        return cls(
            name=info.name,
            width=info.width,
            height=info.height,
            pixel_format=info.pixel_format,
            max_count=info.max_count,
            black_count=float(info.black_count),
        )


class Manifest(_Model):
    """What a capture shall contain. Written first and never changed."""

    format: Literal["slopegate-capture"] = "slopegate-capture"
    version: Literal[1] = VERSION
    created: str
    """UTC, ISO 8601."""
    software: str
    scene: Name
    rig_toml: str
    """The rig as the text of a rig file."""
    camera: CameraFacts
    frames: Annotated[int, Field(ge=1, le=MAX_FRAMES)]
    """Frames that are summed for each slice."""
    dark: bool
    """Whether a dark frame belongs to it."""
    skip_empty: bool
    """Whether slices without light are noted instead of taken."""
    noise: bool | None = None
    """Of a scene: whether the camera has noise. Null where nothing has to hold over a resume, as with a real camera."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    """Of a scene: which noise. Each slice's follows from this and its index alone."""
    slices: Annotated[list[Gate], Field(min_length=1, max_length=MAX_SLICES)]
    """The gates asked for, in the order of capture."""

    @property
    def dark_frames(self) -> int:
        """Frames of the dark frame: from fewer than two nothing is known of noise."""
        return max(self.frames, 2)

    def steps_per_count(self, frames: int) -> int:
        """How many steps of a 16-bit plane make one count: the frames if their sum fits, which keeps it exact.

        Otherwise the largest whole number for which full scale fits; the mean is then rounded to the nearest step.
        """
        return min(frames, 65535 // self.camera.max_count)

    def promises(self, record: SliceRecord) -> bool:
        """Whether a slice has as many frames as it must: from another number its mean would come out wrong."""
        return record.empty or record.frames == (self.dark_frames if record.index is None else self.frames)

    def same_camera(self, info: CameraInfo) -> bool:
        """Whether this is the camera that it was begun with, with pixels of the same number and kind."""
        return self.camera == CameraFacts.of(info)


class SliceRecord(_Model):
    """Everything about one slice but its pixels, which are the sum of `frames` frames."""

    index: Annotated[int, Field(ge=0)] | None
    """Place in the manifest's list; null for the dark frame."""
    asked: Gate
    applied: Gate
    slab: SlabFacts | None
    """Of the gate applied; null where it is no slab, as with the projector beside the camera."""
    frames: Count
    empty: bool = False
    """No light was seen through this gate, so no frames were taken."""
    saturated_share: Share
    """Share of the pixels, over all frames, at max_count."""
    noise_counts: Annotated[float, Field(ge=0)] | None = None
    """Of the dark frame: standard deviation of one pixel from frame to frame."""
    started: str
    ended: str
    """UTC, ISO 8601, of the first and last frame."""
    first_time_s: float = 0.0
    last_time_s: float = 0.0
    """The same on the computer's monotonic clock: when the exposure of row 0 began."""
    first_sequence: Count = 0
    last_sequence: Count = 0
    lost: Count = 0
    duplicated: Count = 0
    discarded: Count = 0
    """Frames missing from the sequence, seen twice, and not used because of a change, since the slice was begun."""
    crc32: Count = 0
    """Of the pixels, row by row, little-endian."""

    @property
    def distance_m(self) -> float | None:
        """Where the gate applied meets the axis; None where it has no slab, or none that does."""
        return None if self.slab is None else self.slab.distance_m


class Sidecar(_Model):
    """Everything about a capture but its pixels."""

    capture: Manifest
    dark: SliceRecord | None
    slices: list[SliceRecord]
    """What there is, by index."""
    missing: list[int]
    """Indices of slices not taken yet."""


class FilmManifest(_Model):
    """What a recording at one gate is of. Written first and never changed."""

    format: Literal["slopegate-recording"] = "slopegate-recording"
    version: Literal[1] = 1
    created: str
    """UTC, ISO 8601."""
    software: str
    scene: Name
    rig_toml: str
    """The rig as the text of a rig file."""
    camera: CameraFacts
    gate: Gate | None
    """The gate asked for; null for a camera without one."""
    every_s: Positive | None = None
    """Seconds from frame to frame of a time lapse; null where every frame of the camera is kept."""


class FilmFrame(_Model):
    """Everything about one frame of a recording but its pixels."""

    number: Count
    """Counts the frames that were kept, from 0."""
    sequence: int
    """The camera's own count."""
    time_s: float
    """When the exposure of row 0 began, on the computer's monotonic clock; of a scene, on the scene's."""
    taken: str
    """UTC, ISO 8601, by the computer's clock."""
    asked: Gate | None
    applied: Gate | None
    """The gate as the camera made it; null for a camera without one."""
    lost_by_camera: Count = 0
    lost_by_disk: Count = 0
    """Frames that are missing between the one before and this one: that the camera lost, or sent with another gate,
    and that the disk was too slow for. In a time lapse, moments without a frame."""


class FilmEnd(_Model):
    """How a recording ended. Written last: a recording without it was cut short, and its frames are all there."""

    frames: Count
    lost_by_camera: Count
    lost_by_disk: Count
    repeated: Count
    """Frames that came again, and were kept once."""
    seconds: Annotated[float, Field(ge=0)]
    """From the first frame to the last, by the frames' own times."""
    bytes: Count
    """Of all frames on the disk."""
    ended: str
    """Why, in a sentence."""

    @property
    def lost(self) -> int:
        """Frames that should be there and are not: the camera lost them, or the disk was too slow."""
        return self.lost_by_camera + self.lost_by_disk
