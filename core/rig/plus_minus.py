"""How a value is written with its standard error."""

from __future__ import annotations

import math


def plus_minus(value: float, error: float, sign: str = "+-") -> str:
    """A value and its standard error, both to the decimals that two figures of the error have."""
    if not error > 0 or not math.isfinite(error):
        return f"{value:.6g} {sign} {error:.2g}"
    decimals = max(0, 1 - math.floor(math.log10(error)))
    if decimals > 12:
        return f"{value:.6g} {sign} {error:.2g}"
    return f"{value:.{decimals}f} {sign} {error:.{decimals}f}"
