"""What is told to the user in one sentence, and the checks of single values."""

from __future__ import annotations

import math


class UserError(Exception):
    """What the user can mend, told in one sentence. Every other exception is a bug of the program: it is logged."""


class InputError(UserError, ValueError):
    """A value that is not allowed: the sentence names the field, the value and what is allowed.

    For values that come from outside. Parts of the program that hand each other arrays which do not fit raise a plain
    ValueError or RuntimeError: those are bugs.
    """


def shown(value: object) -> str:
    """The value as a sentence quotes it: at most 60 characters."""
    try:
        text = repr(value)
    except RecursionError:
        return "nested too deeply"
    return text if len(text) <= 60 else text[:57] + "..."


def require(ok: bool, field: str, value: object, allowed: str) -> None:
    """Raise InputError with one sentence unless `ok`."""
    if not ok:
        raise InputError(f"{field} is {value!r}: it must be {allowed}")


def require_finite(field: str, value: float) -> None:
    """Raise InputError unless the value is a finite number."""
    require(math.isfinite(value), field, value, "a finite number")


def require_positive(field: str, value: float) -> None:
    """Raise InputError unless the value is a finite number above zero."""
    require(math.isfinite(value) and value > 0, field, value, "a finite number above 0")


def require_rectangle(field: str, region: tuple[int, int, int, int], width: int, height: int) -> None:
    """Raise InputError unless x0, y0, x1, y1 in pixels, without x1 and y1 themselves, lie inside the image."""
    x0, y0, x1, y1 = region
    allowed = f"x0, y0, x1, y1 with x0 < x1 and y0 < y1, inside the image of {width} x {height} pixels"
    require(0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height, field, tuple(region), allowed)
