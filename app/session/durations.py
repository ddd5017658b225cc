"""Lengths of time in words. Imported by every command, so nothing heavy here."""

from __future__ import annotations

import math


def time_text(seconds: float) -> str:
    """Hours and minutes, or minutes and seconds, rounded up."""
    whole = math.ceil(seconds)
    if whole >= 3600:
        minutes = math.ceil(seconds / 60)
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60} s"
