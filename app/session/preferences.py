"""What is remembered between two runs, as JSON files in the platform's folder for settings."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self, TypeVar

import platformdirs
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from slopegate.app.session.display import Display
from slopegate.core.rig.settings import GateSettings, gate
from slopegate.drivers.files.durable import StorageError, reason, write_durably
from slopegate.drivers.files.errors import told_fault

FILE_NAME = "window.json"
Kept = TypeVar("Kept", bound=BaseModel)


class RememberedGate(BaseModel):
    """The gate that was asked for last."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    line_time_us: float = Field(gt=0)
    delay_us: float
    exposure_us: float = Field(gt=0)

    @classmethod
    def of(cls, held: GateSettings) -> Self:
        """From the settings that the program uses."""
        return cls(line_time_us=held.line_time_us, delay_us=float(held.delay_us), exposure_us=held.exposure_us)

    def settings(self) -> GateSettings:
        """The same for the program."""
        return gate(self.line_time_us, self.delay_us, self.exposure_us)


class Preferences(BaseModel):
    """Everything that the window remembers. Qt's byte strings are kept as base64."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    gate: RememberedGate | None = None
    slab: tuple[float, float, float] | None = None
    """Tilt in degrees, distance and thickness in metres, where the gate was asked for by them."""
    complement: bool = False
    scene: str | None = None
    rig: str | None = None
    """Name of the rig that the gate belongs to: another rig begins with its own."""
    theme: Literal["system", "light", "dark"] = "system"
    pixel_format: Literal["mono12", "bayer_rg12"] = "mono12"
    noise: bool = True
    rate_hz: float | None = Field(default=20.0, gt=0)
    """Frames a second; None: as fast as it can, for JSON has no infinity."""
    lit_rows: bool = False
    srgb: bool = True
    display: Display = Display()
    snapshot_folder: str = ""
    """Where the last snapshot went; empty: the folder for pictures."""
    geometry: str = ""
    workspace: str = ""
    recent: tuple[str, ...] = ()
    """Scenes, captures and sessions that were opened last, the newest first."""
    layouts: dict[str, str] = Field(default_factory=dict)
    """How the panels are arranged in each workspace."""


def default_path() -> Path:
    """The window's file, where this platform keeps settings."""
    return platformdirs.user_config_path("slopegate", appauthor=False) / FILE_NAME


def load(path: Path, kind: type[Kept], what: str) -> tuple[Kept, str]:
    """What this file remembers of `what`; the defaults, and one sentence saying why, when it cannot be used."""
    try:
        return kind.model_validate_json(path.read_text(encoding="utf-8")), ""
    except FileNotFoundError:
        return kind(), ""
    except ValidationError as error:
        why = told_fault(error)
    except UnicodeDecodeError:
        why = "it is not UTF-8 text"
    except OSError as error:
        why = error.strerror or str(error)
    return kind(), f"What {path} remembers of {what} cannot be used ({why}): starting with the defaults."


def save(path: Path, kept: BaseModel) -> str:
    """Write whole or not at all; one sentence saying why when it cannot be written, else empty."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, kept.model_dump_json(indent=2).encode())
    except OSError as error:
        return f"The settings are not remembered: {reason(path, error)}."
    except StorageError as error:
        return f"The settings are not remembered: {error}."
    return ""
