"""A session as a file: what is looked at, with which rig and gate, and how the window was arranged about it.

JSON, and nothing in it is executed: numbers, names, paths, the text of a rig file, and what Qt makes of its layouts.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from slopegate.app.session.display import Display
from slopegate.app.session.preferences import RememberedGate
from slopegate.drivers.captures.storage import model_fault
from slopegate.drivers.contract.families import Address
from slopegate.drivers.files.durable import check_destination, write_durably
from slopegate.drivers.files.errors import SceneError
from slopegate.drivers.files.reading import read_plain

SUFFIX: Final = ".slopegate"
VERSION: Final = 1
MAX_BYTES = 100_000_000

Value = bool | int | float | Annotated[str, Field(max_length=40_000_000)]


class SavedSession(BaseModel):
    """Everything that reopens. Exactly one of `scene` and `camera` is given."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    format: Literal["slopegate-session"] = "slopegate-session"
    version: Annotated[int, Field(ge=1, le=VERSION)] = VERSION
    scene: str | None = None
    """A file or folder, relative to the session's own folder where it lies beside or below that."""
    camera: str | None = None
    """A device's address."""
    rig_toml: str
    pixel_format: Literal["mono12", "bayer_rg12"] | None = None
    noise: bool = True
    rate_hz: Annotated[float, Field(gt=0)] | None = None
    """Frames a second; null: as fast as it can."""
    lit_rows: bool = False
    gate: RememberedGate | None = None
    slab: tuple[float, float, float] | None = None
    """Tilt in degrees, distance and thickness in metres, where the gate was asked for by them."""
    complement: bool = False
    display: Display | None = None
    """How the live image is shown; null: as it is."""
    levels: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]] | None = None
    """The counts that are shown black and white."""
    srgb: bool | None = None
    workspace: str = ""
    layouts: dict[str, str] = Field(default_factory=dict)
    panels: dict[str, dict[str, Value]] = Field(default_factory=dict)
    """What is set in each panel, by the panel's key and the field's name."""


def scene_in(saved: SavedSession, path: Path) -> Path | None:
    """Where the scene of a session file is."""
    return None if saved.scene is None else path.absolute().parent / saved.scene


def place_of(where: Path | Address, path: Path) -> dict[str, Any]:
    """The fields that tell a session file what is looked at."""
    if isinstance(where, Address):
        return {"camera": str(where)}
    absolute, folder = where.absolute(), path.absolute().parent
    beside = absolute.is_relative_to(folder)
    return {"scene": os.path.relpath(absolute, folder) if beside else str(absolute)}


def write_session(path: Path, saved: SavedSession) -> Path:
    """Write a session's file, replacing it whole; returns it. Raises StorageError."""
    check_destination(path, (SUFFIX,))
    write_durably(path, saved.model_dump_json(indent=1).encode())
    return path


def read_session(path: Path) -> SavedSession:
    """The session in a file. Raises SceneError, one sentence."""
    data = read_plain(path, MAX_BYTES)
    try:
        saved = SavedSession.model_validate_json(data)
    except ValidationError as error:
        raise SceneError(f"{path} cannot be opened as a session: {model_fault(error, VERSION)}") from None
    if (saved.scene is None) == (saved.camera is None):
        raise SceneError(f"{path} is no session: it must name either a scene or a camera")
    return saved
