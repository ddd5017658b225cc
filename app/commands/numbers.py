"""Numbers as options take them: read, finite, and within what the gate is exact for."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError
from collections.abc import Callable

MIN_METRES, MAX_METRES = 1e-6, 1e6
MAX_SAMPLES = 64


def is_number(text: str) -> bool:
    """Whether Python reads this text as a number, NaN and infinity included."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def number(low: float, high: float, allowed: str, above: bool = False) -> Callable[[str], float]:
    """A finite number from `low` to `high`, above `low` where so told."""

    def parse(text: str) -> float:
        if not is_number(text):
            raise ArgumentTypeError(f"{text!r} is not a number")
        value = float(text)
        if not math.isfinite(value) or not low <= value <= high or (above and value == low):
            raise ArgumentTypeError(f"{text} must be {allowed}")
        return value

    return parse


def whole(low: int, high: int) -> Callable[[str], int]:
    """A whole number from `low` to `high`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise ArgumentTypeError(f"{text!r} is not a whole number") from None
        if not low <= value <= high:
            raise ArgumentTypeError(f"{text} must be a whole number from {low} to {high}")
        return value

    return parse


def positive(high: float) -> Callable[[str], float]:
    """A number above 0, at most `high`."""
    return number(0.0, high, f"a number above 0, at most {high:.0f}", above=True)


def plane(text: str) -> tuple[float, float, float, float]:
    """Four coefficients with commas between them."""
    parts = text.split(",")
    if len(parts) != 4 or not all(is_number(part) and math.isfinite(float(part)) for part in parts):
        raise ArgumentTypeError(f"{text!r} must be four finite numbers with commas between them")
    a, b, c, d = map(float, parts)
    return a, b, c, d


def metres() -> Callable[[str], float]:
    """A distance that a bench can have."""
    return number(MIN_METRES, MAX_METRES, f"a number from {MIN_METRES:g} to {MAX_METRES:.0f}")
