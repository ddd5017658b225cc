"""What a scene file may contain, as types. Documented for users in resources/scenes/FORMAT.md."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, BeforeValidator, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from slopegate.core.rig.checks import shown
from slopegate.drivers.files.errors import SceneError, first_fault
from slopegate.drivers.files.reading import read_plain, toml_tables
from slopegate.drivers.scenes.light_toml import MATERIALS, FogTable, MaterialTable
from slopegate.drivers.scenes.scene_values import (
    Colour,
    Degrees,
    Flag,
    Metres,
    NotNegative,
    Number,
    Part,
    Point,
    Positive,
    Size,
    Text,
    listed,
    numeric,
)

MAX_FILE_BYTES = 4_000_000


Table = TypeVar("Table", bound=BaseModel)


class Turned(Part):
    """A table with angles."""

    tilt_deg: Degrees = 0.0
    yaw_deg: Degrees = 0.0
    roll_deg: Degrees = 0.0


class Named(Part):
    """The keys of every object."""

    name: Text | None = None
    motion: Text | None = None
    material: Annotated[MaterialTable, Field(discriminator="type")] | None = None


class Surfaced(Named):
    """An object with one colour or picture."""

    albedo: Colour | None = None
    texture: Text | None = None

    @model_validator(mode="after")
    def _one_colour(self) -> Self:
        if self.albedo is not None and self.texture is not None:
            raise PydanticCustomError("whole", "has both albedo and texture: it must have one of them or neither")
        return self


class PlaneTable(Surfaced, Turned):
    """A rectangle by centre, size and angles."""

    type: Literal["plane"]
    centre_m: Point
    width_m: Metres
    height_m: Metres


class QuadTable(Surfaced):
    """A parallelogram by corner and edges."""

    type: Literal["quad"]
    corner_m: Point
    edge_u_m: Point
    edge_v_m: Point


class BoxTable(Surfaced, Turned):
    """A box by centre, size and angles."""

    type: Literal["box"]
    centre_m: Point
    size_m: Size


class SphereTable(Named):
    """A sphere."""

    type: Literal["sphere"]
    centre_m: Point
    radius_m: Metres
    albedo: Colour | None = None


class MeshTable(Surfaced, Turned):
    """A mesh file and where it goes."""

    type: Literal["mesh"]
    file: Text
    up: Literal["y", "z"] = "y"
    scale: Positive | None = None
    fit_height_m: Metres | None = None
    position_m: Point
    anchor: Literal["centre", "base", "origin"] = "centre"

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.scale is not None and self.fit_height_m is not None:
            raise PydanticCustomError("whole", "has both scale and fit_height_m: it must have one of them or neither")
        return self


class KeyTable(Turned):
    """One key frame."""

    time_s: NotNegative
    offset_m: Point = (0.0, 0.0, 0.0)


class MotionTable(Part):
    """A motion that objects refer to by name."""

    keys: Annotated[tuple[KeyTable, ...], BeforeValidator(lambda value: listed(value, "key frames"))]
    loop: Flag = True
    pivot_m: Point | None = None

    @model_validator(mode="after")
    def _rising(self) -> Self:
        times = [key.time_s for key in self.keys]
        if times[0] != 0 or any(b <= a for a, b in itertools.pairwise(times)):
            raise PydanticCustomError("whole", "has key frames at other times than rising ones from time_s = 0")
        return self


class GateTable(Part):
    """A named gate, given by its settings or by its slab."""

    name: Text
    complement: Flag = False
    clock_mhz: Positive | None = None
    line_time_us: Positive | None = None
    delay_us: Number | None = None
    exposure_us: Positive | None = None
    tilt_deg: Annotated[float, numeric(-89.9, 89.9, "an angle from -89.9 to 89.9 degrees")] | None = None
    distance_m: Metres | None = None
    thickness_m: Metres | None = None
    rig: Text | None = None
    """Name of the rig that it was made for, where that is known."""

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        given = {name for name, value in self if value is not None} - {"name", "complement", "rig"}
        forms = ({"clock_mhz", "delay_us", "exposure_us"}, {"line_time_us", "delay_us", "exposure_us"}, SLAB_KEYS)
        if given not in forms:
            allowed = "; ".join(", ".join(sorted(form)) for form in forms)
            raise PydanticCustomError("whole", "must have exactly one of these sets of keys: {sets}", {"sets": allowed})
        return self


SLAB_KEYS = {"tilt_deg", "distance_m", "thickness_m"}
ObjectTable = PlaneTable | QuadTable | BoxTable | SphereTable | MeshTable
KINDS = {"plane", "quad", "box", "sphere", "mesh"}


class SceneTable(Part):
    """A whole scene file."""

    title: Text | None = None
    description: str = ""
    ambient: NotNegative = 0.0
    indirect: Flag | None = None
    fog: FogTable | None = None
    capture: Text | None = None
    """A folder with photo and depth, relative to the file, instead of objects."""
    objects: Annotated[
        tuple[Annotated[ObjectTable, Field(discriminator="type")], ...],
        BeforeValidator(lambda value: listed(value, "[[objects]] tables")),
    ] = ()
    motions: dict[str, MotionTable] = Field(default_factory=dict)
    gates: Annotated[tuple[GateTable, ...], BeforeValidator(lambda value: listed(value, "[[gates]] tables"))] = ()

    @model_validator(mode="after")
    def _something_to_see(self) -> Self:
        if (self.capture is None) == (not self.objects):
            raise PydanticCustomError("whole", "must have either [[objects]] or a capture")
        return self


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file."""
    return toml_tables(read_plain(path, MAX_FILE_BYTES), str(path))


