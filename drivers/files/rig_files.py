"""Reads and writes rig files (TOML). The format is documented in resources/rigs/FORMAT.md."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from importlib.resources import files
from itertools import pairwise
from os.path import exists
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from slopegate.core.gating.gate import exact_upright_line_time
from slopegate.core.rig.calibration import NUMBERS, Calibration, told_number
from slopegate.core.rig.checks import LONGEST_SENTENCE, InputError, UserError, plain_name
from slopegate.core.rig.pinhole import require_pinhole
from slopegate.core.rig.rig import (
    DISTORTION_LENGTHS,
    IDENTITY,
    MAX_BLUR_PX,
    Lens,
    Matrix3,
    Rig,
    RigCamera,
    RigProjector,
    Vector3,
    matrix3,
)
from slopegate.core.rig.settings import LineTimes, PixelClocks, ShutterLimits, Steps
from slopegate.core.rig.uncertainty import numbers_of
from slopegate.core.rig.variants import in_scan_order
from slopegate.drivers.files.errors import first_fault, told_fault
from slopegate.drivers.files.picture_checks import check_pixels
from slopegate.drivers.files.reading import read_plain, toml_tables

MAX_FILE_BYTES = 1_000_000
MAX_LADDER = 10_000
MAX_PIXELS_A_SIDE = 20_000

DEFAULT_RIG = "check"
"""The key of the rig that the shipped scenes are made for."""
_SHIPPED = Path(str(files("slopegate.resources") / "rigs"))

Positive = Annotated[float, Field(gt=0)]
Side = Annotated[int, Field(ge=1, le=MAX_PIXELS_A_SIDE)]
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]


class RigError(UserError):
    """A rig file cannot be used; the message is one sentence that names the file."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class _Span(_Part):
    min: float
    max: float
    step: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.max < self.min:
            raise InputError(f"max must be at least min ({self.min:g})")
        return self

    def steps(self) -> Steps:
        return Steps(self.min, self.max, self.step)


class _PositiveSpan(_Span):
    min: Positive


class _Clocks(_PositiveSpan):
    @model_validator(mode="before")
    @classmethod
    def _one_clock(cls, value: Any) -> Any:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return {"min": value, "max": value, "step": 1.0}
        return value

    def clocks(self) -> list[float]:
        steps = (self.max - self.min) / self.step + 1e-9
        if steps >= MAX_LADDER:
            raise InputError(f"shutter.ladder_mhz has a range of {steps:.6g} clocks: at most {MAX_LADDER} are allowed")
        return [self.min + k * self.step for k in range(int(steps) + 1)]


class _Lens(_Part):
    width: Side
    height: Side
    fx: Positive
    fy: Positive
    cx: float
    cy: float
    distortion: list[float] = []
    rows: Literal["down", "up"] = "down"
    blur_px: Annotated[float, Field(ge=0, le=MAX_BLUR_PX)] = 0.0

    @field_validator("distortion")
    @classmethod
    def _opencv_lengths(cls, value: list[float]) -> list[float]:
        if len(value) not in DISTORTION_LENGTHS:
            raise InputError("it must be 0, 4, 5, 8, 12 or 14 numbers in OpenCV's order")
        return value

    def lens(self, table: str) -> Lens:
        """The lens; `table` is what the file calls it in errors."""
        check_pixels(table, self.width, self.height, InputError)
        names = (f"{table}.fx", f"{table}.fy", f"{table}.cx", f"{table}.cy")
        require_pinhole((self.width, self.height), (self.fx, self.fy), (self.cx, self.cy), names)
        return Lens(self.width, self.height, self.fx, self.fy, self.cx, self.cy, tuple(self.distortion))


class _Projector(_Lens):
    period_us: Positive
    active_fraction: Annotated[float, Field(gt=0, le=1)] = 0.92


class _Shutter(_Part):
    clocks_per_line: Positive | None = None
    b1_clock_mhz: Positive | None = None
    line_time_us: _PositiveSpan | None = None
    ladder_mhz: Annotated[list[_Clocks], Field(min_length=1)] | None = None
    delay_us: _Span
    exposure_us: _PositiveSpan
    delay_offset_us: float = 0.0

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        ways = (self.clocks_per_line, self.b1_clock_mhz, self.line_time_us)
        if sum(way is not None for way in ways) != 1:
            raise InputError("it must have exactly one of clocks_per_line, b1_clock_mhz and line_time_us")
        if (self.line_time_us is None) != (self.ladder_mhz is not None):
            raise InputError("ladder_mhz belongs to clocks_per_line or b1_clock_mhz, and must stand beside them")
        return self

    def line(self, camera: Lens, projector: RigProjector) -> PixelClocks | LineTimes:
        if self.line_time_us is not None:
            return LineTimes(self.line_time_us.min, self.line_time_us.max, self.line_time_us.step)
        ladder = tuple(clock for span in self.ladder_mhz or [] for clock in span.clocks())
        for clock, following in pairwise(ladder):
            if following <= clock:
                raise InputError(f"shutter.ladder_mhz goes from {clock:g} to {following:g} MHz: it must rise")
        if self.clocks_per_line is not None:
            return PixelClocks(self.clocks_per_line, ladder)
        return PixelClocks((self.b1_clock_mhz or 0.0) * exact_upright_line_time(camera, projector), ladder)


