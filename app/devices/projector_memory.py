"""What the projector's dialog remembers: the screen, and the pattern on it."""

from __future__ import annotations

from typing import Final

from pydantic import BaseModel, ConfigDict, Field, field_validator

from slopegate.core.rig.patterns import KINDS
from slopegate.drivers.contract.projector import MAX_SETTLE_FRAMES

FILE_NAME = "projector.json"
FILE_KEY: Final = "file"
"""Stands for a picture file among the keys of `KINDS`."""
USUAL: Final = "grid"


class ProjectorChoice(BaseModel):
    """Everything that can be chosen in the projector's dialog."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    screen: str = ""
    pattern: str = USUAL
    numbers: dict[str, int] = Field(default_factory=dict)
    """Row, square size or the like, by the key of the pattern."""
    file: str = ""
    settle_frames: int = Field(default=3, ge=1, le=MAX_SETTLE_FRAMES)

    @field_validator("pattern")
    @classmethod
    def _known(cls, pattern: str) -> str:
        """A pattern that another version of the program knew counts as none."""
        return pattern if pattern in {FILE_KEY, *(kind.key for kind in KINDS)} else USUAL