def read_scene_table(path: Path) -> SceneTable:
    """A scene file, checked key by key."""
    return checked(SceneTable, read_toml(path), path)


def read_gates(entries: Any, path: Path) -> tuple[GateTable, ...]:
    """The `gates` of a capture's scene.json, in the same form as a scene file's."""
    return gate_list({"gates": entries}, path)


def gate_list(data: Any, path: Path) -> tuple[GateTable, ...]:
    """The tables of a file that holds gates alone. Raises SceneError."""
    return checked(GateList, data, path).gates


class GateList(Part):
    """A list of gates without a scene."""

    gates: Annotated[tuple[GateTable, ...], BeforeValidator(lambda value: listed(value, "gates"))]


def checked(model: type[Table], data: Any, path: Path) -> Table:
    """Validate a table. Raises SceneError, one sentence about the first thing that is wrong."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{path}: {_sentence(error)}") from error


def _sentence(error: ValidationError) -> str:
    first = first_fault(error)
    where, kind, value = _field(first["loc"]), first["type"], _short(first["input"])
    if kind == "extra_forbidden":
        return f"{where} is not a key that is known there: check its spelling and the documented format"
    if kind == "missing":
        return f"{where} is missing: it must be given"
    if kind in {"union_tag_not_found", "union_tag_invalid"}:
        kinds = MATERIALS if first["loc"][-1] == "material" else KINDS
        tag = first["input"].get("type") if isinstance(first["input"], dict) else None
        return f"{where}.type is {_short(tag)}: it must be one of {', '.join(sorted(kinds))}"
    if kind == "whole":
        return f"{where} {first['msg']}"
    if kind in {"allowed", "model_type", "model_attributes_type"}:
        return f"{where} is {value}: it must be {first['msg'] if kind == 'allowed' else 'a table of keys and values'}"
    return f"{where} is {value}: {first['msg'][:1].lower()}{first['msg'][1:]}".replace("input should be", "it must be")


def _field(location: tuple[int | str, ...]) -> str:
    text = ""
    for place, part in enumerate(location):
        if isinstance(part, int):
            text += f"[{part}]"
        elif not _is_tag(location, place):
            text += f".{part}" if text else part
    return text or "the file"


def _is_tag(location: tuple[int | str, ...], place: int) -> bool:
    """Whether this part of the location is a `type`, which tells the tables apart but is no key on the way."""
    if location[0] != "objects":
        return False
    return (place == 2 and location[place] in KINDS) or (location[place - 1] == "material" and place == 4)


def _short(value: Any) -> str:
    return "missing" if value is None else shown(value)