class _Pose(_Part):
    baseline_m: Positive | None = None
    offset_m: Triple | None = None
    rotation_deg: Triple | None = None
    rotation: Annotated[list[Triple], Field(min_length=3, max_length=3)] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.baseline_m is None) == (self.offset_m is None):
            raise InputError("it must have exactly one of baseline_m and offset_m")
        turned = [name for name in ("rotation_deg", "rotation") if getattr(self, name) is not None]
        if len(turned) > 1 or (turned and self.baseline_m is not None):
            raise InputError("rotation_deg or rotation, not both, belongs to offset_m")
        return self

    def offset(self) -> Vector3:
        if self.offset_m is None:
            return (0.0, -(self.baseline_m or 0.0), 0.0)
        x, y, z = self.offset_m
        return (x, y, z)

    def matrix(self) -> Matrix3:
        if self.rotation_deg is not None:
            import cv2  # large, and few rigs need it

            return matrix3(cv2.Rodrigues(np.radians(self.rotation_deg))[0].tolist())
        return matrix3(self.rotation) if self.rotation is not None else IDENTITY


Fact = Annotated[str, AfterValidator(lambda text: plain_name(text, LONGEST_SENTENCE))]


class _Calibration(_Part):
    names: Annotated[list[str], Field(min_length=1, max_length=len(NUMBERS))]
    covariance: Annotated[list[list[float]], Field(max_length=len(NUMBERS))]
    facts: dict[Annotated[str, AfterValidator(plain_name)], Fact] = {}

    def calibration(self, line: PixelClocks | LineTimes) -> Calibration:
        if "clocks_per_line" in self.names and isinstance(line, LineTimes):
            raise InputError("calibration.names has clocks_per_line, which a camera with line_time_us does not have")
        rows = tuple(map(tuple, self.covariance))
        return Calibration(tuple(self.names), rows, tuple(self.facts.items()))


class _RigFile(_Part):
    name: Annotated[str, AfterValidator(plain_name)] = ""
    camera: _Lens
    projector: _Projector
    shutter: _Shutter
    pose: _Pose
    calibration: _Calibration | None = None


@dataclass(frozen=True)
class RigEntry:
    """A rig that comes with the program."""

    key: str
    rig: Rig


def shipped_rigs() -> list[RigEntry]:
    """The rigs in resources/rigs, the default one first."""
    paths = sorted(_SHIPPED.glob("*.toml"), key=lambda path: (path.stem != DEFAULT_RIG, path.stem))
    return [RigEntry(path.stem, load_rig(path)) for path in paths]


def load_rig(where: str | Path | None) -> Rig:
    """Read a rig file, or the shipped rig of this key where there is no such file; None gives the default rig.

    Raises RigError with one sentence that names the file and the field.
    """
    if where is None:
        return load_rig(_SHIPPED / f"{DEFAULT_RIG}.toml")
    path = Path(where)
    shipped = _SHIPPED / f"{path}.toml"
    if not exists(path) and path.name == str(path) and not path.suffix:
        if not exists(shipped):
            keys = ", ".join(sorted(file.stem for file in _SHIPPED.glob("*.toml")))
            raise RigError(f"{path} is no rig file and none of the shipped rigs ({keys})")
        path = shipped
    return _parse(read_plain(path, MAX_FILE_BYTES, RigError), str(path))


def parse_rig(text: str, source: str) -> Rig:
    """The rig that a TOML text describes; `source` names it in errors (RigError)."""
    return _parse(text.encode(), source)


def _parse(data: bytes, source: str) -> Rig:
    tables = toml_tables(data, source, RigError)
    try:
        return _rig(_RigFile.model_validate(tables))
    except ValidationError as error:
        raise RigError(f"{source}: {_sentence(error)}") from None
    except InputError as error:
        # the file's own name for it
        raise RigError(f"{source}: {str(error).replace('projector_offset_m', 'pose.offset_m')}") from None


