"""Which devices were connected the last time, as one JSON file beside the window's preferences."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from slopegate.drivers.sync_boards import dialect_of
from slopegate.drivers.sync_dialect import Pulse

FILE_NAME = "devices.json"
DelayOwner = Literal["camera", "board"]


class BoardChoice(BaseModel):
    """A sync board or delay generator, how to speak to it, and everything about its pulses but their delay."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    where: str
    dialect: str
    baud: int = Field(gt=0)
    output: int = Field(default=1, ge=1)
    width_us: float = Field(default=100.0, gt=0)
    inverted: bool = False
    trigger_rising: bool = True
    trigger_level_v: float = 1.5

    @field_validator("dialect")
    @classmethod
    def _known(cls, key: str) -> str:
        return dialect_of(key).key

    def pulse(self, delay_us: float = 0.0) -> Pulse:
        """Its pulses, with this delay."""
        rising, level = self.trigger_rising, self.trigger_level_v
        return Pulse(delay_us, self.width_us, self.inverted, trigger_rising=rising, trigger_level_v=level)


class DeviceChoices(BaseModel):
    """Everything that is remembered of devices."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    camera: tuple[str, str] | None = None
    """Family and where."""
    camera_runs: bool = False
    """Whether the window was streaming from it when it was closed."""
    triggered: bool = True
    """Whether the projector's sync signal triggers the camera; else it runs by itself."""
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
