"""What was last shown on which screen, as one JSON file beside the window's preferences."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from slopegate.core.rig.patterns import KINDS
from slopegate.drivers.contract.projector import MAX_SETTLE_FRAMES

FILE_NAME = "projector.json"
FILE_KEY: Final = "file"
"""Stands for a picture file among the keys of `core.patterns.KINDS`."""


class ProjectorChoice(BaseModel):
    """Everything that can be chosen in the projector's dialog."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    screen: str = ""
    pattern: str = "grid"
    numbers: dict[str, int] = Field(default_factory=dict)
    """Row, square size or the like, by the key of the pattern."""
    file: str = ""
    settle_frames: int = Field(default=3, ge=1, le=MAX_SETTLE_FRAMES)


def load(path: Path) -> tuple[ProjectorChoice, str]:
    """What is remembered; the usual and one sentence saying why when the file cannot be used."""
    try:
        choice = ProjectorChoice.model_validate_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return ProjectorChoice(), ""
    except (OSError, UnicodeDecodeError, ValidationError) as error:
        why = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        return ProjectorChoice(), f"What was remembered of the projector in {path} cannot be used ({why})."
    known = {FILE_KEY, *(kind.key for kind in KINDS)}
    return (choice if choice.pattern in known else choice.model_copy(update={"pattern": "grid"})), ""