def _rig(parsed: _RigFile) -> Rig:
    camera = parsed.camera.lens("camera")
    given = parsed.projector
    projector = RigProjector(given.lens("projector"), given.period_us, given.active_fraction, given.blur_px)
    shutter = parsed.shutter
    line, delay, exposure = shutter.line(camera, projector), shutter.delay_us.steps(), shutter.exposure_us.steps()
    limits = ShutterLimits(line, delay, exposure, shutter.delay_offset_us)
    seen_by = RigCamera(camera, limits, parsed.camera.blur_px)
    known = None if parsed.calibration is None else parsed.calibration.calibration(line)
    rig = Rig(seen_by, projector, parsed.pose.offset(), parsed.pose.matrix(), parsed.name, known)
    return in_scan_order(rig, parsed.camera.rows == "up", parsed.projector.rows == "up")


def _sentence(error: ValidationError) -> str:
    """What is wrong, and which keys there are in place of one that is not known."""
    fault = first_fault(error)
    allowed = f" ({_allowed(fault['loc'])})" if fault["type"] == "extra_forbidden" else ""
    return told_fault(error) + allowed


def _allowed(loc: tuple[int | str, ...]) -> str:
    sections: dict[str, type[_Part]] = {
        "camera": _Lens,
        "projector": _Projector,
        "shutter": _Shutter,
        "pose": _Pose,
        "calibration": _Calibration,
    }
    model: type[_Part] = _RigFile if len(loc) == 1 else sections[str(loc[0])] if len(loc) == 2 else _Span
    return "allowed here: " + ", ".join(model.model_fields)


def calibrated_rig_file(rig: Rig, path: Path) -> bytes:
    """The rig as the file at `path`, by which it is named: a calibrated rig is another than the one it was made of."""
    return rig_to_toml(replace(rig, name=path.stem)).encode()


def rig_to_toml(rig: Rig) -> str:
    """The rig as the text of a rig file; reading it back gives the same rig, its name and facts as `plain_name`."""
    limits = rig.camera.shutter
    lines = [
        f"name = {_quoted(plain_name(rig.name))}",
        "",
        "[camera]",
        *_lens_lines(rig.camera.lens),
    ]
    lines += _blur_line(rig.camera.blur_px)
    lines += ["", "[projector]", *_lens_lines(rig.projector.lens)]
    lines += [f"period_us = {rig.projector.period_us!r}", f"active_fraction = {rig.projector.active_fraction!r}"]
    lines += _blur_line(rig.projector.blur_px)
    lines += ["", "[shutter]"]
    if isinstance(limits.line, PixelClocks):
        lines += [f"clocks_per_line = {limits.line.clocks_per_line!r}", f"ladder_mhz = {list(limits.line.ladder_mhz)}"]
    else:
        lines.append(f"line_time_us = {_span(limits.line.min_us, limits.line.max_us, limits.line.step_us)}")
    for name, steps in (("delay_us", limits.delay_us), ("exposure_us", limits.exposure_us)):
        lines.append(f"{name} = {_span(steps.min, steps.max, steps.step)}")
    lines.append(f"delay_offset_us = {limits.delay_offset_us!r}")
    lines += ["", "[pose]", f"offset_m = {[float(v) for v in rig.projector_offset_m]}"]
    if rig.projector_rotation != IDENTITY:
        lines.append(f"rotation = {[list(row) for row in rig.projector_rotation]}")
    if rig.calibration is not None:
        lines += ["", "[calibration]", *_calibration_lines(rig, rig.calibration)]
    return "\n".join(lines) + "\n"


def _calibration_lines(rig: Rig, known: Calibration) -> list[str]:
    """Each number with its standard error as a remark, for people: what counts is the covariance."""
    values, errors = dict(zip(NUMBERS, numbers_of(rig).tolist(), strict=True)), known.standard_errors
    lines = ["names = ["]
    for name in known.names:
        lines.append(f'    "{name}",  # {told_number(name, values[name], errors[name])}')
    lines += ["]", "covariance = ["]
    lines += [f"    {list(map(float, row))}," for row in known.covariance]
    lines.append("]")
    if known.facts:
        lines += ["", "[calibration.facts]"]
    facts = {plain_name(key): plain_name(fact, LONGEST_SENTENCE) for key, fact in known.facts}
    return lines + [f"{_quoted(key)} = {_quoted(fact)}" for key, fact in facts.items()]


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _lens_lines(lens: Lens) -> list[str]:
    numbers = [f"{key} = {getattr(lens, key)!r}" for key in ("width", "height", "fx", "fy", "cx", "cy")]
    return [*numbers, f"distortion = {list(lens.distortion)}"]


def _blur_line(blur_px: float) -> list[str]:
    return [f"blur_px = {blur_px!r}"] if blur_px else []


def _span(low: float, high: float, step: float) -> str:
    return f"{{ min = {low!r}, max = {high!r}, step = {step!r} }}"
