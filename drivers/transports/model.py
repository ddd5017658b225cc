"""The JSON that is written down about an acquisition of light transport."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from slopegate.drivers.captures.limits import MAX_FRAMES, MAX_SLICES
from slopegate.drivers.captures.model import CameraFacts, Gate

CodeName = Literal["hadamard", "s", "impulse", "gray", "adaptive"]
"""How a slice's transport is asked for."""

TRANSPORT_VERSION: Final = 1


class TransportManifest(BaseModel):
    """What an acquisition shall contain. Written first and never changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    format: Literal["slopegate-transport"] = "slopegate-transport"
    version: Literal[1] = TRANSPORT_VERSION
    created: str
    """UTC, ISO 8601."""
    software: str
    scene: str
    rig_toml: str
    """The rig as the text of a rig file."""
    camera: CameraFacts
    raster: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]
    """Width and height of the projector in pixels."""
    grid: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]
    """Columns and rows of blocks."""
    codes: CodeName
    frames: Annotated[int, Field(ge=1, le=MAX_FRAMES)]
    """Frames that are summed for each pattern."""
    settle_frames: Annotated[int, Field(ge=0)]
    """Frames to wait after a pattern was drawn; 0 on the bench."""
    slices: Annotated[list[Gate | None], Field(min_length=1, max_length=MAX_SLICES)]
    """The gates, in the order of acquisition; null for a camera without a gate, which has one slice."""
    counts_per_unit: Annotated[float, Field(gt=0)] | None
    """Counts above the dark that light 1 gives; null for a real camera, whose light is told in counts."""
    seed: Annotated[int, Field(ge=0)] | None
    """Of the bench's noise; null without noise and for a real camera."""
    parts: list[str]
    """Parts of the light that the bench showed; empty for a real camera."""
