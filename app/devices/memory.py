"""Which devices were connected the last time, as one JSON file beside the window's preferences."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from slopegate.drivers.sync.board_choice import BoardChoice

FILE_NAME = "devices.json"
DelayOwner = Literal["camera", "board"]


class CameraMode(BaseModel):
    """A camera's pixel format and rate; what is None was never chosen."""

    model_config = ConfigDict(extra="ignore", frozen=True, ser_json_inf_nan="constants")

    pixel_format: str | None = None
    rate_hz: float | None = Field(default=None, gt=0)
    """Infinite: as fast as it can."""


class DeviceChoices(BaseModel):
    """Everything that is remembered of devices."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    camera: tuple[str, str] | None = None
    """Family and where."""
    camera_runs: bool = False
    """Whether the window was streaming from it when it was closed."""
    triggered: bool = True
    """Whether the projector's sync signal triggers the camera; else it runs by itself."""
    modes: dict[str, CameraMode] = Field(default_factory=dict)
    """By the camera's address."""
    board: BoardChoice | None = None
    """None: none is connected."""
    delay_by: DelayOwner = "camera"


def load(path: Path) -> tuple[DeviceChoices, str]:
    """What is remembered; nothing and one sentence saying why when the file cannot be used."""
    try:
        return DeviceChoices.model_validate_json(path.read_text(encoding="utf-8")), ""
    except FileNotFoundError:
        return DeviceChoices(), ""
    except (OSError, UnicodeDecodeError, ValidationError) as error:
        why = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        return DeviceChoices(), f"The remembered devices in {path} cannot be used ({why}): none is connected."
