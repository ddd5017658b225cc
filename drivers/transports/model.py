"""The JSON that is written down about an acquisition of light transport."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from slopegate.drivers.captures.limits import MAX_FRAMES, MAX_SLICES
from slopegate.drivers.captures.model import CameraFacts, Count, Gate, Name, Share

CodeName = Literal["hadamard", "s", "impulse", "gray", "adaptive"]
"""How a slice's transport is asked for."""

TRANSPORT_VERSION: Final = 1
MOST_SATURATED: Final = 0.05
"""Share of the pixels that may be saturated with all lit."""
MOST_NONLINEAR: Final = 0.02
"""Of a slice's light, by which a pattern and its inverse may miss it before that is remarked."""


class TransportManifest(BaseModel):
    """What an acquisition shall contain. Written first and never changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    format: Literal["slopegate-transport"] = "slopegate-transport"
    version: Literal[1] = TRANSPORT_VERSION
    created: str
    """UTC, ISO 8601."""
    software: str
    scene: Name
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


StageName = Literal["even", "codes", "gray", "check", "unseen", "rows", "columns", "coarse"]
"""Black and white; the codes asked for; of adaptive ones: Gray code, random patterns, blocks that no pixel sees, and
whole rows, whole columns or larger blocks for what is left. A check of other codes is one pattern and its inverse."""


class StageFacts(BaseModel):
    """One set of patterns that a slice was asked with."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    name: StageName
    patterns: Annotated[int, Field(ge=0)]
    frames: Annotated[int, Field(ge=0)]
    grid: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]
    """Columns and rows of the blocks that the patterns are made of."""


class TransportRecord(BaseModel):
    """Everything about one slice but its transport. The slice is there when its record is."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    index: Annotated[int, Field(ge=0)]
    """Place in the manifest's list."""
    asked: Gate | None
    applied: Gate | None
    """Null for a camera without a gate."""
    empty: bool
    """No light was seen through this gate, so nothing but black and white was shown."""
    stages: list[StageFacts]
    """What was shown, in order."""
    entries: Annotated[int, Field(ge=0)]
    """Of all layers together."""
    left_out: Annotated[float, Field(ge=0)]
    """Share of the slice's light that has no entry and is taken to come evenly from the whole projector."""
    unexplained: Annotated[float, Field(ge=0)] | None
    """Of adaptive codes: mean of the squared errors of random check patterns over that of noise; 1: all explained."""
    noise_counts: Annotated[float, Field(ge=0)]
    """Standard deviation of one pixel from frame to frame without light."""
    saturated_share: Share
    """Share of the pixels at max_count with the whole projector lit."""
    nonlinear_share: Annotated[float, Field(ge=0)]
    """What a pattern and its inverse, each shown alone, differ from all on in sum, over all on; whole image."""
    started: str
    ended: str
    """UTC, ISO 8601."""
    seconds: Annotated[float, Field(ge=0)]
    """Measured, decoding included."""
    lost: Count
    duplicated: Count
    discarded: Count
    """Frames missing from the sequence, seen twice, and not used because another pattern or gate may be in them."""

    @property
    def frames(self) -> int:
        """Frames that were used."""
        return sum(stage.frames for stage in self.stages)

    @property
    def doubts(self) -> list[str]:
        """What is doubtful about it, a sentence each."""
        found = []
        if self.nonlinear_share > MOST_NONLINEAR:
            found.append(
                f"a pattern and its inverse miss the fully lit image by {self.nonlinear_share:.1%}: the light does not "
                "add up, as when the camera's response is not linear or the projector's light varies."
            )
        if self.saturated_share > MOST_SATURATED and not self.empty:
            found.append(f"{self.saturated_share:.0%} of the pixels are saturated, so its transport is wrong there.")
        return found
