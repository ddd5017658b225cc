"""What the window remembers between two runs, as one JSON file in the platform's own configuration folder."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import platformdirs
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from slopegate.drivers.files.durable import StorageError, write_durably

FILE_NAME = "window.json"


class RememberedGate(BaseModel):
    """The three numbers of the gate last asked for."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    line_time_us: float = Field(gt=0)
    delay_us: float
    exposure_us: float = Field(gt=0)


class Preferences(BaseModel):
    """Everything the window remembers. Byte strings of Qt are kept as base64."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    gate: RememberedGate | None = None
    complement: bool = False
    scene: str | None = None
    theme: Literal["system", "light", "dark"] = "system"
    pixel_format: Literal["mono12", "bayer_rg12"] = "mono12"
    noise: bool = True
    rate_hz: float | None = Field(default=20.0, gt=0)
    lit_rows: bool = False
    srgb: bool = True
    geometry: str = ""
    workspace: str = ""
    layouts: dict[str, str] = Field(default_factory=dict)
    """How the panels are arranged in each workspace."""


def default_path() -> Path:
    """Where this platform wants it."""
    return platformdirs.user_config_path("slopegate", appauthor=False) / FILE_NAME


def load(path: Path) -> tuple[Preferences, str | None]:
    """The remembered preferences; defaults and one sentence saying why when the file cannot be used."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return Preferences(), None
    except (OSError, UnicodeDecodeError) as error:
        return Preferences(), f"The preferences {path} cannot be read ({error}): starting with the defaults."
    try:
        return Preferences.model_validate_json(text), None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        return (
            Preferences(),
            f"The preferences {path} are damaged ({where}: {first['msg']}): starting with the defaults.",
        )


def save(path: Path, preferences: BaseModel) -> str | None:
    """Write whole or not at all; one sentence saying why when it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, preferences.model_dump_json(indent=2).encode())
    except (OSError, StorageError) as error:
        return f"The preferences {path} cannot be written ({error})."
    return None
