"""Types for the values of a scene file: numbers with units, points, colours, texts, and the base of its tables."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict
from pydantic_core import PydanticCustomError

MAX_METRES = 10_000.0
MIN_METRES = 1e-3
"""Nothing nearer than this to the rig, and nothing beyond MAX_METRES, can be meant."""

Triple = tuple[float, float, float]


class Part(BaseModel):
    """A table of a scene file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def refuse(allowed: str) -> PydanticCustomError:
    """The error for a value that is not what is allowed."""
    return PydanticCustomError("allowed", "{allowed}", {"allowed": allowed})


def _number(value: Any, low: float, high: float, allowed: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise refuse(allowed)
    return float(value)


def numeric(low: float, high: float, allowed: str) -> BeforeValidator:
    """A number from low to high; `allowed` says so in words."""
    return BeforeValidator(lambda value: _number(value, low, high, allowed))


def listed(value: Any, what: str) -> tuple[Any, ...]:
    """A list with at least one entry, as a tuple."""
    if not isinstance(value, list) or not value:
        raise refuse(f"a list of {what} with at least one entry")
    return tuple(value)


def _triple(low: float, high: float, allowed: str) -> BeforeValidator:
    def check(value: Any) -> Triple:
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise refuse(allowed)
        x, y, z = (_number(item, low, high, allowed) for item in value)
        return x, y, z

    return BeforeValidator(check)


def _colour(value: Any) -> Triple:
    allowed = "a number or three numbers (red, green, blue) in 0..1, linear"
    items = [value] * 3 if isinstance(value, int | float) else value
    if not isinstance(items, list | tuple) or len(items) != 3:
        raise refuse(allowed)
    red, green, blue = (_number(item, 0.0, 1.0, allowed) for item in items)
    return red, green, blue


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise refuse("a text that is not empty")
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise refuse("true or false")
    return value


SMALLEST = math.ulp(0.0)
Metres = Annotated[float, numeric(1e-6, MAX_METRES, "a length in metres from 0.000001 to 10000")]
Number = Annotated[float, numeric(-1e9, 1e9, "a finite number")]
Positive = Annotated[float, numeric(SMALLEST, 1e9, "a finite number above 0")]
NotNegative = Annotated[float, numeric(0.0, 1e9, "a finite number of at least 0")]
Degrees = Annotated[float, numeric(-360.0, 360.0, "an angle from -360 to 360 degrees")]
Point = Annotated[Triple, _triple(-MAX_METRES, MAX_METRES, "three lengths [x, y, z] in metres, each within +-10000")]
Corner = Annotated[Triple, _triple(-math.inf, math.inf, "three lengths [x, y, z] in metres, which may be inf or -inf")]
Size = Annotated[Triple, _triple(1e-6, MAX_METRES, "three lengths [x, y, z] in metres, each above 0 and up to 10000")]
Colour = Annotated[Triple, BeforeValidator(_colour)]
Flag = Annotated[bool, BeforeValidator(_flag)]
Text = Annotated[str, BeforeValidator(_text)]
