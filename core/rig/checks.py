"""Refusals that name the field, the value and what is allowed."""

from __future__ import annotations

import math


def shown(value: object) -> str:
    """The value as a sentence quotes it: at most 60 characters."""
    try:
        text = repr(value)
    except RecursionError:
        return "nested too deeply"
    return text if len(text) <= 60 else text[:57] + "..."


def require(ok: bool, field: str, value: object, allowed: str) -> None:
    """Raise ValueError with one sentence unless `ok`."""
    if not ok:
        raise ValueError(f"{field} is {value!r}: it must be {allowed}")


def require_finite(field: str, value: float) -> None:
    """Raise ValueError unless the value is a finite number."""
    require(math.isfinite(value), field, value, "a finite number")


def require_positive(field: str, value: float) -> None:
    """Raise ValueError unless the value is a finite number above zero."""
    require(math.isfinite(value) and value > 0, field, value, "a finite number above 0")
